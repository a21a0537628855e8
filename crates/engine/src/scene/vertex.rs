//! Vertices and triangles.

use crate::radiometry::Rgb;
use glam::{Vec2, Vec3, Vec4};

/// A vertex with everything that is interpolated over a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// World position in metres.
    pub position: Vec3,
    /// Unit shading normal; the geometric normal where the file gives none.
    pub normal: Vec3,
    /// Texture coordinate sets 0 and 1.
    pub uv: [Vec2; 2],
    /// Linear vertex colour; multiplies the base colour.
    pub color: Rgb,
    /// The vertex colour's alpha; multiplies the material's.
    pub alpha: f32,
    /// Unit tangent in world space (xyz), along which the texture coordinate u of the normal map
    /// grows, and the sign of the bitangent (w = ±1): bitangent = w · normal × tangent. Zero where
    /// no normal map needs it.
    pub tangent: Vec4,
}

impl Vertex {
    /// A white, opaque vertex without texture coordinates.
    pub fn new(position: Vec3, normal: Vec3) -> Self {
        let (uv, color, tangent) = ([Vec2::ZERO; 2], Rgb::ONE, Vec4::ZERO);
        Self { position, normal, uv, color, alpha: 1.0, tangent }
    }
}

/// One triangle: three vertex indices and a material index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Numbers of vertices; see [`super::Scene::vertex`].
    pub vertices: [u32; 3],
    /// Index into [`super::Scene::materials`].
    pub material: u32,
}
