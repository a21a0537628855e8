//! What these scenes are made of.

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, Quad, boundary};
use super::super::texture::hash;
use crate::radiometry::Rgb;
use crate::scene::{Camera, Environment, Material};
use glam::Vec3;

/// A scene, and what surrounds it.
pub struct RealScene {
    /// Its name, also of files.
    pub name: String,
    /// What is hard about it, in a few words.
    pub why: &'static str,
    /// The scene with its camera, as a GLB file.
    pub glb: Vec<u8>,
    /// Sky and sun.
    pub environment: Environment,
}

/// Random numbers that depend on a seed and on how many came before.
pub(super) struct Chance {
    seed: u32,
    drawn: u32,
}

impl Chance {
    pub(super) fn new(seed: u32) -> Self {
        Self { seed: hash(seed, 0x5eed), drawn: 0 }
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f32 {
        self.drawn += 1;
        (hash(self.seed, self.drawn) >> 8) as f32 / (1 << 24) as f32
    }

    /// Uniform between two numbers.
    pub(super) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// A colour, each channel uniform between two numbers.
    pub(super) fn color(&mut self, low: f32, high: f32) -> Rgb {
        let mut channel = || self.between(low, high);
        Rgb::new(channel(), channel(), channel())
    }

    /// A unit vector, all directions alike; by rejection, so that no two platforms disagree on it.
    pub(super) fn direction(&mut self) -> Vec3 {
        loop {
            let inside = self.in_ball();
            if inside.length_squared() > 0.01 {
                return inside.normalize();
            }
        }
    }

    /// A point in the unit ball, uniform by volume.
    pub(super) fn in_ball(&mut self) -> Vec3 {
        loop {
            let mut side = || self.between(-1.0, 1.0);
            let point = Vec3::new(side(), side(), side());
            if point.length_squared() <= 1.0 {
                return point;
            }
        }
    }
}

/// A Lambertian material of the file.
pub(super) fn matte(writer: &mut GlbWriter, name: &str, color: [f32; 3]) -> usize {
    writer.material(&Material::lambertian(name, Rgb::from_array(color)))
}

/// A metal of the format's own model, a mirror where `roughness` is 0.
pub(super) fn metal(name: &str, base_color: Rgb, roughness: f32) -> Material {
    Material { name: name.into(), base_color, metallic: 1.0, roughness, ..Material::default() }
}

/// A parallelogram whose front is the side from which `u` to `v` turns left.
pub(super) fn panel(corner: Vec3, u: Vec3, v: Vec3) -> Quad {
    Quad { corners: [corner, corner + u, corner + u + v, corner + v] }
}

/// A lamp that is a parallelogram, black where it does not shine.
pub(super) fn lamp(writer: &mut GlbWriter, quad: &Quad, emission: Rgb) {
    let dark = Material::lambertian("lamp", Rgb::ZERO);
    let shining = writer.material(&Material { emission, ..dark });
    writer.body("lamp", &Mesh::quads([quad]), shining);
}

/// A closed room from the origin to `size`: floor, then all walls, then the ceiling.
pub(super) fn room(writer: &mut GlbWriter, size: Vec3, [floor, walls, ceiling]: [usize; 3]) {
    let quads = boundary([&[0.0, size.x], &[0.0, size.y], &[0.0, size.z]], |_| true);
    let inward: Vec<Quad> = quads.into_iter().map(Quad::flipped).collect();
    let kind = |quad: &Quad| match quad.normal().y {
        up if up > 0.5 => "floor",
        up if up < -0.5 => "ceiling",
        _ => "walls",
    };
    for (name, material) in [("floor", floor), ("walls", walls), ("ceiling", ceiling)] {
        let mesh = Mesh::quads(inward.iter().filter(|quad| kind(quad) == name));
        writer.body(name, &mesh, material);
    }
}

/// Adds the camera and ends the file; `yfov` in radians.
pub(super) fn seen_from(
    mut writer: GlbWriter,
    eye: [f32; 3],
    target: [f32; 3],
    yfov: f32,
) -> Vec<u8> {
    let [eye, target] = [eye, target].map(Vec3::from_array);
    writer.camera(&Camera::look_at("camera", eye, target, Vec3::Y, yfov));
    writer.finish()
}

/// The clear sky and the sun of a place and time, as `LAT,LON,TIME`: +X is east, −Z north.
pub(super) fn daylight(at: &str) -> Environment {
    let at = at.parse().expect("a place and a time");
    Environment::of_daylight(&at).expect("the model's sky is a map")
}
