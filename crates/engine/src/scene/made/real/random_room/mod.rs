//! Furnished rooms by chance.

mod furniture;
mod lamps;

use super::super::glb::GlbWriter;
use super::super::mesh::{Mesh, Quad, boundary};
use super::super::texture;
use super::parts::{Chance, RealScene, daylight, metal, seen_from};
use crate::radiometry::Rgb;
use crate::scene::environment::Sun;
use crate::scene::{Environment, Material, Sky};
use glam::{Vec2, Vec3};

/// Thickness of the walls of rooms that have an outside, metres.
const WALL: f32 = 0.2;
/// Half the angle that the sun covers, radians.
const SUN_RADIUS: f32 = 0.00465;

/// A room that is being made. Its inside goes from the origin to `size`; the camera stands at the
/// end of large z.
struct Making {
    writer: GlbWriter,
    chance: Chance,
    size: Vec3,
    /// Whether something in it is a mirror, in which path tracing can't find lights without extent.
    has_mirror: bool,
    /// Whether the sun shines in.
    is_sunny: bool,
}

/// A closed room with furniture, one to three lamps of several kinds, in a third of the seeds a
/// window to a uniform sky, and textures, gloss and mirrors here and there: all by a seed, so that
/// nothing can be tuned to it.
///
/// What path tracing, the reference, can't find is left out: glass, polished metal that is curved,
/// and lights without extent beside a mirror.
pub fn random_room(seed: u32) -> RealScene {
    let chance = Chance::new(texture::hash(seed, 0x0400));
    let name = format!("room-{seed}");
    made((chance, false), name, "furniture, lamps, mirrors and textures by chance")
}

/// The same with a window through which sun and sky shine in, and no mirror: path tracing finds no sun in one.
pub fn sunny_room(seed: u32) -> RealScene {
    let chance = Chance::new(texture::hash(seed, 0x0501));
    let name = format!("sunny-{seed}");
    made((chance, true), name, "furniture, lamps and textures by chance in the sun")
}

fn made((mut chance, is_sunny): (Chance, bool), name: String, why: &'static str) -> RealScene {
    let mut length = |low, high| chance.between(low, high);
    let size = Vec3::new(length(3.0, 6.0), length(2.3, 3.2), length(3.2, 6.5));
    let mut making =
        Making { writer: GlbWriter::default(), chance, size, has_mirror: false, is_sunny };
    let environment = making.shell();
    making.furnish();
    making.lamps(environment.is_dark());
    let Making { writer, mut chance, .. } = making;
    let left = chance.unit() < 0.5;
    let from = if left { chance.between(0.06, 0.2) } else { chance.between(0.8, 0.94) };
    let eye = [from * size.x, chance.between(1.1, 1.9), size.z - 0.25];
    let across = chance.between(0.35, 0.65) * size.x;
    let target = [across, chance.between(0.4, 1.0), chance.between(0.1, 0.4) * size.z];
    RealScene {
        name,
        why,
        glb: seen_from(writer, eye, target, chance.between(0.7, 1.15)),
        environment,
    }
}

impl Making {
    /// Walls, floor and ceiling; what surrounds them.
    fn shell(&mut self) -> Environment {
        let materials = self.finishes();
        if self.is_sunny || self.chance.unit() < 0.35 {
            return self.house(materials);
        }
        let Vec3 { x, y, z } = self.size;
        let quads = match self.chance.unit() < 0.5 {
            true => self.thick_walls(None),
            false => {
                let outward = boundary([&[0.0, x], &[0.0, y], &[0.0, z]], |_| true);
                outward.into_iter().map(Quad::flipped).collect()
            }
        };
        self.cover(&quads, materials);
        Environment::none()
    }

    /// Thick walls with a window in the one at x = 0, and a sky.
    fn house(&mut self, materials: [usize; 3]) -> Environment {
        let Vec3 { y, z, .. } = self.size;
        let (width, low) = (self.chance.between(0.5, 1.6), self.chance.between(0.8, 1.1));
        let start = self.chance.between(0.15, 0.5) * (z - width);
        let top = (low + self.chance.between(0.5, 1.3)).min(y - 0.1);
        let quads = self.thick_walls(Some([low, top, start, start + width]));
        self.cover(&quads, materials);
        if self.is_sunny {
            return self.sun_and_sky();
        }
        if self.chance.unit() < 0.3 {
            return Environment::studio();
        }
        let sky = Sky::Uniform(self.chance.color(1.0, 3.0));
        Environment { sky, ..Environment::none() }
    }

