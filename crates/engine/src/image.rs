//! Pictures in linear float radiance, and their files: PNG (exposure, sRGB) and EXR (32-bit
//! float, linear, untouched).

mod exr_file;

use crate::radiometry::Rgb;
pub use exr_file::{UNIT_ATTRIBUTE, Units};
use serde::{Deserialize, Serialize};
use std::io::Cursor;

/// What is darker than the mean by this factor is black, whatever the exposure, and says nothing
/// about it: 17 stops, more than a camera tells apart.
const BLACK: f64 = 1e-5;

/// A picture of linear RGB radiance, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width in pixels, ≥ 1, but for the default picture, which has none.
    pub width: u32,
    /// Height in pixels, ≥ 1.
    pub height: u32,
    /// `width × height` radiances in the unit that the scene's emission came in; where there is an
    /// [`alpha`](Picture::alpha), means over the whole pixel, that is, premultiplied by it.
    pub pixels: Vec<Rgb>,
    /// Share of each pixel that surfaces cover, in [0, 1]; `None` where the picture has no
    /// transparent background.
    pub alpha: Option<Vec<f32>>,
}

/// How radiance becomes display values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Exposure {
    /// Brings the picture's log-average radiance to mid grey, without what is black beside the
    /// mean; the same picture always gets the same exposure.
    Auto,
    /// Multiplies radiance by 2^stops.
    Stops(f32),
}

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The encoder refused.
    #[error("picture encoding failed: {0}")]
    Encoding(#[from] image::ImageError),
    /// The encoder of EXR files refused.
    #[error("EXR encoding failed: {0}")]
    Exr(#[from] exr::error::Error),
    /// The file name has no ending that names a format.
    #[error("output {0:?} must end in .png or .exr")]
    UnknownFormat(String),
    /// The file could not be written.
    #[error("cannot write {path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Picture {
    /// A picture without alpha, of `width × height` radiances.
    pub fn new(width: u32, height: u32, pixels: Vec<Rgb>) -> Self {
        Self { width, height, pixels, alpha: None }
    }

    /// A black picture.
    pub fn black(width: u32, height: u32) -> Self {
        Self::new(width, height, vec![Rgb::ZERO; width as usize * height as usize])
    }

    /// Mean radiance over pixels and channels.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.pixels.iter().map(|p| f64::from(p.x + p.y + p.z)).sum();
        sum / (3.0 * self.pixels.len().max(1) as f64)
    }

    /// The factor that [`Picture::to_png`] multiplies radiance by.
    pub fn exposure_factor(&self, exposure: Exposure) -> f32 {
        match exposure {
            Exposure::Stops(stops) => stops.exp2(),
            Exposure::Auto => {
                let luminances = self.pixels.iter().filter_map(|pixel| {
                    let y = f64::from(pixel.dot(crate::radiometry::IMPORTANCE_WEIGHTS));
                    (y > 0.0 && y.is_finite()).then_some(y)
                });
                let mean = luminances.clone().sum::<f64>() / luminances.clone().count() as f64;
                let (mut sum, mut count) = (0.0f64, 0usize);
                for y in luminances.filter(|y| *y >= BLACK * mean) {
                    sum += y.ln();
                    count += 1;
                }
                if count == 0 { 1.0 } else { (0.18 / (sum / count as f64).exp()) as f32 }
            }
        }
    }

    /// 8-bit sRGB PNG; where there is an alpha, with that and with colours that it is yet to be
    /// multiplied into, as PNG has it.
    pub fn to_png(&self, exposure: Exposure) -> Result<Vec<u8>, ImageError> {
        let factor = self.exposure_factor(exposure);
        let code = |pixel: Rgb| (pixel * factor).to_array().map(linear_to_srgb);
        let (bytes, kind) = match &self.alpha {
            None => {
                let bytes: Vec<u8> = self.pixels.iter().flat_map(|pixel| code(*pixel)).collect();
                (bytes, image::ExtendedColorType::Rgb8)
            }
            Some(alpha) => {
                let straight = |(pixel, alpha): (&Rgb, &f32)| {
                    // What shines through no surface would have no colour.
                    let [r, g, b] = code(if *alpha > 0.0 { *pixel / *alpha } else { Rgb::ZERO });
                    [r, g, b, (255.0 * alpha.clamp(0.0, 1.0)).round() as u8]
                };
                let bytes = self.pixels.iter().zip(alpha).flat_map(straight).collect();
                (bytes, image::ExtendedColorType::Rgba8)
            }
        };
        let mut out = Cursor::new(Vec::new());
        let format = image::ImageFormat::Png;
        image::write_buffer_with_format(&mut out, &bytes, self.width, self.height, kind, format)?;
        Ok(out.into_inner())
    }

    /// 32-bit float linear EXR, radiance untouched, premultiplied where there is an alpha.
    pub fn to_exr(&self) -> Result<Vec<u8>, ImageError> {
        self.encode_exr(None)
    }

    /// The same with a header that says what the numbers are.
    pub fn to_exr_in(&self, units: Units) -> Result<Vec<u8>, ImageError> {
        self.encode_exr(Some(units))
    }

    fn encode_exr(&self, units: Option<Units>) -> Result<Vec<u8>, ImageError> {
        let size = [self.width, self.height];
        Ok(exr_file::encode(size, &self.pixels, self.alpha.as_deref(), units)?)
    }

    /// Reads an EXR as linear radiance, with its alpha if it has any.
    pub fn from_exr(bytes: &[u8]) -> Result<Self, ImageError> {
        let ([width, height], pixels, alpha) = exr_file::decode(bytes)?;
        Ok(Self { width, height, pixels, alpha })
    }

    /// Writes `.png` or `.exr` by the file's ending.
    pub fn write(
        &self,
        path: &std::path::Path,
        exposure: Exposure,
        units: Units,
    ) -> Result<(), ImageError> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let bytes = match ending.as_deref() {
            Some("png") => self.to_png(exposure)?,
            Some("exr") => self.to_exr_in(units)?,
            _ => return Err(ImageError::UnknownFormat(path.display().to_string())),
        };
        std::fs::write(path, bytes)
            .map_err(|source| ImageError::Io { path: path.display().to_string(), source })
    }
}

