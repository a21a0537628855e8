//! Morph targets: displacements of a primitive's vertices, of which weights say how much is added.

use super::accessor::Accessor;
use super::document::{MoreTargets, malformed};
use super::local::{Local, LocalVertex};
use super::node::Instance;
use super::pose::Pose;
use crate::scene::SceneError;
use glam::{Vec2, Vec4};
use gltf::json;
use gltf::json::Root;
use gltf::json::accessor::{ComponentType, Type};

/// Most displacements that are added in all: vertices times the targets that have a weight.
pub(super) const MAX_DISPLACEMENTS: u64 = 1 << 28;

/// Most weights of all instances together: all of them are looked at.
const MAX_WEIGHTS: u64 = 16 << 20;

/// A morph target: the accessors of its displacements.
#[derive(Default)]
pub(super) struct Target {
    position: Option<usize>,
    normal: Option<usize>,
    tangent: Option<usize>,
    uv: [Option<usize>; 2],
    color: Option<usize>,
}

/// Where a primitive's morph targets are in the file, and what they are read with.
pub(super) struct Place<'a> {
    /// The primitive.
    pub at: &'a str,
    /// Its mesh, and its place in it.
    pub of: (usize, usize),
    /// The file's accessors.
    pub accessors: &'a [Accessor<'a>],
    /// What the crate does not know of morph targets.
    pub more: &'a MoreTargets,
}

impl Place<'_> {
    /// The morph targets of a primitive of so many vertices, checked.
    pub fn targets(
        &self,
        object: &json::mesh::Primitive,
        vertices: usize,
    ) -> Result<Vec<Target>, SceneError> {
        use ComponentType::{F32, I8, I16, U8, U16};
        const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
        let objects = object.targets.as_deref().unwrap_or_default();
        let mut targets = Vec::with_capacity(objects.len());
        for (index, object) in objects.iter().enumerate() {
            let attribute = |name: &str, accessor: Option<usize>| {
                if let Some(accessor) = accessor {
                    let at = format!("{}.targets[{index}].{name}", self.at);
                    self.check(at, accessor, vertices, (&[Type::Vec3], QUANTIZED))?;
                }
                Ok::<_, SceneError>(accessor)
            };
            let value = |index: &Option<json::Index<_>>| index.as_ref().map(json::Index::value);
            targets.push(Target {
                position: attribute("POSITION", value(&object.positions))?,
                normal: attribute("NORMAL", value(&object.normals))?,
                tangent: attribute("TANGENT", value(&object.tangents))?,
                ..Target::default()
            });
        }
        for (index, name, accessor) in self.more.get(&self.of).into_iter().flatten() {
            let at = format!("{}.targets[{index}].{name}", self.at);
            let count = self.accessors.len();
            let Some(accessor) = usize::try_from(*accessor).ok().filter(|index| *index < count)
            else {
                return Err(malformed(at, format!("names none of the {count} accessors")));
            };
            let kinds: &[Type] =
                if *name == "COLOR_0" { &[Type::Vec3, Type::Vec4] } else { &[Type::Vec2] };
            self.check(at, accessor, vertices, (kinds, QUANTIZED))?;
            let target = &mut targets[*index];
            match *name {
                "COLOR_0" => target.color = Some(accessor),
                "TEXCOORD_0" => target.uv[0] = Some(accessor),
                _ => target.uv[1] = Some(accessor),
            }
        }
        Ok(targets)
    }

    /// Refuses an accessor that has not one displacement of that form for each vertex.
    fn check(
        &self,
        at: String,
        accessor: usize,
        vertices: usize,
        (kinds, components): (&[Type], &[ComponentType]),
    ) -> Result<(), SceneError> {
        let accessor = &self.accessors[accessor];
        if !kinds.contains(&accessor.kind) || !components.contains(&accessor.component) {
            let (kind, component) = (accessor.kind, accessor.component);
            return Err(malformed(at, format!("{} is {kind:?} of {component:?}", accessor.at)));
        }
        if accessor.count != vertices {
            let what = format!("has {} elements for {vertices} positions", accessor.count);
            return Err(malformed(at, what));
        }
        Ok(())
    }
}

/// By instance, how much of each morph target of its mesh is added; empty where nothing is.
pub(super) fn weights<'a>(
    root: &'a Root,
    pose: &'a Pose,
    instances: &[Instance],
) -> Result<Vec<&'a [f32]>, SceneError> {
    let counts = root.meshes.iter().enumerate().map(|(index, mesh)| target_count(index, mesh));
    let counts = counts.collect::<Result<Vec<_>, _>>()?;
    let total = instances
        .iter()
        .fold(0, |sum: u64, instance| sum.saturating_add(counts[instance.mesh] as u64));
    if total > MAX_WEIGHTS {
        return Err(SceneError::too_large(
            "nodes",
            format!(
                "{total} weights of morph targets with all instances; {MAX_WEIGHTS} are allowed"
            ),
            "send fewer instances of meshes with morph targets, or meshes with fewer of them",
        ));
    }
    let weights =
        instances.iter().map(|instance| weights_of(root, pose, instance, counts[instance.mesh]));
    weights.collect()
}

