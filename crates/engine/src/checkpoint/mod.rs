//! Checkpoints: all that a method knows at one moment, as bytes. From a checkpoint the same job
//! goes on as if nothing had happened, bit for bit, or with more time; and another camera begins
//! with the part that does not depend on the camera.
//!
//! A checkpoint is two parts behind a header: what is *shared* by all cameras (the solution on the
//! surfaces), and what is *bound* to one (pixels). The header says what it belongs to. Bytes are
//! little more than copies of memory; the sums over them guard against disks, the checks of
//! every reader against everything else.

mod bytes;
mod error;

use crate::scene::environment::Environment;
use crate::scene::{Background, Camera, Projection, Scene, Triangle, Vertex};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Write;

pub use bytes::{Reader, Writer};
pub use error::CheckpointError;

/// First bytes of a checkpoint.
const MAGIC: [u8; 8] = *b"HMLXCKPT";
/// Changes whenever the frame around the methods' parts is another one; what is in them has a number
/// of each method's own ([`Header::format`]). Machines of the other byte order have their own.
const FORMAT: u32 = 5 | if cfg!(target_endian = "big") { 1 << 31 } else { 0 };
/// Bytes before the header: magic, format, three lengths, three sums, and the sum of all that.
const PREAMBLE: usize = 8 + 4 + 4 + 8 + 8 + 3 * 4 + 4;
/// A longer header is none of ours.
const MOST_HEADER: usize = 1 << 20;

/// A camera, the size of its picture and what is behind it, bit for bit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewKey {
    /// Bits of the camera-to-world matrix, the kind of projection, and its parameter.
    pub camera: Vec<u32>,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// [`Background::key`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub background: Vec<u32>,
}

impl ViewKey {
    /// The key of a camera's picture.
    pub fn new(camera: &Camera, [width, height]: [u32; 2], background: Background) -> Self {
        let (kind, size) = match camera.projection {
            Projection::Perspective { yfov } => (0, yfov),
            Projection::Orthographic { ymag } => (1, ymag),
        };
        let matrix = camera.to_world.to_cols_array().map(f32::to_bits);
        let camera = [&matrix[..], &[kind, size.to_bits()]].concat();
        Self { camera, width, height, background: background.key() }
    }
}

/// What a checkpoint belongs to, and how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the engine that wrote it, for people.
    pub engine: String,
    /// The method.
    pub method: String,
    /// The method's own format. Checkpoints from before there was one are in the first.
    #[serde(default = "first_format")]
    pub format: u32,
    /// Hash of the scene, hexadecimal.
    pub scene: String,
    /// All settings in force.
    pub settings: BTreeMap<String, String>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// What the method decided by the limits or the picture; it stays so.
    pub decided: BTreeMap<String, String>,
    /// What the camera's part is bound to.
    pub view: ViewKey,
    /// Whole iterations done.
    pub iterations: u64,
    /// Shots or rays done.
    pub shots: u64,
    /// Those of them that came from lights.
    pub light_shots: u64,
    /// Seconds that this took.
    pub seconds: f64,
    /// Estimated rRMSE of the picture at that moment.
    pub estimated_error: Option<f64>,
}

fn first_format() -> u32 {
    1
}

/// All that a method knows at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    header: Header,
    shared: Vec<u8>,
    bound: Vec<u8>,
}

impl Checkpoint {
    /// A checkpoint of its parts.
    pub(crate) fn new(header: Header, shared: Vec<u8>, bound: Vec<u8>) -> Self {
        Self { header, shared, bound }
    }

    /// Its parts.
    #[cfg(test)]
    pub(crate) fn into_parts(self) -> (Header, Vec<u8>, Vec<u8>) {
        (self.header, self.shared, self.bound)
    }

    /// The same with another header: `change` makes of this one, as JSON, what another version of
    /// the program would have written.
    #[cfg(test)]
    pub(crate) fn with_header_changed(
        self,
        change: impl FnOnce(&mut serde_json::Map<String, serde_json::Value>),
    ) -> Self {
        let mut header = serde_json::to_value(self.header).expect("plain data");
        change(header.as_object_mut().expect("an object"));
        Self { header: serde_json::from_value(header).expect("a header"), ..self }
    }

