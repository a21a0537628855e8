//! The file's outer shell: GLB chunks, buffers, buffer views, and the URIs that name bytes.

use super::document::{clip, malformed};
use super::limits::Resources;
use super::warnings::Warnings;
use crate::scene::SceneError;
use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf::binary::{Error, Glb};
use gltf::json::buffer::View;
use gltf::json::{Buffer, Index, Root};
use std::borrow::Cow;

const GLB_MAGIC: &[u8] = b"glTF";
const GLB_HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// The JSON of a file and the binary chunk, where it has one.
type Parts<'a> = (Cow<'a, [u8]>, Option<Cow<'a, [u8]>>);

/// Splits a GLB into its JSON and its binary chunk, or takes the bytes as a `.gltf`.
pub(super) fn open<'a>(bytes: &'a [u8], warnings: &mut Warnings) -> Result<Parts<'a>, SceneError> {
    if bytes.is_empty() {
        return Err(malformed("file", "is empty"));
    }
    if bytes.starts_with(GLB_MAGIC) {
        return split_glb(bytes, warnings);
    }
    let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace());
    if first != Some(&b'{') {
        return Err(SceneError::malformed(
            "file",
            "is neither binary glTF (it does not begin with \"glTF\") nor JSON",
            "send a glTF 2.0 file, .glb or .gltf",
        ));
    }
    Ok((bytes.into(), None))
}

fn split_glb<'a>(bytes: &'a [u8], warnings: &mut Warnings) -> Result<Parts<'a>, SceneError> {
    // The crate subtracts the header from the declared length unchecked, and reads on behind it.
    let declared =
        word(bytes, 8).ok_or_else(|| malformed("GLB header", "the file ends within its header"))?;
    if declared < GLB_HEADER_BYTES || declared > bytes.len() {
        return Err(SceneError::malformed(
            "GLB header",
            format!("says the file has {declared} bytes, but it has {}", bytes.len()),
            "send the whole file",
        ));
    }
    if declared < bytes.len() {
        let extra = bytes.len() - declared;
        warnings.push("GLB header", format!("{extra} bytes after the end of the file are ignored"));
    }
    let bytes = &bytes[..declared];
    let json_begin = GLB_HEADER_BYTES + CHUNK_HEADER_BYTES;
    let json = word(bytes, GLB_HEADER_BYTES)
        .filter(|_| bytes.get(json_begin - 4..json_begin) == Some(b"JSON"))
        .and_then(|length| bytes.get(json_begin..)?.get(..length));
    let chunk = if json.is_some() { "GLB chunk 1" } else { "GLB chunk 0" };
    match (Glb::from_slice(bytes), json) {
        (Ok(glb), _) => Ok((glb.json, glb.bin)),
        // The format tells readers to pass over chunks that they do not know.
        (Err(gltf::Error::Binary(Error::UnknownChunkType(_))), Some(json)) => {
            Ok((json.into(), None))
        }
        (Err(gltf::Error::Binary(Error::Version(version))), _) => Err(SceneError::malformed(
            "GLB header",
            format!("container version {version}"),
            "export the scene as glTF 2.0",
        )),
        (Err(gltf::Error::Binary(error)), _) => Err(malformed(
            chunk,
            match error {
                Error::ChunkLength { length, length_read, .. } => {
                    format!("has {length} bytes by its header, {length_read} are left")
                }
                Error::Io(_) => "the file ends within the chunk's header".into(),
                _ if json.is_none() => "the first chunk is not JSON".into(),
                error => error.to_string(),
            },
        )),
        (Err(error), _) => Err(malformed(chunk, error.to_string())),
    }
}

fn word(bytes: &[u8], offset: usize) -> Option<usize> {
    let bytes = bytes.get(offset..offset.checked_add(4)?)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize)
}

/// All buffers and the views into them, checked.
pub(super) struct Buffers<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: &'a [View],
}

impl<'a> Buffers<'a> {
    /// Resolves every buffer and checks every view.
    pub fn new(
        root: &'a Root,
        binary: Option<Cow<'a, [u8]>>,
        resources: &'a Resources,
    ) -> Result<Self, SceneError> {
        let mut binary = binary;
        let mut buffers = Vec::new();
        for (index, object) in root.buffers.iter().enumerate() {
            // Only the first may be the binary chunk.
            buffers.push(buffer(object, index, binary.take(), resources)?);
        }
        for (index, view) in root.buffer_views.iter().enumerate() {
            let (buffer, length) = (view.buffer.value(), view.byte_length.0);
            let offset = view.byte_offset.unwrap_or_default().0;
            let available = buffers[buffer].len() as u64;
            if offset.checked_add(length).is_none_or(|end| end > available) {
                return Err(malformed(
                    format!("bufferViews[{index}]"),
                    format!(
                        "{length} bytes from offset {offset} do not fit buffer {buffer} of {available} bytes"
                    ),
                ));
            }
        }
        Ok(Self { buffers, views: &root.buffer_views })
    }

    /// Bytes of a view and its stride where it has one.
    pub fn view(&self, index: Index<View>) -> (&[u8], Option<usize>) {
        let view = &self.views[index.value()];
        let offset = view.byte_offset.unwrap_or_default().0 as usize;
        let bytes = &self.buffers[view.buffer.value()][offset..];
        (&bytes[..view.byte_length.0 as usize], view.byte_stride.map(|stride| stride.0))
    }
}

