//! What lets light through diffusely, such as paper and leaves (KHR_materials_diffuse_transmission):
//! closed forms, and `hemilux` against path tracing.

use glam::{Quat, Vec3};
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::{Rgb, importance};
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Environment, Layering, Layers, LightKind, Material, PunctualLight, Scene, Sky, Sun,
    Translucency,
};
use hemilux_tests::blocks::{block_means, largest_deviation};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::f32::consts::PI;
use std::sync::Arc;

/// What is rendered, from where, in which surroundings.
struct View<'a> {
    scene: &'a Arc<Scene>,
    environment: Environment,
    camera: ExplicitCamera,
    side: u32,
    options: &'a [(&'a str, &'a str)],
}

impl View<'_> {
    fn rendered(&self, method: &str, iterations: u64) -> Picture {
        let options = self.options.iter().filter(|_| method == "hemilux");
        let request = RenderRequest {
            environment: Some(Arc::new(self.environment.clone())),
            camera: CameraChoice::Explicit(self.camera),
            limits: Limits::iterations(iterations),
            seed: 5,
            options: options.map(|(key, value)| (key.to_string(), value.to_string())).collect(),
            ..RenderRequest::new(self.scene.clone(), method, [self.side; 2])
        };
        rendered(&request).picture
    }
}

/// A surface that lets that share of light through, by its colour.
fn passing(below: Material, share: f32, color: Rgb) -> Material {
    let translucency = Some(Box::new(Translucency::plain(share, color)));
    Material { translucency, double_sided: true, ..below }
}

/// A sheet, two metres square, about the origin, of which a camera in front (+Z) sees the middle.
fn sheet(material: Material) -> Arc<Scene> {
    let mut builder = Builder::default();
    let material = builder.material(material);
    builder.quad(Vec3::new(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, material);
    builder.build()
}

fn towards(eye: [f32; 3], target: [f32; 3], yfov_degrees: f32) -> ExplicitCamera {
    ExplicitCamera { eye, target, up: [0.0, 1.0, 0.0], yfov_degrees }
}

/// Radiance of a sheet by each method.
fn radiance_of(scene: &Arc<Scene>, environment: Environment, eye: [f32; 3]) -> [Rgb; 2] {
    let camera = towards(eye, [0.0; 3], 1.0);
    let view = View { scene, environment, camera, side: 16, options: &[] };
    [("hemilux", 8), ("ray-traced", 400)].map(|(method, iterations)| {
        let picture = view.rendered(method, iterations);
        picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32
    })
}

fn uniform_sky() -> Environment {
    Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() }
}

/// In a uniform sky a sheet sends what it reflects of one side and lets through from the other;
/// one that lets all through loses nothing.
#[test]
fn a_sheet_in_a_uniform_sky_loses_what_its_albedos_say() {
    let base = Rgb::new(0.6, 0.3, 0.9);
    let tint = Rgb::new(0.5, 0.8, 0.1);
    for (share, color) in [(1.0, Rgb::ONE), (0.4, tint), (0.0, tint)] {
        let scene = sheet(passing(Material::lambertian("paper", base), share, color));
        let expected = base * (1.0 - share) + color * share;
        for eye in [[0.0, 0.0, 3.0], [2.0, 0.3, -1.0]] {
            for found in radiance_of(&scene, uniform_sky(), eye) {
                let off = (found - expected).abs().max_element();
                assert!(off < 5e-3, "{share}: {found} {expected}");
            }
        }
    }
}

/// Neither does one with a lobe on top, whose Fresnel term takes as much of what is let through as of
/// what is reflected.
#[test]
fn polished_and_coated_sheets_lose_no_more_than_opaque_ones() {
    let layers = Layers { coat: 0.7, coat_roughness: 0.2, ..Layers::NONE };
    let layering = Some(Box::new(Layering { factors: layers, ..Layering::default() }));
    let polished = Material { roughness: 0.4, ..Material::default() };
    for material in [polished.clone(), Material { layering, ..polished }] {
        let opaque = Material { double_sided: true, ..material.clone() };
        for eye in [[0.0, 0.0, 3.0], [2.0, 0.3, 1.0]] {
            let [_, expected] = radiance_of(&sheet(opaque.clone()), uniform_sky(), eye);
            for share in [0.5, 1.0] {
                let scene = sheet(passing(material.clone(), share, Rgb::ONE));
                for found in radiance_of(&scene, uniform_sky(), eye) {
                    assert!(
                        (found / expected - 1.0).abs().max_element() < 0.01,
                        "{found} {expected}"
                    );
                }
            }
        }
    }
}

