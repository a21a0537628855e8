//! The node graph: which meshes, lights and cameras stand where.

use super::accessor::Accessor;
use super::choice::Choice;
use super::document::{self, malformed, valid};
use super::instancing::Copies;
use super::lights;
use super::limits::MAX_COORDINATE;
use super::pose::{NodePose, Pose};
use super::warnings::Warnings;
use crate::scene::{Camera, Projection, PunctualLight, SceneError};
use glam::{DMat4, DQuat, DVec3, DVec4, Mat4};
use gltf::json::camera::{Camera as Lens, Type};
use gltf::json::{self, Index, Root};
use std::f32::consts::PI;

/// Deepest chain of nodes; real scenes stay below a hundred.
const MAX_NODE_DEPTH: usize = 1000;
const VISIBILITY: &str = "KHR_node_visibility";

/// Farther from the origin than this, metres, single precision has steps of more than 6 cm: nothing
/// but a place on the globe is.
const FAR: f64 = 1e6;
/// By multiples of this it is moved back, metres, so that neighbours are moved alike.
const STEP: f64 = 1e3;

/// Most cameras of a scene: its description names each of them.
const MAX_CAMERAS: usize = 1024;

/// A mesh in its place.
pub(super) struct Instance {
    /// The node that places it.
    pub node: usize,
    /// Its mesh.
    pub mesh: usize,
    /// Mesh to world; of no use to what has joints.
    pub to_world: DMat4,
    /// Its skin.
    pub skin: Option<usize>,
    /// Where it stands about its node, if it stands there more than once.
    pub copies: Option<Copies>,
}

impl Instance {
    /// How often its mesh is shown.
    pub fn count(&self) -> u64 {
        self.copies.as_ref().map_or(1, |copies| copies.count as u64)
    }
}

/// What the chosen scene shows.
pub(super) struct Placed {
    /// Mesh instances, in node order.
    pub instances: Vec<Instance>,
    /// Lights without extent, in node order.
    pub lights: Vec<PunctualLight>,
    /// Cameras, in node order.
    pub cameras: Vec<Camera>,
    /// By node, what takes it to the world.
    pub worlds: Vec<DMat4>,
}

/// What the nodes are read with.
#[derive(Clone, Copy)]
pub(super) struct Graph<'a> {
    /// The file.
    pub root: &'a Root,
    /// Its accessors.
    pub accessors: &'a [Accessor<'a>],
    /// What an animation moves.
    pub pose: &'a Pose,
    /// The scene that is shown; `None` for the file's default one.
    pub scene: Option<&'a Choice>,
}

