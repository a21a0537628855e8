//! Lights without extent (KHR_lights_punctual): points, spots and directions, whose irradiance is
//! known exactly but for what is in between. Photometric as glTF has them: candela and lux.
//!
//! Points and spots may be soft: then a small sphere that shines uniformly stands for each, whose
//! intensity in every direction is the light's own. Its irradiance is that of the point wherever all
//! of it is above the horizon, since π L sin²σ cosθ = I cosθ/d² for L = I/(π r²) and sinσ = r/d.

use crate::radiometry::{Rgb, importance};
use crate::rays::Rays;
use crate::sampling::frame;
use crate::scene::{Environment, LightKind, PunctualLight, Scene};
use glam::Vec3;
use std::f32::consts::TAU;
use std::f64::consts::PI;

/// A light's smallest distance, as a share of the scene's size: nearer, it shines as from there.
const LEAST_DISTANCE: f32 = 1e-6;
/// Largest radius of a soft light as a share of the distance to it: nearer, its sphere is smaller.
const MOST_RADIUS: f32 = 0.5;
/// The horizon cuts a smaller sphere as if it were a point: its part of the light is as small.
const LEAST_SINE: f32 = 1e-5;

/// The punctual lights of a scene, in ray units.
pub struct PunctualLights {
    lights: Vec<Placed>,
    /// Square metres of a square ray unit.
    square_metre: f32,
    /// Distance from which lights of a direction come.
    beyond: f32,
    /// Radius of points and spots; 0 where they have none.
    radius: f32,
}

struct Placed {
    kind: LightKind,
    position: Vec3,
    direction: Vec3,
    intensity: Rgb,
    /// Square of the distance beyond which it does not shine.
    range_square: f32,
}

/// The light of one of them at a point, or in one direction of its sphere.
#[derive(Clone, Copy, Debug)]
pub struct PunctualSample {
    /// Number of the light.
    pub number: usize,
    /// Where rays to it end.
    pub end: Vec3,
    /// Unit direction to it.
    pub direction: Vec3,
    /// Irradiance of a plane that faces it.
    pub irradiance: Rgb,
}

/// A light as it is seen from a point.
#[derive(Clone, Copy)]
struct Seen {
    /// Its middle.
    middle: PunctualSample,
    distance: f32,
    /// Sine of the angle between its middle and its rim; 0 for a light without extent.
    sine: f32,
}

impl Seen {
    /// What a surface with the unit `normal` gets of the light, next to one that faces it: the
    /// cosine, and where the horizon cuts the sphere, what is left of it (Snyder 1996, "Area light
    /// sources for real-time graphics").
    fn cosine(&self, normal: Vec3) -> f32 {
        let cosine = normal.dot(self.middle.direction);
        if cosine.abs() >= self.sine || self.sine < LEAST_SINE {
            return cosine.max(0.0);
        }
        // In double precision: for small spheres, terms much larger than their sum cancel.
        let (cosine, sine) = (f64::from(cosine), f64::from(self.sine));
        let square = sine * sine;
        let across = (1.0 - cosine * cosine).sqrt();
        let x = (square.recip() - 1.0).sqrt();
        let y = (-x * cosine / across).clamp(-1.0, 1.0);
        let rim = across * (1.0 - y * y).sqrt();
        let arc = cosine * y.acos() - x * rim;
        ((arc + (rim / x).atan() / square) / PI).max(0.0) as f32
    }

    fn worth(&self, normal: Vec3, weight: impl Fn(Vec3) -> f32) -> f32 {
        importance(self.middle.irradiance) * self.cosine(normal) * weight(self.middle.direction)
    }

    /// A direction to the sphere, uniform in solid angle, by two uniform numbers: with it goes the
    /// irradiance of a plane that faces it, so that the mean is the irradiance of all of it. The
    /// light itself where it has no extent.
    fn sample(&self, xi: [f32; 2]) -> PunctualSample {
        let Self { middle, distance, sine } = *self;
        if sine <= 0.0 {
            return middle;
        }
        // 1 − cosσ, exact for small angles.
        let height = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
        let own = height * xi[0];
        let square = own * (2.0 - own);
        let (tangent, _) = frame(middle.direction, TAU * xi[1]);
        let direction = (middle.direction * (1.0 - own) + tangent * square.sqrt()).normalize();
        // Where the direction meets the sphere.
        let reach = (sine * sine - square).max(0.0).sqrt();
        let way = distance * ((1.0 - own) - reach);
        PunctualSample {
            end: middle.end + (direction * way - middle.direction * distance),
            direction,
            number: middle.number,
            // L Ω = I/(π r²) 2π (1 − cosσ).
            irradiance: middle.irradiance * (2.0 * height / (sine * sine)),
        }
    }
}

