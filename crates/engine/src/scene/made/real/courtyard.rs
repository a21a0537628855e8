//! Courtyards by chance.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, union_of};
use super::parts::{Chance, RealScene, matte, metal, panel, seen_from};
use crate::radiometry::Rgb;
use crate::scene::{Environment, LightKind, Material, PunctualLight, Sky, Sun};
use glam::Vec3;

/// A walled court under the open sky with boxes, balls of random microfacet materials, a pane or a
/// ball of glass, and a lamp: all by a seed, so that nothing can be tuned to it.
///
/// Nothing that gathers light meets a sun or a lamp so small that path tracing, the reference,
/// can't find it: the sun is ten times as wide as the real one and shines where no ball of glass
/// is, and metal is not polished.
pub fn courtyard(seed: u32) -> RealScene {
    let mut chance = Chance::new(seed);
    let mut writer = GlbWriter::default();
    let size =
        Vec3::new(chance.between(4.0, 6.5), chance.between(1.5, 2.8), chance.between(4.0, 6.5));
    let ground = writer.material(&Material::lambertian("ground", chance.color(0.2, 0.6)));
    let floor = panel(Vec3::new(-15.0, 0.0, 15.0), 30.0 * Vec3::X, -30.0 * Vec3::Z);
    writer.body("ground", &Mesh::quads([&floor]), ground);
    let plaster = writer.material(&Material::lambertian("walls", chance.color(0.3, 0.8)));
    let Vec3 { x, y, z } = 0.5 * size;
    // One side stays open for the camera.
    let walls = union_of(&[
        ([-x - 0.2, 0.0, -z - 0.2], [x + 0.2, 2.0 * y, -z]),
        ([-x - 0.2, 0.0, -z], [-x, 2.0 * y, z]),
        ([x, 0.0, -z], [x + 0.2, 2.0 * y, z]),
    ]);
    writer.body("walls", &walls, plaster);
    bodies(&mut writer, &mut chance, size);
    let ball = chance.unit() < 0.5;
    let tint = chance.color(0.7, 1.0);
    if ball {
        let glass = writer.material(&Material { base_color: tint, ..Material::glass("ball", 1.5) });
        let radius = chance.between(0.25, 0.45);
        let at = Vec3::new(0.25 * x, radius + 0.002, 0.5 * z);
        writer.body("ball of glass", &Mesh::sphere(radius, 32, 64).at(at), glass);
    } else {
        let clear = Material::glass("pane", 1.5);
        let sheet = Material { base_color: tint, volume: None, double_sided: true, ..clear };
        let glass = writer.material(&sheet);
        let corner = Vec3::new(-0.1 * x, 0.05, 0.45 * z);
        let pane = panel(corner, Vec3::X * (0.7 * x), Vec3::Y * (1.1 * y));
        writer.body("pane", &Mesh::quads([&pane]), glass);
    }
    light(&mut writer, &mut chance, (size, ball));
    let environment = surroundings(&mut chance, ball);
    let eye = [chance.between(-0.6, 0.6) * x, 1.7, z + 1.6];
    RealScene {
        name: format!("courtyard-{seed}"),
        why: "walls, boxes, balls, glass and lamp by chance",
        glb: seen_from(writer, eye, [0.0, 0.6, -0.2 * z], 0.85),
        environment,
    }
}

/// Boxes behind and balls before.
fn bodies(writer: &mut GlbWriter, chance: &mut Chance, size: Vec3) {
    let count = 3 + (3.0 * chance.unit()) as u32;
    for index in 0..count {
        // Side by side, so that none is in another.
        let step = 0.9 * size.x / count as f32;
        let left = -0.45 * size.x + step * index as f32;
        let [width, height, depth] =
            [(0.4, 0.9), (0.3, 1.6), (0.3, 0.9)].map(|(low, high)| chance.between(low, high));
        let back = -chance.between(0.25, 0.45) * size.z;
        let block = ([left, 0.0, back], [left + width * step, height, back + depth]);
        let color = chance.color(0.1, 0.8);
        let paint = matte(writer, "block", color.to_array());
        writer.body("block", &union_of(&[block]), paint);
    }
    let count = 2 + (3.0 * chance.unit()) as u32;
    for index in 0..count {
        let step = 0.9 * size.x / count as f32;
        let radius = chance.between(0.2, 0.42 * step.min(1.2));
        let middle = -0.45 * size.x + step * (index as f32 + 0.5);
        let at = Vec3::new(middle, radius + 0.002, chance.between(0.0, 0.12) * size.z);
        let color = chance.color(0.2, 0.9);
        let material = match chance.unit() < 0.5 {
            true => metal("metal ball", color, chance.between(0.2, 0.6)),
            false => Material {
                name: "painted ball".into(),
                base_color: color,
                roughness: chance.between(0.1, 1.0),
                ..Material::default()
            },
        };
        let own = writer.material(&material);
        writer.body("ball", &Mesh::sphere(radius, 32, 64).at(at), own);
    }
}

/// A bulb that can be seen, or a light without extent where no glass would gather it.
fn light(writer: &mut GlbWriter, chance: &mut Chance, (size, large): (Vec3, bool)) {
    let side = if chance.unit() < 0.5 { -0.35 } else { 0.35 };
    let position = Vec3::new(side * size.x, chance.between(1.2, 1.8), -0.05 * size.z);
    let tint = Rgb::new(1.0, chance.between(0.7, 1.0), chance.between(0.4, 0.9));
    if large || chance.unit() < 0.4 {
        let radius = chance.between(0.12, 0.2);
        let emission = tint * chance.between(10.0, 30.0);
        let dark = Material::lambertian("lamp", Rgb::ZERO);
        let bulb = writer.material(&Material { emission, ..dark });
        writer.body("lamp", &Mesh::sphere(radius, 12, 24).at(position), bulb);
        return;
    }
    let spot = LightKind::Spot { inner_cone: 0.5, outer_cone: 0.9 };
    writer.light(&PunctualLight {
        name: "lamp".into(),
        kind: if chance.unit() < 0.5 { LightKind::Point } else { spot },
        position,
        direction: Vec3::new(-position.x, -1.5, 0.0).normalize(),
        intensity: tint * chance.between(2.0, 5.0),
        range: None,
    });
}

/// A studio, a uniform sky, or a uniform sky with a sun.
fn surroundings(chance: &mut Chance, ball: bool) -> Environment {
    let sky = Sky::Uniform(chance.color(0.2, 0.6));
    let kind = chance.unit();
    let towards = Vec3::new(chance.between(-0.7, 0.7), 1.0, chance.between(-0.2, 0.7));
    let tint = Rgb::new(1.0, 0.95, 0.85);
    match kind {
        kind if kind < 0.3 => Environment::studio(),
        kind if kind < 0.5 || ball => Environment { sky, ..Environment::none() },
        _ => {
            let sun = Sun::towards(towards, tint * chance.between(1.5, 4.0), 0.05);
            Environment { sky, sun: Some(sun), ..Environment::none() }
        }
    }
}
