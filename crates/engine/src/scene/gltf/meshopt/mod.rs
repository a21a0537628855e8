//! Buffer views that meshopt has compressed (EXT_meshopt_compression, KHR_meshopt_compression),
//! as appendices A and B of the extensions describe them: a stream of `attributes` or of `indices`,
//! and for attributes a filter that makes what is stored what is read.

mod attributes;
mod filters;
mod indices;
#[cfg(test)]
mod tests;

use super::document::{clip, malformed};
use crate::scene::SceneError;
use filters::Filter;
use gltf::json::buffer::{Buffer, View};
use serde::Deserialize;
use serde_json::{Map, Value};

/// The extensions' names. They differ in what encoders may write; all that either allows is read
/// from both.
const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Longest element that attributes may have, bytes.
const MAX_STRIDE: usize = 256;

/// What the extension says of a buffer view.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Object {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

/// How the elements are stored.
#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// A compressed buffer view: where its stream is and what comes out of it.
pub(super) struct Compressed {
    /// Its place in the file.
    pub at: String,
    /// The buffer with the stream.
    pub buffer: usize,
    /// Where the stream begins in the buffer.
    pub offset: u64,
    /// The stream's length.
    pub length: u64,
    mode: Mode,
    filter: Filter,
    stride: usize,
    count: usize,
}

impl Compressed {
    /// What the extension says of view `index`; `None` where the view is not compressed.
    pub fn of(view: &View, index: usize) -> Result<Option<Self>, SceneError> {
        let Some((name, object)) = view.extensions.as_ref().and_then(|all| named(&all.others))
        else {
            return Ok(None);
        };
        let at = format!("bufferViews[{index}].extensions.{name}");
        let object = Object::deserialize(object)
            .map_err(|error| malformed(&at, clip(&error.to_string())))?;
        let Object { buffer, byte_offset: offset, byte_length: length, .. } = object;
        let Object { mode, filter, byte_stride: stride, count, .. } = object;
        let fits = match mode {
            Mode::Attributes => {
                stride > 0
                    && stride <= MAX_STRIDE
                    && stride.is_multiple_of(4)
                    && filter.fits(stride)
            }
            Mode::Triangles => [2, 4].contains(&stride) && count.is_multiple_of(3),
            Mode::Indices => [2, 4].contains(&stride),
        };
        if !fits || (mode != Mode::Attributes && filter != Filter::None) {
            let what = format!(
                "the mode and the filter do not go with {count} elements of {stride} bytes"
            );
            return Err(malformed(at, what));
        }
        let compressed = Self { at, buffer, offset, length, mode, filter, stride, count };
        let (declared, decoded) = (view.byte_length.0, compressed.decoded_length());
        if declared != decoded {
            let what = format!(
                "{count} elements of {stride} bytes are {decoded} bytes, but the view has {declared}"
            );
            return Err(malformed(compressed.at, what));
        }
        Ok(Some(compressed))
    }

    /// Bytes that come out.
    pub fn decoded_length(&self) -> u64 {
        (self.count as u64).saturating_mul(self.stride as u64)
    }

    /// What the view holds, from its stream. Allocates [`Compressed::decoded_length`], which the
    /// caller has judged.
    pub fn decode(&self, stream: &[u8]) -> Result<Vec<u8>, SceneError> {
        let decoded = match self.mode {
            Mode::Attributes => attributes::decode(stream, self.count, self.stride),
            Mode::Triangles => indices::triangles(stream, self.count, self.stride),
            Mode::Indices => indices::indices(stream, self.count, self.stride),
        };
        let mut decoded = decoded
            .map_err(|why| malformed(&self.at, format!("the stream cannot be decoded: {why}")))?;
        self.filter.apply(&mut decoded, self.stride);
        Ok(decoded)
    }
}

/// Whether a buffer is only there for readers that do not know the extension, so that it may have no
/// bytes.
pub(super) fn is_fallback(buffer: &Buffer) -> bool {
    let object = buffer.extensions.as_ref().and_then(|all| named(&all.others));
    object.is_some_and(|(_, object)| object.get("fallback") == Some(&Value::Bool(true)))
}

fn named(extensions: &Map<String, Value>) -> Option<(&'static str, &Value)> {
    NAMES.into_iter().find_map(|name| Some((name, extensions.get(name)?)))
}
