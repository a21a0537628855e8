//! Light that was scattered more than once, by height and the sun's elevation there.
//!
//! Source: Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering Technique"
//! (2020, §5.5): light of the second order is computed (his eq. 5), all further orders are taken
//! for isotropic and equally bright around a point, so that they are a geometric series (eqs. 7 to
//! 10).

use super::atmosphere::{Atmosphere, GROUND_ALBEDO, GROUND_RADIUS, TOP_RADIUS, densities};
use super::columns::{Columns, distance_to_top};
use super::spectrum::Spectrum;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Number of nodes in height; they are denser near the ground.
const HEIGHTS: usize = 12;
/// Number of nodes in the sun's elevation.
const ELEVATIONS: usize = 13;
/// The nodes reach this far to both sides of the sun's elevation at the observer, in radians: the
/// vertical turns by 10.1° between an observer and the end of the longest ray.
const REACH: f64 = 0.1833;
/// Directions around a point: number of equal parts of the cosine of the angle to the vertical.
const POLAR: usize = 8;
/// Directions around a point: number of azimuths on one side of the sun; the other side is alike.
const AZIMUTHS: usize = 4;
/// Steps along a ray.
const STEPS: usize = 20;

/// Radiance of multiply scattered light, the same in all directions, per irradiance of the sun
/// above the atmosphere, 1/sr.
pub struct MultipleScattering {
    /// The sun's elevation at the observer in radians.
    elevation: f64,
    /// Row by row of one height.
    nodes: Vec<Spectrum>,
}

impl MultipleScattering {
    /// Computes the nodes for a sun's elevation at the observer in radians.
    pub fn new(atmosphere: &Atmosphere, columns: &Columns, elevation: f64) -> Self {
        let air = Air { atmosphere, columns };
        let suns: [f64; ELEVATIONS] =
            std::array::from_fn(|index| elevation + REACH * (2.0 * fraction(index) - 1.0));
        let nodes = (0..HEIGHTS).flat_map(|index| {
            let height =
                (TOP_RADIUS - GROUND_RADIUS) * (index as f64 / (HEIGHTS - 1) as f64).powi(2);
            air.around(GROUND_RADIUS + height, &suns)
        });
        Self { elevation, nodes: nodes.collect() }
    }

    /// Value at a radius in km where the sun's elevation in radians is given.
    pub fn at(&self, radius: f64, elevation: f64) -> Spectrum {
        let height = (radius - GROUND_RADIUS) / (TOP_RADIUS - GROUND_RADIUS);
        let row = height.clamp(0.0, 1.0).sqrt() * (HEIGHTS - 1) as f64;
        let offset = (elevation - self.elevation) / REACH;
        let column = (0.5 * (offset + 1.0)).clamp(0.0, 1.0) * (ELEVATIONS - 1) as f64;
        let (i, j) = ((row as usize).min(HEIGHTS - 2), (column as usize).min(ELEVATIONS - 2));
        let (u, v) = ((column - j as f64) as f32, (row - i as f64) as f32);
        let node = |i: usize, j: usize| self.nodes[i * ELEVATIONS + j];
        node(i, j) * ((1.0 - u) * (1.0 - v))
            + node(i, j + 1) * (u * (1.0 - v))
            + node(i + 1, j) * ((1.0 - u) * v)
            + node(i + 1, j + 1) * (u * v)
    }
}

/// Place of a node in elevation, 0 to 1.
fn fraction(index: usize) -> f64 {
    index as f64 / (ELEVATIONS - 1) as f64
}

/// The atmosphere and its columns.
struct Air<'a> {
    atmosphere: &'a Atmosphere,
    columns: &'a Columns,
}

/// Averages over the directions around a point.
struct Averages {
    /// Light of the second order, for each of the sun's elevations.
    second_order: [Spectrum; ELEVATIONS],
    /// Part of uniform light around a point that is scattered to it again (f_ms).
    returned: Spectrum,
}

/// A ray from a point, with the weight of its direction in the average over all.
struct Ray {
    start: f64,
    sine: f64,
    cosine: f64,
    length: f64,
    meets_ground: bool,
}

impl Ray {
    /// The ray at a cosine to the vertical, up to the ground or the atmosphere's top.
    fn new(start: f64, cosine: f64) -> Self {
        let along = start * cosine;
        let square = along * along + GROUND_RADIUS * GROUND_RADIUS - start * start;
        let meets_ground = cosine < 0.0 && square >= 0.0;
        let length = if meets_ground {
            (-along - square.sqrt()).max(0.0)
        } else {
            distance_to_top(start, cosine)
        };
        Self { start, sine: (1.0 - cosine * cosine).sqrt(), cosine, length, meets_ground }
    }

    /// Distances where steps end: as fractions of the length, denser towards the ground.
    fn distance(&self, step: f64) -> f64 {
        let s = step / STEPS as f64;
        self.length * if self.meets_ground { s * (2.0 - s) } else { s * s }
    }

