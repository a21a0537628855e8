//! Tests of suns that a camera sees by way of glass and of mirrors.

use super::{Gloss, PixelRay, of_camera};
use crate::radiometry::{Rgb, importance};
use crate::random::{Numbers, Stream};
use crate::rays::Eye;
use crate::sampling::Shifted;
use crate::scene::{Camera, Material, Scene, Triangle, Vertex, Volume};
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use crate::transport::hemilux::specimen::{SEED, Specimen, mirrored_by_ball};
use glam::{Vec2, Vec3};

const SUN: Vec3 = Vec3::new(0.5, 0.7, 0.6);
const YFOV: f32 = 0.25;
const SIDE: u32 = 40;
const SEEDS: u64 = 400;
/// Number of a ray that stands for next to nothing of its pixel.
const LATE: u32 = u32::MAX - 1;

/// What a picture by one ray in each pixel, each the n-th of its, shows of an irradiance on a plane that faces the
/// camera: mean over seeds, and standard deviation of one, over that irradiance.
fn shown(specimen: &Specimen, n: u32, irradiance: f64) -> [f64; 2] {
    let (world, coarse) = (&specimen.world, &specimen.coarse);
    let camera = &world.scene.cameras[0];
    let visible = VisibleSurfaces::new(world, specimen.cut.clone(), camera, [SIDE; 2], 4);
    let pixel_ray = PixelRay { frame: visible.frame, height: SIDE, number: n };
    let of_pixel = |seed: u64, pixel: u32| {
        let mut numbers = Numbers::new(seed, Stream::Edge, pixel.into());
        let place = Vec2::new(numbers.uniform(), numbers.uniform()) - 0.5;
        let (origin, direction) = visible.ray(pixel, place);
        let Some(hit) = world.rays.closest(Eye::Camera, origin, direction) else { return 0.0 };
        let sequence = Shifted::new(SEED, Stream::Gloss, seed << 32 | u64::from(pixel)).at(0);
        let found = of_camera(coarse, (&hit, pixel_ray), direction, sequence.afresh());
        f64::from(importance(found))
    };
    let solid_angle = (2.0 * f64::from(YFOV / 2.0).tan() / f64::from(SIDE)).powi(2);
    let of_seed = |seed: u64| -> f64 {
        (0..SIDE * SIDE).map(|pixel| of_pixel(seed, pixel)).sum::<f64>() * solid_angle / irradiance
    };
    let all: Vec<f64> = (0..SEEDS).map(of_seed).collect();
    let mean = all.iter().sum::<f64>() / SEEDS as f64;
    let scatter = all.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / (SEEDS - 1) as f64;
    [mean, scatter.sqrt()]
}

/// Tests that pictures by one ray in each pixel show that irradiance, about one ray of each meeting it, and that rays
/// which stand for nothing but themselves miss it nearly always.
fn shows(specimen: &Specimen, irradiance: f64) {
    let [mean, scatter] = shown(specimen, 0, irradiance);
    let [alone, scatter_alone] = shown(specimen, LATE, irradiance);
    println!("{mean:.3} ± {scatter:.3}, by rays alone {alone:.3} ± {scatter_alone:.3}");
    assert!((mean - 1.0).abs() < 0.15 && scatter < 1.3, "{mean} ± {scatter}");
    assert!(alone < 0.1 || scatter_alone > 3.0 * scatter, "{alone} ± {scatter_alone}");
}

/// A ball of black glass under the sun, and the eye that sees it.
fn black_ball() -> (Specimen, Vec3) {
    let volume = Volume { attenuation_color: Rgb::ZERO, attenuation_distance: 0.01 };
    let glass = Material { volume: Some(volume), ..Material::glass("black", 1.5) };
    let (mut scene, environment) = Specimen::sunlit_ball(glass, 64, SUN);
    let eye = Vec3::new(1.0, 2.0, 12.0);
    scene.cameras = vec![Camera::look_at("camera", eye, Vec3::ZERO, Vec3::Y, YFOV)];
    (Specimen::of(scene, environment, 200), eye)
}

/// Of a ball of black glass the front alone mirrors a sun, by Fresnel's equations.
#[test]
fn glass_mirrors_the_sun() {
    let (specimen, eye) = black_ball();
    let (irradiance, cosine) = mirrored_by_ball(SUN, eye);
    let beyond = (1.0 - (1.0 - cosine * cosine) / 2.25).sqrt();
    let across = (cosine - 1.5 * beyond) / (cosine + 1.5 * beyond);
    let along = (1.5 * cosine - beyond) / (1.5 * cosine + beyond);
    let fresnel = 0.5 * (across * across + along * along);
    shows(&specimen, irradiance * fresnel);
}

