//! Whether what glows in a scene lights it. The lamps of a room do; the headlights of a car that stands alone, or
//! eyes that glow, light nothing that is to be seen, and the rest would be black.

use crate::emitters::TriangleLights;
use crate::random::Stream;
use crate::rays::{Eye, Spot, unit_normal};
use crate::sampling::{Discrete, Seed, Shifted, cosine_direction};
use crate::surface::World;
use glam::Vec3;

/// Rays that lamps send.
const RAYS: u32 = 512;
/// Places of surfaces that look for lamps.
const PLACES: u32 = 1024;
/// Places of lamps that each of them looks at.
const LOOKS: u32 = 4;
/// Share of the lamps' light that stays in closed rooms. What lies behind doors and in cupboards does not see the lamps
/// there, so that the next number says little.
const STAYS: f32 = 0.9;
/// Share of the surfaces with which lamps light a scene that is open.
const ENOUGH: f32 = 0.15;
/// Most triangles that places are picked from.
const MOST_TRIANGLES: usize = 1 << 22;
/// A scene's lights do not depend on the seed of a job.
const SEED: Seed = Seed { number: 0, well_spread: true };
/// The same for looks at lamps, which are not to go by the place that looks.
const OTHER_SEED: Seed = Seed { well_spread: false, ..SEED };
/// Radiance up to which a place does not glow: what is black in a picture may be a little more than that.
const DIM: f32 = 0.05;
/// Most clear surfaces that a ray goes through.
const MOST_CLEAR: u32 = 8;

/// Whether the glowing surfaces of a scene light it: nearly all of their light meets others, or enough of these see
/// them.
pub fn lights_itself(world: &World) -> bool {
    let Some(lights) = TriangleLights::new(world) else { return false };
    let lamps = Lamps { world, lights: &lights };
    lamps.share_met() >= STAYS || lamps.share_lit() >= ENOUGH
}

/// The glowing surfaces of a scene.
struct Lamps<'a> {
    world: &'a World,
    lights: &'a TriangleLights,
}

