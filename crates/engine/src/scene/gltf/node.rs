//! The node graph: which meshes and cameras stand where.

use super::Warnings;
use super::json::{Object, malformed};
use crate::scene::{Camera, Projection, SceneError};
use glam::{DMat4, DQuat, DVec3, DVec4, Mat4};
use std::f64::consts::PI;

/// Deepest chain of nodes; real scenes stay below a hundred.
const MAX_NODE_DEPTH: usize = 1000;

struct Node {
    matrix: DMat4,
    children: Vec<usize>,
    mesh: Option<usize>,
    camera: Option<usize>,
    name: Option<String>,
}

/// A mesh in its place.
pub(super) struct Instance {
    /// The node that places it.
    pub node: usize,
    /// Its mesh.
    pub mesh: usize,
    /// Mesh to world.
    pub to_world: DMat4,
}

/// What the chosen scene shows.
pub(super) struct Placed {
    /// Mesh instances, in node order.
    pub instances: Vec<Instance>,
    /// Cameras, in node order.
    pub cameras: Vec<Camera>,
}

/// Reads the node graph and walks the chosen scene.
pub(super) fn place(root: &Object<'_>, warnings: &mut Warnings) -> Result<Placed, SceneError> {
    let objects = root.objects("nodes")?;
    let mesh_count = root.count("meshes")?;
    let cameras = root.objects("cameras")?;
    let projections =
        cameras.iter().map(|object| projection(object, warnings)).collect::<Result<Vec<_>, _>>()?;
    let nodes = objects
        .iter()
        .map(|object| node(object, objects.len(), mesh_count, cameras.len(), warnings))
        .collect::<Result<Vec<_>, _>>()?;
    check_forest(&nodes)?;
    let (roots, at) = roots(root, &nodes, warnings)?;

    let mut seen = vec![false; nodes.len()];
    let mut placed = Placed { instances: Vec::new(), cameras: Vec::new() };
    let mut camera_nodes = Vec::new();
    let mut stack: Vec<_> = roots.into_iter().rev().map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        if std::mem::replace(&mut seen[index], true) {
            return Err(malformed(&at, format!("reaches node {index} twice")));
        }
        let node = &nodes[index];
        let to_world = parent * node.matrix;
        if let Some(mesh) = node.mesh {
            placed.instances.push(Instance { node: index, mesh, to_world });
        }
        if let Some(camera) = node.camera {
            camera_nodes.push((index, camera, to_world));
        }
        stack.extend(node.children.iter().rev().map(|child| (*child, to_world)));
    }
    placed.instances.sort_by_key(|instance| instance.node);
    camera_nodes.sort_by_key(|(node, ..)| *node);
    for (index, camera, to_world) in camera_nodes {
        let Some(to_world) = frame(to_world) else {
            warnings.push(
                format!("nodes[{index}]"),
                "its camera is left out: the node's transform is singular or out of range",
            );
            continue;
        };
        let name = nodes[index].name.clone().or(cameras[camera].name()?);
        placed.cameras.push(Camera {
            name: name.unwrap_or_else(|| format!("camera {}", placed.cameras.len())),
            to_world,
            projection: projections[camera],
        });
    }
    Ok(placed)
}

/// The nodes that the shown scene begins with, and where the file says so.
fn roots(
    root: &Object<'_>,
    nodes: &[Node],
    warnings: &mut Warnings,
) -> Result<(Vec<usize>, String), SceneError> {
    let scenes = root.objects("scenes")?;
    let chosen = root.index("scene", scenes.len(), "scenes")?;
    if let Some(scene) = scenes.get(chosen.unwrap_or(0)) {
        if scenes.len() > 1 {
            let shown = chosen.unwrap_or(0);
            warnings.push(
                "scenes",
                format!("only scene {shown} of {} is shown; `scene` chooses", scenes.len()),
            );
        }
        let at = scene.path("nodes");
        return Ok((scene.indices("nodes", nodes.len(), "nodes")?, at));
    }
    warnings.push("scenes", "the file has no scene; all root nodes are shown");
    let mut is_child = vec![false; nodes.len()];
    for node in nodes {
        for child in &node.children {
            is_child[*child] = true;
        }
    }
    Ok(((0..nodes.len()).filter(|node| !is_child[*node]).collect(), "scenes".into()))
}

