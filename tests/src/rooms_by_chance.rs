//! Rooms that nobody has looked at: boxes, colours and a lamp by chance, for what must hold in any.

use crate::oracle::rays::Generator;
use crate::scenes::Builder;
use glam::Vec3;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera};
use hemilux_engine::scene::Scene;
use std::sync::Arc;

/// A closed room of up to 4 × 3 × 4 m with up to six boxes and a lamp below its ceiling, and a camera
/// in one of its corners that looks past the middle.
pub fn room(seed: u64) -> (Arc<Scene>, CameraChoice) {
    let mut generator = Generator::new(seed);
    let mut between = |low: f64, high: f64| (low + (high - low) * generator.uniform()) as f32;
    let mut builder = Builder::default();
    let size = Vec3::new(between(2.0, 4.0), between(2.0, 3.0), between(2.0, 4.0));
    let colour = |x: [f32; 3]| Rgb::from_array(x);
    let wall =
        builder.lambertian(colour([between(0.3, 0.8), between(0.3, 0.8), between(0.3, 0.8)]));
    builder.cuboid(Vec3::ZERO, size, true, wall);
    let boxes = between(2.0, 7.0) as u32;
    for _ in 0..boxes {
        let paint = [between(0.1, 0.8), between(0.1, 0.8), between(0.1, 0.8)];
        let paint = builder.lambertian(colour(paint));
        let reach = Vec3::new(between(0.2, 0.8), between(0.2, 1.2), between(0.2, 0.8));
        // Not where the camera is.
        let corner = Vec3::new(between(0.35, 0.7), 0.0, between(0.05, 0.7)) * size;
        let low = corner + Vec3::Y * 1e-3;
        builder.cuboid(low, (low + reach).min(size - Vec3::splat(0.02)), false, paint);
    }
    let lamp = builder.light(Rgb::ZERO, colour([between(8.0, 12.0), 9.0, between(6.0, 10.0)]));
    let (width, depth) = (between(0.3, 0.9), between(0.3, 0.9));
    let place = Vec3::new(between(0.1, 0.5), 0.97, between(0.1, 0.5)) * size;
    builder.quad(place, Vec3::X * width, Vec3::Z * depth, lamp);
    let camera = ExplicitCamera {
        eye: (Vec3::new(0.08, 0.55, 0.9) * size).to_array(),
        target: (Vec3::new(0.6, 0.3, 0.4) * size).to_array(),
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 60.0,
    };
    (builder.build(), CameraChoice::Explicit(camera))
}
