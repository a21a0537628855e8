//! Values that lobes of neighbouring pixels share, as far as they are alike.

use crate::filter::{Center, Plane};
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
    /// And its rays.
    rays: f32,
    /// Σ of the weights times the variances of all values.
    noise: f32,
}

impl Shared {
    /// A lobe's own mean with its variance, from so many rays.
    pub fn new((mean, variance): (Rgb, f32), rays: f32) -> Self {
        let mut plane = Plane::new();
        plane.add(0, 0, mean, rays);
        Self { plane, mean, variance, rays, noise: rays * variance }
    }

    /// The value of a lobe that has no rays of its own: whatever others say.
    pub fn of_others() -> Self {
        Self { plane: Plane::new(), mean: Rgb::ZERO, variance: 0.0, rays: 0.0, noise: 0.0 }
    }

    /// Adds that of a neighbour, so many pixels to the right and down, unless chance does not explain
    /// by how much it differs.
    pub fn add(&mut self, [across, down]: [i32; 2], (mean, variance): (Rgb, f32), weight: f32) {
        let off = (mean - self.mean).length_squared();
        let chance = self.variance + variance;
        let alike = (UNLIKE_VARIANCES - off / chance.max(f32::MIN_POSITIVE))
            / (UNLIKE_VARIANCES - ALIKE_VARIANCES);
        let alike = if self.rays > 0.0 { alike.clamp(0.0, 1.0) } else { 1.0 };
        let weight = weight * alike;
        if weight > 0.0 {
            self.plane.add(across, down, mean, weight);
            self.noise += weight * variance;
        }
    }

    /// The plane's value, its variance, and the weight of all that is in it.
    pub fn center(self) -> Shown {
        let rays = self.plane.weight();
        // That of one value, where these are too few for a plane.
        let own = match self.rays > 0.0 {
            true => self.variance,
            false => self.noise / rays.max(f32::MIN_POSITIVE),
        };
        let (mean, variance) = self.plane.center();
        Shown { mean, variance: variance.map_or(own, Rgb::element_sum), rays }
    }

    /// The same, as far as values lie about the plane no more than by chance; else the lobe's own.
    pub fn center_unless_bent(self) -> Shown {
        let rays = self.plane.weight();
        let noise = self.noise / rays.max(f32::MIN_POSITIVE);
        let Center { value, variance, others } =
            self.plane.center_unless_bent((self.mean, self.variance), noise);
        Shown { mean: value, variance, rays: self.rays + others * (rays - self.rays) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// Shares values of 5 × 5 lobes, `exact` by how many pixels across, that scatter by that standard
    /// deviation and know it: the mean square by which the middle is off, and what it says of that.
    fn off_and_said(exact: impl Fn(i32) -> f32, deviation: f32, bent: bool) -> [f32; 2] {
        const TRIES: u64 = 2000;
        let mut sums = [0.0; 2];
        for seed in 0..TRIES {
            let mut numbers = Numbers::new(seed, Stream::Gloss, 0);
            let mut value = |across: i32| {
                let noise = [0; 3].map(|_| (numbers.uniform() - 0.5) * 12f32.sqrt() * deviation);
                (Rgb::splat(exact(across)) + Rgb::from_array(noise), 3.0 * deviation * deviation)
            };
            let mut shared = Shared::new(value(0), 1.0);
            for (down, across) in (-2..=2).flat_map(|down| (-2..=2).map(move |a| (down, a))) {
                if (across, down) != (0, 0) {
                    shared.add([across, down], value(across), 1.0);
                }
            }
            let shown = if bent { shared.center_unless_bent() } else { shared.center() };
            sums[0] += (shown.mean - Rgb::splat(exact(0))).length_squared() / TRIES as f32;
            sums[1] += shown.variance / TRIES as f32;
        }
        sums
    }

    /// Where values lie on a plane, all of them count; what is said of the error is right.
    #[test]
    fn what_lies_on_a_plane_is_shared() {
        let plane = |across: i32| 5.0 + 0.02 * across as f32;
        let [off, said] = off_and_said(plane, 0.1, true);
        assert!(off < 0.1 * 3.0 * 0.01, "{off}");
        assert!((0.6..2.0).contains(&(said / off)), "{said} {off}");
    }

    /// On a ridge as high as three deviations, what differs is believed in part, and more of the error is
    /// known: not all, since the middle is off by more than the others.
    #[test]
    fn what_is_bent_is_the_lobes_own() {
        let ridge = |across: i32| if across == 0 { 5.15 } else { 5.0 };
        let [off, said] = off_and_said(ridge, 0.05, true);
        let [shared, said_before] = off_and_said(ridge, 0.05, false);
        assert!(off < 0.9 * shared, "{off} {shared}");
        let known = [said / off, said_before / shared];
        assert!(known[0] > 2.0 * known[1] && (0.3..1.5).contains(&known[0]), "{known:?}");
    }
}
