//! What lobes reflect of a sun and of lights without extent: `hemilux`, which finds it by the shadow rays of direct
//! light, against path tracing.

use glam::Vec3;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Environment, Layering, Layers, LightKind, Material, PunctualLight, Scene, Sky, Sun,
};
use hemilux_tests::blocks::{block_means, largest_deviation};
use hemilux_tests::rendering;
use hemilux_tests::scenes::Builder;
use std::sync::Arc;

const SIDE: u32 = 48;

/// Strips of plastic, metal and coated paint, each of about that roughness, under a post that throws two shadows.
fn strips(roughness: f32) -> Arc<Scene> {
    let mut builder = Builder::default();
    let plastic = Material { roughness, base_color: Rgb::splat(0.2), ..Material::default() };
    let metal = Material {
        metallic: 1.0,
        roughness: 1.3 * roughness,
        base_color: Rgb::new(0.9, 0.6, 0.3),
        ..Material::default()
    };
    let factors = Layers { coat: 1.0, coat_roughness: 0.7 * roughness, ..Layers::NONE };
    let layering = Some(Box::new(Layering { factors, ..Layering::default() }));
    let paint = Material { layering, ..Material::lambertian("paint", Rgb::new(0.1, 0.3, 0.5)) };
    for (strip, material) in [plastic, metal, paint].into_iter().enumerate() {
        let material = builder.material(material);
        let corner = Vec3::new(-2.1 + 1.4 * strip as f32, 0.0, 2.0);
        builder.quad(corner, 1.4 * Vec3::X, -4.0 * Vec3::Z, material);
    }
    let post = builder.lambertian(Rgb::splat(0.4));
    builder.cuboid(Vec3::new(-0.1, 0.02, -0.3), Vec3::new(0.1, 1.2, -0.1), false, post);
    let mut scene = Scene::clone(&builder.build());
    let bulb = |position, intensity| PunctualLight {
        name: "bulb".into(),
        kind: LightKind::Point,
        position,
        direction: -Vec3::Y,
        intensity,
        range: None,
    };
    scene.lights = vec![
        bulb(Vec3::new(-1.2, 1.5, -1.5), Rgb::new(1.0, 2.0, 4.0)),
        bulb(Vec3::new(1.5, 1.0, -0.8), Rgb::new(3.0, 1.0, 0.5)),
    ];
    Arc::new(scene)
}

fn rendered(scene: &Arc<Scene>, method: &str, iterations: u64) -> Picture {
    let camera = ExplicitCamera {
        eye: [0.0, 1.8, 3.2],
        target: [0.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 55.0,
    };
    let sun = Some(Sun::towards(Vec3::new(0.1, 0.6, -0.8), Rgb::splat(2.0), 0.005));
    let sky = Sky::Uniform(Rgb::splat(0.1));
    let request = RenderRequest {
        environment: Some(Arc::new(Environment { sky, sun, ..Environment::none() })),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 5,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    rendering::rendered(&request).picture
}

/// In blocks of 8 × 8 pixels, within 3 %; strips that are a fifth rougher are farther off.
#[test]
fn highlights_of_narrow_lights_are_those_of_path_tracing() {
    let scene = strips(0.4);
    let reference = block_means(&rendered(&scene, "ray-traced", 400), 8);
    let off = |scene: &Arc<Scene>, iterations| {
        let means = block_means(&rendered(scene, "hemilux", iterations), 8);
        largest_deviation(&means, &reference)
    };
    let (ours, rougher) = (off(&scene, 8), off(&strips(0.48), 3));
    println!("largest deviation {ours:.4}, with rougher strips {rougher:.4}");
    assert!(ours < 0.03, "{ours}");
    assert!(rougher > 0.1, "{rougher}");
}
