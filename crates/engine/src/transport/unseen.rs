//! What methods on patches can't show of a scene, whatever they make of its materials.

use crate::scene::{PunctualLight, Scene, Warning};

/// A warning for each material in use that makes caustics or lets light through.
pub fn by_patches(scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for index in used(scene) {
        let material = &scene.materials[index];
        let (name, at) = (&material.name, format!("materials[{index}]"));
        if material.is_translucent() {
            let what = format!(
                "{name:?} lets light through diffusely; patches show it as opaque; hemilux and ray-traced can"
            );
            warnings.push(Warning::new(at.clone(), what));
        }
        if material.clear_share() > 0.0 {
            let what = format!(
                "{name:?} lets light through; patches show it as opaque and cannot show its caustics; illumination-map and ray-traced can"
            );
            warnings.push(Warning::new(at, what));
        } else if material.casts_caustics() {
            let what = format!(
                "{name:?} mirrors sharply; patches cannot show its caustics; illumination-map and ray-traced can"
            );
            warnings.push(Warning::new(at, what));
        }
    }
    warnings
}

/// A warning where a scene of more than `most_triangles` has clear bodies, or mirrors of metal, and
/// light other than the sky's: up to there `hemilux` maps their caustics.
pub fn by_gathering(scene: &Scene, has_sun: bool, most_triangles: usize) -> Option<Warning> {
    let casts =
        has_sun || scene.emissive_triangles() > 0 || scene.lights.iter().any(PunctualLight::shines);
    let used = used(scene);
    let makes_caustics = |material: &usize| scene.materials[*material].casts_caustics();
    if scene.triangle_count() <= most_triangles || !casts || !used.iter().any(makes_caustics) {
        return None;
    }
    let what = format!(
        "there are clear bodies or mirrors and more than {most_triangles} triangles: caustics of lamps are noisy, and those of the sun and of lights without extent behind bent glass are missing; illumination-map shows them"
    );
    Some(Warning::new("scene", what))
}

/// The materials that triangles have, in order.
fn used(scene: &Scene) -> Vec<usize> {
    let used = scene.used_materials();
    (0..used.len()).filter(|material| used[*material]).collect()
}
