//! Rooms whose light goes by way of gloss: a gallery of metal balls before a mirror, a kitchen in
//! which everything is a little polished.

use super::glb::GlbWriter;
use super::mesh::{Mesh, Quad, boundary, union_of};
use crate::radiometry::Rgb;
use crate::scene::{Camera, Material, Model};
use glam::Vec3;

fn metal(writer: &mut GlbWriter, name: &str, color: [f32; 3], roughness: f32) -> usize {
    let base_color = Rgb::from_array(color);
    let (name, model) = (name.into(), Model::Phong);
    let metal =
        Material { name, model, base_color, metallic: 1.0, roughness, ..Material::default() };
    writer.material(&metal)
}

fn polished(writer: &mut GlbWriter, name: &str, color: [f32; 3], roughness: f32) -> usize {
    let base_color = Rgb::from_array(color);
    let (name, model) = (name.into(), Model::Phong);
    writer.material(&Material { name, model, base_color, roughness, ..Material::default() })
}

fn matte(writer: &mut GlbWriter, name: &str, grey: f32) -> usize {
    writer.material(&Material::lambertian(name, Rgb::splat(grey)))
}

/// A rectangle that shines to its front, from which its corners run counter-clockwise.
fn panel(writer: &mut GlbWriter, corner: Vec3, u: Vec3, v: Vec3, emission: Rgb) {
    let dark = Material::lambertian("panel", Rgb::ZERO);
    let shining = writer.material(&Material { emission, ..dark });
    let corners = [corner, corner + u, corner + u + v, corner + v];
    writer.body("panel", &Mesh::quads([&Quad { corners }]), shining);
}

/// Floor, walls and ceiling.
fn room(writer: &mut GlbWriter, size: [f32; 3], [floor, walls, ceiling]: [usize; 3]) {
    let [width, height, depth] = size;
    for quad in boundary([&[0.0, width], &[0.0, height], &[0.0, depth]], |_| true) {
        let quad = quad.flipped();
        let up = quad.normal().y;
        let material = match up {
            up if up > 0.5 => floor,
            up if up < -0.5 => ceiling,
            _ => walls,
        };
        writer.body("room", &Mesh::quads([&quad]), material);
    }
}

/// A gallery: four metal balls, polished to rough, on matte blocks before a mirror as wide as
/// they stand, on a polished floor, under a panel and beside a small lamp of 264 triangles.
pub fn gallery() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let floor = polished(&mut writer, "floor", [0.35, 0.22, 0.14], 0.25);
    let (walls, ceiling) = (matte(&mut writer, "walls", 0.71), matte(&mut writer, "ceiling", 0.8));
    room(&mut writer, [6.0, 3.0, 5.0], [floor, walls, ceiling]);
    let corner = Vec3::new(2.2, 2.99, 1.8);
    panel(&mut writer, corner, Vec3::X * 1.6, Vec3::Z, Rgb::new(14.0, 13.0, 12.0));
    let grey = matte(&mut writer, "blocks", 0.6);
    for (x, color, roughness) in [
        (1.2, [0.9, 0.6, 0.3], 0.1),
        (2.2, [0.8, 0.8, 0.85], 0.25),
        (3.2, [0.9, 0.5, 0.4], 0.45),
        (4.3, [0.6, 0.7, 0.9], 0.7),
    ] {
        let block = ([x - 0.2, 0.0, 1.4], [x + 0.2, 0.8, 1.8]);
        writer.body("block", &union_of(&[block]), grey);
        let own = metal(&mut writer, "ball", color, roughness);
        let ball = Mesh::sphere(0.27, 32, 64).at(Vec3::new(x, 1.08, 1.6));
        writer.body("ball", &ball, own);
    }
    let mirror = metal(&mut writer, "mirror", [0.9; 3], 0.03);
    writer.body("mirror", &union_of(&[([1.2, 0.6, 0.0], [4.4, 2.4, 0.01])]), mirror);
    for (at, radius, color, roughness) in [
        ([5.0, 0.351, 2.6], 0.35, [0.1, 0.3, 0.6], 0.15),
        ([0.9, 0.301, 2.9], 0.3, [0.6, 0.1, 0.1], 0.4),
    ] {
        let own = polished(&mut writer, "ball", color, roughness);
        let ball = Mesh::sphere(radius, 32, 64).at(Vec3::from_array(at));
        writer.body("ball", &ball, own);
    }
    let emission = Rgb::new(90.0, 70.0, 40.0);
    let dark = Material::lambertian("lamp", Rgb::ZERO);
    let lamp = writer.material(&Material { emission, ..dark });
    writer.body("lamp", &Mesh::sphere(0.06, 12, 12).at(Vec3::new(5.2, 1.9, 0.8)), lamp);
    let (eye, target) = (Vec3::new(3.0, 1.5, 4.8), Vec3::new(3.0, 1.0, 1.5));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.08));
    writer.finish()
}

