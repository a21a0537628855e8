//! Irradiance by the direction that a surface faces: what a normal map makes of a record's light.
//!
//! A record gathers over the hemisphere of the smooth surface. From the same rays it keeps the radiance
//! in spherical harmonics up to the second order, from which the irradiance for any normal follows, to a
//! few hundredths of the largest (Ramamoorthi and Hanrahan 2001, eq. 10). That is taken as a factor, the irradiance for
//! the one normal over that for the other, so that what makes a record's own irradiance good counts for
//! other normals, too. From below the smooth surface no light comes.

use crate::radiometry::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::PI;

/// Spherical harmonics up to the second order.
pub const COUNT: usize = 9;
/// Least cosine to the record's normal by which radiance is divided, since rays are drawn by it.
const LEAST_COSINE: f32 = 0.03;
/// Most by which a normal map makes a place brighter, where the smooth surface hardly sees the light.
const MOST_FACTOR: f32 = 8.0;

/// Radiance by direction, a coefficient for each harmonic, times the rays of a record.
#[derive(Clone, Copy, Default, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ByDirection([Rgb; COUNT]);

impl ByDirection {
    /// Takes in what comes from a unit direction, by a ray that was drawn by its cosine to a normal.
    pub fn add(&mut self, radiance: Rgb, direction: Vec3, cosine: f32) {
        let light = radiance / cosine.max(LEAST_COSINE);
        for (sum, harmonic) in self.0.iter_mut().zip(harmonics(direction)) {
            *sum += light * harmonic;
        }
    }

    /// Of these numbers, in the order of [`ByDirection::per_ray`].
    pub fn of(numbers: [f32; 3 * COUNT]) -> Self {
        Self(std::array::from_fn(|k| Rgb::from_slice(&numbers[3 * k..])))
    }

    /// Whether all are numbers.
    pub fn is_finite(&self) -> bool {
        self.0.iter().all(|sum| sum.is_finite())
    }

    /// All of it for a ray, one number after the other.
    pub fn per_ray(&self, rays: u32) -> [f32; 3 * COUNT] {
        let per_ray = 1.0 / rays.max(1) as f32;
        std::array::from_fn(|k| self.0[k / 3][k % 3] * per_ray)
    }

    /// Irradiance for a unit normal, in some unit.
    fn irradiance(&self, normal: Vec3) -> Rgb {
        const BANDS: [f32; COUNT] = {
            let [zero, one, two] = [PI, 2.0 * PI / 3.0, PI / 4.0];
            [zero, one, one, one, two, two, two, two, two]
        };
        let terms = self.0.iter().zip(harmonics(normal)).zip(BANDS);
        terms.map(|((light, harmonic), band)| *light * (harmonic * band)).sum()
    }

    /// Irradiance for one unit normal over that for another.
    pub fn factor(&self, facing: Vec3, smooth: Vec3) -> Rgb {
        let [facing, smooth] = [facing, smooth].map(|normal| self.irradiance(normal));
        let factor = Rgb::select(smooth.cmpgt(Rgb::ZERO), facing / smooth, Rgb::ONE);
        factor.clamp(Rgb::ZERO, Rgb::splat(MOST_FACTOR))
    }
}

/// The spherical harmonics in a unit direction: one of order 0, three of order 1, five of order 2.
fn harmonics(Vec3 { x, y, z }: Vec3) -> [f32; COUNT] {
    [
        0.282_095,
        0.488_603 * y,
        0.488_603 * z,
        0.488_603 * x,
        1.092_548 * x * y,
        1.092_548 * y * z,
        0.315_392 * (3.0 * z * z - 1.0),
        1.092_548 * x * z,
        0.546_274 * (x * x - y * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::sampling::{Seed, Shifted, cosine_local};

    /// What rays find that are drawn by the cosine to +Z.
    fn gathered(radiance: impl Fn(Vec3) -> Rgb) -> ByDirection {
        let mut seen = ByDirection::default();
        let seed = Seed { number: 5, well_spread: true };
        let mut sequence = Shifted::new(seed, Stream::Gather, 1).at(0);
        for _ in 0..1 << 14 {
            let (local, height) = cosine_local(sequence.next_pair());
            let direction = local.extend(height);
            seen.add(radiance(direction), direction, height);
        }
        seen
    }

    fn tilted(degrees: f32, around: f32) -> Vec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Vec3::new(sin * around.cos(), sin * around.sin(), cos)
    }

    /// Under a uniform sky a plane that is tilted sees (1 + cosθ)/2 of it.
    #[test]
    fn a_tilted_plane_under_a_uniform_sky() {
        let seen = gathered(|_| Rgb::ONE);
        for degrees in [0.0, 10.0, 25.0, 45.0, 60.0] {
            let expected = 0.5 * (1.0 + f32::to_radians(degrees).cos());
            for around in [0.0, 1.0, 2.5, 4.0] {
                let found = seen.factor(tilted(degrees, around), Vec3::Z);
                let off = (found - expected).abs().max_element();
                assert!(off < 0.02, "{degrees} degrees: {found} for {expected}");
            }
        }
    }

    /// Between a red wall at one side and a blue one at the other: the integrals by the midpoint rule.
    #[test]
    fn a_plane_that_is_turned_to_a_wall_takes_its_colour() {
        let radiance = |direction: Vec3| match direction.x > 0.0 {
            true => Rgb::new(3.0 * direction.x, 0.2, 0.1),
            false => Rgb::new(0.1, 0.2, -2.0 * direction.x),
        };
        let seen = gathered(radiance);
        let exact = |normal: Vec3| {
            let mut sum = glam::DVec3::ZERO;
            for row in 0..200 {
                let z = (f64::from(row) + 0.5) / 200.0;
                for column in 0..400 {
                    let angle = (f64::from(column) + 0.5) * std::f64::consts::PI / 200.0;
                    let (sin, cos) = angle.sin_cos();
                    let across = (1.0 - z * z).sqrt();
                    let direction = glam::DVec3::new(across * cos, across * sin, z).as_vec3();
                    sum += (radiance(direction) * direction.dot(normal).max(0.0)).as_dvec3();
                }
            }
            sum
        };
        let smooth = exact(Vec3::Z);
        for (degrees, around) in [(20.0, 0.0), (40.0, 0.0), (40.0, 2.0), (30.0, 3.1)] {
            let facing = tilted(degrees, around);
            let expected = (exact(facing) / smooth).as_vec3();
            let found = seen.factor(facing, Vec3::Z);
            let off = (found - expected).abs().max_element();
            assert!(off < 0.04, "{degrees}, {around}: {found} for {expected}");
            assert!((expected - 1.0).abs().max_element() > 0.2, "turning changes little");
        }
    }
}
