//! A furnished office under three ceiling panels.

use super::glb::GlbWriter;
use super::mesh::{Block, Mesh, Quad, boundary, spline, union_of};
use super::texture;
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material};
use glam::{Affine3A, Quat, Vec2, Vec3};

/// Ceiling height, metres.
const HEIGHT: f32 = 2.7;
/// Side of the square that one copy of the floor texture covers, metres.
const FLOOR_TILE: f32 = 1.6;
/// How far bodies stand clear of what carries them, metres.
const CLEARANCE: f32 = 0.001;

/// Height of the desk top, metres.
const DESK: f32 = 0.74;
/// Height of what stands on the desk, metres.
const ON_DESK: f32 = DESK + CLEARANCE;

/// Profile of the vase, outside and inside, from the axis to the axis: distance from the axis and
/// height, metres.
const VASE: &[[f64; 2]] = &[
    [0.0, 0.0],
    [0.039, 0.0],
    [0.045, 0.001],
    [0.055, 0.012],
    [0.088, 0.085],
    [0.092, 0.135],
    [0.062, 0.205],
    [0.040, 0.245],
    [0.044, 0.275],
    [0.062, 0.300],
    [0.060, 0.304],
    [0.055, 0.300],
    [0.038, 0.275],
    [0.034, 0.245],
    [0.056, 0.203],
    [0.085, 0.135],
    [0.080, 0.088],
    [0.048, 0.020],
    [0.040, 0.0145],
    [0.0, 0.014],
];

/// Profile of the cup.
const CUP: &[[f64; 2]] = &[
    [0.0, 0.0],
    [0.026, 0.0],
    [0.031, 0.001],
    [0.036, 0.006],
    [0.040, 0.045],
    [0.041, 0.090],
    [0.040, 0.092],
    [0.038, 0.090],
    [0.037, 0.045],
    [0.033, 0.010],
    [0.028, 0.0072],
    [0.0, 0.007],
];

/// Profile of the lamp shade, which is open on both ends.
const SHADE: &[[f64; 2]] = &[
    [0.130, 0.30],
    [0.112, 0.37],
    [0.080, 0.49],
    [0.078, 0.493],
    [0.076, 0.49],
    [0.108, 0.37],
    [0.126, 0.30],
    [0.128, 0.297],
    [0.130, 0.30],
];

/// Profile of the bin.
const BIN: &[[f64; 2]] = &[
    [0.0, 0.0],
    [0.105, 0.0],
    [0.112, 0.001],
    [0.116, 0.006],
    [0.130, 0.170],
    [0.143, 0.330],
    [0.141, 0.333],
    [0.139, 0.330],
    [0.126, 0.170],
    [0.112, 0.012],
    [0.105, 0.0082],
    [0.0, 0.008],
];

/// A furnished office, 4.8 × 2.7 × 3.6 m, closed: desk, chair, shelves with books, a screen, a
/// lamp with a shade, a globe, a bin, a textured wooden floor, three emitting ceiling panels and a
/// smooth glossy vase (ks .25, n 30).
pub fn office() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    room(&mut writer);
    desk(&mut writer);
    chair(&mut writer);
    shelves(&mut writer);
    vase(&mut writer);
    cup(&mut writer);
    lamp(&mut writer);
    globe(&mut writer);
    bin(&mut writer);
    let (eye, target) = (Vec3::new(4.45, 1.55, 3.3), Vec3::new(1.7, 0.75, 0.9));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 0.95));
    let (eye, target) = (Vec3::new(2.75, 1.15, 1.75), Vec3::new(1.95, 0.85, 0.55));
    writer.camera(&Camera::look_at("vase", eye, target, Vec3::Y, 0.7));
    writer.finish()
}

fn diffuse(writer: &mut GlbWriter, name: &str, r: f32, g: f32, b: f32) -> usize {
    writer.material(&Material::lambertian(name, Rgb::new(r, g, b)))
}

