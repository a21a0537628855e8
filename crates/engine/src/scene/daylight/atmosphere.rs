//! The clear atmosphere: what scatters and absorbs light at which height, and how much of a beam
//! passes.
//!
//! Sources: Bruneton and Neyret, "Precomputed Atmospheric Scattering" (2008; §2 and the
//! implementation of 2017) and Hillaire, "A Scalable and Production Ready Sky and Atmosphere
//! Rendering Technique" (2020; table 1) for molecules, ozone, heights and phase functions. The
//! amount of aerosols is that of the standard clear atmosphere of ASTM G173-03: with that of the
//! cited papers, an optical depth of .005, the sun is brighter and the sky darker than on clear
//! days.

use super::spectrum::Spectrum;
use glam::DVec3;
use std::f64::consts::PI;

/// Radius of the planet's surface in km.
pub const GROUND_RADIUS: f64 = 6360.0;
/// Radius of the atmosphere's top in km.
pub const TOP_RADIUS: f64 = 6460.0;
/// Part of arriving light that the ground reflects, diffusely and alike at all wavelengths.
pub const GROUND_ALBEDO: f32 = 0.3;
/// Angular radius of the sun's disc in radians (mean, .2666°).
pub const SUN_RADIUS: f64 = 0.004_652;

/// Height in km over which the density of molecules falls to 1/e.
const MOLECULES_HEIGHT: f64 = 8.0;
/// Height in km over which the density of aerosols falls to 1/e.
const AEROSOLS_HEIGHT: f64 = 1.2;
/// Height in km at which the layer of ozone is densest.
const OZONE_HEIGHT: f64 = 25.0;
/// Half its thickness in km; the density falls linearly to both sides.
const OZONE_WIDTH: f64 = 15.0;

/// Scattering coefficient of molecules at sea level at 1 µm, per km; falls with the fourth power of
/// the wavelength (5.802e-6, 13.558e-6, 33.1e-6 per m at 680, 550, 440 nm).
const MOLECULES_AT_1_UM: f64 = 1.240_62e-3;
/// Optical depth of the aerosols straight up at 500 nm.
const AEROSOL_DEPTH: f64 = 0.084;
/// Ångström's exponent: the depth falls with this power of the wavelength (mean of Ångström 1961).
const AEROSOL_EXPONENT: f64 = 1.3;
/// Part of the light that aerosols scatter instead of absorbing it.
const AEROSOL_ALBEDO: f32 = 0.9;
/// Mean cosine of scattering by aerosols.
const AEROSOL_ASYMMETRY: f64 = 0.8;
/// Ozone molecules per m² of ground: 300 Dobson units.
const OZONE_MOLECULES: f64 = 300.0 * 2.687e20;

/// Optical coefficients of the three constituents where they are densest, per km.
pub struct Atmosphere {
    /// Scattering by molecules; they absorb nothing.
    molecules: Spectrum,
    /// Extinction, that is scattering and absorption, by aerosols.
    aerosols: Spectrum,
    /// Absorption by ozone; it scatters nothing.
    ozone: Spectrum,
}

impl Atmosphere {
    /// The standard clear atmosphere.
    pub fn clear() -> Self {
        let per_molecule = Spectrum::ozone_cross_section();
        Self {
            molecules: Spectrum::of_wavelength(|nm| MOLECULES_AT_1_UM * (nm / 1000.0).powi(-4)),
            aerosols: Spectrum::of_wavelength(|nm| {
                AEROSOL_DEPTH / AEROSOLS_HEIGHT * (nm / 500.0).powf(-AEROSOL_EXPONENT)
            }),
            ozone: per_molecule * (OZONE_MOLECULES / OZONE_WIDTH) as f32,
        }
    }

    /// Optical depth of columns ([`densities`] times km).
    pub fn optical_depth(&self, columns: DVec3) -> Spectrum {
        let columns = columns.as_vec3();
        self.molecules * columns.x + self.aerosols * columns.y + self.ozone * columns.z
    }

    /// Part of a beam's light that passes columns, by Beer and Lambert.
    pub fn transmittance(&self, columns: DVec3) -> Spectrum {
        self.optical_depth(columns).map(|depth| (-depth).exp())
    }

    /// Scattering coefficients per km of molecules and of aerosols where the densities are these.
    pub fn scattering(&self, densities: DVec3) -> [Spectrum; 2] {
        let densities = densities.as_vec3();
        [self.molecules * densities.x, self.aerosols * (AEROSOL_ALBEDO * densities.y)]
    }
}

