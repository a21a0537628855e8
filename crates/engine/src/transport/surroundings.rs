//! What surrounds the scene of a job, where the job does not say.

use crate::render::RenderRequest;
use crate::scene::environment::Environment;
use crate::scene::{Material, PunctualLight, Scene, Triangle, Warning};
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
        _ => "what glows in the scene is no brighter than a screen",
    };
    let what = format!(
        "{found}, so a neutral studio sky gives light; choose another sky or a sun, or none (on \
         the command line `--sky none`)"
    );
    (Arc::new(Environment::studio()), Some(Warning::new("environment", what)))
}

/// Whether the scene has lights of its own, or needs none since no surface of it takes part in light.
/// What glows no brighter than white paper does on a screen, the most that the format's core allows,
/// is a label, a display or the headlight of a parked car: it does not light what is around it, unless
/// all surfaces glow.
fn has_lights(scene: &Scene) -> bool {
    let material = |triangle: &Triangle| &scene.materials[triangle.material as usize];
    let is_lamp = |material: &Material| material.emits() && material.emission.max_element() > 1.0;
    let glows = |material: &Material| material.emits() && material.emission_texture.is_none();
    let mut materials = scene.triangles.iter().map(material);
    scene.lights.iter().any(PunctualLight::shines)
        || materials.clone().any(is_lamp)
        || (!scene.triangles.is_empty()
            && materials.all(|material| material.unlit || glows(material)))
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

    /// By how bright one wall of a room glows, and all the others: whether they light the scene.
    #[test]
    fn what_glows_like_a_screen_lights_nothing_unless_it_is_all_there_is() {
        let room =
            import(&made::cornell(), &Resources::default(), &ImportLimits::default()).unwrap();
        let lamp = room.materials.iter().position(Material::emits).expect("a lamp");
        for (of_lamp, of_others, is_lit) in [
            (1.0, 0.0, false),
            (1.001, 0.0, true),
            (0.2, 0.0, false),
            (0.2, 0.1, true),
            (0.0, 0.0, false),
        ] {
            let mut scene = room.clone();
            for (index, material) in scene.materials.iter_mut().enumerate() {
                let glow = if index == lamp { of_lamp } else { of_others };
                material.emission = glam::Vec3::splat(glow);
            }
            let request = request(scene, None);
            let (environment, warning) = surroundings(&request.scene, &request);
            let found = (environment.is_dark(), warning.is_none());
            assert_eq!(found, (is_lit, is_lit), "{of_lamp} {of_others}");
        }
    }
}
