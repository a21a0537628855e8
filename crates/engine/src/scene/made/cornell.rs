//! The Cornell box, and a variant with two glossy bodies.

use super::glb::GlbWriter;
use super::mesh::{Mesh, Quad, spline};
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material};
use glam::{Affine3A, Quat, Vec3};

/// Full vertical field of view that shows 25 mm of a 35 mm lens, radians: 2·atan(12.5/35).
const YFOV: f32 = 0.686_047_85;

const HEIGHT: f32 = 0.5488;
const DEPTH: f32 = 0.5592;

const fn point(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z)
}

/// The Cornell box in metres, as measured at Cornell (walls that are not quite parallel), with
/// diffuse RGB walls; 46 triangles, one camera. The light fills a hole in the ceiling.
pub fn cornell() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let white = empty_box(&mut writer);
    let short = block(0.165, [[0.130, 0.065], [0.082, 0.225], [0.240, 0.272], [0.290, 0.114]]);
    writer.body("short block", &short, white);
    let tall = block(0.330, [[0.423, 0.247], [0.265, 0.296], [0.314, 0.456], [0.472, 0.406]]);
    writer.body("tall block", &tall, white);
    writer.finish()
}

/// Walls, light and camera; returns the white material.
fn empty_box(writer: &mut GlbWriter) -> usize {
    let white = writer.material(&Material::lambertian("white", Rgb::splat(0.73)));
    let red = writer.material(&Material::lambertian("red", Rgb::new(0.65, 0.05, 0.05)));
    let green = writer.material(&Material::lambertian("green", Rgb::new(0.12, 0.45, 0.15)));
    let light = writer.material(&Material {
        emission: Rgb::new(17.0, 12.0, 4.0),
        ..Material::lambertian("light", Rgb::ZERO)
    });
    let mut wall = |name: &str, corners: [Vec3; 4], material: usize| {
        writer.body(name, &Mesh::quads([&Quad { corners }]), material);
    };
    wall(
        "floor",
        [
            point(0.5528, 0.0, 0.0),
            point(0.0, 0.0, 0.0),
            point(0.0, 0.0, DEPTH),
            point(0.5496, 0.0, DEPTH),
        ],
        white,
    );
    wall(
        "back",
        [
            point(0.5496, 0.0, DEPTH),
            point(0.0, 0.0, DEPTH),
            point(0.0, HEIGHT, DEPTH),
            point(0.556, HEIGHT, DEPTH),
        ],
        white,
    );
    wall(
        "right",
        [
            point(0.0, 0.0, DEPTH),
            point(0.0, 0.0, 0.0),
            point(0.0, HEIGHT, 0.0),
            point(0.0, HEIGHT, DEPTH),
        ],
        green,
    );
    wall(
        "left",
        [
            point(0.5528, 0.0, 0.0),
            point(0.5496, 0.0, DEPTH),
            point(0.556, HEIGHT, DEPTH),
            point(0.556, HEIGHT, 0.0),
        ],
        red,
    );
    ceiling(writer, white, light);
    let eye = point(0.278, 0.273, -0.8);
    writer.camera(&Camera::look_at("camera", eye, eye + Vec3::Z, Vec3::Y, YFOV));
    white
}

/// The ceiling, with the light in its middle.
fn ceiling(writer: &mut GlbWriter, white: usize, light: usize) {
    let (xs, zs) = ([0.0, 0.213, 0.343, 0.556], [0.0, 0.227, 0.332, DEPTH]);
    let mut ceiling = Vec::new();
    for x in 0..3 {
        for z in 0..3 {
            let quad = Quad {
                corners: [
                    point(xs[x + 1], HEIGHT, zs[z]),
                    point(xs[x + 1], HEIGHT, zs[z + 1]),
                    point(xs[x], HEIGHT, zs[z + 1]),
                    point(xs[x], HEIGHT, zs[z]),
                ],
            };
            if (x, z) == (1, 1) {
                writer.body("light", &Mesh::quads([&quad]), light);
            } else {
                ceiling.push(quad);
            }
        }
    }
    writer.body("ceiling", &Mesh::quads(&ceiling), white);
}

