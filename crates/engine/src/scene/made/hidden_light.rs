//! Rooms whose light is hidden in part: a lamp in its shade, a window behind blinds, a hall of
//! hanging lamps. All that is thin or shines has two sides, as modelling programs write it.

use super::glb::GlbWriter;
use super::mesh::{Block, Mesh, Quad, boundary, union_of};
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material};
use glam::{DVec2, Vec3};

fn two_sided(writer: &mut GlbWriter, name: &str, color: Rgb) -> usize {
    writer.material(&Material { double_sided: true, ..Material::lambertian(name, color) })
}

fn shining(writer: &mut GlbWriter, name: &str, emission: Rgb) -> usize {
    let dark = Material::lambertian(name, Rgb::ZERO);
    writer.material(&Material { emission, double_sided: true, ..dark })
}

/// Walls and ceiling, and a floor, but for the cells of the right wall that are `open`.
fn room(writer: &mut GlbWriter, lines: [&[f32]; 3], open: impl Fn(Vec3) -> bool) {
    let white = two_sided(writer, "walls and ceiling", Rgb::new(0.73, 0.71, 0.68));
    let wood = two_sided(writer, "floor", Rgb::new(0.45, 0.33, 0.22));
    let width = lines[0][lines[0].len() - 1];
    let quads: Vec<_> = boundary(lines, |_| true).into_iter().map(Quad::flipped).collect();
    let is_open = |quad: &&Quad| quad.center().x == width && open(quad.center());
    let (floor, others): (Vec<_>, Vec<_>) =
        quads.iter().filter(|quad| !is_open(quad)).partition(|quad| quad.normal().y > 0.5);
    writer.body("floor", &Mesh::quads(floor), wood);
    writer.body("walls and ceiling", &Mesh::quads(others), white);
}

/// A table, .74 m high, of which `at` is the middle of the floor below it.
fn table(at: Vec3, half: [f32; 2]) -> Mesh {
    let [x, z] = half;
    let mut blocks: Vec<Block> = vec![([-x, 0.7, -z], [x, 0.74, z])];
    for [side, front] in [[-1.0f32, -1.0f32], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
        let (x, z) = (side * (x - 0.05), front * (z - 0.05));
        blocks.push(([x - 0.02, 0.0, z - 0.02], [x + 0.02, 0.7, z + 0.02]));
    }
    union_of(&blocks).at(at)
}

/// A room at night: a bulb of 264 triangles in a shade that is open above and below, on a stand
/// beside a table. Half of all that shines is on the inside of the shade.
pub fn shade() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    room(&mut writer, [&[0.0, 5.0], &[0.0, 2.7], &[0.0, 4.0]], |_| false);
    let wood = two_sided(&mut writer, "table", Rgb::new(0.6, 0.4, 0.25));
    let cloth = two_sided(&mut writer, "shade", Rgb::new(0.7, 0.65, 0.5));
    let red = two_sided(&mut writer, "box", Rgb::new(0.5, 0.2, 0.15));
    let bulb = shining(&mut writer, "bulb", Rgb::new(120.0, 100.0, 70.0));
    writer.body("table", &table(Vec3::new(1.6, 0.0, 1.0), [0.8, 0.4]), wood);
    writer.body("box", &union_of(&[([4.0, 0.0, 2.0], [4.8, 0.7, 3.2])]), red);
    let foot = Vec3::new(3.5, 0.0, 1.2);
    writer.body("foot", &Mesh::drum(0.15, 0.001, 0.02, 0.002, 24).at(foot), wood);
    writer.body("stand", &Mesh::drum(0.015, 0.02, 1.45, 0.001, 8).at(foot), wood);
    let out = DVec2::new(0.35, 0.1);
    let side = [(DVec2::new(0.25, 1.4), out), (DVec2::new(0.15, 1.75), out)];
    writer.body("shade", &Mesh::revolved(&side.to_vec(), 32).at(foot), cloth);
    let at = foot + Vec3::Y * 1.55;
    writer.body("bulb", &Mesh::sphere(0.05, 12, 12).at(at), bulb);
    let (eye, target) = (Vec3::new(0.5, 1.6, 3.7), Vec3::new(2.9, 1.0, 0.9));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 0.96));
    writer.finish()
}