/// A kitchen: cupboards, worktops, tiles and pots, all of them a little polished, under one
/// strip of light.
pub fn kitchen() -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let floor = polished(&mut writer, "floor", [0.55, 0.5, 0.45], 0.35);
    let walls = polished(&mut writer, "walls", [0.75, 0.75, 0.72], 0.5);
    let ceiling = matte(&mut writer, "ceiling", 0.82);
    room(&mut writer, [4.0, 2.6, 4.0], [floor, walls, ceiling]);
    let corner = Vec3::new(1.2, 2.59, 1.4);
    panel(&mut writer, corner, Vec3::X * 1.6, Vec3::Z * 0.3, Rgb::new(30.0, 29.0, 27.0));
    let cupboard = polished(&mut writer, "cupboards", [0.8, 0.78, 0.7], 0.4);
    let worktop = polished(&mut writer, "worktops", [0.12, 0.12, 0.13], 0.15);
    let steel = metal(&mut writer, "refrigerator", [0.75, 0.75, 0.77], 0.3);
    let cupboards = union_of(&[
        ([0.001, 0.001, 0.001], [3.2, 0.86, 0.6]),
        ([0.001, 0.001, 0.6], [0.6, 0.86, 3.3]),
        ([0.1, 1.55, 0.001], [3.2, 2.25, 0.4]),
    ]);
    writer.body("cupboards", &cupboards, cupboard);
    let worktops = union_of(&[
        ([0.001, 0.861, 0.001], [3.22, 0.9, 0.63]),
        ([0.001, 0.861, 0.63], [0.63, 0.9, 3.35]),
    ]);
    writer.body("worktops", &worktops, worktop);
    let refrigerator = union_of(&[([3.25, 0.001, 0.85], [3.95, 1.8, 1.55])]);
    writer.body("refrigerator", &refrigerator, steel);
    let colors = [[0.5, 0.6, 0.65], [0.2, 0.7, 0.35], [0.75, 0.5, 0.45], [0.35, 0.5, 0.7]];
    for pot in 0..8 {
        let color = colors[pot % 4];
        let own = polished(&mut writer, "pot", color, 0.2 + 0.1 * (pot / 2) as f32);
        let (x, height) = (0.9 + 0.28 * pot as f32, 0.1 + 0.02 * (3 * pot % 5) as f32);
        let body = Mesh::drum(0.05, 0.0, height, 0.005, 24).at(Vec3::new(x, 0.901, 0.3));
        writer.body("pot", &body, own);
    }
    for (fruit, color) in [[0.7, 0.1, 0.05], [0.8, 0.6, 0.1], [0.3, 0.6, 0.1]].iter().enumerate() {
        let own = polished(&mut writer, "fruit", *color, 0.35);
        let at = Vec3::new(0.3, 0.991, 1.2 + 0.25 * fruit as f32);
        writer.body("fruit", &Mesh::sphere(0.09, 16, 32).at(at), own);
    }
    let (eye, target) = (Vec3::new(3.5, 1.6, 3.8), Vec3::new(1.5, 0.9, 0.8));
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, 1.05));
    writer.finish()
}