/// Irradiance E on the back is radiance t·colour·E/π in front; light on the front is reflected.
#[test]
fn light_from_behind_leaves_in_front() {
    let (share, color, base) = (0.7, Rgb::new(0.9, 0.5, 0.2), Rgb::new(0.2, 0.4, 0.6));
    let scene = sheet(passing(Material::lambertian("paper", base), share, color));
    let bulb = |z: f32| {
        let mut scene = Scene::clone(&scene);
        scene.lights.push(PunctualLight {
            name: "bulb".into(),
            kind: LightKind::Point,
            position: Vec3::new(0.0, 0.0, z),
            direction: -Vec3::Y,
            intensity: Rgb::splat(12.0),
            range: None,
        });
        (Arc::new(scene), Environment::none(), 12.0 / (z * z))
    };
    let sun = |z: f32| {
        let direction = Vec3::new(0.6, 0.0, z);
        let sun = Some(Sun { direction, irradiance: Rgb::splat(5.0), angular_radius: 0.0 });
        (scene.clone(), Environment { sun, ..Environment::none() }, 5.0 * z.abs())
    };
    let cases = [(bulb(-2.0), true), (bulb(2.0), false), (sun(-0.8), true), (sun(0.8), false)];
    for ((scene, environment, irradiance), is_behind) in cases {
        let albedo = if is_behind { color * share } else { base * (1.0 - share) };
        let expected = albedo * irradiance / PI;
        for found in radiance_of(&scene, environment, [0.2, 0.1, 4.0]) {
            assert!((found / expected - 1.0).abs().max_element() < 0.01, "{found} {expected}");
        }
    }
}

/// A closed room with a bulb inside a shade of that material, open above and below.
fn lampshade(paper: Material) -> Arc<Scene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::new(0.6, 0.55, 0.5));
    let bulb = builder.light(Rgb::splat(0.5), Rgb::splat(60.0));
    let paper = builder.material(paper);
    builder.cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true, wall);
    builder.cuboid(Vec3::new(1.93, 1.2, 1.93), Vec3::new(2.07, 1.34, 2.07), false, bulb);
    const SIDES: usize = 12;
    let rim = |side: usize| {
        let (sin, cos) = (side as f32 / SIDES as f32 * 2.0 * PI).sin_cos();
        Vec3::new(2.0 + 0.5 * cos, 0.9, 2.0 + 0.5 * sin)
    };
    for side in 0..SIDES {
        let (from, to) = (rim(side), rim(side + 1));
        builder.quad(from, 0.7 * Vec3::Y, to - from, paper);
    }
    builder.build()
}

/// A ground under leaves that lie like shingles thrown by chance.
fn leaves(leaf: Material) -> Arc<Scene> {
    let mut builder = Builder::default();
    let ground = builder.lambertian(Rgb::new(0.35, 0.3, 0.25));
    let leaf = builder.material(leaf);
    builder.quad(Vec3::new(-6.0, 0.0, 6.0), 12.0 * Vec3::X, -12.0 * Vec3::Z, ground);
    for number in 0..40u32 {
        let at = |step: f32| (number as f32 * step).fract();
        let turn = Quat::from_euler(
            glam::EulerRot::YXZ,
            2.0 * PI * at(0.618_034),
            at(0.754_878) - 0.5,
            at(0.569_84) - 0.5,
        );
        let place = Vec3::new(3.0 * at(0.414_214) - 1.5, 0.5 + 1.2 * at(0.302_776), 0.0);
        let place = place + (3.0 * at(0.236_068) - 1.5) * Vec3::Z;
        builder.quad(place, turn * (0.8 * Vec3::Z), turn * (0.5 * Vec3::X), leaf);
    }
    builder.build()
}