    /// A sun that shines in through the window and a sky: of an afternoon somewhere, or both by chance.
    fn sun_and_sky(&mut self) -> Environment {
        let chance = &mut self.chance;
        if chance.unit() < 0.5 {
            let (latitude, month) = (chance.between(20.0, 55.0), 1.0 + chance.between(0.0, 11.9));
            let (hour, minute) = (chance.between(13.0, 16.0), chance.between(0.0, 59.0));
            return daylight(&format!(
                "{latitude:.1},0.0,2026-{:02}-15T{:02}:{:02}:00Z",
                month as u32, hour as u32, minute as u32
            ));
        }
        let towards = Vec3::new(-1.0, chance.between(0.2, 1.2), chance.between(-0.8, 0.8));
        let tint = Rgb::new(1.0, chance.between(0.7, 1.0), chance.between(0.4, 1.0));
        let sun = Sun::towards(towards, tint * chance.between(10.0, 60.0), SUN_RADIUS);
        let sky = Sky::Uniform(chance.color(0.5, 2.0));
        Environment { sky, sun: Some(sun), ..Environment::none() }
    }

    /// Walls that have an outside; the window from and to which height, from and to which z.
    fn thick_walls(&self, window: Option<[f32; 4]>) -> Vec<Quad> {
        let Vec3 { x, y, z } = self.size;
        let [low, top, start, end] = window.unwrap_or([0.4 * y, 0.6 * y, 0.4 * z, 0.6 * z]);
        let xs = [-WALL, 0.0, x, x + WALL];
        let ys = [-WALL, 0.0, low, top, y, y + WALL];
        let zs = [-WALL, 0.0, start, end, z, z + WALL];
        boundary([&xs, &ys, &zs], |[x, y, z]| {
            let inside = x == 1 && (1..4).contains(&y) && (1..4).contains(&z);
            let open = window.is_some() && [x, y, z] == [0, 2, 2];
            !(inside || open)
        })
    }

    /// Adds the shell's faces: the floor, the walls, the ceiling.
    fn cover(&mut self, quads: &[Quad], materials: [usize; 3]) {
        let height = self.size.y;
        let at = |quad: &Quad, height: f32| quad.corners.iter().all(|corner| corner.y == height);
        let kind = |quad: &Quad| match quad {
            quad if at(quad, 0.0) => "floor",
            quad if at(quad, height) => "ceiling",
            _ => "walls",
        };
        let tile = self.chance.between(0.6, 3.0);
        for (name, material) in ["floor", "walls", "ceiling"].into_iter().zip(materials) {
            let mesh = Mesh::quads(quads.iter().filter(|quad| kind(quad) == name));
            self.writer.body(name, &mesh.with_uvs(|p| Vec2::new(p.x, p.z) / tile), material);
        }
    }

    /// Materials of floor, walls and ceiling.
    fn finishes(&mut self) -> [usize; 3] {
        let chance = &mut self.chance;
        let name = "floor";
        let floor = match chance.unit() {
            kind if kind < 0.25 => {
                let matte = Material::lambertian(name, chance.color(0.6, 1.0));
                self.writer.textured(&matte, &texture::checker())
            }
            kind if kind < 0.5 => {
                let wood = Material { roughness: chance.between(0.2, 0.6), ..Material::default() };
                self.writer.textured(&Material { name: name.into(), ..wood }, &texture::parquet())
            }
            kind if kind < 0.7 => self.writer.material(&Material {
                name: name.into(),
                base_color: chance.color(0.1, 0.6),
                roughness: chance.between(0.15, 0.5),
                ..Material::default()
            }),
            _ => self.writer.material(&Material::lambertian(name, chance.color(0.15, 0.7))),
        };
        let light = if self.chance.unit() < 0.7 { 0.55 } else { 0.1 };
        let tint = self.chance.color(light, 0.85);
        let walls = self.writer.material(&Material::lambertian("walls", tint));
        let white = Rgb::splat(self.chance.between(0.5, 0.88));
        [floor, walls, self.writer.material(&Material::lambertian("ceiling", white))]
    }

    /// A material for furniture: matte in half of all cases, a dielectric or rough metal in the rest.
    fn finish(&mut self, name: &str) -> usize {
        let chance = &mut self.chance;
        let color = chance.color(0.08, 0.85);
        let material = match chance.unit() {
            kind if kind < 0.5 => Material::lambertian(name, color),
            kind if kind < 0.8 => Material {
                name: name.into(),
                base_color: color,
                roughness: chance.between(0.15, 0.9),
                ..Material::default()
            },
            _ => metal(name, color.max(Rgb::splat(0.3)), chance.between(0.25, 0.6)),
        };
        self.writer.material(&material)
    }
}
