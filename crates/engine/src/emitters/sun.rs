//! A sun as a light: directions of its disk.

use crate::radiometry::Rgb;
use crate::sampling::frame;
use crate::scene::environment::{Environment, Sun};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// The sun of an environment.
#[derive(Clone, Copy, Debug)]
pub struct SunLight {
    sun: Sun,
    tangent: Vec3,
    bitangent: Vec3,
    /// 1 − cosine of the angular radius, exact for small ones.
    height: f32,
}

impl SunLight {
    /// The environment's sun; `None` where there is none, or one that does not shine.
    pub fn new(environment: &Environment) -> Option<Self> {
        let sun = environment.sun.filter(|sun| sun.irradiance.max_element() > 0.0)?;
        let (tangent, bitangent) = frame(sun.direction, 0.0);
        let height = 2.0 * (0.5 * sun.angular_radius).sin().powi(2);
        Some(Self { sun, tangent, bitangent, height })
    }

    /// A unit direction into the disk, uniform in solid angle; its middle for a sun without a disk.
    /// With a direction goes [`SunLight::irradiance`] × cosθ: what the whole disk gives, up to the
    /// cosine's change over the disk.
    pub fn sample(&self, xi: [f32; 2]) -> Vec3 {
        let height = self.height * xi[0];
        let radius = (height * (2.0 - height)).sqrt();
        let (sin, cos) = (TAU * xi[1]).sin_cos();
        let across = self.tangent * cos + self.bitangent * sin;
        (self.sun.direction * (1.0 - height) + across * radius).normalize()
    }

    /// Density of [`SunLight::sample`] within the disk, 1/sr; infinite for a sun without a disk.
    pub fn pdf(&self) -> f32 {
        (TAU * self.height).recip()
    }

    /// Radiance of the disk; zero for a sun without one.
    pub fn radiance(&self) -> Rgb {
        self.sun.radiance()
    }

    /// Irradiance on a plane that faces the sun.
    pub fn irradiance(&self) -> Rgb {
        self.sun.irradiance
    }

    /// Unit vector towards the middle of the disk.
    pub fn direction(&self) -> Vec3 {
        self.sun.direction
    }

    /// Angle between the middle of the disk and its rim.
    pub fn angular_radius(&self) -> f32 {
        self.sun.angular_radius
    }

    /// Whether a unit direction meets the disk.
    pub fn covers(&self, direction: Vec3) -> bool {
        self.sun.covers(direction)
    }

    /// Irradiance on a plane of the given unit normal without occluders, ∫ L max(cosθ, 0) dω: the
    /// irradiance of a plane that faces the sun times what a disk gives of it, where the horizon
    /// cuts the disk by the closed form for a small flat disk.
    pub fn unoccluded(&self, normal: Vec3) -> Rgb {
        let (cosine, sine) = (normal.dot(self.sun.direction), self.sun.angular_radius.sin());
        if cosine >= sine || sine <= 0.0 {
            return self.sun.irradiance * cosine.max(0.0);
        }
        // Height of the disk's middle over the horizon in units of its radius, t in [−1, 1]:
        // ∫ max(t + x, 0) dA / π over the unit disk.
        let t = (cosine / sine).clamp(-1.0, 1.0);
        let root = (1.0 - t * t).max(0.0).sqrt();
        let mean = (t * (PI - t.acos()) + root * (2.0 + t * t) / 3.0) / PI;
        self.sun.irradiance * (sine * mean.max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use crate::scene::environment::{SUN_RADIUS, Sky};

    fn light(angular_radius: f32) -> SunLight {
        let direction = Vec3::new(0.3, 0.8, -0.4).normalize();
        let sun = Sun { direction, irradiance: Rgb::new(3.0, 2.0, 1.0), angular_radius };
        SunLight::new(&Environment { sky: Sky::None, sun: Some(sun), ..Environment::default() })
            .unwrap()
    }

    #[test]
    fn directions_fill_the_disk_uniformly() {
        for radius in [SUN_RADIUS, 0.1] {
            let light = light(radius);
            let mut numbers = Numbers::new(1, Stream::Light, 0);
            let rings: Vec<usize> = (0..20_000)
                .map(|_| {
                    let direction = light.sample([numbers.uniform(), numbers.uniform()]);
                    assert!((direction.length() - 1.0).abs() < 1e-6);
                    let chord = (direction - light.direction()).length_squared();
                    // The area within a chord is π chord², exactly.
                    (10.0 * chord / (2.0 * light.height)) as usize
                })
                .collect();
            let counts: Vec<_> =
                (0..10).map(|k| rings.iter().filter(|r| **r == k).count()).collect();
            let chi: f64 = counts.iter().map(|n| (*n as f64 - 2000.0).powi(2) / 2000.0).sum();
            assert!(chi < 27.9, "9 degrees of freedom, one in a thousand: {counts:?}");
        }
    }

    #[test]
    fn density_radiance_and_irradiance_agree() {
        let light = light(0.1);
        // Over the disk, ∫ L cosθ dω by samples that face it.
        let mut numbers = Numbers::new(2, Stream::Light, 0);
        let n = 10_000;
        let sum: Rgb = (0..n)
            .map(|_| {
                let direction = light.sample([numbers.uniform(), numbers.uniform()]);
                light.radiance() * direction.dot(light.direction()) / light.pdf()
            })
            .sum();
        let error = (sum / n as f32 - light.irradiance()).length();
        assert!(error < 1e-3 * light.irradiance().length(), "{error}");
    }

    #[test]
    fn a_sun_without_a_disk_is_one_direction() {
        let light = light(0.0);
        assert!((light.sample([0.7, 0.2]) - light.direction()).length() < 1e-6);
        assert!(light.pdf().is_infinite() && light.radiance() == Rgb::ZERO);
        let (normal, _) = frame(light.direction(), 0.0);
        assert!(light.unoccluded(normal).length() < 1e-5);
        assert_eq!(light.unoccluded(-light.direction()), Rgb::ZERO);
    }

    #[test]
    fn irradiance_without_occluders_is_that_of_samples_at_any_height() {
        let radius = 0.02f32;
        let light = light(radius);
        let (tangent, _) = frame(light.direction(), 0.3);
        for height in [-1.2f32, -0.9, -0.3, 0.0, 0.5, 1.1, 20.0] {
            let angle = height * radius;
            let normal = (tangent * angle.cos() + light.direction() * angle.sin()).normalize();
            let n = 256;
            let grid = (0..n * n).map(|i| [i % n, i / n].map(|k| (k as f32 + 0.5) / n as f32));
            let sum: f64 =
                grid.map(|xi| f64::from(light.sample(xi).dot(normal).max(0.0))).sum::<f64>();
            let sampled = sum / f64::from(n * n) * f64::from(light.radiance().x / light.pdf());
            let exact = f64::from(light.unoccluded(normal).x);
            let scale = f64::from(light.irradiance().x * radius);
            assert!(
                (sampled - exact).abs() < 2e-3 * scale.max(exact),
                "{height}: {sampled} {exact}"
            );
        }
    }
}