impl PunctualLights {
    /// The lights of a scene in its surroundings, which say how soft they are; `None` without any
    /// that shines.
    pub fn new(scene: &Scene, environment: &Environment, rays: &Rays) -> Option<Self> {
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
        let radius = (f64::from(environment.light_radius) * rays.scale()) as f32;
        let beyond = rays.beyond();
        (!lights.is_empty()).then_some(Self { lights, square_metre, beyond, radius })
    }

    /// Number of lights.
    pub fn count(&self) -> usize {
        self.lights.len()
    }

    /// Whether points and spots have an extent: only then do picks need more than one number.
    pub fn are_soft(&self) -> bool {
        self.radius > 0.0
    }

    /// The light of one of them, by its number, at a point, with a direction to it by two uniform
    /// numbers where it is soft; `None` where it does not shine.
    pub fn nth(&self, number: usize, point: Vec3, xi: [f32; 2]) -> Option<PunctualSample> {
        Some(self.light((number, self.lights.get(number)?), point)?.sample(xi))
    }

    /// The light of one at a point; `None` where it does not shine.
    fn light(&self, (number, light): (usize, &Placed), point: Vec3) -> Option<Seen> {
        if let LightKind::Directional = light.kind {
            let direction = -light.direction;
            let end = point + direction * self.beyond;
            let irradiance = light.intensity;
            let middle = PunctualSample { number, end, direction, irradiance };
            return Some(Seen { middle, distance: self.beyond, sine: 0.0 });
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
        let middle = PunctualSample { number, end: light.position, direction, irradiance };
        let distance = square.sqrt();
        let sine = (self.radius / distance).min(MOST_RADIUS);
        (irradiance != Rgb::ZERO).then_some(Seen { middle, distance, sine })
    }

    /// The light of each at a point of which any is above the horizon of a unit `normal`.
    fn all(&self, point: Vec3, normal: Vec3) -> impl Iterator<Item = Seen> + '_ {
        let lights = self.lights.iter().enumerate();
        let lights = lights.filter_map(move |light| self.light(light, point));
        lights.filter(move |light| normal.dot(light.middle.direction) > -light.sine)
    }

    /// Irradiance of all lights on a surface at `point` with unit `normal` without occlusion.
    pub fn unoccluded(&self, point: Vec3, normal: Vec3) -> Rgb {
        let own = |light: Seen| light.middle.irradiance * light.cosine(normal);
        self.all(point, normal).map(own).sum()
    }

    /// Importance of the irradiance of all lights on a surface, each times `weight` of its direction.
    pub fn worth(&self, point: Vec3, normal: Vec3, weight: impl Fn(Vec3) -> f32) -> f32 {
        self.all(point, normal).map(|light| light.worth(normal, &weight)).sum()
    }

