//! Points and spots with a radius: the penumbra of `hemilux` against path tracing, and of that
//! against a shining sphere of triangles.

use glam::Vec3;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Environment, LightKind, Material, PunctualLight, Scene, Triangle, Vertex,
};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

const SIDE: usize = 48;
/// Pixels of a block, whose means are compared.
const BLOCK: usize = 6;
const RADIUS: f32 = 0.3;
const LAMP: Vec3 = Vec3::new(0.0, 2.0, 0.0);
const INTENSITY: Rgb = Rgb::new(3.0, 4.0, 5.0);
/// Height of the camera, which looks straight down and sees as much to each side.
const EYE: f32 = 0.95;

/// A floor under a black half-plane at half the lamp's height: its shadow begins under the lamp.
fn floor() -> Builder {
    let mut builder = Builder::default();
    let white = builder.lambertian(Rgb::splat(0.8));
    builder.quad(Vec3::new(-3.0, 0.0, 3.0), 6.0 * Vec3::X, -6.0 * Vec3::Z, white);
    let black = builder
        .material(Material { double_sided: true, ..Material::lambertian("black", Rgb::ZERO) });
    builder.quad(Vec3::new(0.0, 1.0, 3.0), 3.0 * Vec3::X, -6.0 * Vec3::Z, black);
    builder
}

fn with_lamp(kind: LightKind) -> Arc<Scene> {
    let mut scene = Scene::clone(&floor().build());
    scene.lights.push(PunctualLight {
        name: "lamp".into(),
        kind,
        position: LAMP,
        direction: -Vec3::Y,
        intensity: INTENSITY,
        range: None,
    });
    Arc::new(scene)
}

