//! A room with one small window.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, Quad, boundary, union_of};
use super::parts::{RealScene, daylight, matte, panel, seen_from};
#[cfg(test)]
use crate::radiometry::Rgb;
use crate::scene::Material;
use glam::Vec3;

/// Lines of the house along x, y and z, metres: the outsides of walls 20 cm thick, and their insides.
const XS: [f32; 4] = [-0.2, 0.0, 4.0, 4.2];
const YS: [f32; 4] = [-0.2, 0.0, 2.7, 2.9];
const ZS: [f32; 4] = [-0.2, 0.0, 3.5, 3.7];
/// Where along x and y the window is in the wall to the south: 40 × 40 cm.
const WINDOW: [[f32; 2]; 2] = [[1.8, 2.2], [1.2, 1.6]];
/// One of 220 × 130 cm.
#[cfg(test)]
const WIDE_WINDOW: [[f32; 2]; 2] = [[0.9, 3.1], [0.9, 2.2]];
/// Where the pane stands in the wall.
const PANE_Z: f32 = 3.6;

/// A closed room of 4 × 2.7 × 3.5 m with a window of 40 × 40 cm to the south, through which an
/// afternoon's sun and sky shine; the camera looks away from it.
pub fn window() -> RealScene {
    house("window", "a room lit through one window of 40 cm by sun and sky", WINDOW, |_| ())
}

/// The same with a window as wide as half of the wall.
#[cfg(test)]
pub fn wide_window() -> RealScene {
    house("wide_window", "a room lit through a wide window by sun and sky", WIDE_WINDOW, |_| ())
}

/// The room with its small window and a lamp under the ceiling, which shines far less than the sun does on what
/// that reaches, and far more on all else.
#[cfg(test)]
pub fn lamp_beside_window() -> RealScene {
    house("lamp_beside_window", "a room with a window and a lamp", WINDOW, |writer| {
        let quad = panel(Vec3::new(1.6, 2.69, 1.4), 0.8 * Vec3::X, 0.8 * Vec3::Z);
        super::parts::lamp(writer, &quad, Rgb::splat(3e4));
    })
}

/// The room with a pane in the middle of the window's wall, before which the wall is in the sun; frosted where
/// it has a roughness.
pub fn glazed(roughness: f32) -> RealScene {
    house("glazed", "the same window with a pane of glass", WINDOW, |writer| {
        let glass = Material {
            name: "glass".into(),
            roughness,
            transmission: 1.0,
            double_sided: true,
            ..Material::default()
        };
        let glass = writer.material(&glass);
        let [low, high] = [0, 1].map(|end| Vec3::new(WINDOW[0][end], WINDOW[1][end], PANE_Z));
        let pane = panel(low, Vec3::X * (high.x - low.x), Vec3::Y * (high.y - low.y));
        writer.body("pane", &Mesh::quads([&pane]), glass);
    })
}

/// The room with a window there along x and y, and what `furnish` adds.
fn house(
    name: &str,
    why: &'static str,
    [across, up]: [[f32; 2]; 2],
    furnish: impl FnOnce(&mut GlbWriter),
) -> RealScene {
    let xs = [XS[0], XS[1], across[0], across[1], XS[2], XS[3]];
    let ys = [YS[0], YS[1], up[0], up[1], YS[2], YS[3]];
    let mut writer = GlbWriter::default();
    let plaster = matte(&mut writer, "plaster", [0.72, 0.7, 0.66]);
    let wood = matte(&mut writer, "floor", [0.45, 0.32, 0.22]);
    let solid = |[x, y, z]: [usize; 3]| {
        let inside = (1..4).contains(&x) && (1..4).contains(&y) && z == 1;
        let open = x == 2 && y == 2 && z == 2;
        !(inside || open)
    };
    let quads = boundary([&xs, &ys, &ZS], solid);
    let is_floor = |quad: &&Quad| quad.corners.iter().all(|corner| corner.y == 0.0);
    let floor = Mesh::quads(quads.iter().filter(is_floor));
    writer.body("floor", &floor, wood);
    let rest = Mesh::quads(quads.iter().filter(|quad| !is_floor(quad)));
    writer.body("walls and ceiling", &rest, plaster);

    let blue = matte(&mut writer, "chest", [0.2, 0.3, 0.55]);
    let chest = union_of(&[([2.6, 0.0, 0.25], [3.6, 0.75, 0.75])]);
    writer.body("chest", &chest, blue);
    let red = matte(&mut writer, "ball", [0.65, 0.18, 0.12]);
    writer.body("ball", &Mesh::sphere(0.3, 24, 48).at(Vec3::new(1.5, 0.301, 1.1)), red);
    let white = matte(&mut writer, "vase", [0.75, 0.75, 0.72]);
    let vase = Mesh::drum(0.12, 0.0, 0.4, 0.02, 48).at(Vec3::new(3.1, 0.751, 0.5));
    writer.body("vase", &vase, white);
    furnish(&mut writer);
    RealScene {
        name: name.into(),
        why,
        glb: seen_from(writer, [0.5, 1.6, 3.2], [2.4, 0.75, 0.6], 1.0),
        environment: daylight("48.1,11.6,2026-10-10T13:00:00Z"),
    }
}
