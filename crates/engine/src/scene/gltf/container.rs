//! The file's outer shell: GLB chunks, buffers, buffer views, and the URIs that name bytes.

use super::json::{Object, clip, malformed, parse};
use super::{Resources, Warnings};
use crate::scene::SceneError;
use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;
use std::borrow::Cow;

const GLB_MAGIC: &[u8; 4] = b"glTF";
const GLB_HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Splits a GLB into its JSON and its binary chunk, or takes the bytes as a `.gltf`.
pub(super) fn open<'a>(
    bytes: &'a [u8],
    warnings: &mut Warnings,
) -> Result<(Value, Option<&'a [u8]>), SceneError> {
    if bytes.is_empty() {
        return Err(malformed("file", "is empty"));
    }
    if bytes.starts_with(GLB_MAGIC) {
        let (json, binary) = split_glb(bytes, warnings)?;
        return Ok((parse(json)?, binary));
    }
    let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace());
    if first != Some(&b'{') {
        return Err(SceneError::malformed(
            "file",
            "is neither binary glTF (it does not begin with \"glTF\") nor JSON",
            "send a glTF 2.0 file, .glb or .gltf",
        ));
    }
    Ok((parse(bytes)?, None))
}

fn split_glb<'a>(
    bytes: &'a [u8],
    warnings: &mut Warnings,
) -> Result<(&'a [u8], Option<&'a [u8]>), SceneError> {
    let truncated = || malformed("GLB header", "the file ends within its header");
    let version = word(bytes, 4).ok_or_else(truncated)?;
    let declared = word(bytes, 8).ok_or_else(truncated)?;
    if version != 2 {
        return Err(SceneError::malformed(
            "GLB header",
            format!("container version {version}"),
            "export the scene as glTF 2.0",
        ));
    }
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
    let (mut json, mut binary) = (None, None);
    let (mut offset, mut number) = (GLB_HEADER_BYTES, 0);
    while offset < bytes.len() {
        let at = || format!("GLB chunk {number}");
        let (Some(length), Some(kind)) = (word(bytes, offset), bytes.get(offset + 4..offset + 8))
        else {
            return Err(malformed(at(), "the file ends within the chunk's header"));
        };
        let begin = offset + CHUNK_HEADER_BYTES;
        let chunk =
            begin.checked_add(length).and_then(|end| bytes.get(begin..end)).ok_or_else(|| {
                malformed(
                    at(),
                    format!("has {length} bytes by its header, {} are left", bytes.len() - begin),
                )
            })?;
        match (number, kind) {
            (0, b"JSON") => json = Some(chunk),
            (0, _) => return Err(malformed(at(), "the first chunk is not JSON")),
            (1, b"BIN\0") => binary = Some(chunk),
            // The format tells readers to pass over chunks that they do not know.
            _ => {}
        }
        offset = begin + length;
        number += 1;
    }
    let json = json.ok_or_else(|| malformed("GLB chunk 0", "there is no JSON chunk"))?;
    Ok((json, binary))
}

fn word(bytes: &[u8], offset: usize) -> Option<usize> {
    let bytes = bytes.get(offset..offset.checked_add(4)?)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize)
}

/// A range of a buffer.
struct View {
    buffer: usize,
    offset: usize,
    length: usize,
    stride: Option<usize>,
}

/// All buffers and the views into them, checked.
pub(super) struct Buffers<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: Vec<View>,
}

impl<'a> Buffers<'a> {
    /// Resolves every buffer and checks every view.
    pub fn new(
        root: &Object<'_>,
        binary: Option<&'a [u8]>,
        resources: &'a Resources,
    ) -> Result<Self, SceneError> {
        let mut buffers = Vec::new();
        for (index, object) in root.objects("buffers")?.iter().enumerate() {
            buffers.push(buffer(object, index, binary, resources)?);
        }
        let mut views = Vec::new();
        for object in root.objects("bufferViews")? {
            views.push(view(&object, &buffers)?);
        }
        Ok(Self { buffers, views })
    }

    /// Number of buffer views.
    pub fn view_count(&self) -> usize {
        self.views.len()
    }

    /// Bytes of a view and its stride where it has one.
    pub fn view(&self, index: usize) -> Option<(&[u8], Option<usize>)> {
        let view = self.views.get(index)?;
        let bytes = self.buffers.get(view.buffer)?.get(view.offset..view.offset + view.length)?;
        Some((bytes, view.stride))
    }
}

fn buffer<'a>(
    object: &Object<'_>,
    index: usize,
    binary: Option<&'a [u8]>,
    resources: &'a Resources,
) -> Result<Cow<'a, [u8]>, SceneError> {
    let length = object.integer("byteLength")?.ok_or_else(|| object.missing("byteLength"))?;
    let bytes = match object.string("uri")? {
        Some(uri) => resolve(uri, resources, &object.path("uri"))?,
        None if index == 0 => Cow::Borrowed(
            binary.ok_or_else(|| malformed(&object.at, "has no uri, and there is no BIN chunk"))?,
        ),
        None => {
            return Err(malformed(&object.at, "has no uri; only buffer 0 may be the BIN chunk"));
        }
    };
    if length > bytes.len() as u64 {
        return Err(malformed(
            object.path("byteLength"),
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

fn view(object: &Object<'_>, buffers: &[Cow<'_, [u8]>]) -> Result<View, SceneError> {
    let buffer = object
        .index("buffer", buffers.len(), "buffers")?
        .ok_or_else(|| object.missing("buffer"))?;
    let offset = object.integer("byteOffset")?.unwrap_or(0);
    let length = object.integer("byteLength")?.ok_or_else(|| object.missing("byteLength"))?;
    let available = buffers[buffer].len() as u64;
    if offset.checked_add(length).is_none_or(|end| end > available) {
        return Err(malformed(
            &object.at,
            format!(
                "{length} bytes from offset {offset} do not fit buffer {buffer} of {available} bytes"
            ),
        ));
    }
    let stride = match object.integer("byteStride")? {
        None => None,
        Some(stride) if (1..=1024).contains(&stride) => Some(stride as usize),
        Some(stride) => {
            return Err(malformed(object.path("byteStride"), format!("{stride} is not in 4…252")));
        }
    };
    Ok(View { buffer, offset: offset as usize, length: length as usize, stride })
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
