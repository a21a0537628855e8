//! Meshes to world-space triangles: counter-clockwise from the front, shading normals on the
//! front side, no degenerate triangles.

use super::accessor::Accessor;
use super::attributes::{Primitive, Tables, primitives};
use super::document::{FIX_FILE, malformed};
use super::limits::{ImportLimits, MAX_COORDINATE};
use super::local::{Local, LocalVertex};
use super::node::Instance;
use super::tangents;
use super::variants::Variants;
use super::warnings::Warnings;
use crate::scene::{Scene, SceneError, TextureSlot, Triangle, Vertex};
use glam::{DMat3, DVec3, Vec2, Vec3, Vec4};
use gltf::json::Root;
use gltf::json::accessor::Type;
use std::collections::HashMap;

/// A triangle whose area is below this, in square metres, is degenerate.
const MIN_AREA: f64 = 1e-16;
/// A triangle whose area is below this share of its longest side's square is degenerate: its
/// height is lost in the rounding of its corners.
const MIN_AREA_RATIO: f64 = 1e-9;

/// Least cosine between a shading normal and its triangle's own.
const MIN_NORMAL_COSINE: f32 = 1e-3;

/// Meshes of a file, and where they stand.
pub(super) struct Geometry<'a> {
    /// The file.
    pub root: &'a Root,
    /// Its accessors.
    pub accessors: &'a [Accessor<'a>],
    /// Where meshes stand.
    pub instances: &'a [Instance],
    /// Which materials primitives get.
    pub variants: &'a Variants,
}

impl Geometry<'_> {
    /// Adds every instance's triangles to the scene.
    pub(super) fn build(
        &self,
        limits: &ImportLimits,
        scene: &mut Scene,
        warnings: &mut Warnings,
    ) -> Result<(), SceneError> {
        let tables = Tables { accessors: self.accessors, variants: self.variants };
        let meshes = self
            .root
            .meshes
            .iter()
            .enumerate()
            .map(|(index, mesh)| primitives(mesh, index, tables, warnings))
            .collect::<Result<Vec<_>, _>>()?;
        self.check_size(&meshes, limits)?;
        let mut by_mesh: Vec<Vec<&Instance>> = meshes.iter().map(|_| Vec::new()).collect();
        for instance in self.instances {
            by_mesh[instance.mesh].push(instance);
        }
        let mut default_material = None;
        for (primitives, instances) in meshes.iter().zip(by_mesh) {
            if instances.is_empty() {
                continue;
            }
            for primitive in primitives.iter().filter(|primitive| primitive.triangles > 0) {
                let material = primitive.material.unwrap_or_else(|| {
                    *default_material.get_or_insert_with(|| {
                        scene.materials.push(super::material::default_material());
                        scene.materials.len() - 1
                    })
                });
                let mut local = read(primitive, self.accessors, material as u32)?;
                warn_of_missing_uv(primitive, scene, material, warnings);
                if let Some(map) = &scene.materials[material].normal_map {
                    let slot = map.slot;
                    self.add_tangents(primitive, &slot, &mut local, warnings);
                }
                emit_all(primitive, &local, &instances, scene, warnings)?;
            }
        }
        Ok(())
    }

    /// Gives the vertices of a primitive with a normal map their tangents: the file's, or else
    /// computed ones. Without either, the map has no effect.
    fn add_tangents(
        &self,
        primitive: &Primitive,
        slot: &TextureSlot,
        local: &mut Local,
        warnings: &mut Warnings,
    ) {
        if primitive.uv[slot.uv_set as usize].is_none() {
            let at = format!("{}.attributes.TEXCOORD_{}", primitive.at, slot.uv_set);
            warnings.push(at, "is missing, so the material's normal map has no effect");
            return;
        }
        // Without normals, the format says, tangents are to be computed with them.
        let given = primitive.tangent.filter(|_| primitive.normal.is_some());
        if let Some(accessor) = given.map(|index| &self.accessors[index]) {
            if tangents::read(accessor, local) {
                return;
            }
            warnings.push(
                format!("{}.attributes.TANGENT", primitive.at),
                "has tangents that are zero or not finite; all are computed anew",
            );
        }
        if !tangents::compute(slot, local) {
            let what = "has too many triangles at one vertex to compute tangents; the material's normal map has no effect";
            warnings.push(&primitive.at, what);
        }
    }

    /// Refuses more triangles than are allowed.
    fn check_size(
        &self,
        meshes: &[Vec<Primitive>],
        limits: &ImportLimits,
    ) -> Result<(), SceneError> {
        // Summed by mesh first: a mesh of many primitives may have many instances.
        let triangles: Vec<u64> =
            meshes.iter().map(|mesh| mesh.iter().map(|p| p.triangles as u64).sum()).collect();
        let instances = self.instances.iter();
        let total: u64 =
            instances.fold(0, |sum, instance| sum.saturating_add(triangles[instance.mesh]));
        let most = (limits.max_triangles as u64).min(u64::from(u32::MAX) / 3);
        if total > most {
            return Err(SceneError::too_large(
                "meshes",
                format!("{total} triangles with all instances; {most} are allowed"),
                "simplify the meshes or send fewer instances",
            ));
        }
        Ok(())
    }
}

