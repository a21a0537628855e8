//! Places of elements that lie inside a body, as those of a floor under a box that stands on it: no
//! light ever comes there, and nobody sees them, so that they have no part in their element's mean.

use crate::rays::Eye;
use crate::surface::World;
use glam::Vec3;

/// Directions in which such a place is looked out of, beside the normal: sine and cosine of their angle to
/// it, near the horizon, where a plate above the place leaves it open.
const TILT: [f32; 2] = [0.96, 0.28];
/// Cosine and sine of the angles about the normal of the tilted ones.
const AROUND: [[f32; 2]; 3] = [[1.0, 0.0], [-0.5, 0.866_025_4], [-0.5, -0.866_025_4]];

/// Whether a place above a surface of the unit `normal`, from where a ray met a black back, is inside a
/// body: all that can be seen from there are black backs. From a place behind a one-sided plate
/// something else can be seen, too, and the plate is as dark there as anything black.
pub fn is_inside(world: &World, start: Vec3, normal: Vec3) -> bool {
    let (across, along) = normal.any_orthonormal_pair();
    let [sine, cosine] = TILT;
    let tilted = AROUND.map(|[x, y]| (across * x + along * y) * sine + normal * cosine);
    let sees_back = |direction: Vec3| {
        let hit = world.rays.closest(Eye::Light, start, direction);
        hit.is_some_and(|hit| world.is_black(&hit))
    };
    sees_back(normal) && tilted.into_iter().all(sees_back)
}
