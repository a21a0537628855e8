//! Visible light in bands of wavelength, and how sunlight in these bands becomes photometric RGB.
//!
//! The atmosphere filters by wavelength much finer than three channels tell: the model computes
//! with [`BANDS`] bands, as fractions of the sunlight that arrives at the top of the atmosphere,
//! and folds them into RGB at the end.

use crate::radiometry::Rgb;
use std::array;
use std::ops::{Add, AddAssign, Mul};

/// Number of bands.
pub const BANDS: usize = 16;
/// Width of a band in nm.
const BAND_WIDTH: f64 = 20.0;
/// Begin of the first band in nm.
const FIRST_WAVELENGTH: f64 = 380.0;

/// Begin of the first bin of the tables below in nm.
const FIRST_BIN: f64 = 360.0;
/// Width of their bins in nm.
const BIN_WIDTH: f64 = 10.0;
/// Their number of bins.
const BINS: usize = 48;

/// Luminous efficacy of green light in lm/W, by the definition of the candela.
const EFFICACY: f64 = 683.002;

/// Sunlight at the top of the atmosphere at the mean distance from the sun, W/(m²·nm), mean of each
/// bin: ASTM G173-03, extraterrestrial column, as tabulated by Bruneton (2017).
const SUNLIGHT: [f64; BINS] = [
    1.11776, 1.14259, 1.01249, 1.14716, 1.72765, 1.73054, 1.68870, 1.61253, 1.91198, 2.03474,
    2.02042, 2.02212, 1.93377, 1.95809, 1.91686, 1.82980, 1.86850, 1.89310, 1.85149, 1.85040,
    1.83410, 1.83450, 1.81470, 1.78158, 1.75330, 1.69650, 1.68194, 1.64654, 1.60480, 1.52143,
    1.55622, 1.51130, 1.47400, 1.44820, 1.41018, 1.36775, 1.34188, 1.31429, 1.28303, 1.26758,
    1.23670, 1.20820, 1.18737, 1.14683, 1.12362, 1.10580, 1.07124, 1.04992,
];

/// Absorption cross-section of an ozone molecule at 233 K in units of 1e-26 m², mean of each bin:
/// University of Bremen (Serdyuchenko et al. 2011), as tabulated by Bruneton (2017).
const OZONE: [f64; BINS] = [
    0.1180, 0.02182, 0.02818, 0.06636, 0.1527, 0.2763, 0.5520, 0.8451, 1.582, 2.316, //
    3.669, 4.924, 7.752, 9.016, 14.80, 16.02, 21.39, 27.55, 30.91, 35.00, //
    42.66, 46.72, 43.98, 47.01, 50.19, 43.05, 37.40, 32.15, 26.62, 22.38, //
    18.52, 14.73, 12.09, 9.423, 7.455, 6.566, 5.105, 4.150, 4.228, 3.237, //
    2.451, 2.801, 2.534, 1.624, 1.465, 2.078, 1.383, 0.7105,
];

/// A quantity in each band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spectrum(pub [f32; BANDS]);

impl Spectrum {
    /// Nothing in any band.
    pub const ZERO: Self = Self([0.0; BANDS]);

    /// A function of the wavelength in nm at the centre of each band.
    pub fn of_wavelength(value: impl Fn(f64) -> f64) -> Self {
        Self(array::from_fn(|band| {
            value(FIRST_WAVELENGTH + (band as f64 + 0.5) * BAND_WIDTH) as f32
        }))
    }

    /// Absorption cross-section of an ozone molecule in m².
    pub fn ozone_cross_section() -> Self {
        let bins_per_band = (BAND_WIDTH / BIN_WIDTH) as usize;
        let skipped = ((FIRST_WAVELENGTH - FIRST_BIN) / BIN_WIDTH) as usize;
        Self(array::from_fn(|band| {
            let first = skipped + band * bins_per_band;
            let sum: f64 = OZONE[first..first + bins_per_band].iter().sum();
            (sum / bins_per_band as f64 * 1e-26) as f32
        }))
    }

    /// A function of each band's value.
    pub fn map(self, function: impl Fn(f32) -> f32) -> Self {
        Self(self.0.map(function))
    }

    /// A function of each band's values in two spectra.
    pub fn zip(self, other: Self, function: impl Fn(f32, f32) -> f32) -> Self {
        Self(array::from_fn(|band| function(self.0[band], other.0[band])))
    }
}

impl Add for Spectrum {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl AddAssign for Spectrum {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul for Spectrum {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Mul<f32> for Spectrum {
    type Output = Self;
    fn mul(self, factor: f32) -> Self {
        self.map(|a| a * factor)
    }
}

/// Sunlight at the top of the atmosphere by band, in photometric RGB.
pub struct Sunlight {
    /// Illuminance in lux that each band adds to a plane facing the sun, folded into linear
    /// Rec. 709 RGB: a white of Y lux has R = G = B = Y. Single bands lie outside of what RGB can
    /// show and have negative channels.
    bands: [Rgb; BANDS],
}

impl Sunlight {
    /// Integrates the sun's spectrum over the colour matching functions, bin by bin. What lies
    /// beyond the bands counts into the first and the last one.
    pub fn new() -> Self {
        let mut bands = [[0.0; 3]; BANDS];
        for (bin, irradiance) in SUNLIGHT.iter().enumerate() {
            let wavelength = FIRST_BIN + (bin as f64 + 0.5) * BIN_WIDTH;
            let band = ((wavelength - FIRST_WAVELENGTH) / BAND_WIDTH).max(0.0) as usize;
            let rgb = linear_rec709(color_matching(wavelength));
            for (sum, value) in bands[band.min(BANDS - 1)].iter_mut().zip(rgb) {
                *sum += EFFICACY * irradiance * BIN_WIDTH * value;
            }
        }
        Self { bands: bands.map(|[r, g, b]| Rgb::new(r as f32, g as f32, b as f32)) }
    }

