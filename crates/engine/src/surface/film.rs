//! A thin film on a surface, as KHR_materials_iridescence has it: the film's two boundaries mirror by
//! Schlick's terms, what they mirror interferes, and the spectrum is summed up by Gaussian fits of the
//! eye's sensitivity in Fourier space (Belcour and Barla 2017, "A practical extension to microfacet
//! theory for the modeling of varying iridescence").

use crate::radiometry::Rgb;
use crate::scene::Layers;
use glam::{Mat3, Vec3};
use std::f32::consts::{PI, TAU};

/// Index of refraction of a clear coat, beneath which a film may lie.
const COAT_IOR: f32 = 1.5;
/// Reflectances above make no index of refraction.
const MOST_F0: f32 = 0.9999;
/// Interferences that are summed up beside the mean.
const ORDERS: u32 = 2;
/// The fits of the sensitivities X, Y and Z, and the second peak of X: weight, centre and variance of
/// each Gaussian over wave numbers, 1/m; and the scale of all.
const WEIGHTS: [f32; 4] = [5.4856e-13, 4.4201e-13, 5.2481e-13, 9.747e-14];
const CENTERS: [f32; 4] = [1.681e6, 1.7953e6, 2.2084e6, 2.2399e6];
const VARIANCES: [f32; 4] = [4.3278e9, 9.3046e9, 6.6121e9, 4.5282e9];
const SCALE: f32 = 1.0685e-7;
/// From CIE XYZ to linear Rec. 709.
const TO_RGB: Mat3 = Mat3::from_cols(
    Vec3::new(3.240_454_2, -0.969_266, 0.055_643_4),
    Vec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
    Vec3::new(-0.498_531_4, 0.041_556, 1.057_225_2),
);

/// A thin film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Its strength, in [0, 1].
    pub strength: f32,
    /// Its index of refraction, ≥ 1.
    ior: f32,
    /// Its thickness, metres.
    thickness: f32,
    /// Index of refraction above it.
    outside: f32,
}

impl Film {
    /// Of these layers.
    pub fn new(layers: &Layers) -> Self {
        Self {
            strength: layers.film.clamp(0.0, 1.0),
            ior: layers.film_ior.max(1.0),
            thickness: layers.film_thickness.max(0.0) * 1e-9,
            outside: 1.0 + (COAT_IOR - 1.0) * layers.coat.clamp(0.0, 1.0),
        }
    }

    /// Whether there is one.
    pub fn is_there(&self) -> bool {
        self.strength > 0.0
    }

    /// Reflectance of the film on something that would mirror `f0` at normal incidence, for light at
    /// an angle of that cosine.
    pub fn reflectance(&self, f0: Rgb, cosine: f32) -> Rgb {
        let cosine = cosine.clamp(0.0, 1.0);
        let sine_square = (self.outside / self.ior).powi(2) * (1.0 - cosine * cosine);
        if sine_square >= 1.0 {
            return Rgb::ONE;
        }
        let below = (1.0 - sine_square).sqrt();
        let path = 2.0 * self.ior * self.thickness * below;
        let upper = schlick(normal_reflectance(self.ior, self.outside), cosine);
        let upper_shift = if self.ior < self.outside { 0.0 } else { PI };
        let of_channel = |f0: f32| {
            let root = f0.clamp(0.0, MOST_F0).sqrt();
            let base = (1.0 + root) / (1.0 - root);
            let lower = schlick(normal_reflectance(base, self.ior), below);
            let shift = upper_shift + if base < self.ior { PI } else { 0.0 };
            (lower, shift)
        };
        let [r, g, b] = f0.to_array().map(of_channel);
        let (lower, shifts) = (Rgb::new(r.0, g.0, b.0), Rgb::new(r.1, g.1, b.1));
        interference(upper, lower, path, shifts).clamp(Rgb::ZERO, Rgb::ONE)
    }
}

/// Schlick's term.
fn schlick(f0: f32, cosine: f32) -> f32 {
    f0 + (1.0 - f0) * (1.0 - cosine).clamp(0.0, 1.0).powi(5)
}

/// Reflectance at normal incidence between two indices of refraction.
fn normal_reflectance(beyond: f32, before: f32) -> f32 {
    ((beyond - before) / (beyond + before)).powi(2)
}

