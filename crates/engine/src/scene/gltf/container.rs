//! The file's outer shell: GLB chunks, buffers, buffer views, and the URIs that name bytes.

use super::document::{clip, malformed};
use super::limits::{ImportLimits, Resources};
use super::meshopt::{Compressed, is_fallback};
use super::warnings::Warnings;
use crate::scene::SceneError;
use base64::Engine as _;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf::binary::{Error, Glb};
use gltf::json::buffer::View;
use gltf::json::{Buffer, Index, Root};
use std::borrow::Cow;
use std::ops::Range;

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

/// All buffers and the views into them, checked and decompressed.
pub(super) struct Buffers<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: Vec<Place>,
    /// Bytes that may yet be decompressed.
    left: u64,
}

/// Where a view's bytes are.
struct Place {
    buffer: usize,
    bytes: Range<usize>,
    stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// Resolves every buffer, checks every view and decompresses those that need it.
    pub fn new(
        root: &Root,
        binary: Option<Cow<'a, [u8]>>,
        resources: &'a Resources,
        limits: &ImportLimits,
    ) -> Result<Self, SceneError> {
        let views = root.buffer_views.iter().enumerate();
        let compressed = views
            .map(|(index, view)| Compressed::of(view, index))
            .collect::<Result<Vec<_>, _>>()?;
        let placeholders = placeholders(root, &compressed);
        let mut binary = binary;
        let mut buffers = Vec::new();
        for (index, object) in root.buffers.iter().enumerate() {
            // Only the first may be the binary chunk.
            let binary = binary.take();
            let has_bytes = object.uri.is_some() || binary.is_some();
            let is_empty = is_fallback(object) || (placeholders[index] && !has_bytes);
            buffers.push(match is_empty {
                true => Cow::Borrowed(&[][..]),
                false => buffer(object, index, binary, resources)?,
            });
        }
        let mut all = Self { buffers, views: Vec::new(), left: limits.decoded_bytes() };
        for (index, (view, compressed)) in root.buffer_views.iter().zip(compressed).enumerate() {
            let stride = view.byte_stride.map(|stride| stride.0);
            let place = match compressed {
                Some(compressed) => all.decompress(&compressed, stride)?,
                None => {
                    let offset = view.byte_offset.unwrap_or_default().0;
                    let at = format!("bufferViews[{index}]");
                    let bytes =
                        all.stretch(&at, view.buffer.value(), offset, view.byte_length.0)?;
                    Place { buffer: view.buffer.value(), bytes, stride }
                }
            };
            all.views.push(place);
        }
        Ok(all)
    }

    /// Bytes of a view and its stride where it has one.
    pub fn view(&self, index: Index<View>) -> (&[u8], Option<usize>) {
        let Place { buffer, bytes, stride } = &self.views[index.value()];
        (&self.buffers[*buffer][bytes.clone()], *stride)
    }

    /// Whether there is a view of that index.
    pub fn has_view(&self, index: usize) -> bool {
        index < self.views.len()
    }

    /// How many bytes may yet be decompressed.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Counts bytes that are about to be decompressed.
    pub fn spend(&mut self, at: &str, bytes: u64) -> Result<(), SceneError> {
        let Some(left) = self.left.checked_sub(bytes) else {
            return Err(SceneError::too_large(
                at,
                format!("is {bytes} bytes once decompressed; only {} more are allowed", self.left),
                "simplify the meshes, or send them in several scenes",
            ));
        };
        self.left = left;
        Ok(())
    }

    /// Adds bytes, tightly packed, as a view of their own.
    pub fn add(&mut self, bytes: Vec<u8>) -> Index<View> {
        let place = self.whole(bytes, None);
        self.views.push(place);
        Index::new(self.views.len() as u32 - 1)
    }

    fn whole(&mut self, bytes: Vec<u8>, stride: Option<usize>) -> Place {
        let (buffer, length) = (self.buffers.len(), bytes.len());
        self.buffers.push(Cow::Owned(bytes));
        Place { buffer, bytes: 0..length, stride }
    }

    fn decompress(
        &mut self,
        compressed: &Compressed,
        stride: Option<usize>,
    ) -> Result<Place, SceneError> {
        let Compressed { at, buffer, offset, length, .. } = compressed;
        self.spend(at, compressed.decoded_length())?;
        let bytes = self.stretch(at, *buffer, *offset, *length)?;
        let decoded = compressed.decode(&self.buffers[*buffer][bytes])?;
        Ok(self.whole(decoded, stride))
    }

    /// Where bytes of a buffer are, which there have to be.
    fn stretch(
        &self,
        at: &str,
        buffer: usize,
        offset: u64,
        length: u64,
    ) -> Result<Range<usize>, SceneError> {
        let available = self.buffers.get(buffer).map_or(0, |bytes| bytes.len() as u64);
        match offset.checked_add(length).filter(|end| *end <= available) {
            Some(end) => Ok(offset as usize..end as usize),
            None => Err(malformed(
                at,
                format!(
                    "{length} bytes from offset {offset} do not fit buffer {buffer} of {available} bytes"
                ),
            )),
        }
    }
}

/// By buffer: whether it needs no bytes, since all its views are decompressed from other buffers.
fn placeholders(root: &Root, compressed: &[Option<Compressed>]) -> Vec<bool> {
    let (mut used, mut read) = (vec![false; root.buffers.len()], vec![false; root.buffers.len()]);
    for (view, compressed) in root.buffer_views.iter().zip(compressed) {
        used[view.buffer.value()] = true;
        read[view.buffer.value()] |= compressed.is_none();
    }
    used.into_iter().zip(read).map(|(used, read)| used && !read).collect()
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
    let found = resources.get(&name).or_else(|| resources.get(uri));
    found.map(|bytes| Cow::Borrowed(&bytes[..])).ok_or_else(|| {
        SceneError::malformed(
            at,
            not_among(&name),
            "send the file along under this name, or pack everything into one .glb",
        )
    })
}

fn not_among(name: &str) -> String {
    format!("{:?} is not among the files that came with the scene", clip(name))
}

/// What is missing where a URI names a file that did not come with the scene; `None` where it came,
/// and of URIs that [`resolve`] refuses for other reasons.
pub(super) fn missing(uri: &str, resources: &Resources) -> Option<String> {
    let is_data = uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"));
    let name = (!is_data).then(|| relative_name(uri, "").ok()).flatten()?;
    let came = resources.contains_key(&name) || resources.contains_key(uri);
    (!came).then(|| not_among(&name))
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
