//! What methods on patches can't show of a scene, whatever they make of its materials.

use crate::scene::{PunctualLight, Scene, Warning};

/// A warning for each material in use that makes caustics or lets light through.
pub fn by_patches(scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for index in used(scene) {
        let material = &scene.materials[index];
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

/// What `hemilux` shows badly of a scene: caustics, which are made by light other than the sky's.
/// Those of clear bodies it maps, and beside them those of mirrors, up to `most_triangles`; other
/// ones its rays meet by chance.
pub fn by_gathering(scene: &Scene, has_sun: bool, most_triangles: usize) -> Vec<Warning> {
    let casts =
        has_sun || scene.emissive_triangles() > 0 || scene.lights.iter().any(PunctualLight::shines);
    if !casts {
        return Vec::new();
    }
    let used = used(scene);
    let is_clear = |material: &usize| scene.materials[*material].clear_share() > 0.0;
    if used.iter().any(is_clear) {
        let what = format!(
            "there are clear bodies and more than {most_triangles} triangles, so caustics of the sun and of lights without extent are missing, and those of lamps are noisy; illumination-map shows them"
        );
        let warning = (scene.triangles.len() > most_triangles).then(|| Warning::new("scene", what));
        return warning.into_iter().collect();
    }
    let mirrors = used.into_iter().filter(|material| scene.materials[*material].casts_caustics());
    let warning = |material: usize| {
        let name = &scene.materials[material].name;
        let what = format!(
            "{name:?} mirrors sharply; hemilux finds its caustics by chance, with noise; illumination-map shows them better"
        );
        Warning::new(format!("materials[{material}]"), what)
    };
    mirrors.map(warning).collect()
}

/// The materials that triangles have, in order.
fn used(scene: &Scene) -> Vec<usize> {
    let mut used = vec![false; scene.materials.len()];
    for triangle in &scene.triangles {
        used[triangle.material as usize] = true;
    }
    (0..used.len()).filter(|material| used[*material]).collect()
}
