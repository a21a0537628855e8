//! What surrounds the scene of a job, where the job does not say.

use crate::render::RenderRequest;
use crate::scene::environment::Environment;
use crate::scene::{Material, PunctualLight, Scene, Warning};
use std::sync::Arc;

/// Mean radiance of all surfaces from which what glows lights a scene: that of a white wall lit by a
/// studio would be 1.
const LEAST_GLOW: f64 = 0.003;

/// What surrounds the scene of a job: what the request names; else nothing where the scene has lights of its own, among
/// them what glows in it if it lights the scene (`lights_itself`, asked for where that matters); else a neutral studio,
/// with a warning that says so.
pub fn surroundings(
    request: &RenderRequest,
    lights_itself: impl FnOnce() -> bool,
) -> (Arc<Environment>, Option<Warning>) {
    if let Some(environment) = without_glow(request) {
        return (environment, None);
    }
    let scene = &*request.scene;
    let glows = glows_enough(scene);
    if glows && lights_itself() {
        return (Arc::new(Environment::none()), None);
    }
    let found = match scene.emissive_triangles() {
        0 => "nothing in the scene gives light",
        _ if glows => "what glows in the scene lights hardly any of it",
        _ => "what glows in the scene is no brighter than a screen",
    };
    let what = format!(
        "{found}, so a neutral studio sky gives light; choose another sky or a sun, or none (on \
         the command line `--sky none`)"
    );
    (Arc::new(Environment::studio()), Some(Warning::new("environment", what)))
}

/// What may surround the scene of a job at most: what does if nothing that glows in it lights it.
pub fn most_around(request: &RenderRequest) -> Arc<Environment> {
    without_glow(request).unwrap_or_else(|| Arc::new(Environment::studio()))
}

/// What surrounds the scene of a job where that does not depend on what glows in it.
fn without_glow(request: &RenderRequest) -> Option<Arc<Environment>> {
    let none = || has_lights(&request.scene).then(|| Arc::new(Environment::none()));
    request.environment.clone().or_else(none)
}

/// Whether the scene has lights beside what glows, or needs none since no surface of it takes part in light.
fn has_lights(scene: &Scene) -> bool {
    let is_unlit = |(material, used): (&Material, bool)| material.unlit || !used;
    scene.lights.iter().any(PunctualLight::shines)
        || (scene.triangle_count() > 0
            && scene.materials.iter().zip(scene.used_materials()).all(is_unlit))
}

/// Whether surfaces glow brightly enough to light what they shine on. Textures that glow no brighter than white paper
/// does on a screen, the most that the format's core allows, are labels and displays: they do not. Nor do plain
/// surfaces that glow so where they are too small.
fn glows_enough(scene: &Scene) -> bool {
    let used = scene.used_materials();
    let mut materials =
        scene.materials.iter().zip(used).filter(|(_, used)| *used).map(|(own, _)| own);
    let is_lamp = |material: &Material| material.emits() && material.emission.max_element() > 1.0;
    materials.clone().any(is_lamp)
        || (materials.any(glows_plainly) && mean_glow(scene) > LEAST_GLOW)
}

/// Whether a material glows all over.
fn glows_plainly(material: &Material) -> bool {
    material.emits() && material.emission_texture.is_none()
}

/// Mean over all surfaces of the radiance that plain ones emit.
fn mean_glow(scene: &Scene) -> f64 {
    let (mut light, mut area) = (0.0, 0.0);
    for index in 0..scene.triangle_count() as u32 {
        let triangle = scene.triangle(index);
        let [a, b, c] = scene.corners(&triangle);
        let own = f64::from((b - a).cross(c - a).length());
        let material = &scene.materials[triangle.material as usize];
        area += own;
        if glows_plainly(material) {
            light += own * f64::from(material.emission.max_element());
        }
    }
    light / area.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::scene::environment::Sky;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::transport::prepared::Prepared;

    fn request(scene: Scene, environment: Option<Environment>) -> RenderRequest {
        RenderRequest {
            environment: environment.map(Arc::new),
            seed: 0,
            ..RenderRequest::new(Arc::new(scene), "auto", [4; 2])
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
            let (environment, warning) =
                Prepared::new(request.scene.clone()).surroundings(&request);
            assert_eq!((environment.is_dark(), warning.is_some()), (is_dark, warns));
        }
    }

    /// By how bright a lamp in a room glows, and how large it is beside that of the Cornell box.
    #[test]
    fn what_glows_like_a_screen_lights_a_scene_where_it_is_large_enough() {
        let room =
            import(&made::cornell(), &Resources::default(), &ImportLimits::default()).unwrap();
        let lamp = room.materials.iter().position(Material::emits).expect("a lamp");
        for (glow, size, is_lit) in [
            (1.0, 1.0, true),
            (1.0, 0.1, false),
            (1.001, 0.1, true),
            (0.05, 1.0, false),
            (0.0, 1.0, false),
        ] {
            let mut scene = room.clone();
            scene.materials[lamp].emission = glam::Vec3::splat(glow);
            for index in 0..scene.triangles.len() {
                let triangle = scene.triangles[index];
                if triangle.material as usize == lamp {
                    let [first, ..] = scene.corners(&triangle);
                    for vertex in triangle.vertices {
                        let at = &mut scene.vertices[vertex as usize].position;
                        *at = first + (*at - first) * size;
                    }
                }
            }
            let request = request(scene, None);
            let (environment, warning) =
                Prepared::new(request.scene.clone()).surroundings(&request);
            let found = (environment.is_dark(), warning.is_none());
            assert_eq!(found, (is_lit, is_lit), "{glow} {size}");
        }
    }

    /// A lamp on a box that shines away from it.
    #[test]
    fn lamps_that_light_hardly_anything_leave_the_scene_to_a_studio() {
        let mut scene =
            import(&made::cornell(), &Resources::default(), &ImportLimits::default()).unwrap();
        for index in 0..scene.triangles.len() {
            let triangle = scene.triangles[index];
            if scene.materials[triangle.material as usize].emits() {
                scene.triangles[index].vertices.swap(1, 2);
                for vertex in triangle.vertices {
                    scene.vertices[vertex as usize].position.y += 0.3;
                }
            }
        }
        let request = request(scene, None);
        let (environment, warning) = Prepared::new(request.scene.clone()).surroundings(&request);
        let warning = warning.expect("it says so").what;
        assert!(!environment.is_dark() && warning.contains("lights hardly any of it"), "{warning}");
        assert!(!most_around(&request).is_dark());
    }
}
