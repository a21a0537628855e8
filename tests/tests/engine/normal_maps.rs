//! Normal maps turn all light, also what has bounced.

use glam::{Vec2, Vec3};
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Encoding, Environment, Material, NormalMap, Scene, Texture, TextureSlot,
};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::sync::Arc;

const SIDE: u32 = 32;
/// Tilt of the floor's normals towards the red wall.
const TILT_DEGREES: f32 = 35.0;

/// A room, 4 m square and 2 m high, with a red wall at x = 0, a blue one at x = 4 and a lamp that
/// shines at the ceiling alone, so that all light on the floor has bounced; the floor's normals are
/// turned to the red wall by a map, or not.
fn room(is_mapped: bool) -> Arc<Scene> {
    let mut builder = Builder::default();
    let white = builder.lambertian(Rgb::splat(0.7));
    let red = builder.lambertian(Rgb::new(0.8, 0.1, 0.1));
    let blue = builder.lambertian(Rgb::new(0.1, 0.1, 0.8));
    let floor = builder.material(Material::lambertian("floor", Rgb::splat(0.5)));
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
    let (x, y, z) = (4.0 * Vec3::X, 2.0 * Vec3::Y, 4.0 * Vec3::Z);
    builder.quad(z, x, -z, floor);
    builder.quad(y, x, z, white);
    builder.quad(Vec3::ZERO, x, y, white);
    builder.quad(x + z, -x, y, white);
    builder.quad(z, -z, y, red);
    builder.quad(x, z, y, blue);
    builder.quad(Vec3::new(1.5, 1.4, 2.5), Vec3::X, -Vec3::Z, lamp);
    let mut scene = Scene::clone(&builder.build());
    if is_mapped {
        // A map of one texel, whose red points along the tangent, −x.
        let (sin, cos) = TILT_DEGREES.to_radians().sin_cos();
        let code = |part: f32| ((0.5 * part + 0.5) * 255.0).round() as u8;
        let texel = [code(sin), 128, code(cos), 255];
        scene.textures.push(Texture { width: 1, height: 1, texels: vec![texel] });
        let slot = TextureSlot { encoding: Encoding::Linear, ..TextureSlot::plain(0) };
        scene.materials[floor as usize].normal_map = Some(NormalMap { slot, scale: 1.0 });
        for triangle in scene.triangles.clone().iter().filter(|one| one.material == floor) {
            for vertex in triangle.vertices {
                let vertex = &mut scene.vertices[vertex as usize];
                vertex.uv[0] = Vec2::new(-vertex.position.x, vertex.position.z);
                vertex.tangent = (-Vec3::X).extend(1.0);
            }
        }
    }
    Arc::new(scene)
}

/// Mean radiance of the middle of the floor.
fn floor(scene: &Arc<Scene>, (method, iterations): (&str, u64)) -> Rgb {
    let camera = ExplicitCamera {
        eye: [2.0, 1.2, 2.0],
        target: [2.0, 0.0, 2.0],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 60.0,
    };
    let request = RenderRequest {
        environment: Some(Arc::new(Environment::none())),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 3,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    let picture = rendered(&request).picture;
    picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32
}

#[test]
fn bounced_light_follows_normal_maps() {
    let (mapped, plain) = (room(true), room(false));
    let exact = floor(&mapped, ("ray-traced", 600));
    let found = floor(&mapped, ("hemilux", 6));
    let flat = floor(&plain, ("hemilux", 6));
    println!("ray-traced {exact}, hemilux {found}, without the map {flat}");
    // Beside what arrives without the map: what is kept of directions is that much off.
    let off = |of: Rgb| ((of - exact) / flat).abs().max_element();
    assert!(off(found) < 0.04, "{found} beside {exact}");
    assert!(off(flat) > 0.2, "the map changes little: {flat} beside {exact}");
    assert!(found.x / found.z > 1.2 * flat.x / flat.z, "it is turned to the red wall");
}