fn room(writer: &mut GlbWriter) {
    let white = diffuse(writer, "white paint", 0.76, 0.75, 0.72);
    let blue = diffuse(writer, "blue paint", 0.32, 0.43, 0.55);
    let wood = writer.textured(&Material::lambertian("parquet", Rgb::ONE), &texture::parquet());
    let panel = writer.material(&Material {
        emission: Rgb::new(16.0, 15.5, 14.5),
        ..Material::lambertian("ceiling panel", Rgb::ZERO)
    });
    let xs = [0.0, 0.6, 1.2, 2.1, 2.7, 3.6, 4.2, 4.8];
    let zs = [0.0, 1.2, 2.4, 3.6];
    let quads = boundary([&xs, &[0.0, HEIGHT], &zs], |_| true);
    let inward: Vec<_> = quads.into_iter().map(Quad::flipped).collect();
    let is_panel = |center: Vec3| {
        [(0.6, 1.2), (2.1, 2.7), (3.6, 4.2)].iter().any(|(a, b)| (*a..*b).contains(&center.x))
            && (1.2..2.4).contains(&center.z)
    };
    let kind = |quad: &Quad| match quad.normal() {
        up if up.y > 0.5 => wood,
        down if down.y < -0.5 && is_panel(quad.center()) => panel,
        side if side.x > 0.5 => blue,
        _ => white,
    };
    for (name, material) in
        [("floor", wood), ("ceiling panels", panel), ("blue wall", blue), ("white walls", white)]
    {
        let mut mesh = Mesh::quads(inward.iter().filter(|quad| kind(quad) == material));
        if material == wood {
            mesh = mesh.with_uvs(|p| Vec2::new(p.x, p.z) / FLOOR_TILE);
        }
        writer.body(name, &mesh, material);
    }
}

fn desk(writer: &mut GlbWriter) {
    let oak = Material::phong("varnished oak", Rgb::new(0.42, 0.27, 0.15), 0.06, 12.0);
    let oak = writer.material(&oak);
    let mut blocks: Vec<Block> = vec![([1.2, 0.70, 0.15], [2.8, DESK, 0.90])];
    for x in [1.25, 2.69] {
        for z in [0.20, 0.79] {
            blocks.push(([x, 0.0, z], [x + 0.06, 0.70, z + 0.06]));
        }
    }
    // A chest of drawers under the right end.
    blocks.push(([2.30, 0.0, 0.20], [2.66, 0.62, 0.77]));
    writer.body("desk", &union_of(&blocks), oak);

    let black = Material::phong("black plastic", Rgb::splat(0.04), 0.05, 60.0);
    let black = writer.material(&black);
    let y = DESK + CLEARANCE;
    let screen = union_of(&[
        ([1.47, y, 0.30], [1.73, y + 0.012, 0.48]),
        ([1.57, y + 0.012, 0.36], [1.63, y + 0.10, 0.39]),
        ([1.32, y + 0.10, 0.36], [1.88, y + 0.44, 0.39]),
    ]);
    writer.body("screen", &screen, black);
    let paper = diffuse(writer, "paper", 0.82, 0.81, 0.76);
    let sheets = union_of(&[([2.25, y, 0.55], [2.46, y + 0.02, 0.84])]);
    writer.body("sheets", &sheets, paper);
    let keys = diffuse(writer, "keyboard", 0.25, 0.25, 0.27);
    let keyboard = union_of(&[([1.38, y, 0.60], [1.80, y + 0.02, 0.74])]);
    writer.body("keyboard", &keyboard, keys);
}

fn chair(writer: &mut GlbWriter) {
    let cloth = diffuse(writer, "red cloth", 0.55, 0.12, 0.10);
    let beech = diffuse(writer, "beech", 0.62, 0.47, 0.31);
    // Coordinates of a chair that faces −Z around its own axis.
    let turned = |mesh: Mesh| {
        mesh.moved(Affine3A::from_rotation_translation(
            Quat::from_rotation_y(-0.45),
            Vec3::new(1.75, 0.0, 1.35),
        ))
    };
    let mut frame: Vec<Block> = vec![([-0.22, 0.42, -0.22], [0.22, 0.45, 0.22])];
    for x in [-0.22, 0.18] {
        frame.push(([x, 0.0, -0.22], [x + 0.04, 0.42, -0.18]));
        frame.push(([x, 0.0, 0.18], [x + 0.04, 0.92, 0.22]));
    }
    frame.push(([-0.18, 0.82, 0.19], [0.18, 0.90, 0.21]));
    frame.push(([-0.18, 0.62, 0.19], [0.18, 0.70, 0.21]));
    writer.body("chair", &turned(union_of(&frame)), beech);
    let seat = ([-0.20, 0.45 + CLEARANCE, -0.20], [0.20, 0.50, 0.17]);
    writer.body("cushion", &turned(union_of(&[seat])), cloth);
}

