//! Rooms for measuring: the furnace, lamps near a ceiling, two rooms joined by a corridor, a room of any
//! triangle count.

use super::glb::GlbWriter;
use super::mesh::{Mesh, Quad, boundary, union_of};
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material};
use glam::Vec3;

/// A closed unit box whose diffuse walls all emit `emission` and reflect `albedo`: the radiance
/// is emission / (1 − albedo) everywhere and in every direction.
pub fn furnace(albedo: Rgb, emission: Rgb) -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let wall =
        writer.material(&Material { emission, ..Material::lambertian("furnace wall", albedo) });
    let line = [0.0, 1.0];
    let walls: Vec<_> = boundary([&line; 3], |_| true).into_iter().map(Quad::flipped).collect();
    writer.body("walls", &Mesh::quads(&walls), wall);
    let (eye, target) = (Vec3::new(0.5, 0.5, 0.9), Vec3::new(0.5, 0.5, 0.0));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    writer.finish()
}

/// A room with lamps near its ceiling.
pub struct CeilingLamps {
    /// The scene.
    pub glb: Vec<u8>,
    /// The lowest and the highest corner of each lamp, m.
    pub boxes: Vec<[Vec3; 2]>,
    /// Their surface through which light leaves, m².
    pub area: f32,
    /// Their radiance.
    pub emission: f32,
}

/// A grey room, 4 by 3 by 4 m, with four flat black lamps so many metres below its ceiling.
pub fn ceiling_lamps(gap: f32) -> CeilingLamps {
    const SIZE: [f32; 3] = [4.0, 3.0, 4.0];
    const LAMP: Vec3 = Vec3::new(0.55, 0.03, 0.45);
    let emission = 10.0;
    let mut writer = GlbWriter::default();
    let grey = writer.material(&Material::lambertian("walls", Rgb::splat(0.75)));
    let dark = Material::lambertian("lamps", Rgb::ZERO);
    let lamp = writer.material(&Material { emission: Rgb::splat(emission), ..dark });
    let [x, y, z] = SIZE;
    let walls = boundary([&[0.0, x], &[0.0, y], &[0.0, z]], |_| true);
    let walls: Vec<_> = walls.into_iter().map(Quad::flipped).collect();
    writer.body("walls", &Mesh::quads(&walls), grey);
    let (mut lamps, mut boxes) = (Mesh::default(), Vec::new());
    for place in [[0.6, 0.7], [2.7, 0.8], [0.7, 2.6], [2.6, 2.7]] {
        let low = Vec3::new(place[0], y - gap - LAMP.y, place[1]);
        let high = low + LAMP;
        lamps.add(union_of(&[(low.to_array(), high.to_array())]));
        boxes.push([low, high]);
    }
    writer.body("lamps", &lamps, lamp);
    let (eye, target) = (Vec3::new(0.2, 1.6, 3.8), Vec3::new(3.0, 1.5, 0.5));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    // What touches the ceiling shines into it.
    let [bottom, sides] = [LAMP.x * LAMP.z, 2.0 * (LAMP.x + LAMP.z) * LAMP.y];
    let each = sides + if gap > 0.0 { 2.0 * bottom } else { bottom };
    let area = each * boxes.len() as f32;
    CeilingLamps { glb: writer.finish(), boxes, area, emission }
}