/// A room by day: 26 slats before a window, the sky a large light half a metre behind it.
pub fn blinds() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let (ys, zs) = ([0.0, 0.9, 2.2, 2.7], [0.0, 1.0, 2.8, 4.0]);
    room(&mut writer, [&[0.0, 5.0], &ys, &zs], |at| {
        (0.9..2.2).contains(&at.y) && (1.0..2.8).contains(&at.z)
    });
    let wood = two_sided(&mut writer, "table", Rgb::new(0.6, 0.4, 0.25));
    let slat = two_sided(&mut writer, "slats", Rgb::new(0.75, 0.75, 0.72));
    let sky = shining(&mut writer, "sky", Rgb::new(18.0, 20.0, 24.0));
    let rectangle = |corner: Vec3, u: Vec3, v: Vec3| Quad {
        corners: [corner, corner + u, corner + u + v, corner + v],
    };
    let behind = rectangle(Vec3::new(5.5, 0.4, 0.5), Vec3::Z * 2.8, Vec3::Y * 2.3);
    writer.body("sky", &Mesh::quads([&behind]), sky);
    let slats: Vec<Quad> = (0..26)
        .map(|k| {
            // 52° from level, the inner edge lower.
            let across = Vec3::new(0.027, 0.034, 0.0);
            let middle = Vec3::new(4.98, 0.92 + 0.05 * k as f32, 1.0);
            rectangle(middle - 0.5 * across, Vec3::Z * 1.8, across)
        })
        .collect();
    writer.body("slats", &Mesh::quads(&slats), slat);
    writer.body("table", &table(Vec3::new(2.8, 0.0, 1.6), [0.8, 0.4]), wood);
    let red = two_sided(&mut writer, "box", Rgb::new(0.7, 0.2, 0.2));
    writer.body("box", &union_of(&[([2.55, 0.741, 1.4], [2.85, 0.941, 1.6])]), red);
    let (eye, target) = (Vec3::new(0.4, 1.6, 3.7), Vec3::new(2.2, 0.75, 0.6));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    writer.finish()
}

/// A hall with twenty places to work at between screens, under thirty flat lamps that hang half a
/// centimetre below the ceiling and shine to all sides.
pub fn hall() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    room(&mut writer, [&[0.0, 14.0], &[0.0, 3.0], &[0.0, 10.0]], |_| false);
    let wood = two_sided(&mut writer, "tables", Rgb::new(0.65, 0.55, 0.4));
    let screen = two_sided(&mut writer, "screens", Rgb::new(0.4, 0.5, 0.55));
    let dark = two_sided(&mut writer, "monitors", Rgb::splat(0.05));
    let lamp = shining(&mut writer, "lamps", Rgb::new(9.0, 9.5, 10.0));
    let books = [[0.6, 0.2, 0.2], [0.2, 0.5, 0.3], [0.25, 0.3, 0.6], [0.7, 0.6, 0.2]]
        .map(|color| two_sided(&mut writer, "books", Rgb::from_array(color)));
    let mut lamps = Mesh::default();
    for place in 0..30 {
        let (x, z) = (1.1 + 2.25 * (place % 6) as f32, 0.7 + 2.0 * (place / 6) as f32);
        lamps.add(union_of(&[([x, 2.965, z], [x + 0.6, 2.995, z + 0.6])]));
    }
    let (mut tables, mut screens, mut monitors) =
        (Mesh::default(), Mesh::default(), Mesh::default());
    let mut shelves: [Mesh; 4] = Default::default();
    for place in 0..20 {
        let (x, z) = (1.8 + 2.6 * (place % 5) as f32, 1.6 + 2.3 * (place / 5) as f32);
        tables.add(table(Vec3::new(x, 0.0, z), [0.8, 0.4]));
        let block = |[x0, y0, z0]: [f32; 3], [x1, y1, z1]: [f32; 3]| {
            union_of(&[([x + x0, y0, z + z0], [x + x1, y1, z + z1])])
        };
        screens.add(block([-0.95, 0.01, -0.46], [0.95, 1.2, -0.42]));
        monitors.add(block([-0.28, 0.88, -0.17], [0.28, 1.22, -0.14]));
        monitors.add(block([-0.03, 0.741, -0.2], [0.03, 0.9, -0.18]));
        monitors.add(block([-0.2, 0.741, 0.05], [0.2, 0.755, 0.19]));
        for book in 0..8 {
            let left = 0.5 + 0.022 * book as f32;
            let height = 0.94 + 0.01 * ((3 * book + place) % 7) as f32;
            shelves[(book + place) % 4]
                .add(block([left, 0.741, -0.39], [left + 0.02, height, -0.21]));
        }
    }
    for (name, mesh, material) in [
        ("lamps", &lamps, lamp),
        ("tables", &tables, wood),
        ("screens", &screens, screen),
        ("monitors", &monitors, dark),
    ] {
        writer.body(name, mesh, material);
    }
    for (mesh, material) in shelves.iter().zip(books) {
        writer.body("books", mesh, material);
    }
    let (eye, target) = (Vec3::new(0.5, 1.75, 9.6), Vec3::new(7.0, 0.8, 3.0));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.05));
    writer.finish()
}