/// Reads the node graph and walks the chosen scene.
pub(super) fn place(graph: Graph<'_>, warnings: &mut Warnings) -> Result<Placed, SceneError> {
    let root = graph.root;
    let projections = root
        .cameras
        .iter()
        .enumerate()
        .map(|(index, lens)| usable(projection(lens, index, warnings), warnings))
        .collect::<Vec<_>>();
    let lights = lights::read(root, warnings)?;
    let nodes = &root.nodes[..];
    let carried =
        (0..nodes.len()).map(|node| lights::of_node(root, node)).collect::<Result<Vec<_>, _>>()?;
    let matrices = nodes
        .iter()
        .enumerate()
        .map(|(index, node)| {
            local_matrix(node, graph.pose.of(index), &format!("nodes[{index}]"), warnings)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let worlds = worlds(nodes, &matrices)?;
    let moved = DMat4::from_translation(-far_origin(root, &worlds, warnings));
    let (roots, at) = roots(root, graph.scene, warnings)?;

    let mut seen = vec![false; nodes.len()];
    let mut placed =
        Placed { instances: Vec::new(), lights: Vec::new(), cameras: Vec::new(), worlds };
    let (mut camera_nodes, mut light_nodes) = (Vec::new(), Vec::new());
    let begin = |node| (node, moved, true);
    let mut stack: Vec<_> = roots.into_iter().rev().map(begin).collect();
    while let Some((index, parent, is_parent_visible)) = stack.pop() {
        if std::mem::replace(&mut seen[index], true) {
            return Err(malformed(&at, format!("reaches node {index} twice")));
        }
        let node = &nodes[index];
        let to_world = parent * matrices[index];
        placed.worlds[index] = to_world;
        let is_visible = is_visible(node, index)? && is_parent_visible;
        if let Some(mesh) = node.mesh.filter(|_| is_visible) {
            let mesh = mesh.value();
            placed.instances.push(instance(graph, (index, mesh), to_world, warnings)?);
        }
        if let Some(camera) = node.camera {
            camera_nodes.push((index, camera.value(), to_world));
        }
        if let Some(light) = carried[index].filter(|_| is_visible) {
            light_nodes.push((index, light, to_world));
        }
        stack.extend(children(node).rev().map(|child| (child, to_world, is_visible)));
    }
    placed.instances.sort_by_key(|instance| instance.node);
    camera_nodes.sort_by_key(|(node, ..)| *node);
    light_nodes.sort_by_key(|(node, ..)| *node);
    placed.lights = lights::placed(root, &lights, light_nodes, warnings)?;
    placed.cameras = cameras(root, &projections, camera_nodes, warnings);
    Ok(placed)
}

/// About the middle of the nodes that have meshes, where these are so far away that the
/// scene is to be shown at the origin instead; else zero. Joints may be in no scene and stay where
/// they are.
fn far_origin(root: &Root, worlds: &[DMat4], warnings: &mut Warnings) -> DVec3 {
    let shown = root.nodes.iter().zip(worlds).filter(|(node, _)| node.mesh.is_some());
    let places = shown.map(|(_, world)| world.w_axis.truncate());
    let count = places.clone().count().max(1) as f64;
    let middle = STEP * (places.clone().sum::<DVec3>() / (STEP * count)).round();
    let is_far = middle.is_finite() && middle.length() > FAR;
    if !is_far || !root.skins.is_empty() || !places.clone().all(|place| place.length() > 0.5 * FAR)
    {
        return DVec3::ZERO;
    }
    let [x, y, z] = (DVec3::ZERO - middle).to_array();
    let what = format!(
        "the scene stands where single precision is coarse; all of it is moved by ({x}, {y}, {z}), also for cameras of your own"
    );
    warnings.push("nodes", what);
    middle
}

/// Whether the meshes and lights of a node, and of those below it, are shown (KHR_node_visibility).
fn is_visible(node: &json::Node, index: usize) -> Result<bool, SceneError> {
    let extension = node.extensions.as_ref().and_then(|all| all.others.get(VISIBILITY));
    match extension.and_then(|extension| extension.get("visible")) {
        None => Ok(true),
        Some(json::Value::Bool(visible)) => Ok(*visible),
        Some(_) => Err(malformed(
            format!("nodes[{index}].extensions.{VISIBILITY}.visible"),
            "is neither true nor false",
        )),
    }
}

/// The mesh of a node.
fn instance(
    Graph { root, accessors, .. }: Graph<'_>,
    (node, mesh): (usize, usize),
    to_world: DMat4,
    warnings: &mut Warnings,
) -> Result<Instance, SceneError> {
    let skin = root.nodes[node].skin.map(|skin| skin.value());
    let mut copies = Copies::of_node(root, node, accessors, warnings)?;
    if skin.is_some() && copies.take().is_some() {
        let what = "instances of a mesh with a skin are ignored; it is shown once";
        warnings.push(format!("nodes[{node}].extensions.EXT_mesh_gpu_instancing"), what);
    }
    Ok(Instance { node, mesh, to_world, skin, copies })
}

/// The cameras of `nodes`: the node's index, the camera's, and the transform to the world.
fn cameras(
    root: &Root,
    projections: &[Option<Projection>],
    nodes: Vec<(usize, usize, DMat4)>,
    warnings: &mut Warnings,
) -> Vec<Camera> {
    let mut cameras = Vec::new();
    let mut left_out = 0_usize;
    for (node, camera, to_world) in nodes {
        if cameras.len() == MAX_CAMERAS {
            left_out += 1;
            continue;
        }
        let Some(projection) = projections[camera] else { continue };
        let Some(to_world) = frame(to_world) else {
            warnings.push(
                format!("nodes[{node}]"),
                "its camera is left out: the node's transform is singular or out of range",
            );
            continue;
        };
        let name = document::name(&root.nodes[node].name)
            .or_else(|| document::name(&root.cameras[camera].name));
        cameras.push(Camera {
            name: name.unwrap_or_else(|| format!("camera {}", cameras.len())),
            to_world,
            projection,
        });
    }
    if left_out > 0 {
        let what =
            format!("only the first {MAX_CAMERAS} cameras are kept; {left_out} are left out");
        warnings.push("nodes", what);
    }
    cameras
}

fn children(node: &json::Node) -> impl DoubleEndedIterator<Item = usize> {
    node.children.iter().flatten().map(Index::value)
}

/// The nodes that the shown scene begins with, and where the file says so.
fn roots(
    root: &Root,
    chosen: Option<&Choice>,
    warnings: &mut Warnings,
) -> Result<(Vec<usize>, String), SceneError> {
    let names: Vec<_> = root.scenes.iter().map(|scene| scene.name.as_deref()).collect();
    let chosen = chosen.map(|choice| choice.find("scenes", "scene", &names)).transpose()?;
    let shown = chosen.unwrap_or_else(|| root.scene.map_or(0, |scene| scene.value()));
    if let Some(scene) = root.scenes.get(shown) {
        let count = names.len();
        if count > 1 && chosen.is_none() {
            let what = format!(
                "only scene {shown} of {count} is shown; `gltf_scene` of a job and `--scene` of the command line choose another by its name or index"
            );
            warnings.push("scenes", what);
        }
        let nodes = scene.nodes.iter().map(Index::value).collect();
        return Ok((nodes, format!("scenes[{shown}].nodes")));
    }
    warnings.push("scenes", "the file has no scene; all root nodes are shown");
    let mut is_shown = vec![true; root.nodes.len()];
    for node in &root.nodes {
        for other in children(node).chain(coarser(node)) {
            if let Some(is_shown) = is_shown.get_mut(other) {
                *is_shown = false;
            }
        }
    }
    Ok(((0..root.nodes.len()).filter(|node| is_shown[*node]).collect(), "scenes".into()))
}

/// The nodes that show the same with less detail (MSFT_lod); those that are in no scene anyway need
/// no care.
fn coarser(node: &json::Node) -> impl Iterator<Item = usize> {
    let extension = node.extensions.as_ref().and_then(|all| all.others.get("MSFT_lod"));
    let ids = extension.and_then(|extension| extension.get("ids")?.as_array());
    ids.into_iter().flatten().filter_map(|id| usize::try_from(id.as_u64()?).ok())
}

fn local_matrix(
    node: &json::Node,
    pose: Option<&NodePose>,
    at: &str,
    warnings: &mut Warnings,
) -> Result<DMat4, SceneError> {
    if let Some(numbers) = node.matrix {
        let matrix = DMat4::from_cols_array(&numbers.map(f64::from));
        if !matrix.row(3).abs_diff_eq(DVec4::W, 1e-4) {
            return Err(malformed(
                format!("{at}.matrix"),
                "is not affine: its last row must be 0 0 0 1",
            ));
        }
        return Ok(matrix);
    }
    let translation = DVec3::from_array(node.translation.unwrap_or([0.0; 3]).map(f64::from));
    let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]).map(f64::from));
    let rotation = rotation(node, at, warnings)?;
    let (translation, rotation, scale) = match pose {
        None => (translation, rotation, scale),
        Some(pose) => (
            pose.translation.unwrap_or(translation),
            pose.rotation.unwrap_or(rotation),
            pose.scale.unwrap_or(scale),
        ),
    };
    Ok(DMat4::from_scale_rotation_translation(scale, rotation, translation))
}

