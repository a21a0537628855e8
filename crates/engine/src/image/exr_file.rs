//! Pictures as OpenEXR files, and what their headers say of the numbers.

use crate::radiometry::Rgb;
use exr::prelude::{
    AttributeValue, Image, Layer, LayerAttributes, SpecificChannels, Text, Vec2, WritableImage,
};
use serde::{Deserialize, Serialize};
use std::io::Cursor;

/// Attribute of the header with the unit of the pixels as text; OpenEXR has none of its own.
pub const UNIT_ATTRIBUTE: &str = "hemiluxUnit";

/// What the numbers of a scene, and so of its picture, are. Nothing is converted: light goes through
/// a scene the same way in either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// As glTF has it: candela, lux, and cd/m² (nits) of every channel.
    #[default]
    Photometric,
    /// W/sr, W/m², and W/(m² sr) of every channel.
    Radiometric,
}

impl Units {
    /// The unit of a picture's pixels.
    pub fn of_pixels(self) -> &'static str {
        match self {
            Self::Photometric => "cd/m^2",
            Self::Radiometric => "W/(m^2 sr)",
        }
    }

    /// The standard attribute `whiteLuminance`: the luminance of the RGB value (1, 1, 1), nits,
    /// where the pixels say.
    fn white_luminance(self) -> Option<f32> {
        (self == Self::Photometric).then_some(1.0)
    }
}

/// The file of a picture's pixels: 32-bit float channels, alpha premultiplied as OpenEXR has it;
/// `units` goes into the header.
pub fn encode(
    [width, height]: [u32; 2],
    pixels: &[Rgb],
    alpha: Option<&[f32]>,
    units: Option<Units>,
) -> Result<Vec<u8>, exr::error::Error> {
    let size = Vec2(width as usize, height as usize);
    let rgb = |at: Vec2<usize>| <(f32, f32, f32)>::from(pixels[at.y() * size.x() + at.x()]);
    let (attributes, encoding) = (attributes(units), Default::default());
    let mut file = Cursor::new(Vec::new());
    let written = if let Some(alpha) = alpha {
        let rgba = |at: Vec2<usize>| {
            let (r, g, b) = rgb(at);
            (r, g, b, alpha[at.y() * size.x() + at.x()])
        };
        let layer = Layer::new(size, attributes, encoding, SpecificChannels::rgba(rgba));
        let image = Image::from_layer(layer);
        image.write().to_buffered(&mut file)
    } else {
        let layer = Layer::new(size, attributes, encoding, SpecificChannels::rgb(rgb));
        let image = Image::from_layer(layer);
        image.write().to_buffered(&mut file)
    };
    written.map(|()| file.into_inner())
}

/// What the header says of the pixels.
fn attributes(units: Option<Units>) -> LayerAttributes {
    let mut attributes = LayerAttributes::default();
    if let Some(units) = units {
        attributes.white_luminance = units.white_luminance();
        let unit = AttributeValue::Text(Text::from(units.of_pixels()));
        attributes.other.insert(Text::from(UNIT_ATTRIBUTE), unit);
    }
    attributes
}

/// Width and height, pixels, and alpha if there is any.
type Decoded = ([u32; 2], Vec<Rgb>, Option<Vec<f32>>);

/// Reads an EXR file as linear radiance.
pub fn decode(bytes: &[u8]) -> Result<Decoded, image::ImageError> {
    let decoded = image::load_from_memory_with_format(bytes, image::ImageFormat::OpenExr)?;
    let size = [decoded.width(), decoded.height()];
    if !decoded.color().has_alpha() {
        let rgb = decoded.into_rgb32f();
        return Ok((size, rgb.pixels().map(|p| Rgb::from_array(p.0)).collect(), None));
    }
    let of = |pixel: &image::Rgba<f32>| (Rgb::new(pixel[0], pixel[1], pixel[2]), pixel[3]);
    let (pixels, alpha) = decoded.into_rgba32f().pixels().map(of).unzip();
    Ok((size, pixels, Some(alpha)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::MetaData;

    fn pixels() -> Vec<Rgb> {
        (0..12).map(|i| Rgb::new(i as f32 * 3.7, 1e-5 * i as f32, 17.0)).collect()
    }

    #[test]
    fn every_bit_comes_back_with_and_without_alpha() {
        let pixels = pixels();
        for alpha in [None, Some((0..12).map(|i| i as f32 / 11.0).collect::<Vec<_>>())] {
            for units in [None, Some(Units::Photometric), Some(Units::Radiometric)] {
                let file = encode([4, 3], &pixels, alpha.as_deref(), units).unwrap();
                assert_eq!(decode(&file).unwrap(), ([4, 3], pixels.clone(), alpha.clone()));
            }
        }
    }

    #[test]
    fn the_header_says_what_the_numbers_are() {
        let said = |units: Option<Units>| {
            let file = encode([4, 3], &pixels(), None, units).unwrap();
            let meta = MetaData::read_from_buffered(Cursor::new(file), true).unwrap();
            let own = &meta.headers[0].own_attributes;
            let unit = own.other.get(UNIT_ATTRIBUTE.as_bytes()).map(|value| match value {
                AttributeValue::Text(text) => text.to_string(),
                other => panic!("{other:?}"),
            });
            (own.white_luminance, unit)
        };
        assert_eq!(said(Some(Units::Photometric)), (Some(1.0), Some("cd/m^2".into())));
        assert_eq!(said(Some(Units::Radiometric)), (None, Some("W/(m^2 sr)".into())));
        assert_eq!(said(None), (None, None));
    }

    #[test]
    fn pictures_without_pixels_are_refused() {
        assert!(encode([0, 0], &[], None, None).is_err());
    }
}