fn buffer<'a>(
    object: &Buffer,
    index: usize,
    binary: Option<Cow<'a, [u8]>>,
    resources: &'a Resources,
) -> Result<Cow<'a, [u8]>, SceneError> {
    let at = format!("buffers[{index}]");
    let length = object.byte_length.0;
    let bytes = match &object.uri {
        Some(uri) => resolve(uri, resources, &format!("{at}.uri"))?,
        None if index == 0 => {
            binary.ok_or_else(|| malformed(at.as_str(), "has no uri, and there is no BIN chunk"))?
        }
        None => return Err(malformed(at, "has no uri; only buffer 0 may be the BIN chunk")),
    };
    if length > bytes.len() as u64 {
        return Err(malformed(
            format!("{at}.byteLength"),
            format!("{length}, but the buffer has {} bytes", bytes.len()),
        ));
    }
    let length = length as usize;
    Ok(match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..length]),
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Cow::Owned(bytes)
        }
    })
}

/// The bytes that a URI names: a base64 `data:` URI, or a file that came with the scene.
pub(super) fn resolve<'a>(
    uri: &str,
    resources: &'a Resources,
    at: &str,
) -> Result<Cow<'a, [u8]>, SceneError> {
    if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return data_uri(&uri[5..], at).map(Cow::Owned);
    }
    let name = relative_name(uri, at)?;
    let found = resources.get(&name).or_else(|| resources.get(uri)).ok_or_else(|| {
        SceneError::malformed(
            at,
            format!("{:?} is not among the files that came with the scene", clip(&name)),
            "send the file along under this name, or pack everything into one .glb",
        )
    })?;
    Ok(Cow::Borrowed(found))
}

fn data_uri(rest: &str, at: &str) -> Result<Vec<u8>, SceneError> {
    let (media, payload) =
        rest.split_once(',').ok_or_else(|| malformed(at, "the data URI has no comma"))?;
    let is_base64 = media.rsplit(';').next().is_some_and(|p| p.eq_ignore_ascii_case("base64"));
    if !is_base64 {
        return Err(malformed(at, "the data URI is not base64"));
    }
    let payload: Cow<'_, [u8]> = percent_encoding::percent_decode_str(payload).into();
    let lenient = GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
    );
    lenient
        .decode(payload.as_ref())
        .map_err(|error| malformed(at, format!("the data URI is not base64: {error}")))
}

/// The normal form of a relative URI: percent-decoded, without `.` segments.
///
/// Nothing that could leave the upload is understood: schemes, absolute paths, `..`,
/// backslashes, control characters.
fn relative_name(uri: &str, at: &str) -> Result<String, SceneError> {
    let refused = |why: &str| {
        SceneError::malformed(
            at,
            format!("{:?} {why}", clip(uri)),
            "name a file that comes with the scene by a plain relative path, or pack everything into one .glb",
        )
    };
    let mut rest = uri.as_bytes();
    while let Some(percent) = rest.iter().position(|byte| *byte == b'%') {
        let digits = rest.get(percent + 1..percent + 3);
        if !digits.is_some_and(|digits| digits.iter().all(u8::is_ascii_hexdigit)) {
            return Err(refused("has broken percent-encoding"));
        }
        rest = &rest[percent + 3..];
    }
    let decoded = percent_encoding::percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| refused("is not UTF-8 once percent-decoded"))?;
    // Checked after decoding, so that an encoded `..` or `/` is no way around.
    if decoded.starts_with('/') {
        return Err(refused("is an absolute path"));
    }
    if decoded.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err(refused("has a scheme; nothing is fetched from elsewhere"));
    }
    if decoded.contains('\\') || decoded.chars().any(char::is_control) {
        return Err(refused("has a backslash or a control character"));
    }
    let mut segments = Vec::new();
    for segment in decoded.split('/') {
        match segment {
            ".." => return Err(refused("leaves the folder of the scene")),
            "" | "." => {}
            _ => segments.push(segment),
        }
    }
    if segments.is_empty() {
        return Err(refused("names no file"));
    }
    Ok(segments.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_inside_the_upload_resolve() {
        let resources = Resources::from([("a b/c.bin".to_owned(), vec![1, 2, 3])]);
        for uri in ["a b/c.bin", "a%20b/c.bin", "./a b/./c.bin", "a%20b%2Fc.bin"] {
            assert_eq!(resolve(uri, &resources, "x").unwrap().as_ref(), [1, 2, 3], "{uri}");
        }
        for uri in [
            "../a b/c.bin",
            "a b/../a b/c.bin",
            "%2e%2e/c.bin",
            "/a b/c.bin",
            "%2fetc/passwd",
            "file:///etc/passwd",
            "FILE:c.bin",
            "http://example.com/c.bin",
            "C:\\c.bin",
            "a b\\c.bin",
            "%ff",
            "%",
            "%4",
            "c.bin%00",
            "",
            ".",
            "c.bin",
            "data:",
            "data:text/plain,abc",
            "data:;base64,%ff",
            "data:;base64,@@@@",
            "d\u{e4}ta:",
        ] {
            assert!(resolve(uri, &resources, "x").is_err(), "{uri}");
        }
    }

    #[test]
    fn data_uris_decode_with_and_without_padding() {
        let none = Resources::new();
        for uri in [
            "data:application/octet-stream;base64,AQI=",
            "data:;base64,AQI",
            "DATA:application/gltf-buffer;BASE64,AQI%3D",
        ] {
            assert_eq!(resolve(uri, &none, "x").unwrap().as_ref(), [1, 2], "{uri}");
        }
    }
}
