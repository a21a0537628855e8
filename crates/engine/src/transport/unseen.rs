//! What methods on patches can't show of a scene, whatever they make of its materials.

use crate::scene::{Scene, Warning};

/// Whether anything lets light through.
pub fn lets_light_through(scene: &Scene) -> bool {
    let mut materials = scene.triangles.iter().map(|triangle| triangle.material as usize);
    materials.any(|material| scene.materials[material].clear_share() > 0.0)
}

/// A warning for each material in use that makes caustics or lets light through.
pub fn by_patches(scene: &Scene) -> Vec<Warning> {
    let mut used = vec![false; scene.materials.len()];
    for triangle in &scene.triangles {
        used[triangle.material as usize] = true;
    }
    let mut warnings = Vec::new();
    for (index, material) in scene.materials.iter().enumerate().filter(|(index, _)| used[*index]) {
        let (name, at) = (&material.name, format!("materials[{index}]"));
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
