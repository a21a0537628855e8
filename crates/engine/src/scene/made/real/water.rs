//! Glasses of water on a table.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, spline, union_of};
use super::parts::{RealScene, lamp, matte, panel, room, seen_from};
use crate::radiometry::Rgb;
use crate::scene::{Environment, Material, Volume};
use glam::Vec3;

/// Inner radius of a glass and height of its inner bottom, metres.
const INNER: [f32; 2] = [0.0325, 0.008];
/// How far water reaches into the glass, or stays away from it, metres.
const SLOP: f32 = 2e-4;

/// Two drinking glasses of water on a table in a closed room under a panel of light, as modellers
/// make them: the water of one overlaps the glass by .2 mm, that of the other leaves a gap of
/// .2 mm.
pub fn water() -> RealScene {
    let mut writer = GlbWriter::default();
    let floor = matte(&mut writer, "floor", [0.4, 0.36, 0.3]);
    let walls = matte(&mut writer, "walls", [0.6, 0.6, 0.56]);
    let ceiling = matte(&mut writer, "ceiling", [0.75; 3]);
    room(&mut writer, Vec3::new(2.4, 2.4, 2.4), [floor, walls, ceiling]);
    let wood = matte(&mut writer, "table", [0.5, 0.34, 0.2]);
    let leg = |x: f32, z: f32| ([x, 0.0, z], [x + 0.05, 0.71, z + 0.05]);
    let table = union_of(&[
        ([0.5, 0.71, 0.6], [1.9, 0.75, 1.4]),
        leg(0.5, 0.6),
        leg(1.85, 0.6),
        leg(0.5, 1.35),
        leg(1.85, 1.35),
    ]);
    writer.body("table", &table, wood);
    let orange = matte(&mut writer, "orange", [0.8, 0.35, 0.05]);
    writer.body("orange", &Mesh::sphere(0.04, 24, 48).at(Vec3::new(1.24, 0.791, 0.84)), orange);
    let book = matte(&mut writer, "book", [0.12, 0.25, 0.5]);
    writer.body("book", &union_of(&[([1.02, 0.7505, 0.8], [1.16, 0.78, 0.92])]), book);

    let clear = writer.material(&Material::glass("glass", 1.5));
    let volume = Volume { attenuation_color: Rgb::new(0.7, 0.9, 0.95), attenuation_distance: 0.5 };
    let wet = Material { volume: Some(volume), ..Material::glass("water", 1.333) };
    let wet = writer.material(&wet);
    for (x, reach) in [(1.13, SLOP), (1.27, -SLOP)] {
        let at = Vec3::new(x, 0.7505, 1.02);
        writer.body("glass", &tumbler().at(at), clear);
        let [radius, bottom] = [INNER[0] + reach, INNER[1] - reach];
        writer.body("water", &Mesh::drum(radius, bottom, 0.085, 0.005, 96).at(at), wet);
    }
    let corner = Vec3::new(0.5, 2.39, 0.6);
    lamp(&mut writer, &panel(corner, 0.9 * Vec3::X, 0.9 * Vec3::Z), Rgb::new(9.0, 8.6, 8.0));
    RealScene {
        name: "water".into(),
        why: "water in glasses, overlapping them or with a gap",
        glb: seen_from(writer, [1.2, 1.02, 1.52], [1.2, 0.79, 1.0], 0.45),
        environment: Environment::none(),
    }
}

/// A drinking glass 7 cm wide and 12 cm high with a thick bottom, a closed body.
fn tumbler() -> Mesh {
    // From the middle of the bottom along the outside over the rim down the inside.
    let [inner, bottom] = INNER.map(f64::from);
    let profile = [
        [0.0, 0.0],
        [0.030, 0.0],
        [0.034, 0.001],
        [0.035, 0.005],
        [0.035, 0.060],
        [0.035, 0.117],
        [0.0345, 0.1195],
        [0.03375, 0.120],
        [0.033, 0.1195],
        [inner, 0.117],
        [inner, 0.060],
        [inner, 0.013],
        [0.031, 0.009],
        [0.027, bottom],
        [0.0, bottom],
    ];
    Mesh::revolved(&spline(&profile, 2), 96)
}
