//! Pictures as files, made beside the device that rendered them: encoding a large one takes as much
//! memory as the picture itself, which is the job's to answer for, and the server only hands the
//! files on.

use super::wire::{Message, PictureParts};
use crate::api::jobs::PictureFormat;
use hemilux_engine::image::{Exposure, ImageError, Picture, Units};

/// A message with the picture's files, whose headers say what its numbers are where they can.
///
/// # Errors
/// Where the picture has no pixels or too many for a format.
pub fn message<H>(
    picture: &Picture,
    (formats, units): (&[PictureFormat], Units),
    header: impl FnOnce(PictureParts) -> H,
) -> Result<Message<H>, ImageError> {
    let mut formats = formats.to_vec();
    formats.sort_unstable();
    formats.dedup();
    let mut parts = Vec::new();
    for format in &formats {
        let file = match format {
            PictureFormat::Png => picture.to_png(Exposure::Auto)?,
            PictureFormat::Exr => picture.to_exr_in(units)?,
        };
        parts.push(file.into());
    }
    let files = PictureParts { width: picture.width, height: picture.height, formats };
    Ok(Message { header: header(files), parts })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::Content;
    use hemilux_engine::radiometry::Rgb;

    #[test]
    fn a_format_comes_once_and_exr_holds_every_bit() {
        let rgb = Rgb::new(f32::MIN_POSITIVE, -0.0, 17.25);
        let picture = Picture::new(2, 1, vec![rgb, rgb * 3.0]);
        let (png, exr) = (PictureFormat::Png, PictureFormat::Exr);
        let Message { header: files, parts } =
            message(&picture, (&[exr, png, exr], Units::Photometric), |files| files).unwrap();
        assert_eq!(files, PictureParts { width: 2, height: 1, formats: vec![png, exr] });
        let bytes: Vec<_> =
            parts.into_iter().map(Content::into_bytes).map(Result::unwrap).collect();
        assert!(bytes[0].starts_with(b"\x89PNG") && bytes.len() == 2);
        assert_eq!(Picture::from_exr(&bytes[1]).unwrap(), picture);
        let empty = Picture::new(0, 0, Vec::new());
        assert!(message(&empty, (&[png], Units::Photometric), |files| files).is_err());
    }
}
