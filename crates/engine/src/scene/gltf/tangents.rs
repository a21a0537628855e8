//! Tangents for normal maps: read from the file or computed by the algorithm that glTF asks for,
//! MikkTSpace (Mikkelsen 2008, "Simulation of wrinkled surfaces revisited", §4).

use super::accessor::Accessor;
use super::local::Local;
use crate::scene::TextureSlot;
use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{DVec3, Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Least length of a tangent in a file that still tells a direction.
const MIN_LENGTH: f32 = 1e-6;

/// Most corners that may meet in one vertex: the algorithm goes round a vertex by recursion.
const MAX_CORNERS: u64 = 2048;

/// Most pairs of corners at one vertex, summed over all vertices: the algorithm compares them all.
const MAX_PAIRS: u64 = 1 << 30;

/// Gives every vertex the tangent that the file has for it; false, and nothing given, where one of
/// them has no direction.
pub(super) fn read(accessor: &Accessor<'_>, local: &mut Local) -> bool {
    let mut tangents = Vec::with_capacity(local.vertices.len());
    for source in &local.sources {
        let [x, y, z, w] = accessor.element(*source as usize);
        let tangent = Vec3::new(x, y, z);
        let is_usable = tangent.is_finite() && w.is_finite() && tangent.length() > MIN_LENGTH;
        if !is_usable {
            return false;
        }
        let sign = if w < 0.0 { -1.0 } else { 1.0 };
        // In f64, since squares of large components overflow.
        tangents.push(tangent.as_dvec3().normalize().as_vec3().extend(sign));
    }
    for (vertex, tangent) in local.vertices.iter_mut().zip(tangents) {
        vertex.tangent = tangent;
    }
    true
}

/// Computes tangents along the coordinates with which `slot` is sampled; vertices that need
/// several are split. False, and nothing done, where the algorithm cannot be asked: too many
/// triangles meet in one vertex.
pub(super) fn compute(slot: &TextureSlot, local: &mut Local) -> bool {
    let mut mesh = Mesh::new(slot, local);
    if !mesh.is_manageable() {
        return false;
    }
    if generate_tangents(&mut mesh).is_err() {
        return false;
    }
    let Mesh { faces, tangents, .. } = mesh;
    let mut places: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let mut taken = vec![false; local.vertices.len()];
    for (face, tangents) in faces.into_iter().zip(tangents) {
        for (corner, tangent) in tangents.into_iter().enumerate() {
            let own = local.triangles[face][corner];
            let key = (own, tangent.to_array().map(f32::to_bits));
            let place = *places.entry(key).or_insert_with(|| {
                if !std::mem::replace(&mut taken[own as usize], true) {
                    local.vertices[own as usize].tangent = tangent;
                    return own;
                }
                let mut vertex = local.vertices[own as usize];
                vertex.tangent = tangent;
                local.vertices.push(vertex);
                local.sources.push(local.sources[own as usize]);
                local.vertices.len() as u32 - 1
            });
            local.triangles[face][corner] = place;
        }
    }
    true
}

/// A tangent made unit and perpendicular to a normal; zero where it has no direction then.
pub(super) fn across(normal: Vec3, tangent: Vec4) -> Vec4 {
    let along = tangent.truncate();
    let along = (along - normal * normal.dot(along)).normalize_or_zero();
    if along == Vec3::ZERO { Vec4::ZERO } else { along.extend(tangent.w) }
}

/// A primitive as the algorithm reads it: its triangles that are no lines and no points.
struct Mesh {
    /// Triangles of the primitive that take part.
    faces: Vec<usize>,
    positions: Vec<[[f32; 3]; 3]>,
    normals: Vec<[[f32; 3]; 3]>,
    uvs: Vec<[[f32; 2]; 3]>,
    /// What comes out.
    tangents: Vec<[Vec4; 3]>,
}

/// What brings numbers up to `largest` near 1: a power of two, so that no digit is lost.
fn towards_one(largest: f32) -> f32 {
    if largest > 0.0 { (-largest.log2().floor()).clamp(-120.0, 120.0).exp2() } else { 1.0 }
}

impl Mesh {
    fn new(slot: &TextureSlot, local: &Local) -> Self {
        let position = |vertex: u32| local.vertices[vertex as usize].position.as_vec3();
        let uv = |vertex: u32| {
            let uv = slot.transformed(local.vertices[vertex as usize].uv[slot.uv_set as usize]);
            // Upwards, as the bitangent goes, which the format lets point to the image's top.
            if uv.is_finite() { Vec2::new(uv.x, -uv.y) } else { Vec2::ZERO }
        };
        let used = || local.triangles.iter().flatten().copied();
        let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(0.0, f32::max);
        let grow = towards_one(largest(&mut used().map(|v| position(v).abs().max_element())));
        let stretch = towards_one(largest(&mut used().map(|v| uv(v).abs().max_element())));
        let mut mesh = Self {
            faces: Vec::new(),
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            tangents: Vec::new(),
        };
        for (face, corners) in local.triangles.iter().enumerate() {
            let at = corners.map(|vertex| grow * position(vertex));
            if at[0] == at[1] || at[1] == at[2] || at[2] == at[0] {
                continue;
            }
            let [a, b, c] = at.map(Vec3::as_dvec3);
            let flat = (b - a).cross(c - a).normalize_or(DVec3::Z).as_vec3();
            let normal = |vertex: u32| {
                let given = local.vertices[vertex as usize].normal.as_dvec3();
                given.try_normalize().map_or(flat, |normal| normal.as_vec3())
            };
            mesh.faces.push(face);
            mesh.positions.push(at.map(|position| position.to_array()));
            mesh.normals.push(corners.map(|vertex| normal(vertex).to_array()));
            mesh.uvs.push(corners.map(|vertex| (stretch * uv(vertex)).to_array()));
            mesh.tangents.push([Vec4::ZERO; 3]);
        }
        mesh
    }

    /// Whether the algorithm, which goes round every vertex by recursion and compares all that
    /// meets there, comes to an end in good time.
    fn is_manageable(&self) -> bool {
        let mut corners: HashMap<[u32; 8], u64> = HashMap::new();
        for ((positions, normals), uvs) in self.positions.iter().zip(&self.normals).zip(&self.uvs) {
            for corner in 0..3 {
                let [x, y, z] = positions[corner];
                let ([i, j, k], [u, v]) = (normals[corner], uvs[corner]);
                let key = [x, y, z, i, j, k, u, v].map(f32::to_bits);
                *corners.entry(key).or_default() += 1;
            }
        }
        corners.values().all(|count| *count <= MAX_CORNERS)
            && corners.values().map(|count| count * count).sum::<u64>() <= MAX_PAIRS
    }
}

impl Geometry for Mesh {
    fn num_faces(&self) -> usize {
        self.faces.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.positions[face][vert]
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        self.normals[face][vert]
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        self.uvs[face][vert]
    }

    fn set_tangent(&mut self, tangent_space: Option<TangentSpace>, face: usize, vert: usize) {
        let tangent = tangent_space.map_or(Vec4::ZERO, |space| space.tangent_encoded().into());
        let is_unit = (tangent.truncate().length() - 1.0).abs() < 1e-3;
        self.tangents[face][vert] = if is_unit { tangent } else { Vec4::ZERO };
    }
}