fn warn_of_missing_uv(
    primitive: &Primitive,
    scene: &Scene,
    material: usize,
    warnings: &mut Warnings,
) {
    let material = &scene.materials[material];
    let slots = [
        &material.base_color_texture,
        &material.emission_texture,
        &material.metallic_roughness_texture,
        &material.specular_texture,
        &material.specular_color_texture,
        &material.transmission_texture,
    ];
    for slot in slots.into_iter().flatten() {
        if primitive.uv[slot.uv_set as usize].is_none() {
            warnings.push(
                format!("{}.attributes.TEXCOORD_{}", primitive.at, slot.uv_set),
                "is missing though the material is textured; one texel is used all over",
            );
            return;
        }
    }
}

/// Reads the vertices that a primitive's triangles use.
fn read(
    primitive: &Primitive,
    accessors: &[Accessor<'_>],
    material: u32,
) -> Result<Local, SceneError> {
    let positions = &accessors[primitive.position];
    let attribute = |index: Option<usize>| index.map(|index| &accessors[index]);
    let (normals, colors) = (attribute(primitive.normal), attribute(primitive.color));
    let uvs = primitive.uv.map(attribute);
    let indices = attribute(primitive.indices);
    let mut local = Local {
        sources: Vec::new(),
        vertices: Vec::new(),
        triangles: Vec::with_capacity(primitive.triangles),
        has_normals: normals.is_some(),
        material,
    };
    // Work and memory follow the triangles, not the accessors: many primitives may share one
    // large accessor.
    let mut places: HashMap<u32, u32> = HashMap::new();
    for triangle in 0..primitive.triangles {
        let mut corners = [0; 3];
        for (corner, place) in corners.iter_mut().zip(primitive.mode.corners(triangle)) {
            let index = match indices {
                Some(indices) => checked_index(indices, place, positions.count)?,
                None => place as u32,
            };
            *corner = match places.get(&index) {
                Some(place) => *place,
                None => {
                    let place = local.vertices.len() as u32;
                    places.insert(index, place);
                    local.vertices.push(vertex(index as usize, positions, normals, uvs, colors)?);
                    local.sources.push(index);
                    place
                }
            };
        }
        local.triangles.push(corners);
    }
    Ok(local)
}

fn checked_index(indices: &Accessor<'_>, place: usize, count: usize) -> Result<u32, SceneError> {
    let index = indices.index(place);
    if (index as usize) < count && index != indices.restart() {
        return Ok(index);
    }
    let what = if index == indices.restart() {
        format!(
            "element {place} is {index}, the primitive restart value, which glTF has no use for"
        )
    } else {
        format!("element {place} is {index}, but there are {count} vertices")
    };
    Err(malformed(&indices.at, what))
}

fn vertex(
    index: usize,
    positions: &Accessor<'_>,
    normals: Option<&Accessor<'_>>,
    uvs: [Option<&Accessor<'_>>; 2],
    colors: Option<&Accessor<'_>>,
) -> Result<LocalVertex, SceneError> {
    let [x, y, z, _] = positions.element(index);
    let position = Vec3::new(x, y, z);
    if !position.is_finite() {
        return Err(malformed(
            &positions.at,
            format!("vertex {index} is at ({x}, {y}, {z}), which is not finite"),
        ));
    }
    let normal = normals.map_or(Vec3::ZERO, |accessor| {
        let [x, y, z, _] = accessor.element(index);
        Vec3::new(x, y, z)
    });
    let uv = uvs.map(|accessor| {
        let [u, v, ..] = accessor.map_or([0.0; 4], |accessor| accessor.element(index));
        let uv = Vec2::new(u, v);
        if uv.is_finite() { uv } else { Vec2::ZERO }
    });
    let color = colors.map_or(Vec4::ONE, |accessor| {
        let [r, g, b, a] = accessor.element(index);
        let alpha = if accessor.kind == Type::Vec4 { a } else { 1.0 };
        let color = Vec4::new(r, g, b, alpha);
        if color.is_finite() { color.clamp(Vec4::ZERO, Vec4::ONE) } else { Vec4::ONE }
    });
    let (color, alpha) = (color.truncate(), color.w);
    let position = position.as_dvec3();
    Ok(LocalVertex { position, normal, uv, color, alpha, tangent: Vec4::ZERO })
}

/// Adds a primitive's instances.
fn emit_all(
    primitive: &Primitive,
    local: &Local,
    instances: &[&Instance],
    scene: &mut Scene,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let (mut dropped, mut turned) = (0, 0);
    for instance in instances {
        let counts = emit(local, instance, scene)?;
        dropped += counts.0;
        turned += counts.1;
    }
    if dropped > 0 {
        warnings.push(&primitive.at, format!("{dropped} triangles without area are left out"));
    }
    if turned > 0 && local.has_normals {
        warnings.push(
            format!("{}.attributes.NORMAL", primitive.at),
            format!(
                "{turned} corners have no usable normal on the front side that the winding gives; the flat normal is used there"
            ),
        );
    }
    Ok(())
}

/// Adds one instance; returns how many triangles were dropped and how many corners got the flat
/// normal though the file has another.
fn emit(
    local: &Local,
    instance: &Instance,
    scene: &mut Scene,
) -> Result<(usize, usize), SceneError> {
    let linear = DMat3::from_mat4(instance.to_world);
    // Normals are covectors. A singular transform has no inverse; its surfaces are flat.
    let normal_to_world = Some(linear.inverse().transpose())
        .filter(|matrix| matrix.is_finite() && linear.determinant() != 0.0);
    let mirrored = linear.determinant() < 0.0;
    let handedness = if mirrored { -1.0 } else { 1.0 };
    let mut world = Vec::with_capacity(local.vertices.len());
    for vertex in &local.vertices {
        let position = instance.to_world.transform_point3(vertex.position);
        if !position.is_finite() || position.abs().max_element() > MAX_COORDINATE {
            return Err(SceneError::malformed(
                format!("nodes[{}]", instance.node),
                format!("places a vertex at {position}, beyond {MAX_COORDINATE:e} m"),
                FIX_FILE,
            ));
        }
        let normal = normal_to_world
            .map_or(DVec3::ZERO, |matrix| (matrix * vertex.normal.as_dvec3()).normalize_or_zero());
        let tangent = linear * vertex.tangent.truncate().as_dvec3();
        let tangent = tangent
            .try_normalize()
            .map_or(Vec4::ZERO, |tangent| tangent.as_vec3().extend(handedness * vertex.tangent.w));
        world.push((position.as_vec3(), normal.as_vec3(), tangent));
    }
    let mut shared: Vec<Option<u32>> = vec![None; local.vertices.len()];
    let (mut dropped, mut turned) = (0, 0);
    for corners in &local.triangles {
        let mut corners = *corners;
        if mirrored {
            corners.swap(1, 2);
        }
        let positions = corners.map(|corner| world[corner as usize].0);
        let Some(flat) = geometric_normal(positions) else {
            dropped += 1;
            continue;
        };
        let vertices = corners.map(|corner| {
            let (position, normal, tangent) = world[corner as usize];
            let &LocalVertex { uv, color, alpha, .. } = &local.vertices[corner as usize];
            let mut push = |normal| {
                let index = scene.vertices.len() as u32;
                let tangent = tangents::across(normal, tangent);
                scene.vertices.push(Vertex { position, normal, uv, color, alpha, tangent });
                index
            };
            // Also false for a NaN or zero normal.
            if normal.dot(flat) > MIN_NORMAL_COSINE {
                return *shared[corner as usize].get_or_insert_with(|| push(normal));
            }
            turned += 1;
            push(flat)
        });
        scene.triangles.push(Triangle { vertices, material: local.material });
    }
    Ok((dropped, turned))
}

/// Unit normal of a triangle by its winding; `None` where it has no usable area.
fn geometric_normal(positions: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = positions.map(Vec3::as_dvec3);
    let cross = (b - a).cross(c - a);
    let area = 0.5 * cross.length();
    let longest =
        (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (area > MIN_AREA.max(MIN_AREA_RATIO * longest)).then(|| cross.normalize().as_vec3())
}
