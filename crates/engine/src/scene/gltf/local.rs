//! A primitive as it is read, before nodes place it.

use crate::radiometry::Rgb;
use glam::{DVec3, Vec2, Vec3, Vec4};

/// A primitive's vertices in mesh space; only those that triangles use.
#[derive(Clone, Default)]
pub(super) struct Local {
    /// The vertices.
    pub vertices: Vec<LocalVertex>,
    /// By vertex: its element in the file's accessors.
    pub sources: Vec<u32>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the file has normals for them.
    pub has_normals: bool,
    /// Index of the material in the scene.
    pub material: u32,
}

/// A vertex in mesh space.
#[derive(Clone, Copy)]
pub(super) struct LocalVertex {
    /// Position in the mesh's unit.
    pub position: DVec3,
    /// As in the file, not checked; zero without.
    pub normal: Vec3,
    /// Texture coordinate sets 0 and 1; zero without.
    pub uv: [Vec2; 2],
    /// Vertex colour, in [0, 1].
    pub color: Rgb,
    /// Its alpha, in [0, 1].
    pub alpha: f32,
    /// Unit tangent (xyz) and the bitangent's sign (w); zero without.
    pub tangent: Vec4,
}
