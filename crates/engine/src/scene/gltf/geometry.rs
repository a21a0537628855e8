//! Meshes to world-space triangles: which vertices a primitive's triangles use, in which shape, and
//! how often. `placing` gives them their places.

use super::accessor::Accessor;
use super::attributes::{Primitive, Tables, primitives};
use super::document::{MoreTargets, malformed};
use super::limits::ImportLimits;
use super::local::{Local, LocalVertex};
use super::morph;
use super::node::Instance;
use super::placing::{Placement, Placing};
use super::pose::Pose;
use super::sharing::{self, Counts, SharedShape};
use super::skin::Bones;
use super::tangents;
use super::variants::Variants;
use super::warnings::Warnings;
use crate::scene::instances::Instances;
use crate::scene::{Scene, SceneError, TextureSlot};
use glam::{DMat4, Vec2, Vec3, Vec4};
use gltf::json::Root;
use gltf::json::accessor::Type;
use std::collections::HashMap;
use std::sync::Arc;

/// Meshes of a file, and where they stand.
pub(super) struct Geometry<'a> {
    /// The file.
    pub root: &'a Root,
    /// Its accessors.
    pub accessors: &'a [Accessor<'a>],
    /// Where meshes stand.
    pub instances: &'a [Instance],
    /// By skin, what takes vertices to the world.
    pub skins: &'a [Vec<DMat4>],
    /// What an animation moves.
    pub pose: &'a Pose,
    /// What the crate does not know of morph targets.
    pub more_targets: &'a MoreTargets,
    /// Which materials primitives get.
    pub variants: &'a Variants,
}

/// An instance with the weights of its mesh's morph targets.
#[derive(Clone, Copy)]
struct Shown<'a> {
    instance: &'a Instance,
    weights: &'a [f32],
}

/// Instances one after another that have the same shape.
fn runs<'s, 'a>(shown: &'s [Shown<'a>]) -> impl Iterator<Item = &'s [Shown<'a>]> {
    shown.chunk_by(|one, other| one.weights == other.weights)
}