/// What two boundaries mirror together, whose light differs by a path, metres, and a phase.
fn interference(upper: f32, lower: Rgb, path: f32, shifts: Rgb) -> Rgb {
    let through = 1.0 - upper;
    let both = (upper * lower).clamp(Rgb::splat(1e-5), Rgb::splat(0.9999));
    let bounced = through * through * lower / (Rgb::ONE - both);
    let mut sum = upper + bounced;
    let mut amplitude = bounced - through;
    for order in 1..=ORDERS {
        amplitude *= both.map(f32::sqrt);
        let order = order as f32;
        sum += amplitude * 2.0 * sensitivity(order * path, order * shifts);
    }
    sum
}

/// What the eye makes of a spectrum that is a cosine of the wave number, in linear Rec. 709: the
/// Fourier transform of its sensitivities.
fn sensitivity(path: f32, shifts: Rgb) -> Rgb {
    let phase = TAU * path;
    let gaussian = |k: usize, shift: f32| {
        let spread = (-phase * phase * VARIANCES[k]).exp();
        WEIGHTS[k] * (TAU * VARIANCES[k]).sqrt() * (CENTERS[k] * phase + shift).cos() * spread
    };
    let x = gaussian(0, shifts.x) + gaussian(3, shifts.x);
    let xyz = Vec3::new(x, gaussian(1, shifts.y), gaussian(2, shifts.z));
    TO_RGB * (xyz / SCALE)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(ior: f32, thickness: f32) -> Film {
        Film { strength: 1.0, ior, thickness: thickness * 1e-9, outside: 1.0 }
    }

    /// Airy's formula for a thick film on glass, averaged over all phases: incoherent light that goes
    /// to and fro between the boundaries.
    #[test]
    fn thick_films_mirror_without_interference() {
        for (ior, f0) in [(1.33f32, 0.04f32), (1.8, 0.04), (1.33, 0.5)] {
            for cosine in [1.0f32, 0.6] {
                let below = (1.0 - (1.0 - cosine * cosine) / (ior * ior)).sqrt();
                let base = (1.0 + f0.sqrt()) / (1.0 - f0.sqrt());
                let upper = schlick(((ior - 1.0) / (ior + 1.0)).powi(2), cosine);
                let lower = schlick(((base - ior) / (base + ior)).powi(2), below);
                let expected = upper + (1.0 - upper).powi(2) * lower / (1.0 - upper * lower);
                let found = film(ior, 20_000.0).reflectance(Rgb::splat(f0), cosine);
                assert!((found - expected).abs().max_element() < 1e-3, "{found} {expected}");
            }
        }
    }

    /// A film of a quarter of the wavelength of green on glass, of an index between those of air and
    /// glass, mirrors little of it; one of half the wavelength mirrors as much as bare glass.
    #[test]
    fn quarter_waves_cancel_and_half_waves_do_not() {
        let quarter = 550.0 / (4.0 * 1.23);
        let glass = Rgb::splat(0.04);
        let [dark, bright] =
            [quarter, 2.0 * quarter].map(|nm| film(1.23, nm).reflectance(glass, 1.0).y);
        assert!(dark < 0.005, "{dark}");
        assert!((0.03..0.045).contains(&bright), "{bright}");
    }

    /// Nothing is mirrored more than wholly, and colours change with the angle.
    #[test]
    fn reflectance_is_a_share() {
        for nm in [0.0, 100.0, 400.0, 1000.0] {
            for f0 in [0.0, 0.04, 0.6, 1.0] {
                for cosine in [0.0, 0.3, 1.0] {
                    let share = film(1.5, nm).reflectance(Rgb::splat(f0), cosine);
                    assert!(share.min_element() >= 0.0 && share.max_element() <= 1.0, "{share}");
                }
            }
        }
        let [above, aslant] =
            [1.0, 0.4].map(|cosine| film(1.5, 400.0).reflectance(Rgb::splat(0.3), cosine));
        let hue = |color: Rgb| color / color.element_sum();
        assert!((hue(above) - hue(aslant)).length() > 0.05, "{above} {aslant}");
    }
}
