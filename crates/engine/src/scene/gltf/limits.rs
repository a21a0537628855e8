//! What an import is given beside the file, and the bounds that it keeps.

use super::choice::Choice;
use std::collections::BTreeMap;

/// Bounds on what an upload may contain; exceeding one is a [`crate::scene::SceneError`] with `too_large`.
#[derive(Clone, Copy, Debug)]
pub struct ImportLimits {
    /// Triangles that are kept: those of meshes that many instances share count once, and each of
    /// their instances as [`INSTANCE_TRIANGLES`] more.
    ///
    /// [`INSTANCE_TRIANGLES`]: crate::scene::instances::INSTANCE_TRIANGLES
    pub max_triangles: usize,
    /// Meshes are shared by their instances, rather than copied for each, where the copies would have
    /// more triangles than this altogether.
    pub share_above: u64,
    /// Texels of one texture.
    pub max_texture_texels: u64,
    /// Texels of all textures together.
    pub max_total_texels: u64,
}

impl Default for ImportLimits {
    fn default() -> Self {
        Self {
            max_triangles: 4_000_000,
            share_above: 500_000,
            max_texture_texels: 64 << 20,
            max_total_texels: 256 << 20,
        }
    }
}

/// Bytes that a file may have decompressed, however few triangles are allowed.
const DECODED_BASE_BYTES: u64 = 64 << 20;
/// Bytes that a file may have decompressed for each triangle that is allowed. Its indices and three
/// corners of its own take 228, with position, normal, tangent, two sets of texture coordinates and a
/// colour as floats.
const DECODED_BYTES_PER_TRIANGLE: u64 = 256;

impl ImportLimits {
    /// Most bytes that a file's compressed geometry may have once decompressed, all of it together.
    pub(super) fn decoded_bytes(&self) -> u64 {
        let triangles = self.max_triangles as u64;
        DECODED_BASE_BYTES.saturating_add(triangles.saturating_mul(DECODED_BYTES_PER_TRIANGLE))
    }
}

/// What an import is asked for.
#[derive(Clone, Debug, Default)]
pub struct ImportOptions {
    /// Bounds on what the file may contain.
    pub limits: ImportLimits,
    /// Name of the variant whose materials are shown (KHR_materials_variants); `None` for those
    /// that the file shows without one.
    pub variant: Option<String>,
    /// The scene of the file that is shown; `None` for its default one, or else its first.
    pub scene: Option<Choice>,
    /// The animation that moves it; `None` for the file at rest.
    pub animation: Option<Choice>,
    /// The moment of the animation, seconds; finite and not negative. Before the first key of a
    /// property its first value holds, after the last one its last.
    pub time: f64,
}

/// Files that came with a `.gltf`, by the relative URI that it names them with.
pub type Resources = BTreeMap<String, Vec<u8>>;

/// Largest world coordinate, metres: areas and their squares stay finite in f32.
pub const MAX_COORDINATE: f64 = 1e8;