/// Densities of molecules, aerosols and ozone relative to where they are densest, at a height above
/// the ground in km.
pub fn densities(height: f64) -> DVec3 {
    let height = height.max(0.0);
    DVec3::new(
        (-height / MOLECULES_HEIGHT).exp(),
        (-height / AEROSOLS_HEIGHT).exp(),
        (1.0 - (height - OZONE_HEIGHT).abs() / OZONE_WIDTH).max(0.0),
    )
}

/// Phase function of molecules (Rayleigh) per sr at the cosine of the angle of deflection.
pub fn molecules_phase(cosine: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

/// Phase function of aerosols (Cornette and Shanks 1992) per sr at the cosine of the angle of
/// deflection.
pub fn aerosols_phase(cosine: f64) -> f64 {
    let g = AEROSOL_ASYMMETRY;
    let numerator = 3.0 * (1.0 - g * g) * (1.0 + cosine * cosine);
    let base = 1.0 + g * g - 2.0 * g * cosine;
    numerator / (8.0 * PI * (2.0 + g * g) * base * base.sqrt())
}

/// Angle in radians by which the horizon lies below the horizontal at a radius in km.
pub fn horizon_dip(radius: f64) -> f64 {
    (GROUND_RADIUS / radius).min(1.0).acos()
}

/// The part of the sun's disc that the planet leaves visible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibleSun {
    /// Part of the disc's area, 0 to 1.
    pub fraction: f64,
    /// Angle in radians of the middle of the visible part above the horizon.
    pub height: f64,
}

impl VisibleSun {
    /// The sun whose centre is by an angle in radians above the horizon, negative below.
    pub fn above_horizon(angle: f64) -> Self {
        let (lowest, highest) = ((angle - SUN_RADIUS).max(0.0), angle + SUN_RADIUS);
        // Area of the disc's segment above a line.
        let x = (angle / SUN_RADIUS).clamp(-1.0, 1.0);
        let fraction = 0.5 + (x * (1.0 - x * x).sqrt() + x.asin()) / PI;
        Self { fraction, height: (0.5 * (lowest + highest)).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integral of a function of the cosine over the sphere by the midpoint rule.
    fn over_sphere(function: impl Fn(f64) -> f64) -> f64 {
        let steps = 100_000;
        let cosine = |step: i32| 2.0 * (f64::from(step) + 0.5) / f64::from(steps) - 1.0;
        (0..steps).map(|step| function(cosine(step))).sum::<f64>() * 4.0 * PI / f64::from(steps)
    }

    #[test]
    fn phase_functions_are_normalised() {
        assert!((over_sphere(molecules_phase) - 1.0).abs() < 1e-6);
        assert!((over_sphere(aerosols_phase) - 1.0).abs() < 1e-6);
    }

    /// Hillaire 2020, table 1, at 680, 550 and 440 nm; here at the centres of the bands 15 (690
    /// nm), 8 (550 nm) and 3 (450 nm), scaled from there by Rayleigh's law.
    #[test]
    fn coefficients_are_the_published_ones() {
        let clear = Atmosphere::clear();
        let published = [
            (15, 5.802e-3 * (680.0_f64 / 690.0).powi(4)),
            (8, 13.558e-3),
            (3, 33.1e-3 * (440.0_f64 / 450.0).powi(4)),
        ];
        for (band, expected) in published {
            assert!((f64::from(clear.molecules.0[band]) / expected - 1.0).abs() < 2e-3, "{band}");
        }
        // 1.881e-6 per m at 550 nm is of the bin from 550 to 560 nm, the band begins at 540 nm.
        assert!((clear.ozone.0[8] / 1.881e-3 - 0.94).abs() < 0.01, "{}", clear.ozone.0[8]);
        // Straight up, 500 nm lies between two bands.
        let depth = f64::from(clear.aerosols.0[5] + clear.aerosols.0[6]) / 2.0 * AEROSOLS_HEIGHT;
        assert!((depth / AEROSOL_DEPTH - 1.0).abs() < 2e-3, "{depth}");
    }

    /// A full disc, half a disc, none; and the fraction rises with the sun.
    #[test]
    fn sun_sets_gradually() {
        let above = VisibleSun::above_horizon;
        assert_eq!(above(0.1), VisibleSun { fraction: 1.0, height: 0.1 });
        assert!((above(0.0).fraction - 0.5).abs() < 1e-12);
        assert!((above(0.0).height - SUN_RADIUS / 2.0).abs() < 1e-12);
        assert!(above(-SUN_RADIUS).fraction.abs() < 1e-12);
        assert_eq!(above(-1.0).height, 0.0);
        let fractions = (-10..=10).map(|step| above(SUN_RADIUS * f64::from(step) / 10.0).fraction);
        assert!(fractions.is_sorted());
    }
}
