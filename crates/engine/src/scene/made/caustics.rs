//! Scenes for caustics: a metal ring that gathers light into a cusp on the floor, and clear bodies
//! that focus it.

use super::glb::GlbWriter;
use super::mesh::{Mesh, Quad, boundary, spline};
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material, Volume};
use glam::Vec3;

/// Sides of the room, metres.
const ROOM: [f32; 3] = [3.0, 2.4, 3.0];
/// Phong exponent of the polished metal: a quarter of a degree.
const POLISH: f32 = 40_000.0;

/// A polished metal ring on the floor of a closed room, lit from one side by a small lamp: what
/// its inside reflects meets in a cusp (the nephroid of coffee cups).
pub fn ring() -> Vec<u8> {
    let mut writer = room();
    let gold = writer.material(&Material::metal("gold", Rgb::new(0.95, 0.72, 0.38), POLISH));
    // From the outside over a rounded top to the inside; it stands on the floor.
    let wall = [
        [0.400, 0.000],
        [0.400, 0.125],
        [0.400, 0.240],
        [0.398, 0.248],
        [0.390, 0.250],
        [0.382, 0.248],
        [0.380, 0.240],
        [0.380, 0.125],
        [0.380, 0.000],
    ];
    let ring = Mesh::revolved(&spline(&wall, 1), 192).at(Vec3::new(1.5, 0.0, 1.5));
    writer.body("ring", &ring, gold);
    let (eye, target) = (Vec3::new(1.55, 1.35, 2.55), Vec3::new(1.55, 0.05, 1.5));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 0.7));
    writer.finish()
}

/// A sphere of clear glass and a lens of tinted glass over the floor of a closed room, lit by a
/// small lamp.
pub fn glass() -> Vec<u8> {
    let mut writer = room();
    let clear = writer.material(&Material::glass("clear glass", 1.5));
    let tinted = writer.material(&Material {
        volume: Some(Volume {
            attenuation_color: Rgb::new(0.35, 0.75, 0.95),
            attenuation_distance: 0.2,
        }),
        ..Material::glass("tinted glass", 1.5)
    });
    let sphere = Mesh::sphere(0.22, 48, 96).at(Vec3::new(1.2, 0.24, 1.45));
    writer.body("sphere", &sphere, clear);
    let lens = Mesh::spheroid(0.2, 0.1, 32, 96).at(Vec3::new(1.85, 0.12, 1.6));
    writer.body("lens", &lens, tinted);
    let (eye, target) = (Vec3::new(1.75, 1.25, 2.75), Vec3::new(1.6, 0.05, 1.5));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 0.7));
    writer.finish()
}

/// A closed room with a small lamp high on the left.
fn room() -> GlbWriter {
    let mut writer = GlbWriter::default();
    let plaster = writer.material(&Material::lambertian("plaster", Rgb::new(0.55, 0.54, 0.52)));
    let floor = writer.material(&Material::lambertian("floor", Rgb::splat(0.6)));
    let lamp = writer.material(&Material {
        emission: Rgb::new(400.0, 380.0, 340.0),
        ..Material::lambertian("lamp", Rgb::ZERO)
    });
    let [x, y, z] = ROOM;
    let quads = boundary([&[0.0, x], &[0.0, y], &[0.0, z]], |_| true);
    let inward: Vec<_> = quads.into_iter().map(Quad::flipped).collect();
    let is_floor = |quad: &&Quad| quad.normal().y > 0.5;
    writer.body("floor", &Mesh::quads(inward.iter().filter(is_floor)), floor);
    let rest = inward.iter().filter(|quad| !is_floor(quad));
    writer.body("walls and ceiling", &Mesh::quads(rest), plaster);
    let bulb = Mesh::sphere(0.06, 8, 16).at(Vec3::new(0.5, 0.8, 1.0));
    writer.body("lamp", &bulb, lamp);
    writer
}