    /// What it belongs to, and how far it is.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The part that any camera can use.
    pub(crate) fn shared(&self) -> Reader<'_> {
        Reader::new(&self.shared)
    }

    /// The part of its own camera.
    pub(crate) fn bound(&self) -> Reader<'_> {
        Reader::new(&self.bound)
    }

    /// Bytes of the part that any camera can use.
    pub fn shared_size(&self) -> u64 {
        self.shared.len() as u64
    }

    /// Bytes that it takes, but for its header.
    pub fn size(&self) -> u64 {
        (self.shared.len() + self.bound.len()) as u64
    }

    /// Writes it.
    ///
    /// # Errors
    /// Those of `to`.
    pub fn write(&self, mut to: impl Write) -> std::io::Result<()> {
        let header = serde_json::to_vec(&self.header)?;
        let parts = [&header, &self.shared, &self.bound];
        let mut preamble = Vec::with_capacity(PREAMBLE);
        preamble.extend(MAGIC);
        preamble.extend(FORMAT.to_le_bytes());
        preamble.extend((header.len() as u32).to_le_bytes());
        preamble.extend((self.shared.len() as u64).to_le_bytes());
        preamble.extend((self.bound.len() as u64).to_le_bytes());
        for part in parts {
            preamble.extend(crc32fast::hash(part).to_le_bytes());
        }
        preamble.extend(crc32fast::hash(&preamble).to_le_bytes());
        to.write_all(&preamble)?;
        parts.into_iter().try_for_each(|part| to.write_all(part))
    }

    /// Its bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(PREAMBLE + MOST_HEADER / 64 + self.size() as usize);
        self.write(&mut bytes).expect("memory takes all bytes, and the header is plain data");
        bytes
    }

    /// Reads it from any bytes whatever.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] or [`CheckpointError::Version`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CheckpointError> {
        let damaged = |what: &str| CheckpointError::damaged(what);
        let Some((preamble, rest)) = bytes.split_at_checked(PREAMBLE) else {
            return Err(damaged("it ends too early"));
        };
        let word = |at: usize| u32::from_le_bytes(preamble[at..at + 4].try_into().expect("four"));
        let long = |at: usize| u64::from_le_bytes(preamble[at..at + 8].try_into().expect("eight"));
        if preamble[..8] != MAGIC {
            return Err(damaged("it does not begin as a checkpoint"));
        }
        if crc32fast::hash(&preamble[..PREAMBLE - 4]) != word(PREAMBLE - 4) {
            return Err(damaged("its first bytes were changed"));
        }
        if word(8) != FORMAT {
            let (found, here) = (format!("format {}", word(8)), format!("format {FORMAT}"));
            return Err(CheckpointError::Version { found, here });
        }
        let lengths = [u64::from(word(12)), long(16), long(24)];
        let total = lengths.iter().try_fold(0u64, |sum, length| sum.checked_add(*length));
        if total != Some(rest.len() as u64) || lengths[0] > MOST_HEADER as u64 {
            return Err(damaged("it is not as long as it says"));
        }
        let (header, rest) = rest.split_at(lengths[0] as usize);
        let (shared, bound) = rest.split_at(lengths[1] as usize);
        for (part, at) in [header, shared, bound].into_iter().zip([32, 36, 40]) {
            if crc32fast::hash(part) != word(at) {
                return Err(damaged("its bytes were changed"));
            }
        }
        let header: Header = serde_json::from_slice(header).map_err(|error| {
            CheckpointError::damaged(format!("its header can't be read: {error}"))
        })?;
        Ok(Self { header, shared: shared.into(), bound: bound.into() })
    }
}

/// What the hash of a scene in its surroundings begins with: everything of the scene that light meets.
/// Cameras are no part of it.
#[derive(Clone)]
pub struct SceneDigest(Sha256);

impl SceneDigest {
    /// Of a scene.
    pub fn of(scene: &Scene) -> Self {
        Self(digest(scene))
    }

    /// SHA-256 of the scene and of what surrounds it, hexadecimal. Darkness adds nothing, so that
    /// scenes with lights of their own have the hash that they had before there were skies.
    pub fn within(&self, environment: &Environment) -> String {
        let mut hash = self.0.clone();
        environment.digest_into(&mut |bytes| hash.update(bytes));
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

fn digest(scene: &Scene) -> Sha256 {
    let mut hash = Sha256::new();
    digest_mesh(&scene.vertices, &scene.triangles, &mut hash);
    digest_instances(scene, &mut hash);
    for texture in &scene.textures {
        hash.update(texture.width.to_le_bytes());
        hash.update(texture.height.to_le_bytes());
        hash.update(bytemuck::cast_slice(&texture.texels));
    }
    // Numbers are written so that no two look the same.
    hash.update(format!("{:?}", scene.materials));
    hash.update(format!("{:?}", scene.lights));
    let counts = [scene.vertices.len(), scene.triangles.len(), scene.textures.len()];
    hash.update(format!("{counts:?}"));
    hash
}

fn digest_mesh(vertices: &[Vertex], triangles: &[Triangle], hash: &mut Sha256) {
    let mut numbers: Vec<f32> = Vec::new();
    for some in vertices.chunks(1024) {
        numbers.clear();
        for vertex in some {
            numbers.extend(vertex.position.to_array());
            numbers.extend(vertex.normal.to_array());
            numbers.extend(vertex.uv.iter().flat_map(|uv| uv.to_array()));
            numbers.extend(vertex.color.to_array());
            numbers.push(vertex.alpha);
            numbers.extend(vertex.tangent.to_array());
        }
        hash.update(bytemuck::cast_slice(&numbers));
    }
    let mut indices: Vec<u32> = Vec::new();
    for some in triangles.chunks(1024) {
        indices.clear();
        for triangle in some {
            indices.extend(triangle.vertices);
            indices.push(triangle.material);
        }
        hash.update(bytemuck::cast_slice(&indices));
    }
}

/// Adds meshes that are there many times; nothing where there are none.
fn digest_instances(scene: &Scene, hash: &mut Sha256) {
    if scene.instances.is_empty() {
        return;
    }
    for shape in scene.instances.shapes() {
        digest_mesh(&shape.vertices, &shape.triangles, hash);
        hash.update(format!("{:?}", [shape.vertices.len(), shape.triangles.len()]));
    }
    for instance in scene.instances.all() {
        hash.update(instance.shape.to_le_bytes());
        hash.update(bytemuck::cast_slice(&instance.to_world.to_cols_array()));
    }
}

#[cfg(test)]
mod tests;