impl Lamps<'_> {
    /// Share of the light that leaves them that meets other surfaces, such as reflect it.
    fn share_met(&self) -> f32 {
        let sequence = Shifted::new(SEED, Stream::OwnLight, 0);
        let met = |n| {
            let point = sequence.at(n);
            let ([pick, side], place) = (point.pair(), point.second_pair());
            let light = self.lights.emit(self.world, f64::from(pick), place);
            let is_back = light.two_sided && side < 0.5;
            let normal = if is_back { -light.spot.normal } else { light.spot.normal };
            let direction = cosine_direction(normal, point.third_pair());
            self.meets(light.spot.off_surface(normal), direction)
        };
        let met: Vec<bool> = (0..RAYS).filter_map(met).collect();
        let count = met.iter().filter(|met| **met).count();
        count as f32 / met.len().max(1) as f32
    }

    /// Whether a ray meets a surface, be it through clear ones; `None` where that is a lamp.
    fn meets(&self, mut origin: Vec3, direction: Vec3) -> Option<bool> {
        for _ in 0..MOST_CLEAR {
            let Some(hit) = self.world.rays.closest(Eye::Light, origin, direction) else {
                return Some(false);
            };
            if self.glows(hit.triangle, [hit.u, hit.v]) {
                return None;
            }
            if !self.world.is_clear(hit.triangle) {
                let takes_light = !self.world.material(hit.triangle).unlit;
                return Some(takes_light && !self.world.is_black(&hit));
            }
            let spot = self.world.rays.spot(&hit);
            origin = spot.off_surface(spot.normal * spot.normal.dot(direction).signum());
        }
        Some(true)
    }

    /// Whether a place of a triangle glows.
    fn glows(&self, triangle: u32, [u, v]: [f32; 2]) -> bool {
        self.world.emission(triangle, u, v).max_element() > DIM
    }

    /// Share of the other surfaces that see a lamp; all, where there are none.
    fn share_lit(&self) -> f32 {
        let (world, scene) = (self.world, &self.world.scene);
        let area = |triangle: u32| match world.material(triangle).unlit {
            true => 0.0,
            false => f64::from(world.rays.corners(scene, triangle).1),
        };
        let step = scene.triangle_count().div_ceil(MOST_TRIANGLES).max(1);
        let triangles = (0..scene.triangle_count() as u32).step_by(step);
        let areas: Vec<f64> = triangles.map(area).collect();
        if !areas.iter().any(|area| *area > 0.0) {
            return 1.0;
        }
        let choice = Discrete::new(areas.into_iter());
        let sequence = Shifted::new(SEED, Stream::OwnLight, 1);
        let lit = (0..PLACES).filter_map(|n| {
            let point = sequence.at(n);
            let [pick, side] = point.pair();
            let triangle = (choice.pick(f64::from(pick)) * step) as u32;
            let corners = world.rays.corners(scene, triangle).0;
            let [x, y] = point.second_pair();
            let (u, v) = (x.sqrt() * (1.0 - y), x.sqrt() * y);
            if self.glows(triangle, [u, v]) {
                return None;
            }
            let spot = Spot::new(corners, unit_normal(corners), u, v);
            let is_back = world.is_two_sided(triangle) && side < 0.5;
            let normal = if is_back { -spot.normal } else { spot.normal };
            let from = spot.off_surface(normal);
            Some((0..LOOKS).any(|look| self.is_seen(from, normal, LOOKS * n + look)))
        });
        let lit: Vec<bool> = lit.collect();
        match lit.len() {
            0 => 1.0,
            count => lit.iter().filter(|lit| **lit).count() as f32 / count as f32,
        }
    }

    /// Whether a place sees the n-th place of a lamp.
    fn is_seen(&self, from: Vec3, normal: Vec3, n: u32) -> bool {
        let point = Shifted::new(OTHER_SEED, Stream::OwnLight, 2).at(n);
        let light = self.lights.emit(self.world, f64::from(point.pair()[0]), point.second_pair());
        let between = light.spot.point - from;
        let cosine = -light.spot.normal.dot(between);
        if normal.dot(between) <= 0.0 || (cosine <= 0.0 && !light.two_sided) {
            return false;
        }
        let end = light.spot.off_surface(light.spot.normal * cosine.signum());
        !self.world.rays.blocked(from, end, |triangle| self.world.is_clear(triangle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::Rgb;
    use crate::scene::{Material, Scene, Texture, TextureSlot, Triangle, Vertex};
    use glam::Vec2;
    use std::sync::Arc;

    const PAINT: u32 = 0;
    const LAMP: u32 = 1;
    const GLASS: u32 = 2;

    /// A scene of parallelograms, each a corner, two edges, with the front towards their cross product, and a material.
    fn world(quads: &[([Vec3; 3], u32)]) -> World {
        World::new(Arc::new(scene(quads)))
    }

    fn scene(quads: &[([Vec3; 3], u32)]) -> Scene {
        let mut scene = Scene {
            materials: vec![
                Material::lambertian("paint", Rgb::splat(0.6)),
                Material { emission: Rgb::splat(5.0), ..Material::lambertian("lamp", Rgb::ZERO) },
                Material { transmission: 1.0, ..Material::default() },
            ],
            ..Scene::default()
        };
        for ([corner, a, b], material) in quads {
            let first = scene.vertices.len() as u32;
            let corners = [*corner, corner + a, corner + a + b, corner + b];
            let normal = a.cross(*b).normalize();
            scene.vertices.extend(corners.map(|at| Vertex::new(at, normal)));
            for corners in [[0, 1, 2], [0, 2, 3]] {
                let vertices = corners.map(|corner| first + corner);
                scene.triangles.push(Triangle { vertices, material: *material });
            }
        }
        scene
    }

    /// The same by one material for all, whose emission a texture tells: white where the lamps are.
    fn by_one_texture(quads: &[([Vec3; 3], u32)]) -> World {
        let mut scene = scene(quads);
        let texel = |x: u32| if x < 4 { [255; 4] } else { [0, 0, 0, 255] };
        scene.textures = vec![Texture { width: 8, height: 1, texels: (0..8).map(texel).collect() }];
        for triangle in &mut scene.triangles {
            let u = if triangle.material == LAMP { 0.25 } else { 0.75 };
            for vertex in triangle.vertices {
                scene.vertices[vertex as usize].uv = [Vec2::new(u, 0.5); 2];
            }
            triangle.material = LAMP;
        }
        scene.materials[LAMP as usize].emission_texture = Some(TextureSlot::plain(0));
        World::new(Arc::new(scene))
    }

    /// A block from the origin with its front towards +x, seen from outside; or a room of that size.
    fn block(size: Vec3, is_room: bool) -> Vec<([Vec3; 3], u32)> {
        let [x, y, z] = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
        let sides = [
            [x, y, z],
            [Vec3::ZERO, z, y],
            [y, z, x],
            [Vec3::ZERO, x, z],
            [z, x, y],
            [Vec3::ZERO, y, x],
        ];
        let turned =
            |[corner, a, b]: [Vec3; 3]| if is_room { [corner, b, a] } else { [corner, a, b] };
        sides.map(|side| (turned(side), PAINT)).to_vec()
    }

    /// A car, its lamps in front, with a pane before them.
    fn car() -> Vec<([Vec3; 3], u32)> {
        let lamp = |x: f32, z: f32| [Vec3::new(x, 0.4, z), 0.1 * Vec3::Y, 0.2 * Vec3::Z];
        let mut car = block(Vec3::new(4.0, 1.2, 1.6), false);
        for z in [0.2, 1.2] {
            car.push((lamp(4.01, z), LAMP));
            car.push((lamp(4.02, z), GLASS));
        }
        car
    }

    #[test]
    fn lamps_light_rooms_and_floors_and_headlights_no_car() {
        let lamp = ([Vec3::new(1.0, 2.9, 1.0), 0.1 * Vec3::X, 0.1 * Vec3::Z], LAMP);
        let mut room = block(Vec3::new(5.0, 3.0, 5.0), true);
        room.push(lamp);
        let floor = vec![([Vec3::ZERO, 5.0 * Vec3::Z, 5.0 * Vec3::X], PAINT), lamp];
        let glow = vec![lamp];
        for (quads, expected) in [(room, true), (floor, true), (glow, true), (car(), false)] {
            assert_eq!(lights_itself(&world(&quads)), expected, "{quads:?}");
            let opaque: Vec<_> = quads.into_iter().filter(|quad| quad.1 != GLASS).collect();
            assert_eq!(lights_itself(&by_one_texture(&opaque)), expected, "{opaque:?}");
        }
        assert!(!lights_itself(&world(&block(Vec3::ONE, false))), "nothing glows");
    }

    /// In a garage a car's headlights light all that they shine on, for their light stays there.
    #[test]
    fn light_that_stays_in_a_room_lights_it() {
        let mut garage = block(Vec3::new(40.0, 3.0, 3.0), true);
        garage.extend(car().into_iter().map(|([corner, a, b], material)| {
            ([corner + Vec3::new(35.0, 0.1, 0.7), a, b], material)
        }));
        let world = world(&garage);
        let lights = TriangleLights::new(&world).expect("headlights");
        let lamps = Lamps { world: &world, lights: &lights };
        assert_eq!(lamps.share_met(), 1.0);
        assert!(lamps.share_lit() < ENOUGH, "{}", lamps.share_lit());
        assert!(lights_itself(&world));
    }
}
