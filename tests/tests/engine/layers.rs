//! Surfaces with layers on top, such as clear coats and sheen: `hemilux` against path tracing.

use glam::{Vec2, Vec3};
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Encoding, Environment, Layering, Layers, Material, NormalMap, Scene, Texture, TextureSlot,
};
use hemilux_tests::blocks::{block_means, largest_deviation};
use hemilux_tests::rendering;
use hemilux_tests::scenes::Builder;
use std::sync::Arc;

const SIDE: u32 = 48;

fn rendered(scene: &Arc<Scene>, method: &str, iterations: u64) -> Picture {
    let camera = ExplicitCamera {
        eye: [2.0, 1.5, 3.9],
        target: [2.0, 0.6, 1.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 60.0,
    };
    let request = RenderRequest {
        environment: Some(Arc::new(Environment::none())),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 5,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    rendering::rendered(&request).picture
}

fn covered(below: Material, factors: Layers) -> Material {
    Material { layering: Some(Box::new(Layering { factors, ..Layering::default() })), ..below }
}

/// A closed room with a lamp on its ceiling, whose floor, left block and right block are of these
/// materials.
fn room(floor: Material, [left, right]: [Material; 2]) -> Arc<Scene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::new(0.6, 0.55, 0.5));
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
    let [floor, left, right] = [floor, left, right].map(|material| builder.material(material));
    builder.cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true, wall);
    builder.quad(Vec3::new(0.01, 0.01, 3.99), 3.98 * Vec3::X, -3.98 * Vec3::Z, floor);
    builder.quad(Vec3::new(1.5, 2.99, 1.5), Vec3::X, Vec3::Z, lamp);
    builder.cuboid(Vec3::new(0.7, 0.02, 0.8), Vec3::new(1.6, 1.1, 1.7), false, left);
    builder.cuboid(Vec3::new(2.4, 0.02, 0.9), Vec3::new(3.3, 0.8, 1.8), false, right);
    let mut scene = Scene::clone(&builder.build());
    for vertex in &mut scene.vertices {
        vertex.tangent = vertex.normal.any_orthonormal_vector().extend(1.0);
    }
    Arc::new(scene)
}

/// The largest deviation of a block of pixels of `hemilux` from path tracing; `without` is the same
/// room without what is tested, which has to differ by more.
fn agrees(name: &str, scene: &Arc<Scene>, without: &Arc<Scene>, [most, least]: [f64; 2]) {
    let reference = block_means(&rendered(scene, "ray-traced", 250), 8);
    // What differs by far needs few iterations to show it.
    let [ours, plain] = [(scene, 8), (without, 2)].map(|(scene, iterations)| {
        largest_deviation(&block_means(&rendered(scene, "hemilux", iterations), 8), &reference)
    });
    println!("{name}: largest deviation {ours:.4}, without {plain:.4}");
    assert!(ours < most, "{name}: {ours}");
    assert!(plain > least, "{name}: {plain}");
}

#[test]
fn coats_are_those_of_path_tracing() {
    let floor = Material { roughness: 0.6, base_color: Rgb::splat(0.3), ..Material::default() };
    let left = Material { metallic: 1.0, roughness: 0.5, ..Material::default() };
    let right = Material::lambertian("paint", Rgb::new(0.6, 0.1, 0.1));
    let coat = |coat_roughness| Layers { coat: 1.0, coat_roughness, ..Layers::NONE };
    let with = room(
        covered(floor.clone(), coat(0.1)),
        [covered(left.clone(), coat(0.3)), covered(right.clone(), coat(0.0))],
    );
    agrees("coats", &with, &room(floor, [left, right]), [0.05, 0.1]);
}

/// What a coat leaves of the light below goes by its own normal, not by that of the map below it.
#[test]
fn a_coat_dims_by_its_own_normal() {
    let matt = Material { roughness: 0.9, base_color: Rgb::splat(0.8), ..Material::default() };
    let polished = Layers { coat: 1.0, coat_roughness: 0.1, ..Layers::NONE };
    let slot = TextureSlot { encoding: Encoding::Linear, ..TextureSlot::plain(0) };
    let map = Some(NormalMap { slot, scale: 1.0 });
    // Of one texel, which leans by 37°.
    let map_of_one = Texture { width: 1, height: 1, texels: vec![[204, 128, 230, 255]] };
    let with_floor = |coat_normal_map| {
        let layering = Layering { factors: polished, coat_normal_map, ..Layering::default() };
        let floor =
            Material { normal_map: map, layering: Some(Box::new(layering)), ..matt.clone() };
        let mut scene = Scene::clone(&room(floor, [matt.clone(), matt.clone()]));
        scene.textures.push(map_of_one.clone());
        Arc::new(scene)
    };
    agrees("a coat's normal", &with_floor(None), &with_floor(map), [0.05, 0.1]);
}

#[test]
fn sheen_is_that_of_path_tracing() {
    let cloth = Material { roughness: 1.0, base_color: Rgb::splat(0.1), ..Material::default() };
    let sheen =
        |sheen_color, sheen_roughness| Layers { sheen_color, sheen_roughness, ..Layers::NONE };
    let blue = sheen(Rgb::new(0.3, 0.5, 0.9), 0.5);
    let with = room(
        covered(cloth.clone(), sheen(Rgb::splat(0.8), 0.3)),
        [covered(cloth.clone(), blue), covered(cloth.clone(), Layers { coat: 0.8, ..blue })],
    );
    agrees("sheen", &with, &room(cloth.clone(), [cloth.clone(), cloth]), [0.05, 0.1]);
}

#[test]
fn films_and_brushed_metals_are_those_of_path_tracing() {
    let floor = Material { roughness: 0.6, base_color: Rgb::splat(0.3), ..Material::default() };
    let steel = Material { metallic: 1.0, roughness: 0.3, ..Material::lambertian("", Rgb::ONE) };
    let film = Layers { film: 1.0, film_thickness: 500.0, film_ior: 1.5, ..Layers::NONE };
    let brushed = Layers { anisotropy: Vec2::new(0.8, 0.0), coat: 0.5, ..Layers::NONE };
    let with = room(
        covered(floor.clone(), film),
        [covered(steel.clone(), film), covered(steel.clone(), brushed)],
    );
    agrees("films, brushed", &with, &room(floor, [steel.clone(), steel]), [0.05, 0.1]);
}
