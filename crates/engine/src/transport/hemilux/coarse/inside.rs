//! Places of elements that lie inside a body, as those of a floor under a box that stands on it: no
//! light ever comes there, and nobody sees them, so that they have no part in their element's mean.

use crate::patches::Cut;
use crate::rays::{Eye, Hit};
use crate::surface::World;
use glam::Vec3;

/// Directions in which such a place is looked out of, beside the normal: sine and cosine of their angle to
/// it, near the horizon, where a plate above the place leaves it open.
const TILT: [f32; 2] = [0.96, 0.28];
/// Cosine and sine of the angles about the normal of the tilted ones.
const AROUND: [[f32; 2]; 3] = [[1.0, 0.0], [-0.5, 0.866_025_4], [-0.5, -0.866_025_4]];

/// Of these and the normal, how many see a black back from inside a body that is not closed: where a wall
/// cuts through it, the wall is seen, too.
const MOST: usize = 3;

/// A place of an element.
pub struct Place {
    /// Above the surface.
    pub start: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Side of the element, ray units.
    pub side: f32,
}

/// Whether a place is inside a body, or behind what cuts through its element, where a ray from there met a
/// black back: that of a closed body, or one that is nearer than the element is large, or there
/// are black backs all around. From a place behind a one-sided plate something else can be seen, too, and
/// the plate is as dark there as anything black.
pub fn is_inside(world: &World, cut: &Cut, place: &Place, hit: &Hit) -> bool {
    let Place { start, normal, side } = *place;
    if hit.distance < side || cut.bounds_dark_body(hit.triangle, hit.u, hit.v) {
        return true;
    }
    let (across, along) = normal.any_orthonormal_pair();
    let [sine, cosine] = TILT;
    let tilted = AROUND.map(|[x, y]| (across * x + along * y) * sine + normal * cosine);
    let sees_back = |direction: &Vec3| {
        let hit = world.rays.closest(Eye::Light, start, *direction);
        hit.is_some_and(|hit| world.is_black(&hit))
    };
    let [a, b, c] = tilted;
    [normal, a, b, c].iter().filter(|direction| sees_back(direction)).count() >= MOST
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::Rgb;
    use crate::scene::{Material, Scene, Triangle, Vertex};
    use std::sync::Arc;

    /// One-sided squares with a corner and two edges each; their fronts are where the first turns left
    /// into the second.
    fn squares(all: &[[[f32; 3]; 3]]) -> (World, Cut) {
        let mut scene = Scene::default();
        scene.materials.push(Material::lambertian("dark", Rgb::ZERO));
        for [corner, u, v] in all {
            let [corner, u, v] = [corner, u, v].map(|vector| Vec3::from(*vector));
            let first = scene.vertices.len() as u32;
            for position in [corner, corner + u, corner + u + v, corner + v] {
                scene.vertices.push(Vertex::new(position, u.cross(v)));
            }
            for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
                scene.triangles.push(Triangle { vertices, material: 0 });
            }
        }
        let scene = Arc::new(scene);
        (World::new(scene.clone()), Cut::new(scene, 100, None))
    }

    /// Whether a place with the normal upwards is inside, by the black back above it; `None` where there
    /// is no black back. The place and the side of its element in metres.
    fn is_within((world, cut): &(World, Cut), at: [f32; 3], side: f64) -> Option<bool> {
        let start = world.rays.place(Vec3::from(at));
        let side = (side * world.rays.scale()) as f32;
        let place = Place { start, normal: Vec3::Y, side };
        let hit = world.rays.closest(Eye::Light, start, Vec3::Y)?;
        world.is_black(&hit).then(|| is_inside(world, cut, &place, &hit))
    }

    #[test]
    fn a_box_without_a_bottom_has_an_inside_and_a_plate_has_none() {
        let open_box = squares(&[
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        ]);
        for [x, z] in [[0.5, 0.5], [0.02, 0.98], [0.3, 0.01]] {
            assert_eq!(is_within(&open_box, [x, 1e-3, z], 0.01), Some(true), "{x} {z}");
        }
        assert_eq!(is_within(&open_box, [0.5, 1.01, 0.5], 0.01), None, "above the box");
        assert_eq!(is_within(&open_box, [1.02, 1e-3, 0.5], 0.01), None, "beside the box");
        // Its back is towards the floor.
        let plate = squares(&[[[0.0, 0.2, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]]);
        // Below a triangle's middle, not its edge, where rays may pass.
        let below = [0.3, 0.0, 0.6];
        assert_eq!(
            is_within(&plate, below, 0.19),
            Some(false),
            "farther than the element is large"
        );
        assert_eq!(is_within(&plate, below, 0.21), Some(true), "nearer than the element is large");
    }
}