fn rotation(node: &json::Node, at: &str, warnings: &mut Warnings) -> Result<DQuat, SceneError> {
    let rotation = DQuat::from_array(node.rotation.unwrap_or_default().0.map(f64::from));
    let length = rotation.length();
    let at = || format!("{at}.rotation");
    if !(length.is_finite() && length > 1e-6) {
        return Err(malformed(at(), "is not a rotation: its length is 0 or not finite"));
    }
    if (length - 1.0).abs() > 1e-2 {
        let what = format!("the quaternion has length {length:.3}; it is normalised");
        warnings.push(at(), what);
    }
    Ok(rotation / length)
}

/// What takes each node to the world, shown or not: joints need not be in the shown scene. Refuses
/// nodes with two parents, cycles and chains beyond [`MAX_NODE_DEPTH`].
fn worlds(nodes: &[json::Node], matrices: &[DMat4]) -> Result<Vec<DMat4>, SceneError> {
    let mut parents = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for (place, child) in children(node).enumerate() {
            if let Some(other) = parents[child].replace(index) {
                return Err(malformed(
                    format!("nodes[{index}].children[{place}]"),
                    format!("node {child} is a child of node {other} already"),
                ));
            }
        }
    }
    // With one parent at most, what is not below a root is on or below a cycle.
    let mut worlds = matrices.to_vec();
    let mut depth: Vec<usize> = vec![0; nodes.len()];
    let mut stack: Vec<_> = (0..nodes.len()).filter(|node| parents[*node].is_none()).collect();
    for root in &stack {
        depth[*root] = 1;
    }
    while let Some(index) = stack.pop() {
        if depth[index] > MAX_NODE_DEPTH {
            return Err(SceneError::too_large(
                format!("nodes[{index}]"),
                format!("lies more than {MAX_NODE_DEPTH} levels deep"),
                "flatten the node hierarchy",
            ));
        }
        for child in children(&nodes[index]) {
            depth[child] = depth[index] + 1;
            worlds[child] = worlds[index] * matrices[child];
            stack.push(child);
        }
    }
    match depth.iter().position(|depth| *depth == 0) {
        None => Ok(worlds),
        Some(index) => Err(malformed(
            format!("nodes[{index}]"),
            "the node is its own ancestor, or below one that is",
        )),
    }
}

