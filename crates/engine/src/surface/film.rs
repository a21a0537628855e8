//! A thin film on a surface, as KHR_materials_iridescence has it: the film's two boundaries mirror by
//! Schlick's terms, what they mirror interferes, and the spectrum is summed up by Gaussian fits of the
//! eye's sensitivity in Fourier space (Belcour and Barla 2017, "A practical extension to microfacet
//! theory for the modeling of varying iridescence").

use crate::radiometry::Rgb;
use crate::scene::Layers;
use glam::{Mat3, Vec3};
use std::f32::consts::TAU;
use std::sync::LazyLock;

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
/// Paths beyond which nothing interferes, metres: the narrowest of the fits is 10⁻⁴ of its weight.
const LONGEST: f32 = 7.4e-6;
/// Entries of the table of sensitivities: a hundred for each turn of the fastest.
const ENTRIES: usize = 2048;
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

    /// The film on something that would mirror `f0` at normal incidence.
    pub fn on(&self, f0: Rgb) -> Filmed {
        // Light that is mirrored by what is denser comes back half a wave late.
        let of_channel = |f0: f32| {
            let root = f0.clamp(0.0, MOST_F0).sqrt();
            let base = (1.0 + root) / (1.0 - root);
            let in_step = (self.ior < self.outside) != (base < self.ior);
            (normal_reflectance(base, self.ior), if in_step { 1.0 } else { -1.0 })
        };
        let [r, g, b] = f0.to_array().map(of_channel);
        Filmed {
            upper: normal_reflectance(self.ior, self.outside),
            lower: Rgb::new(r.0, g.0, b.0),
            signs: Vec3::new(r.1, g.1, b.1),
            bending: (self.outside / self.ior).powi(2),
            path: 2.0 * self.ior * self.thickness,
        }
    }
}

/// A film and what it lies on.
#[derive(Clone, Copy, Debug)]
pub struct Filmed {
    /// Reflectance of the upper boundary at normal incidence.
    upper: f32,
    /// That of the lower one.
    lower: Rgb,
    /// Which channels are in step where the film is thin: 1, else −1.
    signs: Vec3,
    /// Square of the quotient of the indices of refraction above it and in it.
    bending: f32,
    /// Twice its optical thickness, metres.
    path: f32,
}

impl Filmed {
    /// Reflectance for light at an angle of that cosine.
    pub fn reflectance(&self, cosine: f32) -> Rgb {
        let cosine = cosine.clamp(0.0, 1.0);
        let sine_square = self.bending * (1.0 - cosine * cosine);
        if sine_square >= 1.0 {
            return Rgb::ONE;
        }
        let below = (1.0 - sine_square).sqrt();
        let upper = self.upper + (1.0 - self.upper) * (1.0 - cosine).powi(5);
        let lower = self.lower + (Rgb::ONE - self.lower) * (1.0 - below).powi(5);
        interference(upper, lower, self.path * below, self.signs).clamp(Rgb::ZERO, Rgb::ONE)
    }
}

/// Reflectance at normal incidence between two indices of refraction.
fn normal_reflectance(beyond: f32, before: f32) -> f32 {
    ((beyond - before) / (beyond + before)).powi(2)
}

/// What two boundaries mirror together, whose light differs by a path, metres; the signs say which
/// channels are in step where the path is 0, and which are half a wave apart.
fn interference(upper: f32, lower: Rgb, path: f32, signs: Vec3) -> Rgb {
    let through = 1.0 - upper;
    let both = (upper * lower).clamp(Rgb::splat(1e-5), Rgb::splat(0.9999));
    let bounced = through * through * lower / (Rgb::ONE - both);
    let mut sum = upper + bounced;
    let mut amplitude = bounced - through;
    let mut sign = Vec3::ONE;
    for order in 1..=ORDERS {
        amplitude *= both.map(f32::sqrt);
        sign *= signs;
        sum += amplitude * 2.0 * (TO_RGB * (sign * sensitivity(order as f32 * path)));
    }
    sum
}

