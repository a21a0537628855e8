//! Radiance of the sky seen from the ground, as a map of the whole sphere.
//!
//! Light that was scattered once is integrated along each ray; light of higher orders comes from
//! [`MultipleScattering`] (Hillaire 2020, eqs. 1 to 3 and 11). The rays of one row of the map pass
//! the same air, and away from the phase functions their radiance changes slowly with the azimuth
//! to the sun: it is computed at [`AZIMUTHS`] azimuths and interpolated between.

use super::atmosphere::{Atmosphere, GROUND_RADIUS, aerosols_phase, densities, molecules_phase};
use super::columns::{Columns, distance_to_top};
use super::multiple_scattering::MultipleScattering;
use super::spectrum::{Spectrum, Sunlight, into_gamut};
use crate::radiometry::Rgb;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Nodes in azimuth from the sun's side to the opposite side.
const AZIMUTHS: usize = 33;
/// Steps along a ray.
const STEPS: usize = 48;

/// What makes the sky's light.
pub struct SkyModel<'a> {
    /// The air.
    pub atmosphere: &'a Atmosphere,
    /// Its columns.
    pub columns: &'a Columns,
    /// Light of higher orders for the same sun.
    pub multiple: &'a MultipleScattering,
    /// The sun's light.
    pub sunlight: &'a Sunlight,
}

/// A step of a ray: where it is, and what scatters light towards the observer there.
struct Step {
    /// Across and up from the planet's centre, km.
    position: DVec2,
    /// Part of sunlight that molecules scatter into the ray and that arrives at the observer.
    molecules: Spectrum,
    /// The same of aerosols.
    aerosols: Spectrum,
}

/// Radiance without phase functions in photometric RGB.
#[derive(Clone, Copy)]
struct Scattered {
    molecules: Rgb,
    aerosols: Rgb,
    multiple: Rgb,
}

impl Scattered {
    fn lerp(self, other: Self, t: f32) -> Self {
        Self {
            molecules: self.molecules.lerp(other.molecules, t),
            aerosols: self.aerosols.lerp(other.aerosols, t),
            multiple: self.multiple.lerp(other.multiple, t),
        }
    }
}

impl SkyModel<'_> {
    /// Radiance in cd/m² folded into RGB of `width` texels at an elevation above 0 in radians, all
    /// around; the sun is at a unit direction.
    pub fn row(&self, elevation: f64, width: usize, sun: DVec3) -> Vec<Rgb> {
        let steps = self.steps(elevation);
        let nodes: Vec<Scattered> = (0..AZIMUTHS)
            .map(|node| self.scattered(&steps, sun, PI * node as f64 / (AZIMUTHS - 1) as f64))
            .collect();
        let sun_azimuth = sun.z.atan2(sun.x);
        let texel = |column: usize| {
            let azimuth = ((column as f64 + 0.5) / width as f64 - 0.5) * TAU;
            let direction = direction(elevation, azimuth);
            let cosine = direction.dot(sun).clamp(-1.0, 1.0);
            let turn = (azimuth - sun_azimuth).rem_euclid(TAU);
            let at = turn.min(TAU - turn) / PI * (AZIMUTHS - 1) as f64;
            let node = (at as usize).min(AZIMUTHS - 2);
            let light = nodes[node].lerp(nodes[node + 1], (at - node as f64) as f32);
            into_gamut(
                light.molecules * molecules_phase(cosine) as f32
                    + light.aerosols * aerosols_phase(cosine) as f32
                    + light.multiple,
            )
        };
        (0..width).map(texel).collect()
    }

    /// The steps of a ray from the ground to the atmosphere's top. Within a step the densities are
    /// those of its middle and the extinction is integrated exactly (Hillaire 2015, "Physically
    /// Based and Unified Volumetric Rendering in Frostbite").
    fn steps(&self, elevation: f64) -> Vec<Step> {
        let (sine, cosine) = elevation.sin_cos();
        let length = distance_to_top(GROUND_RADIUS, sine);
        let end = |step: usize| length * (step as f64 / STEPS as f64).powi(3);
        let mut passed = DVec3::ZERO;
        let step = |index: usize| {
            let size = end(index + 1) - end(index);
            let distance = 0.5 * (end(index + 1) + end(index));
            let position = DVec2::new(distance * cosine, GROUND_RADIUS + distance * sine);
            let densities = densities(position.length() - GROUND_RADIUS);
            let depth = self.atmosphere.optical_depth(densities * size);
            let mean =
                depth.map(|depth| if depth > 1e-4 { -(-depth).exp_m1() / depth } else { 1.0 });
            let arriving = self.atmosphere.transmittance(passed) * mean * size as f32;
            passed += densities * size;
            let [molecules, aerosols] = self.atmosphere.scattering(densities);
            Step { position, molecules: molecules * arriving, aerosols: aerosols * arriving }
        };
        (0..STEPS).map(step).collect()
    }

    /// Sums the light of the steps of a ray whose azimuth differs from the sun's by an angle.
    fn scattered(&self, steps: &[Step], sun: DVec3, azimuth: f64) -> Scattered {
        let across = (1.0 - sun.y * sun.y).max(0.0).sqrt() * azimuth.cos();
        let [mut molecules, mut aerosols, mut multiple] = [Spectrum::ZERO; 3];
        for step in steps {
            let radius = step.position.length();
            let cosine = (step.position.y * sun.y + step.position.x * across) / radius;
            let elevation = cosine.clamp(-1.0, 1.0).asin();
            let light = self.columns.sunlight(self.atmosphere, radius, elevation);
            molecules += step.molecules * light;
            aerosols += step.aerosols * light;
            multiple += (step.molecules + step.aerosols) * self.multiple.at(radius, elevation);
        }
        Scattered {
            molecules: self.sunlight.filtered(&molecules),
            aerosols: self.sunlight.filtered(&aerosols),
            multiple: self.sunlight.filtered(&multiple),
        }
    }
}

