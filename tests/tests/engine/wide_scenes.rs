//! Small buildings on wide plains: what is seen is a thousandth of the scene, and gets the patches.

use glam::Vec3;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest, Unobserved};
use hemilux_engine::scene::{Environment, Scene, Sky, Sun, environment};
use hemilux_engine::transport::render;
use hemilux_tests::halves::Halves;
use hemilux_tests::scenes::Builder;
use std::sync::Arc;

/// A pavilion of three walls, a roof and a table on a plain, seen from inside.
fn pavilion(plain: f32) -> Arc<Scene> {
    let mut builder = Builder::default();
    let ground = builder.lambertian(Rgb::new(0.45, 0.42, 0.35));
    let white = builder.lambertian(Rgb::splat(0.8));
    let red = builder.lambertian(Rgb::new(0.6, 0.2, 0.15));
    let corner = Vec3::new(-0.5, 0.0, -0.5) * plain;
    builder.quad(corner, Vec3::Z * plain, Vec3::X * plain, ground);
    let mut block = |low: [f32; 3], high: [f32; 3], material| {
        builder.cuboid(Vec3::from(low), Vec3::from(high), false, material);
    };
    block([-3.0, 0.001, -2.15], [3.0, 2.8, -2.0], white);
    block([-3.15, 0.001, -2.15], [-3.0, 2.8, 2.0], red);
    block([3.0, 0.001, -2.15], [3.15, 2.8, 2.0], white);
    block([-3.15, 2.8, -2.15], [3.15, 3.0, 2.6], white);
    block([-3.0, 0.001, 1.9], [-0.8, 2.8, 2.0], white);
    block([0.2, 0.001, -1.2], [1.2, 0.7, -0.4], white);
    builder.build()
}

fn request(method: &str, iterations: u64) -> RenderRequest {
    let sky = Sky::Uniform(Rgb::new(0.3, 0.4, 0.55));
    let towards = Vec3::new(0.4, 0.6, 0.7).normalize();
    let sun = Sun::towards(towards, Rgb::new(4.0, 3.7, 3.2), environment::SUN_RADIUS);
    RenderRequest {
        environment: Some(Arc::new(Environment { sky, sun: Some(sun), light_radius: 0.0 })),
        camera: CameraChoice::Explicit(ExplicitCamera {
            eye: [2.2, 1.6, 1.5],
            target: [-1.2, 1.2, -1.6],
            up: [0.0, 1.0, 0.0],
            yfov_degrees: 66.0,
        }),
        limits: Limits::iterations(iterations),
        seed: 7,
        ..RenderRequest::new(pavilion(1000.0), method, [48, 36])
    }
}

#[test]
fn a_pavilion_on_a_square_kilometre_is_as_path_tracing_shows_it() {
    let reference = Halves::traced(&request("ray-traced", 500), f32::INFINITY);
    let mut device = CpuDevice::new(Some(2)).expect("threads");
    let request = request("hemilux", 12);
    let ours = render(&mut device, &request, &mut Unobserved).expect("it renders");
    let error = reference.error(&ours.picture);
    let predicted = ours.stats.figures.estimated_error.expect("it predicts");
    println!("error {error:.4}, predicted {predicted:.4}");
    // With patches of equal area it is .1, with a tenth of that predicted.
    assert!(error < 0.04, "{error}");
    assert!((0.6..1.6).contains(&(predicted / error)), "{predicted} for {error}");
}
