//! Textures that are finer than pixels, and textures that shine.

use super::glb::GlbWriter;
use super::mesh::{Mesh, Quad};
use super::texture;
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material};
use glam::{Vec2, Vec3};

/// A floor, 80 m square, with a checker of so many squares a metre, seen at eye height as far as
/// the horizon. Nothing in it shines.
pub fn checker(squares_per_metre: f32) -> Vec<u8> {
    const HALF: f32 = 40.0;
    let mut writer = GlbWriter::default();
    let material = Material::lambertian("checker", Rgb::ONE);
    let material = writer.textured(&material, &texture::checker());
    let floor = rectangle(Vec3::new(-HALF, 0.0, HALF), 2.0 * HALF * Vec3::X, -2.0 * HALF * Vec3::Z);
    let scale = squares_per_metre / texture::CHECKER_SQUARES as f32;
    let mesh = Mesh::quads(&[floor]).with_uvs(|at| scale * Vec2::new(at.x, at.z));
    writer.body("floor", &mesh, material);
    let (eye, target) = (Vec3::new(0.3, 1.6, 39.0), Vec3::new(1.0, 0.4, 35.0));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    writer.finish()
}

/// A closed grey room, 6 × 3 × 5 m, lit by nine video screens on the far wall, each with a
/// picture of 64 × 64 texels that `seed` says; a dark panel stands before them.
pub fn screens(seed: u32) -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let grey = writer.material(&Material::lambertian("grey", Rgb::splat(0.6)));
    let (x, y, z) = (6.0 * Vec3::X, 3.0 * Vec3::Y, 5.0 * Vec3::Z);
    let walls = [
        rectangle(z, x, -z),
        rectangle(y, x, z),
        rectangle(Vec3::ZERO, x, y),
        rectangle(x + z, -x, y),
        rectangle(z, -z, y),
        rectangle(x, z, y),
    ];
    writer.body("room", &Mesh::quads(&walls), grey);
    for screen in 0..9u32 {
        let material = Material {
            emission: Rgb::splat(6.0),
            ..Material::lambertian(&format!("screen {screen}"), Rgb::splat(0.03))
        };
        let picture = texture::screen(texture::hash(seed, screen));
        let material = writer.shining(&material, &picture);
        let corner =
            Vec3::new(0.75 + 1.6 * (screen % 3) as f32, 0.3 + 0.85 * (screen / 3) as f32, 0.02);
        let size = Vec2::new(1.3, 0.7);
        let quad = rectangle(corner, size.x * Vec3::X, size.y * Vec3::Y);
        let uv = |at: Vec3| {
            let at = (at - corner).truncate() / size;
            Vec2::new(at.x, 1.0 - at.y)
        };
        writer.body(&format!("screen {screen}"), &Mesh::quads(&[quad]).with_uvs(uv), material);
    }
    let dark = writer.material(&Material::lambertian("panel", Rgb::splat(0.2)));
    let panel = super::mesh::union_of(&[([2.2, 0.0, 1.6], [2.5, 1.2, 2.6])]);
    writer.body("panel", &panel, dark);
    let (eye, target) = (Vec3::new(4.6, 1.7, 4.7), Vec3::new(2.6, 1.2, 0.0));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    writer.finish()
}

/// A parallelogram whose front is the side from which `u` to `v` turns left.
fn rectangle(corner: Vec3, u: Vec3, v: Vec3) -> Quad {
    Quad { corners: [corner, corner + u, corner + u + v, corner + v] }
}