/// Unit direction at an elevation and an azimuth from +X towards +Z, in radians.
pub fn direction(elevation: f64, azimuth: f64) -> DVec3 {
    let (sine, cosine) = elevation.sin_cos();
    DVec3::new(cosine * azimuth.cos(), sine, cosine * azimuth.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Radiance at a texel by 5,000 equal steps without interpolation between azimuths.
    fn finely(model: &SkyModel, elevation: f64, azimuth: f64, sun: DVec3) -> Rgb {
        let along = direction(elevation, azimuth);
        let size = distance_to_top(GROUND_RADIUS, along.y) / 5000.0;
        let [molecules_phase, aerosols_phase] =
            [molecules_phase, aerosols_phase].map(|phase| phase(along.dot(sun)) as f32);
        let (mut sum, mut passed) = (Spectrum::ZERO, DVec3::ZERO);
        for step in 0..5000 {
            let position = DVec3::Y * GROUND_RADIUS + along * (size * (f64::from(step) + 0.5));
            let radius = position.length();
            let densities = densities(radius - GROUND_RADIUS);
            let view = model.atmosphere.transmittance(passed + densities * (0.5 * size));
            let sun_elevation = (position.dot(sun) / radius).asin();
            let light = model.columns.sunlight(model.atmosphere, radius, sun_elevation);
            let [molecules, aerosols] = model.atmosphere.scattering(densities);
            let once = light * (molecules * molecules_phase + aerosols * aerosols_phase);
            let more = (molecules + aerosols) * model.multiple.at(radius, sun_elevation);
            sum += view * (once + more) * size as f32;
            passed += densities * size;
        }
        into_gamut(model.sunlight.filtered(&sum))
    }

    /// The map's steps and its interpolation between azimuths err by little.
    #[test]
    fn rows_agree_with_fine_integration() {
        let (atmosphere, columns) = (Atmosphere::clear(), Columns::new());
        let sunlight = Sunlight::new();
        for sun_elevation in [50.0_f64, 8.0, -3.0] {
            let sun_elevation = sun_elevation.to_radians();
            let sun = direction(sun_elevation, 0.7);
            let multiple = MultipleScattering::new(&atmosphere, &columns, sun_elevation);
            let model = SkyModel {
                atmosphere: &atmosphere,
                columns: &columns,
                multiple: &multiple,
                sunlight: &sunlight,
            };
            for elevation in [0.012, 0.1, 0.6, 1.5] {
                let row = model.row(elevation, 7, sun);
                for (column, found) in row.into_iter().enumerate() {
                    let azimuth = ((column as f64 + 0.5) / 7.0 - 0.5) * TAU;
                    let expected = finely(&model, elevation, azimuth, sun);
                    let error = (found - expected).abs().max_element() / expected.max_element();
                    assert!(error < 0.03, "{sun_elevation} {elevation} {azimuth}: {error}");
                }
            }
        }
    }
}
