//! Lights that broad lobes see in one direction: points, spots and directions without extent, and the sun.
//! What a lobe reflects of these is known without a ray, but for what is in between.

use super::all_unoccluded::AllUnoccluded;
use super::direct_lights::DirectLights;
use super::unoccluded::LobeAxis;
use crate::radiometry::Rgb;
use glam::Vec3;

/// Most lights without extent of which each is looked at.
const MOST_POINTS: usize = 8;
/// Largest exponents of lobes that leave narrow lights to others: of broad ones, on which single places tell what
/// they reflect, and of polished ones, whose microfacets tell. 0 where there are no narrow lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NarrowLimits {
    /// Of broad lobes.
    pub broad: f32,
    /// Of polished ones; no less.
    pub polished: f32,
}

/// Largest exponent of a lobe that is broad.
const MOST_EXPONENT: f32 = 1e4;
/// The same times the square of the sun's angular radius: a lobe of exponent n has fallen to e^−nθ²/2 at an
/// angle of θ.
const MOST_ACROSS_SUN: f32 = 0.25;
/// Largest angular radius of a sun that polished lobes see as a narrow light, four times the real one's: beyond that
/// their rays meet it well.
const MOST_RADIUS: f32 = 0.02;
/// Group of the sun, and of lights without extent.
const SUN: usize = 2;
const POINTS: usize = 3;

impl DirectLights {
    /// Whether there are lights without extent, but few.
    pub(super) fn has_few_points(&self) -> bool {
        let points = self.punctual.as_ref();
        points.is_some_and(|points| !points.are_soft() && points.count() <= MOST_POINTS)
    }

    /// Largest exponents of lobes that leave narrow lights to others.
    pub fn narrow_up_to(&self) -> NarrowLimits {
        if !self.is_exact() || !(self.sun.is_some() || self.has_few_points()) {
            return NarrowLimits { broad: 0.0, polished: 0.0 };
        }
        let radius = self.sun.as_ref().map_or(0.0, |sun| sun.angular_radius());
        let broad = MOST_EXPONENT.min(MOST_ACROSS_SUN / (radius * radius));
        NarrowLimits { broad, polished: if radius <= MOST_RADIUS { f32::INFINITY } else { broad } }
    }

    /// Whether there are narrow lights that rays by polished lobes meet too seldom.
    pub fn has_narrow(&self) -> bool {
        self.narrow_up_to().polished == f32::INFINITY
    }

    /// Angular radius of a narrow light, by its number.
    pub fn narrow_radius(&self, number: usize) -> f32 {
        self.sun.as_ref().filter(|_| number == 0).map_or(0.0, |sun| sun.angular_radius())
    }

    /// Number of narrow lights.
    pub fn narrow_count(&self) -> usize {
        let points = self.punctual.as_ref().filter(|_| self.has_few_points());
        usize::from(self.sun.is_some()) + points.map_or(0, |points| points.count())
    }

    /// Number, of all narrow lights, of one without extent.
    pub(super) fn number_of_point(&self, point: usize) -> Option<u8> {
        self.has_few_points().then_some(u8::from(self.sun.is_some()) + point as u8)
    }

    /// A narrow light from a point, by its number, the sun's first: its unit direction, and what it shines on a
    /// plane that faces it; into the sun's disk by two uniform numbers. `None` where it does not shine.
    pub fn narrow(&self, number: usize, point: Vec3, xi: [f32; 2]) -> Option<(Vec3, Rgb)> {
        let of_point = match (&self.sun, number) {
            (Some(sun), 0) => return Some((sun.sample(xi), sun.irradiance())),
            (sun, _) => number - usize::from(sun.is_some()),
        };
        let light = self.punctual.as_ref()?.nth(of_point, point, xi)?;
        Some((light.direction, light.irradiance))
    }