/// Linear to sRGB code value, IEC 61966-2-1, rounded; out-of-range values clip.
pub fn linear_to_srgb(x: f32) -> u8 {
    let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Texture;

    fn ramp() -> Picture {
        let pixels = (0..12).map(|i| Rgb::new(i as f32 * 3.7, 1e-5 * i as f32, 17.0)).collect();
        Picture::new(4, 3, pixels)
    }

    #[test]
    fn png_has_straight_alpha() {
        let grey = Rgb::splat(0.5);
        let alpha = vec![1.0, 0.25, 0.0];
        let pixels = alpha.iter().map(|alpha| grey * *alpha).collect();
        let picture = Picture { alpha: Some(alpha), ..Picture::new(3, 1, pixels) };
        let bytes = picture.to_png(Exposure::Stops(0.0)).unwrap();
        let decoded = image::load_from_memory(&bytes).unwrap();
        assert!(decoded.color().has_alpha());
        let code = linear_to_srgb(0.5);
        let found: Vec<_> = decoded.into_rgba8().pixels().map(|pixel| pixel.0).collect();
        assert_eq!(found, [[code, code, code, 255], [code, code, code, 64], [0; 4]]);
        let opaque = image::load_from_memory(&ramp().to_png(Exposure::Auto).unwrap()).unwrap();
        assert!(!opaque.color().has_alpha());
    }

    /// Light that has crept into what is black by rounding does not make the rest white.
    #[test]
    fn what_is_black_beside_the_mean_has_no_say_in_the_exposure() {
        let of = |pixels: &[f32]| {
            let pixels = pixels.iter().map(|y| Rgb::splat(*y)).collect::<Vec<_>>();
            Picture::new(pixels.len() as u32, 1, pixels).exposure_factor(Exposure::Auto)
        };
        let lit = of(&[0.5, 0.5, 0.0, 0.0]);
        assert!((lit / 0.36 - 1.0).abs() < 1e-4, "{lit}");
        assert_eq!(of(&[0.5, 0.5, 1e-13, 1e-13]), lit);
        // A deep shadow counts: it is ten stops darker.
        let shadow = of(&[0.5, 0.5, 5e-4, 5e-4]);
        assert!((shadow / lit / 1000f32.sqrt() - 1.0).abs() < 1e-3, "{shadow}");
        assert_eq!(of(&[0.0, 0.0]), 1.0);
    }

    #[test]
    fn png_is_srgb() {
        let bytes = ramp().to_png(Exposure::Stops(-4.0)).unwrap();
        let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(decoded.dimensions(), (4, 3));
        assert_eq!(decoded.get_pixel(2, 0).0[0], linear_to_srgb(7.4 / 16.0));
        assert_eq!(decoded.get_pixel(0, 0).0[2], 255);
    }

    #[test]
    fn srgb_round_trip() {
        let codes: Vec<[u8; 4]> = (0..=255u8).map(|c| [c; 4]).collect();
        let texture = Texture { width: 256, height: 1, texels: codes };
        for (code, texel) in texture.texels.iter().enumerate() {
            let linear = crate::scene::srgb_to_linear(texel[0]);
            assert_eq!(linear_to_srgb(linear) as usize, code);
        }
    }
}
