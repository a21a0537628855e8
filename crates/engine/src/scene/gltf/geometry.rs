//! Meshes to world-space triangles: counter-clockwise from the front, shading normals on the
//! front side, no degenerate triangles.

use super::accessor::Accessor;
use super::document::{FIX_FILE, malformed, valid};
use super::limits::{ImportLimits, MAX_COORDINATE};
use super::node::Instance;
use super::warnings::Warnings;
use crate::radiometry::Rgb;
use crate::scene::{Scene, SceneError, Triangle, Vertex};
use glam::{DMat3, DVec3, Vec2, Vec3};
use gltf::Semantic;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{self, Root};
use std::collections::HashMap;

/// A triangle whose area is below this, in square metres, is degenerate.
const MIN_AREA: f64 = 1e-16;
/// A triangle whose area is below this share of its longest side's square is degenerate: its
/// height is lost in the rounding of its corners.
const MIN_AREA_RATIO: f64 = 1e-9;

/// Least cosine between a shading normal and its triangle's own.
const MIN_NORMAL_COSINE: f32 = 1e-3;

/// How vertices join to triangles.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    List,
    Strip,
    Fan,
}

impl Mode {
    /// Triangles that `count` vertices make.
    fn triangles(self, count: usize) -> usize {
        match self {
            Mode::List => count / 3,
            Mode::Strip | Mode::Fan => count.saturating_sub(2),
        }
    }

    /// Places of a triangle's corners in the vertex order.
    fn corners(self, triangle: usize) -> [usize; 3] {
        match self {
            Mode::List => [3 * triangle, 3 * triangle + 1, 3 * triangle + 2],
            Mode::Strip if triangle % 2 == 1 => [triangle + 1, triangle, triangle + 2],
            Mode::Strip => [triangle, triangle + 1, triangle + 2],
            Mode::Fan => [triangle + 1, triangle + 2, 0],
        }
    }
}

/// A primitive that makes triangles.
struct Primitive {
    at: String,
    mode: Mode,
    position: usize,
    normal: Option<usize>,
    uv: [Option<usize>; 2],
    color: Option<usize>,
    indices: Option<usize>,
    material: Option<usize>,
    triangles: usize,
}

/// A primitive's vertices in mesh space; only those that triangles use.
struct Local {
    vertices: Vec<LocalVertex>,
    triangles: Vec<[u32; 3]>,
    has_normals: bool,
    material: u32,
}

struct LocalVertex {
    position: DVec3,
    normal: Vec3,
    uv: [Vec2; 2],
    color: Rgb,
}

/// Meshes of a file, and where they stand.
pub(super) struct Geometry<'a> {
    /// The file.
    pub root: &'a Root,
    /// Its accessors.
    pub accessors: &'a [Accessor<'a>],
    /// Where meshes stand.
    pub instances: &'a [Instance],
}

impl Geometry<'_> {
    /// Adds every instance's triangles to the scene.
    pub(super) fn build(
        &self,
        limits: &ImportLimits,
        scene: &mut Scene,
        warnings: &mut Warnings,
    ) -> Result<(), SceneError> {
        let meshes = self
            .root
            .meshes
            .iter()
            .enumerate()
            .map(|(index, mesh)| primitives(mesh, index, self.accessors, warnings))
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
                let local = read(primitive, self.accessors, material as u32)?;
                warn_of_missing_uv(primitive, scene, material, warnings);
                emit_all(primitive, &local, &instances, scene, warnings)?;
            }
        }
        Ok(())
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