/// Two rooms joined by a corridor, the only light in the ceiling of the first; what the camera in
/// the second sees is lit by many bounces. Closed; a sphere and a cupboard stand in it.
pub fn corridor() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let white = writer.material(&Material::lambertian("white", Rgb::splat(0.75)));
    let floor = writer.material(&Material::lambertian("floor", Rgb::new(0.45, 0.38, 0.30)));
    let warm = writer.material(&Material::lambertian("warm wall", Rgb::new(0.70, 0.42, 0.25)));
    let light = writer.material(&Material {
        emission: Rgb::new(40.0, 38.0, 34.0),
        ..Material::lambertian("light", Rgb::ZERO)
    });
    // Rooms at both ends of x, the corridor in the middle third of z and below the lintel.
    let xs = [0.0, 1.5, 2.5, 4.0, 7.0, 11.0];
    let ys = [0.0, 2.2, 2.8];
    let zs = [0.0, 1.5, 2.5, 4.0];
    let quads = boundary([&xs, &ys, &zs], |[x, y, z]| x != 3 || (y == 0 && z == 1));
    let inward: Vec<_> = quads.into_iter().map(Quad::flipped).collect();
    let kind = |quad: &Quad| {
        let (center, normal) = (quad.center(), quad.normal());
        if normal.y > 0.5 {
            floor
        } else if normal.y < -0.5
            && (1.5..2.5).contains(&center.x)
            && (1.5..2.5).contains(&center.z)
        {
            light
        } else if center.x == 11.0 {
            warm
        } else {
            white
        }
    };
    for (name, material) in
        [("floor", floor), ("light", light), ("far wall", warm), ("walls and ceiling", white)]
    {
        let mesh = Mesh::quads(inward.iter().filter(|quad| kind(quad) == material));
        writer.body(name, &mesh, material);
    }
    let blue = writer.material(&Material::lambertian("blue", Rgb::new(0.20, 0.30, 0.60)));
    let sphere = Mesh::sphere(0.4, 16, 32).at(Vec3::new(8.6, 0.41, 2.9));
    writer.body("sphere", &sphere, blue);
    let cupboard = super::mesh::union_of(&[([9.6, 0.0, 0.5], [10.4, 1.6, 1.1])]);
    writer.body("cupboard", &cupboard, warm);
    let (eye, target) = (Vec3::new(10.6, 1.6, 3.6), Vec3::new(6.8, 1.0, 1.7));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.1));
    writer.finish()
}

/// Where the wall of [`divided_room`] stands, metres along x.
pub const DIVIDED_AT: f32 = 1.63;

/// A room of 4.03 × 2.71 × 3.97 m that a wall of that `thickness` divides. The wall goes on into the
/// floor, the ceiling and one wall, ends `gap` before the other wall, and is a sheet without ends where
/// it has no thickness. The only lamp is in the first room; the camera is in the second.
pub fn divided_room(thickness: f32, gap: f32) -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let white = writer.material(&Material::lambertian("white", Rgb::new(0.7, 0.7, 0.65)));
    let inner = Material::lambertian("dividing wall", Rgb::new(0.6, 0.5, 0.4));
    let inner = writer.material(&Material { double_sided: thickness == 0.0, ..inner });
    let light = writer.material(&Material {
        emission: Rgb::new(50.0, 50.0, 45.0),
        ..Material::lambertian("light", Rgb::ZERO)
    });
    let red = writer.material(&Material::lambertian("red", Rgb::new(0.6, 0.2, 0.2)));
    let (width, height, depth) = (4.03, 2.71, 3.97);
    let lines: [&[f32]; 3] = [&[0.0, width], &[0.0, height], &[0.0, depth]];
    let walls: Vec<_> = boundary(lines, |_| true).into_iter().map(Quad::flipped).collect();
    writer.body("walls", &Mesh::quads(&walls), white);
    let x = DIVIDED_AT;
    if thickness > 0.0 {
        let end = if gap > 0.0 { depth - gap } else { depth + 0.05 };
        let wall = ([x, -0.05, -0.05], [x + thickness, height + 0.05, end]);
        writer.body("dividing wall", &super::mesh::union_of(&[wall]), inner);
    } else {
        let at = |y, z| Vec3::new(x, y, z);
        let far = depth - gap;
        let sheet =
            Quad { corners: [at(0.0, 0.0), at(height, 0.0), at(height, far), at(0.0, far)] };
        writer.body("dividing wall", &Mesh::quads([&sheet]), inner);
    }
    let lamp = super::mesh::union_of(&[([0.4, 2.65, 1.1], [1.2, 2.7, 1.9])]);
    writer.body("lamp", &lamp, light);
    let block = super::mesh::union_of(&[([2.5, 0.0, 1.0], [3.2, 0.8, 1.8])]);
    writer.body("block", &block, red);
    let (eye, target) = (Vec3::new(3.9, 1.7, 3.7), Vec3::new(2.4, 0.9, 0.6));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.0));
    writer.finish()
}