/// All that black glass shows of a sun is known as what paths of the audit hardly find.
#[test]
fn what_glass_mirrors_is_told_to_the_audit() {
    let (specimen, _) = black_ball();
    let visible = specimen.visible();
    let gloss = Gloss::after(&specimen, &visible, false, (16, false));
    let fragments = gloss.of_fragments(&visible);
    let shown = |lobe: &Lobe| visible.share(lobe) * importance(fragments[lobe.fragment as usize].0);
    let shown: f32 = visible.lobes.iter().map(shown).sum();
    let mut mirrored = Vec::new();
    gloss.add_mirrored(&visible, &mut mirrored);
    let told: f32 = mirrored.into_iter().map(importance).sum();
    assert!(shown > 0.0 && (told / shown - 1.0).abs() < 0.01, "{told} of {shown}");
}

/// A mirror shows a metal ball that mirrors a sun as an eye behind it would see that.
#[test]
fn a_mirror_shows_what_a_ball_mirrors() {
    let metal =
        Material { base_color: Rgb::ONE, metallic: 1.0, roughness: 0.0, ..Material::default() };
    let (mut scene, environment) = Specimen::sunlit_ball(metal, 64, SUN);
    add_mirror(&mut scene, 6.0);
    let image = Vec3::new(12.0, 0.0, 0.0);
    let eye = Vec3::new(0.0, 1.0, 12.0);
    scene.cameras = vec![Camera::look_at("camera", eye, image, Vec3::Y, YFOV)];
    let (irradiance, _) = mirrored_by_ball(SUN, image + eye * Vec3::new(-1.0, 1.0, 1.0));
    shows(&Specimen::of(scene, environment, 200), irradiance);
}

/// A mirror shows a rough plate that the sun shines on through a pane, as bright as without that but for what the pane
/// takes. Suns that are found by lights and by rays, too, are noticed.
#[test]
fn a_sun_behind_a_pane_is_found_once() {
    let seen = |has_pane: bool| {
        let metal = |roughness: f32| Material {
            base_color: Rgb::ONE,
            metallic: 1.0,
            roughness,
            ..Material::default()
        };
        let (ball, environment) = Specimen::sunlit_ball(metal(0.0), 8, Vec3::new(-0.2, 1.0, -0.3));
        let mut scene = Scene { materials: ball.materials, ..Scene::default() };
        add_mirror(&mut scene, 6.0);
        scene.materials.push(metal(0.6));
        add_level(&mut scene, (0.0, 2.0), 1);
        if has_pane {
            scene.materials.push(Material { volume: None, ..Material::glass("pane", 1.5) });
            add_level(&mut scene, (3.9, 20.0), 2);
        }
        let eye = Vec3::new(0.0, 2.0, 12.0);
        scene.cameras =
            vec![Camera::look_at("camera", eye, Vec3::new(12.0, 0.0, 0.0), Vec3::Y, YFOV)];
        let specimen = Specimen::of(scene, environment, 200);
        shown(&specimen, 0, 1.0)
    };
    let [[open, _], [behind, scatter]] = [false, true].map(seen);
    println!("{open} {behind} ± {scatter}");
    // A sheet lets 1 − F through, F = .04.
    let share = behind / open;
    assert!(open > 0.0 && (0.93..0.99).contains(&share), "{share}");
}

/// Adds a level square of a material at such a height, which faces up, of such a half side.
fn add_level(scene: &mut Scene, (y, half): (f32, f32), material: u32) {
    let first = scene.vertices.len() as u32;
    let corner = |(x, z)| Vertex::new(half * Vec3::new(x, 0.0, z) + y * Vec3::Y, Vec3::Y);
    scene.vertices.extend([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(corner));
    let triangle = |corners: [u32; 3]| Triangle { vertices: corners.map(|k| first + k), material };
    scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(triangle));
}

/// Adds an upright square of the scene's material at such an x, which faces the other way.
fn add_mirror(scene: &mut Scene, x: f32) {
    let first = scene.vertices.len() as u32;
    let corner = |(y, z)| Vertex::new(Vec3::new(x, y, z), -Vec3::X);
    scene.vertices.extend([(-4.0, 0.0), (-4.0, 12.0), (4.0, 12.0), (4.0, 0.0)].map(corner));
    let triangle =
        |corners: [u32; 3]| Triangle { vertices: corners.map(|k| first + k), material: 0 };
    scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(triangle));
}