    /// [`DirectLights::for_lobe`] without the narrow lights.
    pub fn extended_for_lobe(&self, point: Vec3, normal: Vec3, axis: LobeAxis) -> AllUnoccluded {
        let mut all = self.for_lobe(point, normal, axis);
        let mut left = 1.0 - std::mem::take(&mut all.shares[SUN]);
        if self.has_few_points() {
            left -= std::mem::take(&mut all.shares[POINTS]);
        }
        if left > 0.0 {
            all.shares = all.shares.map(|share| share / left);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::environment::{Environment, Sky, Sun};
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::{LightKind, PunctualLight, made};
    use crate::surface::World;
    use std::sync::Arc;

    /// The Cornell box with so many bulbs, of such a radius, a sky and a sun.
    fn lights(bulbs: usize, light_radius: f32) -> (World, DirectLights) {
        let glb = made::cornell();
        let mut scene = import(&glb, &Resources::default(), &ImportLimits::default()).unwrap();
        let bulb = |number: usize| PunctualLight {
            name: "bulb".into(),
            kind: LightKind::Point,
            position: Vec3::new(0.1 * number as f32, 0.9, 0.2),
            direction: -Vec3::Y,
            intensity: Rgb::new(1.0, 2.0, 3.0),
            range: None,
        };
        scene.lights = (0..bulbs).map(bulb).collect();
        let environment = Environment {
            sky: Sky::Uniform(Rgb::ONE),
            sun: Some(Sun::towards(Vec3::new(0.2, 0.9, 0.3), Rgb::splat(4.0), 0.005)),
            light_radius,
        };
        let world = World::surrounded(Arc::new(scene), Arc::new(environment));
        let lights = DirectLights::new(&world).expect("there is light");
        (world, lights)
    }

    /// What narrow lights shine one by one is what they shine together; a sampled one has its number.
    #[test]
    fn each_is_found_by_its_number() {
        let (world, lights) = lights(3, 0.0);
        assert_eq!(lights.narrow_count(), 4);
        let (point, normal) = (world.rays.place(Vec3::new(0.3, 0.4, 0.5)), Vec3::Y);
        let one = |number| lights.narrow(number, point, [0.5; 2]).expect("it shines");
        let sum: Rgb =
            (0..4).map(one).map(|(direction, light)| light * normal.dot(direction)).sum();
        let sun = lights.sun.as_ref().expect("a sun").unoccluded(normal);
        let points = lights.punctual.as_ref().expect("bulbs").unoccluded(point, normal);
        let off = (sum / (sun + points) - Rgb::ONE).abs().max_element();
        assert!(off < 1e-3, "{sum} {}", sun + points);
        let all = lights.unoccluded(point, normal);
        let mut found = [0; 4];
        for number in 0..200 {
            let xi = Vec3::new((number as f32 + 0.5) / 200.0, 0.3, 0.6);
            let Some(light) = lights.sample(&all, point, normal, xi) else { continue };
            let Some(narrow) = light.narrow else { continue };
            let direction = (light.end - point).normalize();
            let off = direction.angle_between(one(usize::from(narrow)).0);
            assert!(off < 0.012, "{narrow}: {off}");
            found[usize::from(narrow)] += 1;
        }
        assert!(found.iter().all(|count| *count > 0), "{found:?}");
    }

    /// Lobes that leave narrow lights to others pick none.
    #[test]
    fn extended_lights_are_the_others() {
        let (world, lights) = lights(2, 0.0);
        let (point, normal) = (world.rays.place(Vec3::new(0.3, 0.4, 0.5)), Vec3::Y);
        let axis = LobeAxis {
            direction: Vec3::new(0.2, 0.9, 0.3).normalize(),
            exponent: 50.0,
            of_narrow: 50.0,
        };
        let [all, extended] =
            [lights.for_lobe(point, normal, axis), lights.extended_for_lobe(point, normal, axis)];
        let mut narrow = [0, 0];
        for number in 0..200 {
            let xi = Vec3::new((number as f32 + 0.5) / 200.0, 0.3, 0.6);
            for (found, from) in narrow.iter_mut().zip([&all, &extended]) {
                let light = lights.sample(from, point, normal, xi);
                *found += u32::from(light.is_some_and(|light| light.narrow.is_some()));
            }
        }
        assert!(narrow[0] > 50 && narrow[1] == 0, "{narrow:?}");
        assert!(extended.shares[..2].iter().sum::<f32>() > all.shares[..2].iter().sum::<f32>());
    }

    /// Many lights, and soft ones, are not looked at one by one; beside a wide sun lobes have to be broader.
    #[test]
    fn few_hard_lights_and_the_sun_are_narrow() {
        let (_, many) = lights(MOST_POINTS + 1, 0.0);
        let (_, soft) = lights(1, 0.1);
        assert_eq!([many, soft].map(|lights| lights.narrow_count()), [1, 1]);
        let (_, few) = lights(MOST_POINTS, 0.0);
        assert_eq!(
            (few.narrow_count(), few.narrow_up_to().broad),
            (MOST_POINTS + 1, MOST_EXPONENT)
        );
        let sun = Some(Sun::towards(Vec3::Y, Rgb::ONE, 0.1));
        let around = Environment { sun, ..Environment::none() };
        let glb = made::cornell();
        let scene = import(&glb, &Resources::default(), &ImportLimits::default()).unwrap();
        let world = World::surrounded(Arc::new(scene), Arc::new(around));
        let wide = DirectLights::new(&world).expect("there is light");
        let NarrowLimits { broad, polished } = wide.narrow_up_to();
        assert!((broad - 25.0).abs() < 0.1 && polished == broad, "{broad} {polished}");
        assert_eq!(few.narrow_up_to().polished, f32::INFINITY);
    }
}
