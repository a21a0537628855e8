//! glTF 2.0 / GLB import.

use super::{Scene, SceneError};
use std::collections::BTreeMap;

/// Bounds on what an upload may contain; exceeding one is a [`SceneError`] with `too_large`.
#[derive(Clone, Copy, Debug)]
pub struct ImportLimits {
    /// Triangles after instancing.
    pub max_triangles: usize,
    /// Texels of one texture.
    pub max_texture_texels: u64,
    /// Texels of all textures together.
    pub max_total_texels: u64,
}

impl Default for ImportLimits {
    fn default() -> Self {
        Self { max_triangles: 4_000_000, max_texture_texels: 64 << 20, max_total_texels: 256 << 20 }
    }
}

/// Files that came with a `.gltf`, by the relative URI that it names them with.
pub type Resources = BTreeMap<String, Vec<u8>>;

/// Imports a `.glb` (or a `.gltf` with its `resources`).
///
/// # Errors
/// [`SceneError`] names the place in the file, what is wrong there and what to do.
pub fn import(
    _bytes: &[u8],
    _resources: &Resources,
    _limits: &ImportLimits,
) -> Result<Scene, SceneError> {
    Err(SceneError::malformed("file", "import is not there yet", "wait"))
}