    /// Picks a light for a surface by a uniform number, in proportion to its irradiance there times
    /// `weight` of its direction; and a direction to it, by two more, which count only where lights
    /// are soft. With the probability of the light. `None` where none shines.
    pub fn pick(
        &self,
        point: Vec3,
        normal: Vec3,
        xi: Vec3,
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
            if own > 0.0 && sum > xi.x * total {
                break;
            }
        }
        last.map(|(light, probability)| (light.sample([xi.y, xi.z]), probability))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Triangle, Vertex};
    use std::f32::consts::PI;
    use std::f64::consts::GOLDEN_RATIO;

    fn lights(kind: LightKind, range: Option<f32>) -> (PunctualLights, Rays) {
        soft_lights(kind, range, 0.0)
    }

    fn soft_lights(kind: LightKind, range: Option<f32>, radius: f32) -> (PunctualLights, Rays) {
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
        let around = Environment { light_radius: radius, ..Environment::none() };
        (PunctualLights::new(&scene, &around, &rays).expect("it shines"), rays)
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

    /// Well-spread pairs of numbers.
    fn pairs(count: u32) -> impl Iterator<Item = [f32; 2]> {
        (0..count).map(move |k| {
            let at = f64::from(k) + 0.5;
            [(at / f64::from(count)) as f32, (at * GOLDEN_RATIO).fract() as f32]
        })
    }

    /// The mean of what samples of a soft light give a surface is its irradiance without occlusion:
    /// the point's own where all of the sphere is above the horizon, and less or more where not.
    #[test]
    fn samples_of_soft_lights_add_up() {
        for radius in [0.001, 0.1, 0.7] {
            let (soft, rays) = soft_lights(LightKind::Point, None, radius);
            let (point, _) = lights(LightKind::Point, None);
            let place = rays.place(Vec3::new(0.5, 0.0, 0.3));
            let towards = (rays.place(Vec3::new(0.0, 2.0, 0.0)) - place).normalize();
            let sine = radius / Vec3::new(0.5, 2.0, 0.3).length();
            let across = frame(towards, 0.3).0;
            for height in [1.0, 0.5, 1.001 * sine, 0.6 * sine, 0.0, -0.6 * sine, -1.001 * sine] {
                let normal = towards * height + across * (1.0 - height * height).sqrt();
                let expected = soft.unoccluded(place, normal).x;
                let sampled = pairs(40_000).map(|[a, b]| {
                    let picked = soft.pick(place, normal, Vec3::new(0.5, a, b), |_| 1.0);
                    picked.map_or(0.0, |(light, probability)| {
                        assert_eq!(probability, 1.0);
                        let cosine = f64::from(normal.dot(light.direction)).max(0.0);
                        f64::from(light.irradiance.x) * cosine
                    })
                });
                let mean = (sampled.sum::<f64>() / 40_000.0) as f32;
                let whole = soft.unoccluded(place, towards).x;
                assert!(
                    (mean - expected).abs() < 2e-3 * expected.max(0.01 * whole),
                    "{radius} {height}: {mean} {expected}"
                );
                let of_point = point.unoccluded(place, normal).x;
                if height.abs() > sine {
                    assert!((expected - of_point).abs() < 1e-4 * whole, "{radius} {height}");
                } else {
                    assert!(expected > of_point + 1e-3 * sine * whole, "{radius} {height}");
                }
            }
        }
    }

    /// Directions fill the sphere as it is seen, and end on it.
    #[test]
    fn soft_lights_are_seen_as_spheres() {
        let (soft, rays) = soft_lights(LightKind::Point, None, 0.5);
        let (place, middle) = (rays.place(Vec3::ZERO), rays.place(Vec3::new(0.0, 2.0, 0.0)));
        let radius = (0.5 * rays.scale()) as f32;
        let mut farthest = 0f32;
        for [a, b] in pairs(1000) {
            let (light, _) = soft.pick(place, Vec3::Y, Vec3::new(0.0, a, b), |_| 1.0).unwrap();
            let off = (light.end - middle).length() / radius;
            assert!((off - 1.0).abs() < 1e-3, "{off}");
            let way = (light.end - place).normalize();
            assert!((way - light.direction).length() < 1e-3 && light.end.y < middle.y);
            farthest = farthest.max(way.angle_between(Vec3::Y));
        }
        assert!((farthest / 0.25f32.asin() - 1.0).abs() < 0.01, "{farthest}");
        // From within twice its radius it is smaller, so that it never surrounds anyone.
        let near = rays.place(Vec3::new(0.0, 1.9, 0.0));
        let (light, _) = soft.pick(near, Vec3::Y, Vec3::new(0.0, 0.99, 0.5), |_| 1.0).unwrap();
        assert!(((light.end - middle).length() / (0.05 * rays.scale()) as f32 - 1.0).abs() < 0.01);
        let (sun, rays) = soft_lights(LightKind::Directional, None, 0.5);
        let place = rays.place(Vec3::X);
        for [a, b] in pairs(3) {
            let (light, _) = sun.pick(place, Vec3::Y, Vec3::new(0.0, a, b), |_| 1.0).unwrap();
            assert_eq!(light.direction, Vec3::Y, "directions have no radius");
        }
    }
}
