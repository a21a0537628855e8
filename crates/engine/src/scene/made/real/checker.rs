//! A checker to the horizon.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, union_of};
use super::super::texture::png;
use super::parts::{RealScene, matte, panel, seen_from};
use crate::radiometry::Rgb;
use crate::scene::environment::SUN_RADIUS;
use crate::scene::{Environment, Material, Sky, Sun};
use glam::{Vec2, Vec3};

/// Texels along a side of the texture and of one of its squares.
const SIDE: u32 = 64;
const SQUARE: u32 = 8;
/// Metres that the texture covers; its squares are 2 cm.
const TILE: f32 = 0.16;

/// A ground of 100 × 100 m with a checker of squares of 2 cm, which is finer than a pixel but for
/// the nearest metres, a block on it, the sun and a uniform sky.
pub fn checker() -> RealScene {
    let mut writer = GlbWriter::default();
    let mut texels = Vec::with_capacity((SIDE * SIDE * 3) as usize);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let light = (x / SQUARE + y / SQUARE).is_multiple_of(2);
            texels.extend(if light { [230u8; 3] } else { [25; 3] });
        }
    }
    let picture = png(&texels, SIDE, image::ExtendedColorType::Rgb8);
    let checked = writer.textured(&Material::lambertian("checker", Rgb::ONE), &picture);
    let ground = panel(Vec3::new(-50.0, 0.0, 4.0), 100.0 * Vec3::X, -100.0 * Vec3::Z);
    let mesh = Mesh::quads([&ground]).with_uvs(|at| Vec2::new(at.x, at.z) / TILE);
    writer.body("ground", &mesh, checked);
    let red = matte(&mut writer, "block", [0.6, 0.2, 0.12]);
    writer.body("block", &union_of(&[([-0.5, 0.0, -3.5], [0.3, 0.9, -2.7])]), red);
    let sun = Sun::towards(Vec3::new(0.7, 0.8, 0.4), Rgb::new(4.0, 3.8, 3.4), SUN_RADIUS);
    RealScene {
        name: "checker".into(),
        why: "a checker far finer than a pixel, to the horizon",
        glb: seen_from(writer, [0.0, 1.6, 2.0], [0.0, 0.7, -3.0], 0.9),
        environment: Environment {
            sky: Sky::Uniform(Rgb::new(0.5, 0.6, 0.8)),
            sun: Some(sun),
            ..Environment::none()
        },
    }
}