    /// RGB of light whose bands hold the given fractions of sunlight; may have negative channels
    /// ([`into_gamut`]).
    pub fn filtered(&self, fractions: &Spectrum) -> Rgb {
        self.bands.iter().zip(fractions.0).map(|(band, fraction)| *band * fraction).sum()
    }
}

/// The nearest colour without negative channels on the way to grey of the same luminance.
///
/// The deepest reds of a setting sun are purer than any that RGB has without negative light.
pub fn into_gamut(color: Rgb) -> Rgb {
    let least = color.min_element();
    if least >= 0.0 {
        return color;
    }
    let luminance = luminance(color);
    if luminance <= 0.0 {
        return Rgb::ZERO;
    }
    let grey = Rgb::splat(luminance);
    (grey + (color - grey) * (luminance / (luminance - least))).max(Rgb::ZERO)
}

/// Photometric value of linear Rec. 709 RGB.
pub fn luminance(color: Rgb) -> f32 {
    color.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

/// CIE 1931 colour matching functions x̄, ȳ, z̄ at a wavelength in nm: multi-lobe fit of Wyman,
/// Sloan and Shirley (JCGT 2(2), 2013, eq. 4).
fn color_matching(wavelength: f64) -> [f64; 3] {
    let lobe = |center: f64, below: f64, above: f64| {
        let width = if wavelength < center { below } else { above };
        (-0.5 * ((wavelength - center) / width).powi(2)).exp()
    };
    [
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7)
            - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8),
    ]
}

/// CIE XYZ to linear RGB with the primaries and the white D65 of Rec. 709.
fn linear_rec709([x, y, z]: [f64; 3]) -> [f64; 3] {
    [
        3.240_969_94 * x - 1.537_383_18 * y - 0.498_610_76 * z,
        -0.969_243_64 * x + 1.875_967_50 * y + 0.041_555_06 * z,
        0.055_630_08 * x - 0.203_976_96 * y + 1.056_971_51 * z,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published illuminance of the extraterrestrial sun: 128 klx (IES) to 133.3 klx (Darula,
    /// Kittler and Gueymard 2005); its colour is a little warmer than D65.
    #[test]
    fn sunlight_above_the_atmosphere() {
        let sun = Sunlight::new().filtered(&Spectrum([1.0; BANDS]));
        let illuminance = luminance(sun);
        assert!((128_000.0..134_000.0).contains(&illuminance), "{illuminance}");
        assert!(sun.x > sun.y && sun.y > sun.z && sun.z > 0.8 * sun.x, "{sun}");
    }

    /// White of Rec. 709, D65, has equal channels; X and Z of D65 by IEC 61966-2-1.
    #[test]
    fn white_has_equal_channels() {
        for channel in linear_rec709([0.950_456, 1.0, 1.089_058]) {
            assert!((channel - 1.0).abs() < 1e-4, "{channel}");
        }
    }

    /// CIE 1931 tables: ȳ peaks at 555 nm with 1.0; x̄ = 1.0622 at 600 nm, z̄ = 1.7826 at 445 nm;
    /// the integrals of all three are equal (106.86 nm).
    #[test]
    fn color_matching_functions_are_those_of_the_cie() {
        assert!((color_matching(555.0)[1] - 1.0).abs() < 0.02);
        assert!((color_matching(600.0)[0] - 1.0622).abs() < 0.02);
        assert!((color_matching(445.0)[2] - 1.7826).abs() < 0.05);
        for axis in 0..3 {
            let integral: f64 = (360..830).map(|nm| color_matching(f64::from(nm))[axis]).sum();
            assert!((integral - 106.86).abs() < 0.7, "{axis}: {integral}");
        }
    }

    /// The cross-section peaks at about 5e-25 m² in the Chappuis band near 600 nm.
    #[test]
    fn ozone_absorbs_most_in_the_chappuis_band() {
        let ozone = Spectrum::ozone_cross_section();
        let largest = ozone.0.iter().copied().fold(0.0, f32::max);
        assert!((4.5e-25..5.1e-25).contains(&largest), "{largest}");
        // Band 11 is 600 to 620 nm; band 3, 440 to 460 nm, is nearly free of absorption.
        assert_eq!(ozone.0[11], largest);
        assert!(ozone.0[3] < 0.05 * largest);
    }

    #[test]
    fn colors_outside_rgb_keep_their_luminance() {
        let inside = Rgb::new(0.2, 0.0, 3.0);
        assert_eq!(into_gamut(inside), inside);
        let outside = Rgb::new(5.0, 0.3, -0.4);
        let moved = into_gamut(outside);
        assert!((luminance(moved) - luminance(outside)).abs() < 1e-5);
        assert!(moved.min_element() >= 0.0 && moved.min_element() < 1e-5);
        assert!(moved.x > moved.y && moved.y > moved.z);
        assert_eq!(into_gamut(Rgb::new(0.0, -1.0, 0.1)), Rgb::ZERO);
    }
}
