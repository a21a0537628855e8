//! What the camera looks at, where that is a small part of a wide scene: the patches are finest about
//! it ([`Focus`]).

use crate::measurement::Frame;
use crate::patches::Focus;
use crate::rays::Eye;
use crate::scene::Camera;
use crate::surface::World;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Rays of the camera along each side of the picture.
const SIDE: u32 = 32;
/// Fewest of them that meet something.
const LEAST_MET: usize = 16;
/// Share of what they meet that lies in the focus.
const INSIDE: f32 = 0.6;
/// Scenes with more of their area in focus than this share have none: their patches are alike.
const MOST_SHARE: f64 = 0.25;

/// The focus of a camera's picture; `None` where most of the scene is in it.
pub fn find(world: &World, camera: &Camera, [width, height]: [u32; 2]) -> Option<Focus> {
    let frame = Frame::new(&world.rays.camera(camera), width, height);
    let seen = |ray: u32| {
        let at = Vec2::new((ray % SIDE) as f32, (ray / SIDE) as f32) + 0.5;
        let (origin, direction) = frame.ray(2.0 * at / SIDE as f32 - 1.0);
        let hit = world.rays.closest(Eye::Camera, origin, direction)?;
        let triangle = &world.scene.triangle(hit.triangle);
        Some(world.scene.interpolate(triangle, hit.u, hit.v, |vertex| vertex.position))
    };
    let places: Vec<Vec3> = (0..SIDE * SIDE).into_par_iter().filter_map(seen).collect();
    if places.len() < LEAST_MET {
        return None;
    }
    let center = [0, 1, 2].map(|axis| at_share(places.iter().map(|place| place[axis]), 0.5));
    let center = Vec3::from_array(center);
    let radius = at_share(places.iter().map(|place| place.distance(center)), INSIDE);
    let focus = Focus { center, radius };
    (radius > 0.0 && focus.share(&world.scene) < MOST_SHARE).then_some(focus)
}

/// The number below which a share of some numbers lies.
fn at_share(numbers: impl Iterator<Item = f32>, share: f32) -> f32 {
    let mut sorted: Vec<f32> = numbers.collect();
    sorted.sort_unstable_by(f32::total_cmp);
    sorted[((sorted.len() as f32 * share) as usize).min(sorted.len() - 1)]
}

/// A focus, or none, in words that [`parsed`] reads.
pub fn told(focus: Option<Focus>) -> String {
    let Some(Focus { center: Vec3 { x, y, z }, radius }) = focus else { return "none".into() };
    format!("{x},{y},{z},{radius}")
}

/// The focus that [`told`] has told; `None` where that is damaged.
pub fn parsed(words: &str) -> Option<Option<Focus>> {
    if words == "none" {
        return Some(None);
    }
    let numbers: Result<Vec<f32>, _> = words.split(',').map(str::parse).collect();
    let [x, y, z, radius] = numbers.ok()?.try_into().ok()?;
    let is_sound = [x, y, z, radius].iter().all(|number: &f32| number.is_finite()) && radius > 0.0;
    is_sound.then_some(Some(Focus { center: Vec3::new(x, y, z), radius }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::{Triangle, Vertex, made};
    use std::sync::Arc;

    #[test]
    fn a_room_has_no_focus_until_it_stands_on_a_wide_plain() {
        let glb = made::cornell();
        let mut scene = import(&glb, &Resources::new(), &ImportLimits::default()).unwrap();
        let camera = scene.cameras[0].clone();
        let world = World::new(Arc::new(scene.clone()));
        assert_eq!(find(&world, &camera, [64, 64]), None);
        let first = scene.vertices.len() as u32;
        for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)] {
            scene.vertices.push(Vertex::new(Vec3::new(500.0 * x, -0.1, 500.0 * z), Vec3::Y));
        }
        for corners in [[0, 1, 2], [0, 2, 3]] {
            let vertices = corners.map(|corner| first + corner);
            scene.triangles.push(Triangle { vertices, material: 0 });
        }
        let world = World::new(Arc::new(scene));
        let focus = find(&world, &camera, [64, 64]).expect("the plain is wide");
        assert!(focus.radius > 0.1 && focus.radius < 1000.0, "{focus:?}");
        assert_eq!(parsed(&told(Some(focus))), Some(Some(focus)));
        assert_eq!(parsed(&told(None)), Some(None));
        for damaged in ["", "1,2,3", "1,2,3,0", "1,2,nan,4", "1,2,3,4,5"] {
            assert_eq!(parsed(damaged), None, "{damaged}");
        }
    }
}