    /// Position at a distance: across and up from the planet's centre.
    fn position(&self, distance: f64) -> DVec2 {
        DVec2::new(distance * self.sine, self.start + distance * self.cosine)
    }
}

impl Air<'_> {
    /// Radiance of multiply scattered light around a point for each of the sun's elevations.
    fn around(&self, radius: f64, suns: &[f64; ELEVATIONS]) -> [Spectrum; ELEVATIONS] {
        let mut averages =
            Averages { second_order: [Spectrum::ZERO; ELEVATIONS], returned: Spectrum::ZERO };
        for polar in 0..POLAR {
            let cosine = 2.0 * (polar as f64 + 0.5) / POLAR as f64 - 1.0;
            self.follow(&Ray::new(radius, cosine), suns, &mut averages);
        }
        let series = averages.returned.map(|returned| 1.0 / (1.0 - returned.min(0.99)));
        averages.second_order.map(|light| light * series)
    }

    /// Adds what arrives along a ray to the averages.
    fn follow(&self, ray: &Ray, suns: &[f64; ELEVATIONS], averages: &mut Averages) {
        let mut passed = DVec3::ZERO;
        for step in 0..STEPS {
            let (begin, end) = (ray.distance(step as f64), ray.distance(step as f64 + 1.0));
            let position = ray.position(0.5 * (begin + end));
            let densities = densities(position.length() - GROUND_RADIUS);
            let through = self.atmosphere.transmittance(passed + densities * (0.5 * (end - begin)));
            let [molecules, aerosols] = self.atmosphere.scattering(densities);
            let scattered = through * (molecules + aerosols) * ((end - begin) as f32);
            averages.returned += scattered * (1.0 / POLAR as f32);
            let factor = scattered * (1.0 / (4.0 * PI) as f32);
            self.light(position, suns, |_| 1.0, factor, averages);
            passed += densities * (end - begin);
        }
        if ray.meets_ground {
            let reflected =
                self.atmosphere.transmittance(passed) * (GROUND_ALBEDO / std::f32::consts::PI);
            let lit = |elevation: f64| elevation.sin().max(0.0) as f32;
            self.light(ray.position(ray.length), suns, lit, reflected, averages);
        }
    }

    /// Adds the sun's light at a position, times a function of its elevation there and a factor.
    fn light(
        &self,
        position: DVec2,
        suns: &[f64; ELEVATIONS],
        function: impl Fn(f64) -> f32,
        factor: Spectrum,
        averages: &mut Averages,
    ) {
        let radius = position.length();
        let up = position / radius;
        let factor = factor * (1.0 / (POLAR * AZIMUTHS) as f32);
        for (sun, sum) in suns.iter().zip(&mut averages.second_order) {
            for azimuth in 0..AZIMUTHS {
                let azimuth = PI * (azimuth as f64 + 0.5) / AZIMUTHS as f64;
                let cosine = up.y * sun.sin() + up.x * sun.cos() * azimuth.cos();
                let elevation = cosine.clamp(-1.0, 1.0).asin().clamp(-FRAC_PI_2, FRAC_PI_2);
                let light = self.columns.sunlight(self.atmosphere, radius, elevation);
                *sum += light * factor * function(elevation);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(height: f64, degrees: f64) -> Spectrum {
        let (atmosphere, columns) = (Atmosphere::clear(), Columns::new());
        let sun = degrees.to_radians();
        MultipleScattering::new(&atmosphere, &columns, sun).at(GROUND_RADIUS + height, sun)
    }

    /// Near the ground half of all directions see sunlit ground, whose radiance at 60° is (.3/π)
    /// sin 60° of the sunlight that passes the air; the other half adds scattered light: little at
    /// 690 nm, more at 450 nm, where more of the sunlight is lost on its way, too.
    #[test]
    fn ground_gives_half_of_it_and_air_the_rest() {
        let (atmosphere, columns) = (Atmosphere::clear(), Columns::new());
        let sun = 60.0_f64.to_radians();
        let direct = columns.sunlight(&atmosphere, GROUND_RADIUS, sun);
        let ground = direct * (0.5 * GROUND_ALBEDO * sun.sin() as f32 / std::f32::consts::PI);
        let noon = at(0.0, 60.0);
        let [blue, red] = [3, 15].map(|band: usize| noon.0[band] / ground.0[band]);
        assert!((1.0..1.6).contains(&red) && (1.5..2.5).contains(&blue), "{red} {blue}");
        let evening = at(0.0, 5.0);
        assert!((0..16).all(|band| noon.0[band] > evening.0[band]));
    }

    /// At the atmosphere's top, half of all directions see space and nothing comes from there.
    #[test]
    fn night_is_dark_and_height_dims() {
        assert!(at(0.0, -30.0).0.iter().all(|value| *value == 0.0));
        let (low, high) = (at(0.0, 45.0), at(100.0, 45.0));
        assert!(high.0[3] > 0.0 && high.0[3] < low.0[3]);
    }
}
