//! A corridor of mirrors.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, union_of};
use super::parts::{RealScene, lamp, matte, metal, panel, room, seen_from};
use crate::radiometry::Rgb;
use crate::scene::Environment;
use glam::Vec3;

/// A corridor of 6 × 2.6 × 1.6 m whose long walls are mirrors of polished metal, one perfect and
/// one of roughness .05, with a lamp on its ceiling and a ball on a plinth in its middle.
pub fn mirrors() -> RealScene {
    let mut writer = GlbWriter::default();
    let floor = matte(&mut writer, "floor", [0.4, 0.38, 0.34]);
    let walls = matte(&mut writer, "walls", [0.7, 0.6, 0.42]);
    let ceiling = matte(&mut writer, "ceiling", [0.75; 3]);
    room(&mut writer, Vec3::new(6.0, 2.6, 1.6), [floor, walls, ceiling]);
    // Before the long walls, so that these can't be seen.
    let polished = writer.material(&metal("mirror", Rgb::splat(0.92), 0.0));
    let brushed = writer.material(&metal("dull mirror", Rgb::new(0.9, 0.88, 0.82), 0.05));
    let (along, up) = (6.0 * Vec3::X, 2.6 * Vec3::Y);
    let far = panel(Vec3::new(0.0, 0.0, 0.005), along, up);
    writer.body("mirror", &Mesh::quads([&far]), polished);
    let near = panel(Vec3::new(6.0, 0.0, 1.595), -along, up);
    writer.body("dull mirror", &Mesh::quads([&near]), brushed);

    let plinth = matte(&mut writer, "plinth", [0.6; 3]);
    writer.body("plinth", &union_of(&[([2.8, 0.0, 0.6], [3.2, 0.8, 1.0])]), plinth);
    let red = matte(&mut writer, "ball", [0.7, 0.12, 0.08]);
    writer.body("ball", &Mesh::sphere(0.2, 24, 48).at(Vec3::new(3.0, 1.001, 0.8)), red);
    let corner = Vec3::new(2.6, 2.59, 0.6);
    let shade = panel(corner, 0.8 * Vec3::X, 0.4 * Vec3::Z);
    lamp(&mut writer, &shade, Rgb::new(22.0, 20.0, 17.0));
    RealScene {
        name: "mirrors".into(),
        why: "a corridor between two mirrors, perfect and nearly so",
        glb: seen_from(writer, [0.4, 1.5, 1.0], [3.6, 1.05, 0.5], 1.0),
        environment: Environment::none(),
    }
}
