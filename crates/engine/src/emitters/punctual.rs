//! Lights without extent (KHR_lights_punctual): points, spots and directions, whose irradiance is
//! known exactly but for what is in between. Photometric as glTF has them: candela and lux.

use crate::radiometry::{Rgb, importance};
use crate::rays::Rays;
use crate::scene::{LightKind, PunctualLight, Scene};
use glam::Vec3;

/// A light's smallest distance, as a share of the scene's size: nearer, it shines as from there.
const LEAST_DISTANCE: f32 = 1e-6;

/// The punctual lights of a scene, in ray units.
pub struct PunctualLights {
    lights: Vec<Placed>,
    /// Square metres of a square ray unit.
    square_metre: f32,
    /// Distance from which lights of a direction come.
    beyond: f32,
}

struct Placed {
    kind: LightKind,
    position: Vec3,
    direction: Vec3,
    intensity: Rgb,
    /// Square of the distance beyond which it does not shine.
    range_square: f32,
}

/// The light of one of them at a point.
#[derive(Clone, Copy, Debug)]
pub struct PunctualSample {
    /// Where rays to it end.
    pub end: Vec3,
    /// Unit direction to it.
    pub direction: Vec3,
    /// Irradiance of a plane that faces it.
    pub irradiance: Rgb,
}

impl PunctualSample {
    fn worth(&self, normal: Vec3, weight: impl Fn(Vec3) -> f32) -> f32 {
        importance(self.irradiance) * normal.dot(self.direction) * weight(self.direction)
    }
}

impl PunctualLights {
    /// The lights of a scene; `None` without any that shines.
    pub fn new(scene: &Scene, rays: &Rays) -> Option<Self> {
        let place = |light: &PunctualLight| Placed {
            kind: light.kind,
            position: rays.place(light.position),
            direction: light.direction,
            intensity: light.intensity,
            range_square: light
                .range
                .map_or(f32::INFINITY, |range| (f64::from(range) * rays.scale()).powi(2) as f32),
        };
        let lights: Vec<Placed> =
            scene.lights.iter().filter(|light| light.shines()).map(place).collect();
        let square_metre = (rays.scale() * rays.scale()).recip() as f32;
        (!lights.is_empty()).then(|| Self { lights, square_metre, beyond: rays.beyond() })
    }

    /// Number of lights.
    pub fn count(&self) -> usize {
        self.lights.len()
    }

    /// The light of one of them, by its number, at a point; `None` where it does not shine.
    pub fn nth(&self, number: usize, point: Vec3) -> Option<PunctualSample> {
        self.light(self.lights.get(number)?, point)
    }

    /// The light of one at a point; `None` where it does not shine.
    fn light(&self, light: &Placed, point: Vec3) -> Option<PunctualSample> {
        if let LightKind::Directional = light.kind {
            let direction = -light.direction;
            let end = point + direction * self.beyond;
            return Some(PunctualSample { end, direction, irradiance: light.intensity });
        }
        let between = light.position - point;
        let least = self.beyond * LEAST_DISTANCE;
        let square = between.length_squared().max(least * least);
        let direction = between.normalize_or(Vec3::Y);
        let cone = match light.kind {
            LightKind::Spot { inner_cone, outer_cone } => {
                // As the extension has it: squared, linear in the cosine between the cones.
                let [inner, outer] = [inner_cone, outer_cone].map(f32::cos);
                let cosine = -light.direction.dot(direction);
                let share = (cosine - outer) / (inner - outer).max(1e-3);
                share.clamp(0.0, 1.0).powi(2)
            }
            _ => 1.0,
        };
        let fade = if light.range_square.is_finite() {
            (1.0 - (square / light.range_square).powi(2)).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let irradiance = light.intensity * (cone * fade / (square * self.square_metre));
        let sample = PunctualSample { end: light.position, direction, irradiance };
        (irradiance != Rgb::ZERO).then_some(sample)
    }

    /// The light of each at a point that shines above the horizon of a unit `normal`.
    fn all(&self, point: Vec3, normal: Vec3) -> impl Iterator<Item = PunctualSample> + '_ {
        let lights = self.lights.iter().filter_map(move |light| self.light(light, point));
        lights.filter(move |light| normal.dot(light.direction) > 0.0)
    }