/// A block without a bottom, its corners (x, z) in clockwise order seen from above.
fn block(height: f32, base: [[f32; 2]; 4]) -> Mesh {
    let corner = |index: usize, y: f32| point(base[index % 4][0], y, base[index % 4][1]);
    let mut quads = vec![Quad { corners: [0, 1, 2, 3].map(|index| corner(index, height)) }];
    for side in 0..4 {
        quads.push(Quad {
            corners: [
                corner(side + 1, 0.0),
                corner(side + 1, height),
                corner(side, height),
                corner(side, 0.0),
            ],
        });
    }
    Mesh::quads(&quads)
}

/// The Cornell box with two smooth modified-Phong bodies in place of the blocks: a robot
/// (ks .27, n 28) and an alien (ks .2, n 10), built of spheres, spheroids and capsules that
/// stand clear of each other and of the floor by 1 mm or more.
pub fn phong_cornell() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    empty_box(&mut writer);
    let steel = Material::phong("robot", Rgb::new(0.35, 0.38, 0.45), 0.27, 28.0);
    let steel = writer.material(&steel);
    let turn = Affine3A::from_rotation_translation(
        Quat::from_rotation_y(0.35),
        point(0.385, 0.001, 0.330),
    );
    writer.body("robot", &robot().moved(turn), steel);
    let skin = Material::phong("alien", Rgb::new(0.30, 0.55, 0.20), 0.20, 10.0);
    let skin = writer.material(&skin);
    let turn = Affine3A::from_rotation_translation(
        Quat::from_rotation_y(-0.3),
        point(0.165, 0.001, 0.210),
    );
    writer.body("alien", &alien().moved(turn), skin);
    writer.finish()
}

/// A capsule along a line.
fn limb(from: Vec3, to: Vec3, radius: f32, slices: u32) -> Mesh {
    let way = to - from;
    let turn = Quat::from_rotation_arc(Vec3::Y, way.normalize());
    Mesh::capsule(radius, 0.0, way.length(), slices / 4, slices)
        .moved(Affine3A::from_rotation_translation(turn, from))
}

/// Stands on y = 0 and faces −Z; 0.35 m tall.
fn robot() -> Mesh {
    let mut mesh = Mesh::drum(0.055, 0.122, 0.240, 0.015, 32);
    mesh.add(Mesh::spheroid(0.045, 0.038, 12, 24).at(point(0.0, 0.281, 0.0)));
    mesh.add(limb(point(0.0, 0.3205, 0.0), point(0.0, 0.345, 0.0), 0.004, 12));
    for side in [-1.0, 1.0] {
        mesh.add(Mesh::drum(0.028, 0.0, 0.022, 0.010, 24).at(point(0.031 * side, 0.0, -0.006)));
        mesh.add(limb(
            point(0.031 * side, 0.0235, 0.0),
            point(0.031 * side, 0.1205, 0.0),
            0.017,
            20,
        ));
        mesh.add(limb(
            point(0.074 * side, 0.232, 0.0),
            point(0.098 * side, 0.140, -0.030),
            0.015,
            20,
        ));
        mesh.add(Mesh::sphere(0.017, 8, 16).at(point(0.1025 * side, 0.122, -0.0365)));
        mesh.add(Mesh::sphere(0.008, 6, 12).at(point(0.018 * side, 0.288, -0.050)));
    }
    mesh
}

/// Stands on y = 0 and faces −Z; 0.24 m tall.
fn alien() -> Mesh {
    let body = spline(
        &[
            [0.0, 0.0],
            [0.034, 0.001],
            [0.044, 0.007],
            [0.056, 0.035],
            [0.044, 0.075],
            [0.022, 0.112],
            [0.0, 0.124],
        ],
        4,
    );
    let mut mesh = Mesh::revolved(&body, 32);
    let tilt = Quat::from_rotation_x(-0.25);
    mesh.add(
        Mesh::spheroid(0.050, 0.040, 14, 28)
            .moved(Affine3A::from_rotation_translation(tilt, point(0.0, 0.167, 0.0))),
    );
    for side in [-1.0, 1.0] {
        mesh.add(Mesh::sphere(0.013, 8, 16).at(point(0.024 * side, 0.178, -0.058)));
        mesh.add(limb(
            point(0.050 * side, 0.098, 0.0),
            point(0.082 * side, 0.052, -0.034),
            0.010,
            16,
        ));
        mesh.add(limb(
            point(0.022 * side, 0.2075, 0.008),
            point(0.036 * side, 0.232, 0.014),
            0.0035,
            12,
        ));
        mesh.add(Mesh::sphere(0.008, 6, 12).at(point(0.0405 * side, 0.2405, 0.016)));
    }
    mesh
}