/// What the eye makes of a spectrum that is a cosine of the wave number, as CIE XYZ: the Fourier
/// transform of its sensitivities, from a table.
fn sensitivity(path: f32) -> Vec3 {
    static TABLE: LazyLock<Vec<Vec3>> = LazyLock::new(|| {
        let step = LONGEST / ENTRIES as f32;
        (0..=ENTRIES).map(|entry| transform(entry as f32 * step)).collect()
    });
    let at = path * (ENTRIES as f32 / LONGEST);
    let entry = at as usize;
    if entry >= ENTRIES {
        return Vec3::ZERO;
    }
    TABLE[entry].lerp(TABLE[entry + 1], at - entry as f32)
}

/// An entry of the table of [`sensitivity`].
fn transform(path: f32) -> Vec3 {
    let phase = TAU * path;
    let gaussian = |k: usize| {
        let spread = (-phase * phase * VARIANCES[k]).exp();
        WEIGHTS[k] * (TAU * VARIANCES[k]).sqrt() * (CENTERS[k] * phase).cos() * spread
    };
    Vec3::new(gaussian(0) + gaussian(3), gaussian(1), gaussian(2)) / SCALE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(ior: f32, thickness: f32) -> Film {
        Film { strength: 1.0, ior, thickness: thickness * 1e-9, outside: 1.0 }
    }

    /// Schlick's term.
    fn schlick(f0: f32, cosine: f32) -> f32 {
        f0 + (1.0 - f0) * (1.0 - cosine).clamp(0.0, 1.0).powi(5)
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
                let found = film(ior, 20_000.0).on(Rgb::splat(f0)).reflectance(cosine);
                assert!((found - expected).abs().max_element() < 1e-3, "{found} {expected}");
            }
        }
    }

    /// The table says what it is a table of, at places between its entries and beyond its end.
    #[test]
    fn sensitivities_are_those_of_the_fits() {
        let whole = transform(0.0).max_element();
        for k in 0..5000 {
            let path = 1.1 * LONGEST * (k as f32 + 0.37) / 5000.0;
            let difference = (sensitivity(path) - transform(path)).abs().max_element();
            assert!(difference < 1e-3 * whole, "{path}: {difference}");
        }
        assert!((sensitivity(1e-7) - transform(1.1e-7)).length() > 0.05 * whole);
    }

    /// A film of a quarter of the wavelength of green on glass, of an index between those of air and
    /// glass, mirrors little of it; one of half the wavelength mirrors as much as bare glass.
    #[test]
    fn quarter_waves_cancel_and_half_waves_do_not() {
        let quarter = 550.0 / (4.0 * 1.23);
        let glass = Rgb::splat(0.04);
        let [dark, bright] =
            [quarter, 2.0 * quarter].map(|nm| film(1.23, nm).on(glass).reflectance(1.0).y);
        assert!(dark < 0.005, "{dark}");
        assert!((0.03..0.045).contains(&bright), "{bright}");
    }

    /// Nothing is mirrored more than wholly, and colours change with the angle.
    #[test]
    fn reflectance_is_a_share() {
        for nm in [0.0, 100.0, 400.0, 1000.0] {
            for f0 in [0.0, 0.04, 0.6, 1.0] {
                for cosine in [0.0, 0.3, 1.0] {
                    let share = film(1.5, nm).on(Rgb::splat(f0)).reflectance(cosine);
                    assert!(share.min_element() >= 0.0 && share.max_element() <= 1.0, "{share}");
                }
            }
        }
        let [above, aslant] =
            [1.0, 0.4].map(|cosine| film(1.5, 400.0).on(Rgb::splat(0.3)).reflectance(cosine));
        let hue = |color: Rgb| color / color.element_sum();
        assert!((hue(above) - hue(aslant)).length() > 0.05, "{above} {aslant}");
    }
}