    /// Irradiance of all lights on a surface at `point` with unit `normal` without occlusion.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Rgb {
        let own = |light: PunctualSample| light.irradiance * normal.dot(light.direction);
        self.all(point, normal).map(own).sum()
    }

    /// Importance of the irradiance of all lights on a surface, each times `weight` of its direction.
    pub fn worth(&self, point: Vec3, normal: Vec3, weight: impl Fn(Vec3) -> f32) -> f32 {
        self.all(point, normal).map(|light| light.worth(normal, &weight)).sum()
    }

    /// Picks a light for a surface by a uniform number, in proportion to its irradiance there times
    /// `weight` of its direction; with its probability. `None` where none shines.
    pub fn pick(
        &self,
        point: Vec3,
        normal: Vec3,
        x: f32,
        weight: impl Fn(Vec3) -> f32,
    ) -> Option<(PunctualSample, f32)> {
        let total = self.worth(point, normal, &weight);
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let (mut sum, mut last) = (0.0, None);
        for light in self.all(point, normal) {
            let own = light.worth(normal, &weight);
            sum += own;
            last = Some((light, own / total)).filter(|_| own > 0.0).or(last);
            if own > 0.0 && sum > x * total {
                break;
            }
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Triangle, Vertex};
    use std::f32::consts::PI;

    fn lights(kind: LightKind, range: Option<f32>) -> (PunctualLights, Rays) {
        let corner = |x, z| Vertex::new(Vec3::new(x, 0.0, z), Vec3::Y);
        let light = PunctualLight {
            name: "lamp".into(),
            kind,
            position: Vec3::new(0.0, 2.0, 0.0),
            direction: -Vec3::Y,
            intensity: Rgb::splat(100.0 / (4.0 * PI)),
            range,
        };
        let scene = Scene {
            vertices: vec![corner(-5.0, -5.0), corner(0.0, 5.0), corner(5.0, -5.0)],
            triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
            materials: vec![Material::lambertian("floor", Rgb::ONE)],
            lights: vec![light],
            ..Scene::default()
        };
        let rays = Rays::new(&scene);
        (PunctualLights::new(&scene, &rays).expect("it shines"), rays)
    }

    #[test]
    fn a_hundred_lumen_are_as_textbooks_say() {
        let (lights, rays) = lights(LightKind::Point, None);
        let at = |x, y| lights.unoccluded(rays.place(Vec3::new(x, y, 0.0)), Vec3::Y).x;
        assert!((at(0.0, 1.0) - 7.9577).abs() < 1e-3, "{}", at(0.0, 1.0));
        assert!((at(0.0, 0.0) - 7.9577 / 4.0).abs() < 1e-3);
        // Under 45°: half the square distance's share, and the cosine.
        assert!((at(2.0, 0.0) - 7.9577 / 8.0 * 0.5f32.sqrt()).abs() < 1e-3);
        assert_eq!(lights.unoccluded(rays.place(Vec3::ZERO), -Vec3::Y), Rgb::ZERO);
    }

    #[test]
    fn spots_shine_in_their_cone_and_directions_everywhere() {
        let (inner_cone, outer_cone) = (0.3f32, 0.6f32);
        let (spot, rays) = lights(LightKind::Spot { inner_cone, outer_cone }, None);
        let (point, _) = lights(LightKind::Point, None);
        let ratio = |angle: f32| {
            let at = rays.place(Vec3::new(2.0 * angle.tan(), 0.0, 0.0));
            spot.unoccluded(at, Vec3::Y).x / point.unoccluded(at, Vec3::Y).x
        };
        assert!((ratio(0.2) - 1.0).abs() < 1e-3);
        assert_eq!(ratio(0.7), 0.0);
        let half = (0.45f32.cos() - outer_cone.cos()) / (inner_cone.cos() - outer_cone.cos());
        assert!((ratio(0.45) - half * half).abs() < 1e-3);
        let (sun, rays) = lights(LightKind::Directional, None);
        let at = rays.place(Vec3::new(3.0, 0.0, 1.0));
        let slanted = Vec3::new(0.0, 0.8, 0.6);
        assert!((sun.unoccluded(at, slanted).x - 0.8 * 7.9577).abs() < 1e-3);
    }

    #[test]
    fn range_ends_the_light() {
        let (lights, rays) = lights(LightKind::Point, Some(2.5));
        let at = |y| lights.unoccluded(rays.place(Vec3::new(0.0, y, 0.0)), Vec3::Y).x;
        assert!((at(1.9) / 795.77 - 1.0).abs() < 1e-3);
        assert_eq!(at(-0.6), 0.0);
    }
}
