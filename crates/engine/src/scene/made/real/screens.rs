//! A wall of screens.

use super::super::glb::{GlbWriter, Maps};
use super::super::mesh::Mesh;
use super::super::texture::{hash, png};
use super::parts::{RealScene, matte, metal, panel, room, seen_from};
use crate::radiometry::Rgb;
use crate::scene::{Environment, Material};
use glam::{Vec2, Vec3};

/// Texels along a side of a screen.
const SIDE: u32 = 64;
/// Radiance of a white texel.
const BRIGHTEST: f32 = 20.0;

/// Nine screens of 64 × 64 texels with random patterns, most texels dark and some bright, which
/// are all the light in a room of 5 × 3 × 4 m.
pub fn screens(seed: u32) -> RealScene {
    let mut writer = GlbWriter::default();
    let floor = matte(&mut writer, "floor", [0.5, 0.48, 0.45]);
    let walls = matte(&mut writer, "walls", [0.45, 0.45, 0.5]);
    let ceiling = matte(&mut writer, "ceiling", [0.6; 3]);
    room(&mut writer, Vec3::new(5.0, 3.0, 4.0), [floor, walls, ceiling]);
    for screen in 0..9u32 {
        let emission = Some(writer.texture(&pattern(hash(seed, screen))));
        let dark = Material::lambertian("screen", Rgb::ZERO);
        let shining = Material { emission: Rgb::splat(BRIGHTEST), ..dark };
        let material = writer.mapped(&shining, Maps { emission, ..Maps::default() });
        let (column, row) = ((screen % 3) as f32, (screen / 3) as f32);
        let corner = Vec3::new(0.9 + 1.1 * column, 0.5 + 0.75 * row, 0.02);
        let (size, across) = (Vec2::new(1.0, 0.65), Vec3::X);
        let mesh = Mesh::quads([&panel(corner, size.x * across, size.y * Vec3::Y)])
            .with_uvs(|at| Vec2::new(at.x - corner.x, corner.y + size.y - at.y) / size);
        writer.body("screen", &mesh, material);
    }
    let grey = matte(&mut writer, "ball", [0.6; 3]);
    writer.body("ball", &Mesh::sphere(0.35, 24, 48).at(Vec3::new(1.5, 0.351, 1.4)), grey);
    let steel = writer.material(&metal("steel ball", Rgb::splat(0.75), 0.25));
    writer.body("steel ball", &Mesh::sphere(0.35, 32, 64).at(Vec3::new(3.4, 0.351, 1.5)), steel);
    RealScene {
        name: "screens".into(),
        why: "nine video screens, 36,864 texels that shine or don't",
        glb: seen_from(writer, [2.9, 1.6, 3.8], [2.4, 0.9, 0.8], 1.05),
        environment: Environment::none(),
    }
}

/// Blocks of texels, one in four of them bright, in colours by chance.
fn pattern(seed: u32) -> Vec<u8> {
    let mut texels = Vec::with_capacity((SIDE * SIDE * 3) as usize);
    // Patterns of one to eight texels.
    let coarse = 1 << (seed % 4);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let block = hash(seed ^ (x / coarse), y / coarse);
            let bright = block.is_multiple_of(4);
            let channel = |shift: u32| {
                let code = (block >> shift) & 255;
                if bright { 128 + code / 2 } else { code / 12 }
            };
            texels.extend([8, 16, 24].map(|shift| channel(shift) as u8));
        }
    }
    png(&texels, SIDE, image::ExtendedColorType::Rgb8)
}
