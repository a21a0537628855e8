//! Values that lobes of neighbouring pixels share, as far as they are alike.

use crate::filter::Plane;
use crate::radiometry::Rgb;

/// Squared difference between two neighbours' means, in units of its variance, up to which they
/// count in full: 2.4 standard deviations. As with shadows.
const ALIKE_VARIANCES: f32 = 6.0;
/// The same from which they do not count: 4.9 standard deviations.
const UNLIKE_VARIANCES: f32 = 24.0;

/// What a lobe shows with what its neighbours found.
#[derive(Clone, Copy, Default)]
pub struct Shown {
    /// Radiance over the lobe's albedo.
    pub mean: Rgb,
    /// Variance of that, summed over the channels.
    pub variance: f32,
    /// Rays that it comes from, weighted.
    pub rays: f32,
}

/// A value that neighbours share as far as theirs are alike.
pub struct Shared {
    plane: Plane,
    /// The lobe's own mean.
    mean: Rgb,
    /// And its variance, summed over the channels.
    variance: f32,
}

impl Shared {
    /// A lobe's own mean with its variance, from so many rays.
    pub fn new((mean, variance): (Rgb, f32), rays: f32) -> Self {
        let mut plane = Plane::new();
        plane.add(0, 0, mean, rays);
        Self { plane, mean, variance }
    }

    /// Adds that of a neighbour, so many pixels to the right and down, unless chance does not explain
    /// by how much it differs.
    pub fn add(&mut self, [across, down]: [i32; 2], (mean, variance): (Rgb, f32), weight: f32) {
        let off = (mean - self.mean).length_squared();
        let chance = self.variance + variance;
        let alike = (UNLIKE_VARIANCES - off / chance.max(f32::MIN_POSITIVE))
            / (UNLIKE_VARIANCES - ALIKE_VARIANCES);
        let weight = weight * alike.clamp(0.0, 1.0);
        if weight > 0.0 {
            self.plane.add(across, down, mean, weight);
        }
    }

    /// The plane's value, its variance, and the weight of all that is in it.
    pub fn center(self) -> Shown {
        let rays = self.plane.weight();
        let (mean, scatter) = self.plane.center();
        Shown { mean, variance: scatter.map_or(self.variance, Rgb::element_sum), rays }
    }
}