/// The projection, or a warning of what is wrong with it: the scene can be seen by other cameras.
fn usable(
    projection: Result<Projection, SceneError>,
    warnings: &mut Warnings,
) -> Option<Projection> {
    projection
        .map_err(|SceneError { at, what, .. }| {
            let what = format!("{what}; the camera is left out, name one of your own instead");
            warnings.push(at, what);
        })
        .ok()
}

fn projection(
    camera: &Lens,
    index: usize,
    warnings: &mut Warnings,
) -> Result<Projection, SceneError> {
    let at = format!("cameras[{index}]");
    match valid(&camera.type_, format!("{at}.type"))? {
        Type::Perspective => {
            let at = format!("{at}.perspective");
            let lens = camera.perspective.as_ref().ok_or_else(|| malformed(&at, "is missing"))?;
            let yfov = lens.yfov;
            if !(yfov > 1e-4 && yfov < PI - 1e-4) {
                return Err(malformed(
                    format!("{at}.yfov"),
                    format!("{yfov} radians is not a field of view between 0 and π"),
                ));
            }
            Ok(Projection::Perspective { yfov })
        }
        Type::Orthographic => {
            let at = format!("{at}.orthographic");
            let lens = camera.orthographic.as_ref().ok_or_else(|| malformed(&at, "is missing"))?;
            let at = format!("{at}.ymag");
            if lens.ymag < 0.0 {
                warnings.push(&at, "is negative; its magnitude is used");
            }
            let ymag = lens.ymag.abs();
            if !(1e-6..=1e8).contains(&ymag) {
                return Err(malformed(at, "is not a usable half height in metres"));
            }
            Ok(Projection::Orthographic { ymag })
        }
    }
}

/// The camera's frame without scale and shear: −Z stays where it looks, +Y as near as can be.
fn frame(to_world: DMat4) -> Option<Mat4> {
    let eye = to_world.w_axis.truncate();
    let backward = to_world.z_axis.truncate().try_normalize()?;
    let up = to_world.y_axis.truncate().try_normalize()?;
    let right = up.cross(backward);
    to_world.x_axis.truncate().try_normalize()?;
    // Below this the two axes are one for f32.
    let right = (right.length() > 1e-6).then(|| right.normalize())?;
    let up = backward.cross(right);
    let frame =
        DMat4::from_cols(right.extend(0.0), up.extend(0.0), backward.extend(0.0), eye.extend(1.0))
            .as_mat4();
    (frame.is_finite() && eye.abs().max_element() <= MAX_COORDINATE).then_some(frame)
}