/// The largest deviation of a block of pixels of `hemilux` from path tracing. What is planted, the same
/// scene with another material, has to deviate by more.
fn agrees(name: &str, view: &View<'_>, planted: &Arc<Scene>, iterations: [u64; 2]) {
    let reference = block_means(&view.rendered("ray-traced", iterations[1]), 8);
    let deviation = |scene| {
        let view = View { scene, environment: view.environment.clone(), ..*view };
        largest_deviation(&block_means(&view.rendered("hemilux", iterations[0]), 8), &reference)
    };
    let [ours, wrong] = [view.scene, planted].map(deviation);
    println!("{name}: largest deviation {ours:.4}, planted {wrong:.4}");
    assert!(ours < 0.04, "{name}: {ours}");
    assert!(wrong > 0.1, "{name}: {wrong}");
}

fn paper(share: f32, color: Rgb) -> Material {
    passing(Material::lambertian("paper", Rgb::splat(0.8)), share, color)
}

#[test]
fn a_lampshade_shines_as_by_path_tracing() {
    let (scene, planted) = (
        lampshade(paper(0.6, Rgb::new(0.9, 0.7, 0.4))),
        lampshade(paper(0.6, Rgb::new(0.7, 0.55, 0.3))),
    );
    let camera = towards([3.3, 1.9, 3.7], [1.9, 0.9, 1.9], 60.0);
    let environment = Environment::none();
    let view = View { scene: &scene, environment, camera, side: 48, options: &[] };
    agrees("lampshade", &view, &planted, [16, 2000]);
}

/// Also where the leaves are a crowd of triangles, of which nothing is listed.
#[test]
fn leaves_shine_as_by_path_tracing() {
    let green =
        Material { base_color: Rgb::new(0.2, 0.35, 0.1), roughness: 0.5, ..Material::default() };
    let tint = Rgb::new(0.5, 0.8, 0.15);
    let (scene, planted) =
        (leaves(passing(green.clone(), 0.5, tint)), leaves(passing(green, 0.5, 0.7 * tint)));
    let sun = Some(Sun {
        direction: Vec3::new(-0.4, 0.8, -0.45).normalize(),
        irradiance: Rgb::splat(4.0),
        angular_radius: 0.005,
    });
    let environment =
        Environment { sun, sky: Sky::Uniform(Rgb::splat(0.2)), ..Environment::none() };
    let camera = towards([0.5, 0.6, 3.4], [0.0, 0.7, 0.0], 50.0);
    for (name, options) in [("leaves", &[][..]), ("a crowd", &[("coarse_patches", "8")][..])] {
        let environment = environment.clone();
        let view = View { scene: &scene, environment, camera, side: 48, options };
        agrees(name, &view, &planted, [6, 500]);
    }
}

/// Light that bounces in a room gets out of a box of paper that nothing else leaves.
#[test]
fn light_leaves_a_box_of_paper() {
    let mut builder = Builder::default();
    let ground = builder.lambertian(Rgb::splat(0.5));
    let bulb = builder.light(Rgb::ZERO, Rgb::splat(30.0));
    let paper = builder.material(paper(0.5, Rgb::ONE));
    builder.quad(Vec3::new(-4.0, 0.0, 4.0), 8.0 * Vec3::X, -8.0 * Vec3::Z, ground);
    builder.cuboid(Vec3::new(-0.5, 0.2, -0.5), Vec3::new(0.5, 1.2, 0.5), false, paper);
    builder.cuboid(
        Vec3::splat(-0.1) + 0.6 * Vec3::Y,
        Vec3::splat(0.1) + 0.6 * Vec3::Y,
        false,
        bulb,
    );
    let scene = builder.build();
    let camera = towards([1.5, 1.6, 2.4], [0.0, 0.5, 0.0], 60.0);
    let view =
        View { scene: &scene, environment: Environment::none(), camera, side: 48, options: &[] };
    // Few paths find the bulb in the box: larger blocks keep their noise low.
    let [ours, reference] = [("hemilux", 16), ("ray-traced", 3000)]
        .map(|(method, iterations)| block_means(&view.rendered(method, iterations), 16));
    assert!(reference.iter().map(|block| importance(*block)).sum::<f32>() > 1.0);
    let deviation = largest_deviation(&ours, &reference);
    println!("box of paper: largest deviation {deviation:.4}");
    assert!(deviation < 0.04, "{deviation}");
}
