//! Files of skies: OpenEXR and Radiance HDR. They are hostile like every upload.

use super::SceneError;
use super::sky_map::{MAX_SKY_HEIGHT, MAX_SKY_WIDTH, SkyMap, check_size};
use crate::radiometry::Rgb;
use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// What a sender can do about a file that is not a sky.
const FIX: &str = "send an equirectangular map as OpenEXR (.exr) or Radiance (.hdr)";
/// Bytes that a decoder may hold for each texel: four floats, twice, and what it was compressed in.
const DECODER_BYTES_PER_TEXEL: u64 = 64;
/// Decoder memory that every map gets, however small it is.
const DECODER_BASE_BYTES: u64 = 16 << 20;
/// Longest part of a decoder's message that is passed on, characters.
const MESSAGE: usize = 200;

impl SkyMap {
    /// The map in a file: OpenEXR or Radiance HDR, told apart by their first bytes. An alpha channel
    /// is left aside.
    ///
    /// # Errors
    /// [`SceneError`] where the bytes are neither, can't be decoded, are too large, or where a texel
    /// is no radiance.
    pub fn decode(bytes: &[u8]) -> Result<Self, SceneError> {
        let refused = |what: String| SceneError::malformed("sky", what, FIX);
        let format = match image::guess_format(bytes) {
            Ok(format @ (ImageFormat::OpenExr | ImageFormat::Hdr)) => format,
            _ => return Err(refused("is neither OpenEXR nor Radiance HDR".into())),
        };
        let broken = |error: image::ImageError| match error {
            image::ImageError::Limits(_) => SceneError::too_large(
                "sky",
                "takes too much memory to decode",
                format!("send a map of at most {MAX_SKY_WIDTH} × {MAX_SKY_HEIGHT} texels"),
            ),
            error => {
                let message: String = error.to_string().chars().take(MESSAGE).collect();
                refused(format!("cannot be decoded: {message}"))
            }
        };
        // Codecs are foreign code that reads foreign bytes: a panic there costs the upload, not the
        // process.
        let guarded = |work: &dyn Fn() -> Result<Self, SceneError>| {
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(work))
                .unwrap_or_else(|_| Err(refused("cannot be decoded: the decoder gave up".into())))
        };
        guarded(&|| {
            let reader = ImageReader::with_format(Cursor::new(bytes), format);
            let (width, height) = reader.into_dimensions().map_err(broken)?;
            check_size(width, height)?;
            let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
            let mut limits = Limits::default();
            limits.max_image_width = Some(width);
            limits.max_image_height = Some(height);
            let texels = u64::from(width) * u64::from(height);
            limits.max_alloc = Some(texels * DECODER_BYTES_PER_TEXEL + DECODER_BASE_BYTES);
            reader.limits(limits);
            let decoded = reader.decode().map_err(broken)?.into_rgb32f();
            let texels = decoded.pixels().map(|pixel| Rgb::from_array(pixel.0)).collect();
            Self::new(decoded.width(), decoded.height(), texels)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ExtendedColorType::Rgb32F;

    fn file(format: ImageFormat, texels: &[Rgb], [width, height]: [u32; 2]) -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        let bytes: &[u8] = bytemuck::cast_slice(texels);
        image::write_buffer_with_format(&mut out, bytes, width, height, Rgb32F, format).unwrap();
        out.into_inner()
    }

    fn ramp() -> Vec<Rgb> {
        (0..8).map(|i| Rgb::new(i as f32, 0.25, 3e4)).collect()
    }

    #[test]
    fn both_formats_are_read() {
        let exr = SkyMap::decode(&file(ImageFormat::OpenExr, &ramp(), [4, 2])).unwrap();
        assert_eq!((exr.width(), exr.height(), exr.texels()), (4, 2, &ramp()[..]));
        let hdr = SkyMap::decode(&file(ImageFormat::Hdr, &ramp(), [4, 2])).unwrap();
        assert_eq!((hdr.width(), hdr.height()), (4, 2));
        // One exponent for three colours, mantissas of eight bits.
        for (texel, exact) in hdr.texels().iter().zip(ramp()) {
            assert!((*texel - exact).abs().max_element() <= exact.max_element() / 128.0, "{texel}");
        }
    }

    #[test]
    fn texels_that_are_no_radiance_are_named() {
        let mut texels = ramp();
        texels[6].z = f32::NAN;
        let error = SkyMap::decode(&file(ImageFormat::OpenExr, &texels, [4, 2])).unwrap_err();
        assert_eq!(error.at, "sky, column 2, row 1");
        texels[6].z = -1.0;
        assert!(SkyMap::decode(&file(ImageFormat::OpenExr, &texels, [4, 2])).is_err());
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let png = {
            let mut out = Cursor::new(Vec::new());
            image::write_buffer_with_format(
                &mut out,
                &[7; 3],
                1,
                1,
                image::ExtendedColorType::Rgb8,
                ImageFormat::Png,
            )
            .unwrap();
            out.into_inner()
        };
        for bytes in [&b""[..], b"#?RADIANCE", b"v/1\x01", &png] {
            assert!(!SkyMap::decode(bytes).unwrap_err().too_large);
        }
        for format in [ImageFormat::OpenExr, ImageFormat::Hdr] {
            let good = file(format, &ramp(), [4, 2]);
            // Whatever single byte is damaged, it is an answer, not a panic; cut files are refused.
            for at in 0..good.len() {
                let mut bytes = good.clone();
                bytes[at] ^= 0x81;
                let _ = SkyMap::decode(&bytes);
            }
            assert!(SkyMap::decode(&good[..good.len() - 9]).is_err(), "{format:?}");
        }
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n";
        assert!(SkyMap::decode(huge).unwrap_err().too_large);
    }
}
