//! Clear surfaces: what Fresnel's equations let through a polished dielectric goes on, bent at the
//! surface of a body and straight through a sheet; the rest is mirrored.
//!
//! Walks carry radiance over n², which refraction does not change, so that walks from the camera
//! and from the light weigh alike.

use super::side::Side;
use crate::radiometry::Rgb;
use crate::scene::{Appearance, Material, Volume};
use glam::Vec3;

/// The least that a colour leaves of light when it becomes an absorption coefficient.
const LEAST_LEFT: f32 = 1e-30;

/// What a clear surface does.
#[derive(Clone, Copy, Debug)]
pub struct Clear {
    /// The share of light that meets it as a clear surface, in (0, 1]; for the rest it is opaque.
    pub share: f32,
    /// Index of refraction; below 1 it mirrors everything.
    ior: f32,
    /// What a crossing leaves of each channel.
    tint: Rgb,
    /// What it bounds; `None` of a sheet.
    inside: Option<Inside>,
}

/// The inside of a clear body: its absorption coefficient, per ray unit.
#[derive(Clone, Copy, Debug)]
pub struct Inside(Rgb);

/// The direction in which a ray leaves an interface, by reflection or through it.
pub struct ExitDirection {
    /// Unit direction away from the surface.
    pub direction: Vec3,
    /// What is left of each channel.
    pub tint: Rgb,
    /// Whether it went through.
    pub through: bool,
    /// What it is in from there on, if it went through.
    pub inside: Option<Inside>,
}

impl Inside {
    fn new(volume: &Volume, metre: f64) -> Self {
        let left = volume.attenuation_color.max(Rgb::splat(LEAST_LEFT));
        let per_metre = left.map(|left| -left.ln()) / volume.attenuation_distance;
        Self(per_metre / metre as f32)
    }

    /// What is left of each channel after a way, in ray units.
    pub fn left_after(&self, way: f32) -> Rgb {
        (self.0 * -way).exp()
    }
}

impl Clear {
    /// What a material says; `None` of an opaque one. A metre is that many ray units.
    pub fn new(material: &Material, metre: f64) -> Option<Self> {
        let share = material.clear_share();
        let inside = material.volume.map(|volume| Inside::new(&volume, metre));
        (share > 0.0).then_some(Self {
            share,
            ior: material.ior,
            tint: material.base_color,
            inside,
        })
    }

    /// The same where the material looks like this; `None` where that is opaque.
    pub fn looking(self, at: &Appearance) -> Option<Self> {
        let share = at.transmission.clamp(0.0, 1.0) * (1.0 - at.metallic.clamp(0.0, 1.0));
        (share > 0.0).then_some(Self { share, tint: at.base_color, ..self })
    }

    /// Where light goes on that is met from `viewer`, mirrored or let through as a uniform number
    /// says; `None` where shading and geometric normals contradict each other.
    pub fn pass(&self, surface: Side, viewer: Vec3, xi: f32) -> Option<ExitDirection> {
        let normal = surface.shading_normal;
        let cosine = normal.dot(viewer);
        if cosine <= 0.0 {
            return None;
        }
        let index = match self.inside {
            Some(_) if surface.back => 1.0 / self.ior,
            _ => self.ior,
        };
        let below = 1.0 - (1.0 - cosine * cosine).max(0.0) / (index * index);
        let mirrors =
            if self.ior < 1.0 || below <= 0.0 { 1.0 } else { fresnel(cosine, below.sqrt(), index) };
        if xi < mirrors {
            let direction = (2.0 * cosine * normal - viewer).normalize();
            let passed = ExitDirection { direction, tint: Rgb::ONE, through: false, inside: None };
            return (surface.normal.dot(direction) > 0.0).then_some(passed);
        }
        let direction = match self.inside {
            Some(_) => ((cosine / index - below.sqrt()) * normal - viewer / index).normalize(),
            None => -viewer,
        };
        let inside = if surface.back { None } else { self.inside };
        let passed = ExitDirection { direction, tint: self.tint, through: true, inside };
        (surface.normal.dot(direction) < 0.0).then_some(passed)
    }
}

impl ExitDirection {
    /// The change of power of light that comes from `source` and goes on in this direction
    /// ([`Side::power_factor`]). A sheet bends nothing.
    pub fn power_factor(&self, surface: Side, source: Vec3) -> f32 {
        if self.through && self.direction == -source {
            return 1.0;
        }
        surface.power_factor(self.direction, source)
    }
}

/// Unpolarised reflectance of an interface: cosines on both sides, and the index beyond over the
/// index before.
fn fresnel(before: f32, beyond: f32, index: f32) -> f32 {
    let across = (before - index * beyond) / (before + index * beyond);
    let along = (index * before - beyond) / (index * before + beyond);
    0.5 * (across * across + along * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(back: bool) -> Side {
        let normal = if back { -Vec3::Z } else { Vec3::Z };
        Side { normal, shading_normal: normal, back }
    }

    fn glass(ior: f32) -> Clear {
        Clear::new(&Material::glass("glass", ior), 1.0).expect("it is clear")
    }

    #[test]
    fn fresnel_is_what_textbooks_print() {
        assert!((fresnel(1.0, 1.0, 1.5) - 0.04).abs() < 1e-6);
        // Brewster's angle, tan θ = n, reflects half of (cos²θ − sin²θ)².
        let cosine = (1.0f32 + 1.5 * 1.5).sqrt().recip();
        let sine = (1.0 - cosine * cosine).sqrt();
        let expected = 0.5 * (cosine * cosine - sine * sine).powi(2);
        assert!((fresnel(cosine, sine, 1.5) - expected).abs() < 1e-6);
    }

    #[test]
    fn light_is_bent_by_snells_law_and_there_and_back_again() {
        for sine in [0.0f32, 0.2, 0.5, 0.9, 0.999] {
            let viewer = Vec3::new(sine, 0.0, (1.0 - sine * sine).sqrt());
            let front = surface(false);
            let passed = glass(1.5).pass(front, viewer, 0.999_999).expect("it goes through");
            assert!(passed.through && passed.inside.is_some());
            assert!((passed.direction.x + sine / 1.5).abs() < 1e-6, "{}", passed.direction);
            assert!((passed.power_factor(front, viewer) - 1.0).abs() < 1e-5);
            // From inside along the way it came: out along the way that it came.
            let out = glass(1.5).pass(surface(true), passed.direction, 0.999_999);
            let out = out.expect("it comes out");
            assert!(out.inside.is_none());
            assert!((out.direction - viewer).length() < 1e-3, "{} {viewer}", out.direction);
        }
    }

    #[test]
    fn beyond_the_critical_angle_everything_is_mirrored() {
        let viewer = Vec3::new(0.7, 0.0, -(1.0f32 - 0.49).sqrt());
        let passed = glass(1.5).pass(surface(true), viewer, 0.999_999).expect("it is mirrored");
        assert!(!passed.through);
        assert!((passed.direction - Vec3::new(-0.7, 0.0, viewer.z)).length() < 1e-6);
    }

    #[test]
    fn absorption_is_what_the_colour_says_at_its_distance() {
        let volume =
            Volume { attenuation_color: Rgb::new(0.5, 1.0, 0.0), attenuation_distance: 2.0 };
        let left = Inside::new(&volume, 8.0).left_after(16.0);
        assert!((left - Rgb::new(0.5, 1.0, 0.0)).length() < 1e-6, "{left}");
        assert_eq!(Inside::new(&volume, 8.0).left_after(0.0), Rgb::ONE);
        assert_eq!(Inside::new(&Volume::default(), 8.0).left_after(1e6), Rgb::ONE);
    }
}
