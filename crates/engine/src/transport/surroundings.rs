//! What surrounds the scene of a job, where the job does not say.

use crate::render::RenderRequest;
use crate::scene::environment::Environment;
use crate::scene::{Material, PunctualLight, Scene, Warning};
use std::sync::Arc;

/// What surrounds `scene` in a job: what the request names; else nothing where the scene has lights
/// of its own; else a neutral studio, with a warning that says so.
pub fn surroundings(scene: &Scene, request: &RenderRequest) -> (Arc<Environment>, Option<Warning>) {
    if let Some(environment) = &request.environment {
        return (environment.clone(), None);
    }
    if has_lights(scene) {
        return (Arc::new(Environment::none()), None);
    }
    let found = match scene.emissive_triangles() {
        0 => "nothing in the scene gives light",
        _ => "in the scene only textures glow, no brighter than a screen",
    };
    let what = format!(
        "{found}, so a neutral studio sky gives light; choose another sky or a sun, or none (on \
         the command line `--sky none`)"
    );
    (Arc::new(Environment::studio()), Some(Warning::new("environment", what)))
}

/// Whether the scene has lights of its own, or needs none since no surface of it takes part in light.
/// Textures that glow no brighter than white paper does on a screen are labels and displays: they do
/// not light what is around them.
fn has_lights(scene: &Scene) -> bool {
    let used = scene.used_materials();
    let mut materials =
        scene.materials.iter().zip(used).filter(|(_, used)| *used).map(|(own, _)| own);
    let is_lamp = |material: &Material| {
        material.emits()
            && (material.emission_texture.is_none() || material.emission.max_element() > 1.0)
    };
    scene.lights.iter().any(PunctualLight::shines)
        || materials.clone().any(is_lamp)
        || (scene.triangle_count() > 0 && materials.all(|material| material.unlit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Begin, CameraChoice, Limits};
    use crate::scene::environment::Sky;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;

    fn request(scene: Scene, environment: Option<Environment>) -> RenderRequest {
        RenderRequest {
            scene: Arc::new(scene),
            environment: environment.map(Arc::new),
            background: Default::default(),
            camera: CameraChoice::First,
            width: 4,
            height: 4,
            method: "auto".into(),
            limits: Limits::default(),
            seed: 0,
            options: Default::default(),
            begin: Begin::Afresh,
        }
    }

    #[test]
    fn scenes_without_lights_get_a_studio_and_all_others_what_they_ask_for() {
        let lit =
            import(&made::cornell(), &Resources::default(), &ImportLimits::default()).unwrap();
        let mut dark = lit.clone();
        dark.materials.iter_mut().for_each(|m| m.emission = Default::default());
        let sky = Environment { sky: Sky::Uniform(glam::Vec3::ONE), ..Environment::default() };
        for (scene, asked, is_dark, warns) in [
            (&lit, None, true, false),
            (&dark, None, false, true),
            (&dark, Some(Environment::none()), true, false),
            (&lit, Some(sky), false, false),
        ] {
            let request = request(scene.clone(), asked);
            let (environment, warning) = surroundings(&request.scene, &request);
            assert_eq!((environment.is_dark(), warning.is_some()), (is_dark, warns));
        }
    }
}