/// The same with a shining sphere of triangles in place of the lamp, of the same intensity.
fn with_sphere() -> Arc<Scene> {
    const RINGS: u32 = 24;
    let mut scene = Scene::clone(&floor().build());
    let first = scene.vertices.len() as u32;
    for ring in 0..=RINGS {
        for column in 0..2 * RINGS {
            let (sin, cos) = (PI * ring as f32 / RINGS as f32).sin_cos();
            let azimuth = TAU * column as f32 / (2 * RINGS) as f32;
            let normal = Vec3::new(sin * azimuth.cos(), cos, sin * azimuth.sin());
            scene.vertices.push(Vertex::new(LAMP + RADIUS * normal, normal));
        }
    }
    let material = scene.materials.len() as u32;
    for ring in 0..RINGS {
        for column in 0..2 * RINGS {
            let at = |ring: u32, column: u32| first + ring * 2 * RINGS + column % (2 * RINGS);
            let [a, b] = [at(ring, column), at(ring, column + 1)];
            let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
            for vertices in [[a, b, d], [a, d, c]] {
                scene.triangles.push(Triangle { vertices, material });
            }
        }
    }
    let lamp = scene.triangles.iter().filter(|triangle| triangle.material == material);
    let area: f32 = lamp
        .map(|triangle| {
            let [a, b, c] = scene.corners(triangle);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    // A convex body of area A shows A/4 on average.
    let emission = INTENSITY * (4.0 / area);
    scene.materials.push(Material { emission, ..Material::lambertian("lamp", Rgb::ZERO) });
    Arc::new(scene)
}

fn picture(scene: &Arc<Scene>, light_radius: f32, (method, iterations): (&str, u64)) -> Picture {
    let camera = ExplicitCamera {
        eye: [0.0, EYE, 0.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 90.0,
    };
    let request = RenderRequest {
        environment: Some(Arc::new(Environment { light_radius, ..Environment::none() })),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 11,
        ..RenderRequest::new(scene.clone(), method, [SIDE as u32; 2])
    };
    rendered(&request).picture
}

/// Mean radiance of blocks, row by row.
fn blocks(picture: &Picture) -> Vec<Rgb> {
    let count = SIDE / BLOCK;
    let mean = |block: usize| {
        let (row, column) = (block / count * BLOCK, block % count * BLOCK);
        let pixels = (0..BLOCK * BLOCK)
            .map(|k| picture.pixels[(row + k / BLOCK) * SIDE + column + k % BLOCK]);
        pixels.sum::<Rgb>() / (BLOCK * BLOCK) as f32
    };
    (0..count * count).map(mean).collect()
}

/// Root of the mean square of the blocks' differences, relative to the mean of all.
fn off(a: &Picture, b: &Picture) -> f32 {
    let (a, b) = (blocks(a), blocks(b));
    let mean = b.iter().sum::<Rgb>() / b.len() as f32;
    let squares = a.iter().zip(&b).map(|(a, b)| ((*a - *b) / mean).length_squared() / 3.0);
    (squares.sum::<f32>() / a.len() as f32).sqrt()
}

const KINDS: [LightKind; 2] =
    [LightKind::Point, LightKind::Spot { inner_cone: 0.3, outer_cone: 0.9 }];

#[test]
fn penumbrae_are_those_of_path_tracing() {
    for kind in KINDS {
        let scene = with_lamp(kind);
        let traced = picture(&scene, RADIUS, ("ray-traced", 512));
        for method in [("hemilux", 12), ("illumination-map", 512)] {
            let found = off(&picture(&scene, RADIUS, method), &traced);
            println!("{kind:?}, {}: off by {found}", method.0);
            assert!(found < 0.012, "{kind:?}, {}: {found}", method.0);
        }
        // A planted error that this must see: the radius ignored, or half of it.
        for (radius, least) in [(0.0, 0.05), (0.5 * RADIUS, 0.02)] {
            let hard = off(&picture(&scene, radius, ("hemilux", 12)), &traced);
            println!("{kind:?}, radius {radius}: off by {hard}");
            assert!(hard > least, "{kind:?}: {hard}");
        }
    }
}

#[test]
fn soft_points_light_as_shining_spheres_do() {
    let sphere = picture(&with_sphere(), 0.0, ("ray-traced", 1024));
    let scene = with_lamp(LightKind::Point);
    let soft = off(&picture(&scene, RADIUS, ("ray-traced", 1024)), &sphere);
    let hard = off(&picture(&scene, 0.0, ("ray-traced", 64)), &sphere);
    println!("off by {soft}, without radius {hard}");
    assert!(soft < 0.012 && hard > 0.05, "{soft} {hard}");
}

/// Away from the shadow's edge the light is that of the point.
#[test]
fn a_radius_changes_only_shadows() {
    for kind in KINDS {
        let scene = with_lamp(kind);
        for method in [("hemilux", 6), ("ray-traced", 512)] {
            let [hard, soft] = [0.0, RADIUS].map(|radius| blocks(&picture(&scene, radius, method)));
            let count = SIDE / BLOCK;
            let mut umbra = 0;
            for (block, (hard, soft)) in hard.iter().zip(&soft).enumerate() {
                let middle = (block % count) as f32 + 0.5;
                let x = EYE * (2.0 * middle / count as f32 - 1.0);
                // The penumbra reaches as far to each side as the sphere.
                if x < -1.5 * RADIUS {
                    let ratio = (*soft / *hard - Rgb::ONE).abs().max_element();
                    assert!(ratio < 0.01, "{kind:?}, {} at {x}: {ratio}", method.0);
                } else if x > 1.5 * RADIUS {
                    assert!(soft.max_element() < 1e-3, "{kind:?}, {} at {x}: {soft}", method.0);
                    umbra += 1;
                } else if x.abs() < 0.5 * RADIUS {
                    let changed = (*soft - *hard).abs().max_element();
                    assert!(changed > 0.02, "{kind:?}, {} at {x}: {changed}", method.0);
                }
            }
            assert!(umbra > 0);
        }
    }
}