fn shelves(writer: &mut GlbWriter) {
    const LEVELS: [f32; 5] = [0.06, 0.44, 0.82, 1.20, 1.58];
    let white = diffuse(writer, "lacquer", 0.70, 0.69, 0.66);
    // Along the wall x = 0, clear of it.
    let (back, front, left, right) = (0.02, 0.32, 1.30, 2.70);
    let mut blocks: Vec<Block> = vec![
        ([back, 0.0, left], [front, 1.96, left + 0.02]),
        ([back, 0.0, right - 0.02], [front, 1.96, right]),
        ([back, 0.0, left + 0.02], [back + 0.01, 1.96, right - 0.02]),
        ([back + 0.01, 1.94, left + 0.02], [front, 1.96, right - 0.02]),
    ];
    for level in LEVELS {
        blocks.push(([back + 0.01, level, left + 0.02], [front, level + 0.02, right - 0.02]));
    }
    writer.body("shelves", &union_of(&blocks), white);

    let covers = [
        diffuse(writer, "red cover", 0.50, 0.13, 0.11),
        diffuse(writer, "green cover", 0.16, 0.36, 0.20),
        diffuse(writer, "blue cover", 0.15, 0.22, 0.45),
        diffuse(writer, "ochre cover", 0.60, 0.45, 0.18),
        diffuse(writer, "grey cover", 0.38, 0.37, 0.36),
    ];
    let mut books = [const { Vec::<Quad>::new() }; 5];
    let mut number = 0u32;
    for level in LEVELS {
        let foot = level + 0.02 + CLEARANCE;
        let mut z = left + 0.03;
        loop {
            let noise = texture::hash(number, 7);
            number += 1;
            let share = |shift: u32| ((noise >> shift) & 15) as f32 / 15.0;
            let thickness = 0.020 + 0.030 * share(0);
            // Some shelves end early.
            let end = right - 0.04 - 0.25 * (texture::hash((level * 100.0) as u32, 3) % 3) as f32;
            if z + thickness > end {
                break;
            }
            let (height, depth) = (0.20 + 0.10 * share(4), 0.15 + 0.07 * share(8));
            let low = Vec3::new(back + 0.03, foot, z);
            let high = Vec3::new(back + 0.03 + depth, foot + height, z + thickness);
            books[(noise >> 12) as usize % books.len()].extend(box_faces(low, high));
            z += thickness + 0.002;
        }
    }
    for ((index, quads), material) in books.iter().enumerate().zip(covers) {
        writer.body(&format!("books {index}"), &Mesh::quads(quads), material);
    }
}

fn box_faces(low: Vec3, high: Vec3) -> Vec<Quad> {
    boundary([&[low.x, high.x], &[low.y, high.y], &[low.z, high.z]], |_| true)
}

fn vase(writer: &mut GlbWriter) {
    let glaze = Material::phong("glazed vase", Rgb::new(0.10, 0.30, 0.42), 0.25, 30.0);
    let glaze = writer.material(&glaze);
    let vase = Mesh::revolved(&spline(VASE, 3), 48).at(Vec3::new(2.06, ON_DESK, 0.45));
    writer.body("vase", &vase, glaze);
}

fn cup(writer: &mut GlbWriter) {
    let china = Material::phong("china", Rgb::splat(0.70), 0.05, 40.0);
    let china = writer.material(&china);
    let cup = Mesh::revolved(&spline(CUP, 2), 32).at(Vec3::new(1.98, ON_DESK, 0.70));
    writer.body("cup", &cup, china);
}

fn lamp(writer: &mut GlbWriter) {
    let place = Vec3::new(2.58, ON_DESK, 0.36);
    let brass = Material::phong("brass", Rgb::new(0.30, 0.21, 0.07), 0.30, 50.0);
    let brass = writer.material(&brass);
    let mut lamp = Mesh::drum(0.08, 0.0, 0.02, 0.006, 32);
    lamp.add(Mesh::capsule(0.009, 0.021, 0.36, 4, 16));
    writer.body("lamp", &lamp.at(place), brass);
    let cloth = diffuse(writer, "lamp shade", 0.68, 0.60, 0.45);
    let shade = Mesh::revolved(&spline(SHADE, 3), 40).at(place);
    writer.body("lamp shade", &shade, cloth);
}

fn globe(writer: &mut GlbWriter) {
    let ocean = Material::phong("globe", Rgb::new(0.15, 0.25, 0.40), 0.05, 25.0);
    let ocean = writer.material(&ocean);
    let globe = Mesh::sphere(0.13, 20, 40).at(Vec3::new(0.17, 1.96 + 0.13 + CLEARANCE, 2.35));
    writer.body("globe", &globe, ocean);
}

fn bin(writer: &mut GlbWriter) {
    let steel = Material::phong("bin", Rgb::splat(0.30), 0.20, 20.0);
    let steel = writer.material(&steel);
    let bin = Mesh::revolved(&spline(BIN, 2), 40).at(Vec3::new(3.15, CLEARANCE, 0.45));
    writer.body("bin", &bin, steel);
}