fn primitives(
    mesh: &json::Mesh,
    index: usize,
    accessors: &[Accessor<'_>],
    warnings: &mut Warnings,
) -> Result<Vec<Primitive>, SceneError> {
    let mut primitives = Vec::new();
    for (place, object) in mesh.primitives.iter().enumerate() {
        let at = format!("meshes[{index}].primitives[{place}]");
        primitives.extend(primitive(object, at, accessors, warnings)?);
    }
    Ok(primitives)
}

fn primitive(
    object: &json::mesh::Primitive,
    at: String,
    accessors: &[Accessor<'_>],
    warnings: &mut Warnings,
) -> Result<Option<Primitive>, SceneError> {
    let attributes = Attributes::of(object, &at, accessors)?;
    if object.attributes.contains_key(&Checked::Invalid) {
        warnings.push(
            &attributes.at,
            "a name that glTF does not define is ignored; names of your own begin with _",
        );
    }
    let indices = indices(object, &at, accessors)?;
    let Some(mode) = mode(object, &at, warnings)? else { return Ok(None) };
    let Some(position) = attributes.position else {
        let what = "is missing; the primitive is left out";
        warnings.push(format!("{}.POSITION", attributes.at), what);
        return Ok(None);
    };
    let vertices = accessors[position].count;
    attributes.check_counts(vertices, accessors)?;
    if !accessors[position].has_data() {
        check_not_packed(object, &at)?;
    }
    if object.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
        let what = "morph targets are ignored; the base shape is shown";
        warnings.push(format!("{at}.targets"), what);
    }
    let count = indices.map_or(vertices, |index| accessors[index].count);
    if mode == Mode::List && !count.is_multiple_of(3) {
        warnings.push(
            &at,
            format!("{count} corners make no whole number of triangles; the rest is left out"),
        );
    }
    let triangles = mode.triangles(count);
    let material = object.material.map(|material| material.value());
    let Attributes { normal, uv, color, .. } = attributes;
    Ok(Some(Primitive { at, mode, position, normal, uv, color, indices, material, triangles }))
}

/// Which accessors a primitive's vertices are read from.
struct Attributes {
    /// Their place in the file.
    at: String,
    position: Option<usize>,
    normal: Option<usize>,
    uv: [Option<usize>; 2],
    color: Option<usize>,
}

impl Attributes {
    fn of(
        object: &json::mesh::Primitive,
        at: &str,
        accessors: &[Accessor<'_>],
    ) -> Result<Self, SceneError> {
        use ComponentType::{F32, I8, I16, U8, U16};
        const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
        let at = format!("{at}.attributes");
        let attribute = |semantic: Semantic, kinds: &[Type], components: &[ComponentType]| {
            let name = semantic.to_string();
            let Some(index) = object.attributes.get(&Checked::Valid(semantic)) else {
                return Ok(None);
            };
            let accessor = &accessors[index.value()];
            if !kinds.contains(&accessor.kind) || !components.contains(&accessor.component) {
                return Err(malformed(
                    format!("{at}.{name}"),
                    format!("{} is {:?} of {:?}", accessor.at, accessor.kind, accessor.component),
                ));
            }
            Ok(Some(index.value()))
        };
        Ok(Self {
            position: attribute(Semantic::Positions, &[Type::Vec3], QUANTIZED)?,
            normal: attribute(Semantic::Normals, &[Type::Vec3], &[F32, I8, I16])?,
            uv: [
                attribute(Semantic::TexCoords(0), &[Type::Vec2], QUANTIZED)?,
                attribute(Semantic::TexCoords(1), &[Type::Vec2], QUANTIZED)?,
            ],
            color: attribute(Semantic::Colors(0), &[Type::Vec3, Type::Vec4], &[F32, U8, U16])?,
            at,
        })
    }

    /// Refuses attributes that have not one element for each position.
    fn check_counts(&self, vertices: usize, accessors: &[Accessor<'_>]) -> Result<(), SceneError> {
        for (name, index) in [
            ("NORMAL", self.normal),
            ("TEXCOORD_0", self.uv[0]),
            ("TEXCOORD_1", self.uv[1]),
            ("COLOR_0", self.color),
        ] {
            let count = index.map(|index| accessors[index].count);
            if let Some(count) = count.filter(|count| *count != vertices) {
                return Err(malformed(
                    format!("{}.{name}", self.at),
                    format!("has {count} elements for {vertices} positions"),
                ));
            }
        }
        Ok(())
    }
}

/// The accessor of a primitive's vertex indices.
fn indices(
    object: &json::mesh::Primitive,
    at: &str,
    accessors: &[Accessor<'_>],
) -> Result<Option<usize>, SceneError> {
    let indices = object.indices.map(|index| index.value());
    if let Some(accessor) = indices.map(|index| &accessors[index])
        && !accessor.is_index()
    {
        return Err(malformed(
            format!("{at}.indices"),
            format!("{} is not a list of unsigned integers", accessor.at),
        ));
    }
    Ok(indices)
}

/// How a primitive's vertices join; `None` where they make no triangles.
fn mode(
    object: &json::mesh::Primitive,
    at: &str,
    warnings: &mut Warnings,
) -> Result<Option<Mode>, SceneError> {
    Ok(match valid(&object.mode, format!("{at}.mode"))? {
        json::mesh::Mode::Triangles => Some(Mode::List),
        json::mesh::Mode::TriangleStrip => Some(Mode::Strip),
        json::mesh::Mode::TriangleFan => Some(Mode::Fan),
        mode => {
            let what = if mode == json::mesh::Mode::Points { "points" } else { "lines" };
            warnings.push(format!("{at}.mode"), format!("{what} have no area; they are left out"));
            None
        }
    })
}

/// Refuses a primitive whose geometry is there in compressed form only.
fn check_not_packed(object: &json::mesh::Primitive, at: &str) -> Result<(), SceneError> {
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        if object.extensions.as_ref().is_some_and(|all| all.others.contains_key(name)) {
            return Err(SceneError::malformed(
                format!("{at}.extensions.{name}"),
                "the geometry is there in compressed form only",
                "export the scene without mesh compression",
            ));
        }
    }
    Ok(())
}

fn warn_of_missing_uv(
    primitive: &Primitive,
    scene: &Scene,
    material: usize,
    warnings: &mut Warnings,
) {
    let material = &scene.materials[material];
    for slot in [&material.base_color_texture, &material.emission_texture].into_iter().flatten() {
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
    let color = colors.map_or(Rgb::ONE, |accessor| {
        let [r, g, b, _] = accessor.element(index);
        let color = Rgb::new(r, g, b);
        if color.is_finite() { color.clamp(Rgb::ZERO, Rgb::ONE) } else { Rgb::ONE }
    });
    Ok(LocalVertex { position: position.as_dvec3(), normal, uv, color })
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
        world.push((position.as_vec3(), normal.as_vec3()));
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
            let (position, normal) = world[corner as usize];
            let source = &local.vertices[corner as usize];
            let mut push = |normal| {
                let index = scene.vertices.len() as u32;
                scene.vertices.push(Vertex {
                    position,
                    normal,
                    uv: source.uv,
                    color: source.color,
                });
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