/// The number of morph targets of a mesh, which all its primitives share.
fn target_count(index: usize, mesh: &json::Mesh) -> Result<usize, SceneError> {
    let count = |primitive: &json::mesh::Primitive| primitive.targets.as_ref().map_or(0, Vec::len);
    let targets = mesh.primitives.first().map_or(0, count);
    match mesh.primitives.iter().position(|primitive| count(primitive) != targets) {
        None => Ok(targets),
        Some(place) => {
            let own = count(&mesh.primitives[place]);
            Err(malformed(
                format!("meshes[{index}].primitives[{place}].targets"),
                format!("{own} morph targets, but the mesh's first primitive has {targets}"),
            ))
        }
    }
}

/// The weights of an instance: as the pose says, or else the node, or else the mesh.
fn weights_of<'a>(
    root: &'a Root,
    pose: &'a Pose,
    instance: &Instance,
    targets: usize,
) -> Result<&'a [f32], SceneError> {
    let posed = pose.of(instance.node).and_then(|pose| pose.weights.as_deref());
    let own = root.nodes[instance.node].weights.as_deref();
    let of_mesh = root.meshes[instance.mesh].weights.as_deref();
    let (weights, at) = match (posed, own, of_mesh) {
        _ if targets == 0 => return Ok(&[]),
        (Some(weights), ..) => return Ok(weights),
        (_, Some(weights), _) => (weights, format!("nodes[{}].weights", instance.node)),
        (.., Some(weights)) => (weights, format!("meshes[{}].weights", instance.mesh)),
        _ => return Ok(&[]),
    };
    if weights.len() != targets {
        let what = format!("{} weights for {targets} morph targets", weights.len());
        return Err(malformed(at, what));
    }
    if let Some(place) = weights.iter().position(|weight| !weight.is_finite()) {
        return Err(malformed(format!("{at}[{place}]"), "is not finite"));
    }
    Ok(weights)
}

/// The targets that have a weight, each with it.
fn active<'a>(
    targets: &'a [Target],
    weights: &'a [f32],
) -> impl Iterator<Item = (&'a Target, f32)> {
    targets.iter().zip(weights.iter().copied()).filter(|(_, weight)| *weight != 0.0)
}

/// How many targets have a weight.
pub(super) fn active_count(weights: &[f32]) -> u64 {
    weights.iter().filter(|weight| **weight != 0.0).count() as u64
}

/// Adds what the weights say to everything but tangents, which a primitive may not have yet.
pub(super) fn displace(
    local: &mut Local,
    targets: &[Target],
    weights: &[f32],
    accessors: &[Accessor<'_>],
) -> Result<(), SceneError> {
    for (target, weight) in active(targets, weights) {
        let of = |index: Option<usize>| index.map(|index| &accessors[index]);
        let (position, normal, color) = (of(target.position), of(target.normal), of(target.color));
        let uvs = target.uv.map(of);
        for (vertex, source) in local.vertices.iter_mut().zip(&local.sources) {
            if let Some(by) = displacement(position, *source)? {
                let by = by.truncate().as_dvec3();
                vertex.position += f64::from(weight) * by;
            }
            if let Some(by) = displacement(normal.filter(|_| local.has_normals), *source)? {
                vertex.normal += weight * by.truncate();
            }
            for (uv, accessor) in vertex.uv.iter_mut().zip(uvs) {
                if let Some(by) = displacement(accessor, *source)? {
                    *uv += weight * Vec2::new(by.x, by.y);
                }
            }
            if let Some(by) = displacement(color, *source)? {
                vertex.color += weight * by.truncate();
                vertex.alpha += weight * by.w;
            }
        }
    }
    if active_count(weights) > 0 {
        local.vertices.iter_mut().for_each(settle);
    }
    Ok(())
}

/// Keeps what was displaced within what vertices may have.
fn settle(vertex: &mut LocalVertex) {
    let finite = |value: f32| if value.is_finite() { value } else { 1.0 };
    vertex.color = vertex.color.map(|channel| finite(channel).clamp(0.0, 1.0));
    vertex.alpha = finite(vertex.alpha).clamp(0.0, 1.0);
    for uv in &mut vertex.uv {
        if !uv.is_finite() {
            *uv = Vec2::ZERO;
        }
    }
}

/// Adds what the weights say to tangents that the file gives.
pub(super) fn displace_tangents(
    local: &mut Local,
    targets: &[Target],
    weights: &[f32],
    accessors: &[Accessor<'_>],
) -> Result<(), SceneError> {
    for (target, weight) in active(targets, weights) {
        let accessor = target.tangent.map(|index| &accessors[index]);
        for (vertex, source) in local.vertices.iter_mut().zip(&local.sources) {
            if let Some(by) = displacement(accessor, *source)? {
                vertex.tangent += (weight * by.truncate()).extend(0.0);
            }
        }
    }
    Ok(())
}

/// An element of an accessor; what a colour without alpha adds to alpha is 0.
fn displacement(accessor: Option<&Accessor<'_>>, element: u32) -> Result<Option<Vec4>, SceneError> {
    let Some(accessor) = accessor else { return Ok(None) };
    let value = Vec4::from_array(accessor.element(element as usize));
    if value.is_finite() {
        return Ok(Some(value));
    }
    Err(malformed(&accessor.at, format!("element {element} is not finite")))
}