fn node(
    object: &Object<'_>,
    nodes: usize,
    meshes: usize,
    cameras: usize,
    warnings: &mut Warnings,
) -> Result<Node, SceneError> {
    let mesh = object.index("mesh", meshes, "meshes")?;
    if object.has("skin") {
        warnings.push(object.path("skin"), "skinning is ignored; the mesh is shown as bound");
    }
    if object.extension("KHR_lights_punctual")?.is_some() {
        warnings.push(
            object.path("extensions.KHR_lights_punctual"),
            "the light is ignored; give a surface emission to light the scene",
        );
    }
    if object.extension("EXT_mesh_gpu_instancing")?.is_some() {
        warnings.push(
            object.path("extensions.EXT_mesh_gpu_instancing"),
            "instancing is ignored; the mesh is shown once, at the node itself",
        );
    }
    Ok(Node {
        matrix: local_matrix(object, warnings)?,
        children: object.indices("children", nodes, "nodes")?,
        mesh,
        camera: object.index("camera", cameras, "cameras")?,
        name: object.name()?,
    })
}

fn local_matrix(object: &Object<'_>, warnings: &mut Warnings) -> Result<DMat4, SceneError> {
    if let Some(numbers) = object.numbers::<16>("matrix")? {
        let matrix = DMat4::from_cols_array(&numbers);
        let last = DVec4::new(numbers[3], numbers[7], numbers[11], numbers[15]);
        if !last.abs_diff_eq(DVec4::W, 1e-4) {
            return Err(malformed(
                object.path("matrix"),
                "is not affine: its last row must be 0 0 0 1",
            ));
        }
        return Ok(matrix);
    }
    let translation = object.numbers::<3>("translation")?.unwrap_or([0.0; 3]);
    let scale = object.numbers::<3>("scale")?.unwrap_or([1.0; 3]);
    let rotation = object.numbers::<4>("rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = DQuat::from_array(rotation);
    let length = rotation.length();
    if !(length.is_finite() && length > 1e-6) {
        return Err(malformed(
            object.path("rotation"),
            "is not a rotation: its length is 0 or not finite",
        ));
    }
    if (length - 1.0).abs() > 1e-2 {
        warnings.push(
            object.path("rotation"),
            format!("the quaternion has length {length:.3}; it is normalised"),
        );
    }
    Ok(DMat4::from_scale_rotation_translation(
        DVec3::from_array(scale),
        rotation / length,
        DVec3::from_array(translation),
    ))
}

/// Refuses nodes with two parents, cycles and chains beyond [`MAX_NODE_DEPTH`], shown or not.
fn check_forest(nodes: &[Node]) -> Result<(), SceneError> {
    let mut parents = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for (place, child) in node.children.iter().enumerate() {
            if let Some(other) = parents[*child].replace(index) {
                return Err(malformed(
                    format!("nodes[{index}].children[{place}]"),
                    format!("node {child} is a child of node {other} already"),
                ));
            }
        }
    }
    // With one parent at most, what is not below a root is on or below a cycle.
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
        for child in &nodes[index].children {
            depth[*child] = depth[index] + 1;
            stack.push(*child);
        }
    }
    match depth.iter().position(|depth| *depth == 0) {
        None => Ok(()),
        Some(index) => Err(malformed(
            format!("nodes[{index}]"),
            "the node is its own ancestor, or below one that is",
        )),
    }
}

fn projection(object: &Object<'_>, warnings: &mut Warnings) -> Result<Projection, SceneError> {
    let kind = object.string("type")?.ok_or_else(|| object.missing("type"))?;
    let parameters = |key: &str| object.object(key)?.ok_or_else(|| object.missing(key));
    match kind {
        "perspective" => {
            let lens = parameters("perspective")?;
            let yfov = lens.number("yfov")?.ok_or_else(|| lens.missing("yfov"))?;
            if !(yfov > 1e-4 && yfov < PI - 1e-4) {
                return Err(malformed(
                    lens.path("yfov"),
                    format!("{yfov} radians is not a field of view between 0 and π"),
                ));
            }
            Ok(Projection::Perspective { yfov: yfov as f32 })
        }
        "orthographic" => {
            let lens = parameters("orthographic")?;
            let ymag = lens.number("ymag")?.ok_or_else(|| lens.missing("ymag"))?;
            if ymag < 0.0 {
                warnings.push(lens.path("ymag"), "is negative; its magnitude is used");
            }
            let ymag = ymag.abs();
            if !(1e-6..=1e8).contains(&ymag) {
                return Err(malformed(lens.path("ymag"), "is not a usable half height in metres"));
            }
            Ok(Projection::Orthographic { ymag: ymag as f32 })
        }
        _ => Err(malformed(object.path("type"), "is neither perspective nor orthographic")),
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
    (frame.is_finite() && eye.abs().max_element() <= super::MAX_COORDINATE).then_some(frame)
}