/// A closed room with five bumpy bodies and a light in the ceiling, of about `triangles`
/// triangles, all of them needed for the shape: a fifth in the walls, the rest in the bodies.
/// From about 300 up to some millions.
pub fn tessellated_room(triangles: usize) -> Vec<u8> {
    const BODIES: usize = 5;
    let mut writer = GlbWriter::default();
    let white = writer.material(&Material::lambertian("white", Rgb::splat(0.7)));
    let light = writer.material(&Material {
        emission: Rgb::new(12.0, 11.0, 10.0),
        ..Material::lambertian("light", Rgb::ZERO)
    });
    // Six sides of k × k quads; the light is the middle third of the ceiling.
    let thirds = ((0.2 * triangles as f64 / 12.0).sqrt() / 3.0).round().max(1.0) as usize;
    let line = |length: f32| -> Vec<f32> {
        let steps = 3 * thirds;
        (0..=steps).map(|step| length * step as f32 / steps as f32).collect()
    };
    let (xs, ys, zs) = (line(4.0), line(3.0), line(4.0));
    let (mut walls, mut lamp) = (Vec::new(), Vec::new());
    for quad in shell([&xs, &ys, &zs]) {
        let center = quad.center();
        let middle = |x: f32| (4.0 / 3.0..8.0 / 3.0).contains(&x);
        if quad.normal().y < -0.5 && middle(center.x) && middle(center.z) {
            lamp.push(quad);
        } else {
            walls.push(quad);
        }
    }
    writer.body("walls", &Mesh::quads(&walls), white);
    writer.body("light", &Mesh::quads(&lamp), light);
    // A sphere of s stacks and 2s slices has 4s(s − 1) triangles.
    let each = triangles.saturating_sub(2 * (walls.len() + lamp.len())) as f64 / BODIES as f64;
    let stacks = ((0.5 * (1.0 + (1.0 + each).sqrt())).round() as u32).max(4);
    let colors = [
        Rgb::new(0.65, 0.20, 0.15),
        Rgb::new(0.20, 0.50, 0.25),
        Rgb::new(0.20, 0.30, 0.65),
        Rgb::new(0.65, 0.55, 0.20),
        Rgb::splat(0.6),
    ];
    for (body, color) in colors.into_iter().enumerate() {
        let material = writer.material(&Material::lambertian(&format!("body {body}"), color));
        let place = [[1.0, 1.0], [3.0, 1.0], [2.0, 2.0], [1.0, 3.0], [3.0, 3.0]][body];
        let radius = 0.35 + 0.05 * body as f32;
        let mesh = bumpy_sphere(radius, stacks, 3 + body as u32).at(Vec3::new(
            place[0],
            1.2 * radius + 0.01,
            place[1],
        ));
        writer.body(&format!("body {body}"), &mesh, material);
    }
    let (eye, target) = (Vec3::new(0.3, 1.9, 3.8), Vec3::new(2.4, 0.6, 1.4));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.1));
    writer.finish()
}

/// The inside of a box, each side cut along the given lines.
fn shell(lines: [&[f32]; 3]) -> Vec<Quad> {
    let mut quads = Vec::new();
    for axis in 0..3 {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        for (end, positive) in [(lines[axis][0], false), (lines[axis][lines[axis].len() - 1], true)]
        {
            for along_b in lines[b].windows(2) {
                for along_c in lines[c].windows(2) {
                    let corner = |u: f32, v: f32| {
                        let mut point = [end; 3];
                        point[b] = u;
                        point[c] = v;
                        Vec3::from_array(point)
                    };
                    let quad = Quad {
                        corners: [
                            corner(along_b[0], along_c[0]),
                            corner(along_b[1], along_c[0]),
                            corner(along_b[1], along_c[1]),
                            corner(along_b[0], along_c[1]),
                        ],
                    };
                    // The front is towards the room.
                    quads.push(if positive { quad.flipped() } else { quad });
                }
            }
        }
    }
    quads
}

/// A sphere whose radius waves by a tenth; smooth normals from the triangles around each vertex.
fn bumpy_sphere(radius: f32, stacks: u32, waves: u32) -> Mesh {
    let mut mesh = Mesh::sphere(radius, stacks, 2 * stacks);
    for position in &mut mesh.positions {
        // A polynomial of the direction, so that no two platforms disagree on it.
        let d = *position / radius;
        let frequency = waves as f32;
        let wave = |x: f32| {
            let phase = (x * frequency).rem_euclid(2.0) - 1.0;
            4.0 * phase * (1.0 - phase.abs())
        };
        let bump = 0.1 * (wave(d.x) + wave(d.y) + wave(d.z)) / 3.0;
        *position = (*position * (1.0 + bump)).to_array().map(snap).into();
    }
    let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
        for index in triangle {
            normals[*index as usize] += (b - a).cross(c - a);
        }
    }
    mesh.normals =
        normals.into_iter().map(|n| n.normalize_or(Vec3::Y).to_array().map(snap).into()).collect();
    mesh
}

fn snap(x: f32) -> f32 {
    let grid = (1 << 16) as f32;
    (x * grid).round() / grid + 0.0
}
