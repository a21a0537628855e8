//! KHR_lights_punctual: lights without extent, and where nodes place them.

use super::document::{self, malformed};
use super::limits::MAX_COORDINATE;
use super::warnings::Warnings;
use crate::radiometry::Rgb;
use crate::scene::{LightKind, PunctualLight, SceneError};
use glam::{DMat4, DVec3, Vec3};
use gltf::json::Root;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Spot, Type};
use gltf::json::validation::Checked;
use std::f32::consts::FRAC_PI_2;

/// Most lights of a scene: each is asked for at every point.
const MAX_LIGHTS: usize = 16_384;

/// Largest intensity, in the file's unit: far above the sun, well within f32.
const MAX_INTENSITY: f32 = 1e12;

/// What is left of an inner cone that is as wide as the outer one, so that light can fall off.
const NARROWED: f32 = 0.999;

/// A node that carries a light: the node's index, the light's, and the transform to the world.
pub(super) type LightNode = (usize, usize, DMat4);

/// Where the file lists its lights.
const LIST: &str = "extensions.KHR_lights_punctual.lights";

/// The file's lights, in its order, as they are at the origin, shining along −Z; `None` for those
/// of an unknown kind.
pub(super) fn read(
    root: &Root,
    warnings: &mut Warnings,
) -> Result<Vec<Option<PunctualLight>>, SceneError> {
    let objects = listed(root).iter().enumerate();
    objects.map(|(index, object)| light(object, &format!("{LIST}[{index}]"), warnings)).collect()
}

fn listed(root: &Root) -> &[Light] {
    let extension = root.extensions.as_ref().and_then(|all| all.khr_lights_punctual.as_ref());
    extension.map_or(&[], |extension| &extension.lights)
}

/// The light that a node names; refused where the file has it not.
pub(super) fn of_node(root: &Root, node: usize) -> Result<Option<usize>, SceneError> {
    let extensions = root.nodes[node].extensions.as_ref();
    let Some(own) = extensions.and_then(|all| all.khr_lights_punctual.as_ref()) else {
        return Ok(None);
    };
    let (light, count) = (own.light.value(), listed(root).len());
    if light >= count {
        return Err(malformed(
            format!("nodes[{node}].extensions.KHR_lights_punctual.light"),
            format!("{light}, but there are {count} lights"),
        ));
    }
    Ok(Some(light))
}

fn light(
    object: &Light,
    at: &str,
    warnings: &mut Warnings,
) -> Result<Option<PunctualLight>, SceneError> {
    let Checked::Valid(kind) = object.type_ else {
        let what = "is not a kind of light that is known; the light is left out, export it as point, spot or directional";
        warnings.push(format!("{at}.type"), what);
        return Ok(None);
    };
    let kind = match kind {
        Type::Point => LightKind::Point,
        Type::Directional => LightKind::Directional,
        Type::Spot => {
            let at = format!("{at}.spot");
            let spot = object.spot.as_ref().ok_or_else(|| malformed(&at, "is missing"))?;
            cone(spot, &at, warnings)?
        }
    };
    let color = Rgb::from_array(object.color);
    if !(color.is_finite() && color.min_element() >= 0.0) {
        return Err(malformed(format!("{at}.color"), "is negative or not finite"));
    }
    let strength = object.intensity;
    if !(strength.is_finite() && strength >= 0.0) {
        let what = format!("{strength:e} is negative or not finite");
        return Err(malformed(format!("{at}.intensity"), what));
    }
    let mut intensity = color * strength;
    if intensity.max_element() > MAX_INTENSITY {
        warnings.push(at, format!("is brighter than {MAX_INTENSITY:e}; it is clamped"));
        intensity = intensity.min(Rgb::splat(MAX_INTENSITY));
    }
    if let Some(range) = object.range
        && !(range.is_finite() && range > 0.0)
    {
        let what = format!("{range:e} is not a distance above 0");
        return Err(malformed(format!("{at}.range"), what));
    }
    Ok(Some(PunctualLight {
        name: document::name(&object.name).unwrap_or_default(),
        kind,
        position: Vec3::ZERO,
        direction: Vec3::NEG_Z,
        intensity,
        range: object.range,
    }))
}

fn cone(spot: &Spot, at: &str, warnings: &mut Warnings) -> Result<LightKind, SceneError> {
    let (mut inner, outer) = (spot.inner_cone_angle, spot.outer_cone_angle);
    if !(outer > 0.0 && outer <= FRAC_PI_2) {
        let what = format!("{outer} radians is not in (0, π/2]");
        return Err(malformed(format!("{at}.outerConeAngle"), what));
    }
    let inner_at = || format!("{at}.innerConeAngle");
    if !(inner >= 0.0 && inner <= outer) {
        let what = format!("{inner} radians is not in [0, {outer}), the outer cone's angle");
        return Err(malformed(inner_at(), what));
    }
    if inner == outer {
        // Some exporters write a hard edge so, though the format wants a difference.
        warnings.push(inner_at(), "is as large as the outer cone's; it is taken 0.1 % smaller");
        inner = NARROWED * outer;
    }
    Ok(LightKind::Spot { inner_cone: inner, outer_cone: outer })
}

/// The lights of `nodes` in the world.
pub(super) fn placed(
    root: &Root,
    lights: &[Option<PunctualLight>],
    nodes: Vec<LightNode>,
    warnings: &mut Warnings,
) -> Result<Vec<PunctualLight>, SceneError> {
    if nodes.len() > MAX_LIGHTS {
        return Err(SceneError::too_large(
            "nodes",
            format!("{} of them carry lights; {MAX_LIGHTS} are allowed", nodes.len()),
            "send fewer lights, or shining surfaces instead",
        ));
    }
    let mut placed = Vec::new();
    for (node, light, to_world) in nodes {
        let Some(light) = &lights[light] else { continue };
        let position = to_world.w_axis.truncate();
        let direction = to_world.transform_vector3(DVec3::NEG_Z).try_normalize();
        let direction = match (light.kind, direction) {
            (_, Some(direction)) => direction.as_vec3(),
            (LightKind::Point, None) => Vec3::NEG_Z,
            _ => Vec3::ZERO,
        };
        let is_near = position.is_finite() && position.abs().max_element() <= MAX_COORDINATE;
        if direction == Vec3::ZERO || !is_near {
            warnings.push(
                format!("nodes[{node}]"),
                "its light is left out: the node's transform is singular or out of range",
            );
            continue;
        }
        let mut name = document::name(&root.nodes[node].name).unwrap_or_else(|| light.name.clone());
        if name.is_empty() {
            name = format!("light {}", placed.len());
        }
        let position = position.as_vec3();
        placed.push(PunctualLight { name, position, direction, ..light.clone() });
    }
    Ok(placed)
}