impl Geometry<'_> {
    /// Adds every instance's triangles to the scene.
    pub(super) fn build(
        &self,
        limits: &ImportLimits,
        scene: &mut Scene,
        warnings: &mut Warnings,
    ) -> Result<(), SceneError> {
        let (accessors, variants) = (self.accessors, self.variants);
        let tables = Tables { accessors, variants, more_targets: self.more_targets };
        let meshes = self
            .root
            .meshes
            .iter()
            .enumerate()
            .map(|(index, mesh)| primitives(mesh, index, tables, warnings))
            .collect::<Result<Vec<_>, _>>()?;
        let weights = morph::weights(self.root, self.pose, self.instances)?;
        let mut by_mesh: Vec<Vec<Shown<'_>>> = meshes.iter().map(|_| Vec::new()).collect();
        for (instance, weights) in self.instances.iter().zip(weights) {
            by_mesh[instance.mesh].push(Shown { instance, weights });
        }
        let shares = counts(&meshes, &by_mesh).check(limits)?;
        self.check_displacements(&meshes, &by_mesh)?;
        let mut shared = shares.then(|| Sharing::new(limits));
        let mut default_material = None;
        for (primitives, shown) in meshes.iter().zip(by_mesh) {
            if shown.is_empty() {
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
                let whereto = Whereto { scene, warnings, shared: &mut shared };
                self.show(primitive, local, &shown, whereto)?;
            }
        }
        if let Some(Sharing { mut instances, .. }) = shared {
            instances.finish();
            scene.instances = Arc::new(instances);
        }
        Ok(())
    }

    /// Adds a primitive wherever its mesh is shown.
    fn show(
        &self,
        primitive: &Primitive,
        mut local: Local,
        shown: &[Shown<'_>],
        whereto: Whereto<'_>,
    ) -> Result<(), SceneError> {
        let Whereto { scene, warnings, shared } = whereto;
        let material = &scene.materials[local.material as usize];
        let needed = material.tangent_slot().map(|slot| {
            let only_brushed = !material.has_normal_map();
            let what = if only_brushed { "anisotropy" } else { "normal map" };
            let is_textured = !only_brushed || material.is_brushed_by_texture();
            NeededTangents { slot, what, is_textured }
        });
        let has_normals = local.has_normals;
        let mut placing = Placing::new(scene);
        let mut rest = shown.len();
        let mut said = Warnings::default();
        for run in runs(shown) {
            rest -= run.len();
            // The last run needs no copy.
            let mut shape = if rest > 0 { local.clone() } else { std::mem::take(&mut local) };
            let (weights, targets) = (run[0].weights, &primitive.targets);
            morph::displace(&mut shape, targets, weights, self.accessors)?;
            if let Some(needed) = &needed {
                let mut own = Warnings::default();
                if self.add_tangents(primitive, needed, &mut shape, &mut own) {
                    morph::displace_tangents(&mut shape, targets, weights, self.accessors)?;
                }
                // What is wrong with tangents is said once.
                said = said.or(own);
            }
            let [rigid, _] = count_of(primitive, run);
            let mut shared =
                shared.as_mut().filter(|_| sharing::pays(shape.triangles.len() as u64, rigid));
            let of_all = shared.as_mut().and_then(|shared| {
                SharedShape::new(&shape, rigid, &mut shared.instances, &mut placing)
            });
            for Shown { instance, .. } in run {
                let shared = shared.as_deref_mut().map(|shared| (of_all.as_ref(), shared));
                self.place((primitive, &shape), instance, &mut placing, shared)?;
            }
        }
        warnings.append(said);
        if primitive.influences.is_empty() && shown.iter().any(|s| s.instance.skin.is_some()) {
            let what = "has no joints (JOINTS_0), though a node shows it with a skin; it stays at the node";
            warnings.push(format!("{}.attributes", primitive.at), what);
        }
        placing.warn(&primitive.at, has_normals, warnings);
        Ok(())
    }

    /// Adds an instance of a primitive in its shape, with all its copies.
    fn place(
        &self,
        (primitive, shape): (&Primitive, &Local),
        instance: &Instance,
        placing: &mut Placing<'_>,
        mut shared: Option<(Option<&SharedShape>, &mut Sharing)>,
    ) -> Result<(), SceneError> {
        let node = instance.node;
        if let Some(skin) = instance.skin.filter(|_| !primitive.influences.is_empty()) {
            let (sets, accessors) = (&primitive.influences[..], self.accessors);
            let bones = Bones { matrices: &self.skins[skin], sets, accessors };
            return placing.add(shape, &Placement::Skinned(bones), node);
        }
        let mut add = |to_world: DMat4| {
            if let Some((of_all, shared)) = &mut shared {
                if let Some(of_all) = of_all
                    && of_all.place(to_world, &mut shared.instances)?
                {
                    return Ok(());
                }
                shared.copy(shape.triangles.len())?;
            }
            placing.add(shape, &Placement::Rigid(to_world), node)
        };
        let Some(copies) = &instance.copies else { return add(instance.to_world) };
        for copy in 0..copies.count {
            add(instance.to_world * copies.matrix(copy, self.accessors)?)?;
        }
        Ok(())
    }

    /// Gives the vertices of a primitive with a normal map, or that is brushed, their tangents: the
    /// file's, which is what it returns, or else computed ones. Without either, neither has an effect.
    fn add_tangents(
        &self,
        primitive: &Primitive,
        needed: &NeededTangents,
        local: &mut Local,
        warnings: &mut Warnings,
    ) -> bool {
        let NeededTangents { slot, what, is_textured } = needed;
        let has_coordinates = primitive.uv[slot.uv_set as usize].is_some();
        let missing = |warnings: &mut Warnings| {
            let at = format!("{}.attributes.TEXCOORD_{}", primitive.at, slot.uv_set);
            warnings.push(at, format!("is missing, so the material's {what} has no effect"));
        };
        if *is_textured && !has_coordinates {
            missing(warnings);
            return false;
        }
        // Without normals, the format says, tangents are to be computed with them.
        let given = primitive.tangent.filter(|_| primitive.normal.is_some());
        if let Some(accessor) = given.map(|index| &self.accessors[index]) {
            if tangents::read(accessor, local) {
                return true;
            }
            warnings.push(
                format!("{}.attributes.TANGENT", primitive.at),
                "has tangents that are zero or not finite; all are computed anew",
            );
        }
        if !has_coordinates {
            missing(warnings);
            return false;
        }
        if !tangents::compute(slot, local) {
            let what = format!(
                "has too many triangles at one vertex to compute tangents; the material's {what} has no effect"
            );
            warnings.push(&primitive.at, what);
        }
        false
    }

    /// Refuses more displacements by morph targets than are allowed.
    fn check_displacements(
        &self,
        meshes: &[Vec<Primitive>],
        shown: &[Vec<Shown<'_>>],
    ) -> Result<(), SceneError> {
        let mut total: u64 = 0;
        for (primitives, shown) in meshes.iter().zip(shown) {
            // No more vertices are read than triangles have corners.
            let vertices = |primitive: &Primitive| {
                let there = self.accessors[primitive.position].count as u64;
                there.min(3 * primitive.triangles as u64)
            };
            let vertices: u64 = primitives.iter().map(vertices).sum();
            for run in runs(shown) {
                let targets = morph::active_count(run[0].weights);
                total = total.saturating_add(vertices.saturating_mul(targets));
            }
        }
        if total <= morph::MAX_DISPLACEMENTS {
            return Ok(());
        }
        Err(SceneError::too_large(
            "meshes",
            format!(
                "morph targets displace {total} vertices, counted once for each target with a weight; {} are allowed",
                morph::MAX_DISPLACEMENTS
            ),
            "simplify the meshes, or give fewer morph targets a weight",
        ))
    }
}

/// How many instances show a primitive by their transform alone, and how many by their joints.
fn count_of(primitive: &Primitive, run: &[Shown<'_>]) -> [u64; 2] {
    let mut counts = [0u64; 2];
    for Shown { instance, .. } in run {
        let skinned = instance.skin.is_some() && !primitive.influences.is_empty();
        let count = &mut counts[usize::from(skinned)];
        *count = count.saturating_add(instance.count());
    }
    counts
}

/// What is shown of all meshes.
fn counts(meshes: &[Vec<Primitive>], shown: &[Vec<Shown<'_>>]) -> Counts {
    let mut counts = Counts::default();
    for (primitives, shown) in meshes.iter().zip(shown) {
        for run in runs(shown) {
            // Of each kind together, since a mesh of many primitives may have many instances.
            let mut of_kind: HashMap<bool, Option<[u64; 2]>> = HashMap::new();
            for primitive in primitives {
                let kind = of_kind.entry(primitive.influences.is_empty()).or_default();
                let [rigid, skinned] = *kind.get_or_insert_with(|| count_of(primitive, run));
                counts.add(primitive.triangles as u64, rigid, skinned);
            }
        }
    }
    counts
}

/// Where primitives go.
struct Whereto<'a> {
    scene: &'a mut Scene,
    warnings: &'a mut Warnings,
    shared: &'a mut Option<Sharing>,
}

/// What is shared, if anything is.
struct Sharing {
    instances: Instances,
    /// Triangles that may still be copied where instances can't share them.
    left: usize,
}

impl Sharing {
    fn new(limits: &ImportLimits) -> Self {
        Self { instances: Instances::default(), left: limits.max_triangles }
    }

    /// Counts triangles that are copied though instances were to share them.
    fn copy(&mut self, triangles: usize) -> Result<(), SceneError> {
        let left = self.left.checked_sub(triangles).ok_or_else(|| {
            SceneError::too_large(
                "meshes",
                "too many instances have transforms that leave some triangle hardly any area, and can't share their mesh",
                "simplify the meshes or send fewer instances",
            )
        })?;
        self.left = left;
        Ok(())
    }
}

/// What tangents are needed for.
struct NeededTangents {
    /// The texture along whose coordinates they are.
    slot: TextureSlot,
    /// What needs them.
    what: &'static str,
    /// Whether that is a texture, which needs coordinates, too.
    is_textured: bool,
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
    let layers = material.layering.iter().flat_map(|layering| layering.slots());
    let passed = material.translucency.iter().flat_map(|translucency| translucency.slots());
    for slot in slots.into_iter().flatten().chain(layers).chain(passed) {
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
