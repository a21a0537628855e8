//! Rooms by chance of things that furnished rooms have not, and files from outside have: plates that face
//! away, hollow boxes, glass, what is half there, one through the other.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, Quad, boundary};
use super::super::texture;
use super::parts::{Chance, RealScene, metal, seen_from};
use crate::radiometry::Rgb;
use crate::scene::{Alpha, Environment, Material, Sky, Volume};
use glam::{Affine3A, Quat, Vec3};

/// Which faces of a box there are, by the direction in which they face.
type HasFace = fn(Vec3) -> bool;

/// Shapes of things: a plate, a box, one without a bottom, and a shell that is open on two sides.
const SHAPES: [(&str, HasFace); 4] = [
    ("plate", |normal| normal.z > 0.5),
    ("box", |_| true),
    ("hood", |normal| normal.y > -0.5),
    ("shell", |normal| normal.y < 0.5 && normal.z < 0.5),
];

/// A room without thickness, closed or open to a sky at the top or behind the camera, in which up to
/// seven things hang and stand as they happen to: one-sided plates, hollow boxes, shells that face
/// inwards or outwards, turned anyhow and through each other; matte, metal, glossy, half there, clear,
/// black. One or two lamps. All by a seed.
pub fn odd_room(seed: u32) -> RealScene {
    let mut chance = Chance::new(texture::hash(seed, 0x0dd));
    let mut writer = GlbWriter::default();
    let size =
        Vec3::new(chance.between(2.0, 5.0), chance.between(2.0, 3.0), chance.between(2.4, 5.0));
    let is_open = shell(&mut writer, &mut chance, size);
    for _ in 0..(3.0 + 5.0 * chance.unit()) as u32 {
        thing(&mut writer, &mut chance, size);
    }
    for _ in 0..(1.0 + 2.0 * chance.unit()) as u32 {
        lamp(&mut writer, &mut chance, size);
    }
    let sky = Sky::Uniform(chance.color(0.5, 1.5));
    let eye = [chance.between(0.3, 0.7) * size.x, 0.55 * size.y, size.z - 0.15];
    let target = [0.5 * size.x, chance.between(0.3, 0.5) * size.y, 0.3 * size.z];
    RealScene {
        name: format!("odd-{seed}"),
        why: "plates, hollow things and all kinds of material through each other, by chance",
        glb: seen_from(writer, eye, target, chance.between(0.8, 1.2)),
        environment: if is_open {
            Environment { sky, ..Environment::none() }
        } else {
            Environment::none()
        },
    }
}

/// The faces of a box about the origin.
fn faces(size: Vec3, has_face: impl Fn(Vec3) -> bool, inward: bool) -> Vec<Quad> {
    let half = (0.5 * size).to_array();
    let lines = half.map(|half| [-half, half]);
    let all = boundary([&lines[0], &lines[1], &lines[2]], |_| true);
    let some = all.into_iter().filter(|quad| has_face(quad.normal()));
    some.map(|quad| if inward { quad.flipped() } else { quad }).collect()
}

/// Walls, floor and ceiling of one paint; whether one of them is missing.
fn shell(writer: &mut GlbWriter, chance: &mut Chance, size: Vec3) -> bool {
    let open = match chance.unit() {
        kind if kind < 0.15 => Some(Vec3::Y),
        kind if kind < 0.3 => Some(Vec3::Z),
        _ => None,
    };
    let paint = Material::lambertian("paint", chance.color(0.45, 0.9));
    let paint = writer.material(&paint);
    let there = |normal: Vec3| open.is_none_or(|open| normal.dot(open) < 0.5);
    let walls = faces(size, there, true);
    writer.body("room", &Mesh::quads(&walls).at(0.5 * size), paint);
    open.is_some()
}

/// Something that hangs or lies somewhere.
fn thing(writer: &mut GlbWriter, chance: &mut Chance, size: Vec3) {
    let (finish, is_solid) = finish(chance);
    let (name, has_face) = match is_solid {
        true => SHAPES[1],
        false => SHAPES[(chance.unit() * SHAPES.len() as f32) as usize],
    };
    let mut side = || chance.between(0.2, 0.9);
    let sides = Vec3::new(side(), side(), side());
    let is_inward = name == "shell" && chance.unit() < 0.5;
    let mesh = Mesh::quads(&faces(sides, has_face, is_inward));
    // Not where the camera is.
    let mut place =
        Vec3::new(chance.between(0.15, 0.85), chance.between(0.15, 0.85), chance.between(0.1, 0.6))
            * size;
    let mut turn = Quat::IDENTITY;
    if chance.unit() < 0.3 {
        // On the floor, or a little in it.
        place.y = 0.5 * sides.y - if chance.unit() < 0.3 { 0.05 } else { 0.0 };
    } else {
        let mut number = || chance.between(-1.0, 1.0);
        turn = Quat::from_xyzw(number(), number(), number(), number()).normalize();
    }
    let material = writer.material(&finish);
    writer.body(name, &mesh.moved(Affine3A::from_rotation_translation(turn, place)), material);
}

/// Of what a thing is, and whether that must be closed.
fn finish(chance: &mut Chance) -> (Material, bool) {
    let color = chance.color(0.1, 0.9);
    let paint = |name: &str| Material::lambertian(name, color);
    let glossy = |roughness| Material {
        name: "gloss".into(),
        base_color: color,
        roughness,
        ..Material::default()
    };
    let mut finish = match (chance.unit() * 9.0) as u32 {
        0 => paint("matte"),
        1 => Material::lambertian("black", Rgb::ZERO),
        2 => metal("metal", color, chance.between(0.3, 0.9)),
        3 => glossy(chance.between(0.15, 0.6)),
        4 => Material { alpha: Alpha::Blend, opacity: chance.between(0.2, 0.8), ..paint("veil") },
        5 => Material {
            alpha: Alpha::Blend,
            opacity: chance.between(0.3, 0.9),
            ..glossy(chance.between(0.2, 1.0))
        },
        6 => {
            let volume =
                Volume { attenuation_color: color, attenuation_distance: chance.between(0.3, 3.0) };
            return (Material { volume: Some(volume), ..Material::glass("glass", 1.5) }, true);
        }
        7 => Material {
            base_color: color,
            volume: None,
            transmission: chance.between(0.5, 1.0),
            ..Material::glass("pane", 1.5)
        },
        _ => paint("card"),
    };
    finish.double_sided = chance.unit() < 0.5;
    (finish, false)
}

/// A lamp: a box, or a plate below the ceiling.
fn lamp(writer: &mut GlbWriter, chance: &mut Chance, size: Vec3) {
    let emission = Rgb::new(1.0, 0.9, 0.8) * chance.between(8.0, 30.0);
    let shining =
        writer.material(&Material { emission, ..Material::lambertian("lamp", Rgb::splat(0.5)) });
    let is_plate = chance.unit() < 0.5;
    let mut side = || chance.between(0.15, 0.5);
    let sides = Vec3::new(side(), if is_plate { 0.02 } else { side() }, side());
    let height = if is_plate { 0.97 } else { chance.between(0.4, 0.9) };
    let place = Vec3::new(chance.between(0.2, 0.8), height, chance.between(0.15, 0.6)) * size;
    let mesh = match is_plate {
        true => Mesh::quads(&faces(sides, |normal| normal.y < -0.5, false)),
        false => Mesh::quads(&faces(sides, |_| true, false)),
    };
    writer.body("lamp", &mesh.at(place), shining);
}
