//! What the shadow rays of a fragment found, as sums.

use crate::checkpoint::CheckpointError;
use crate::radiometry::{Rgb, importance};
use bytemuck::{Pod, Zeroable};

/// Factor by which well-spread points are taken to lower the variance of random ones where lights
/// are too many for the closed form.
const WELL_SPREAD_FACTOR: f32 = 0.5;
/// Squared difference between a neighbour's share of blocked rays and the fragment's own, in units
/// of its variance by chance, up to which the neighbour counts in full: 2.4 standard deviations.
const ALIKE_VARIANCES: f32 = 6.0;
/// The same from which it does not count, since a shadow's edge is in between: 4.9 standard
/// deviations.
const UNLIKE_VARIANCES: f32 = 24.0;
/// Shares of blocked light of two rays that differ by less count as the same: panes take a little
/// more of light that crosses them at another angle.
pub const SAME_SHARE: f32 = 0.02;

/// Fragments, this one among them, whose rays are compared to tell whether they agree.
const RAYS_AROUND: f32 = 25.0;

/// Bound on rays of a fragment read from a checkpoint: more than any run casts, so a larger number
/// means damage.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// [`ShadowSums`] as checkpoints store them: without the closed form, which is computed again. The
/// order of the fields is part of the format.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct StoredShadowSums {
    seen: Rgb,
    cast: Rgb,
    squares: f32,
    rays: u32,
    blocked: f32,
    first: f32,
    disputed: u32,
    apart: Rgb,
    apart_squares: f32,
    apart_rays: u32,
}

/// Sums over the shadow rays of a fragment. Where lights are too many for the closed form
/// ([`crate::emitters::DirectLights::is_exact`]) the light points' irradiances are a Monte-Carlo estimate
/// themselves.
#[derive(Clone, Copy, Default)]
pub struct ShadowSums {
    /// Irradiance without occlusion in closed form; zero where lights are too many for that.
    pub unoccluded: Rgb,
    /// Σ irradiance that the unoccluded light points stand for.
    pub seen: Rgb,
    /// Σ irradiance that all light points stand for.
    pub cast: Rgb,
    /// Σ squared importance of the irradiance seen, where lights are too many for the closed form.
    pub squares: f32,
    /// Rays so far.
    pub rays: u32,
    /// Σ share of the light of each ray that something kept from arriving.
    pub blocked: f32,
    /// That share of the first ray; negative before that.
    pub first: f32,
    /// Whether that of another ray was another.
    pub mixed: bool,
    /// Whether rays here or in the neighbourhood disagreed when they were last compared.
    pub disputed: bool,
    /// Light of the sky through openings, of the same rays, if it is seen so.
    pub apart: LightApart,
}

/// Sums over the rays that went to light which is no part of the irradiance without occlusion.
#[derive(Clone, Copy, Default)]
pub struct LightApart {
    /// Whether there is such light.
    pub is_any: bool,
    /// Σ irradiance that arrives.
    seen: Rgb,
    /// Σ squared importance of it.
    squares: f32,
    /// Rays that went there.
    rays: u32,
}

impl StoredShadowSums {
    /// The sums to be stored.
    pub fn of(sums: &ShadowSums) -> Self {
        Self {
            seen: sums.seen,
            cast: sums.cast,
            squares: sums.squares,
            rays: sums.rays,
            blocked: sums.blocked,
            first: sums.first,
            disputed: u32::from(sums.disputed) | u32::from(sums.mixed) << 1,
            apart: sums.apart.seen,
            apart_squares: sums.apart.squares,
            apart_rays: sums.apart.rays,
        }
    }

    /// Puts back what was stored.
    pub fn restore(&self, sums: &mut ShadowSums) -> Result<(), CheckpointError> {
        if self.rays > MOST_RAYS_OF_ALL || self.apart_rays > self.rays || !self.blocked.is_finite()
        {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        (sums.seen, sums.cast, sums.squares) = (self.seen, self.cast, self.squares);
        (sums.rays, sums.blocked, sums.first) = (self.rays, self.blocked, self.first);
        (sums.disputed, sums.mixed) = (self.disputed & 1 != 0, self.disputed & 2 != 0);
        (sums.apart.seen, sums.apart.squares) = (self.apart, self.apart_squares);
        sums.apart.rays = self.apart_rays;
        Ok(())
    }
}

impl LightApart {
    /// Adds what a ray found.
    pub fn add(&mut self, irradiance: Rgb) {
        self.seen += irradiance;
        self.squares += importance(irradiance).powi(2);
        self.rays += 1;
    }
}

impl ShadowSums {
    /// No rays yet, of a fragment with that irradiance without occlusion; `looks_out` if there is
    /// light apart from it.
    pub fn new(unoccluded: Rgb, looks_out: bool) -> Self {
        let apart = LightApart { is_any: looks_out, ..LightApart::default() };
        Self { unoccluded, first: -1.0, apart, ..Self::default() }
    }

    /// Estimated variance of the irradiance by the rays of the fragment alone.
    pub fn own_variance(&self, exact: bool) -> Rgb {
        if !exact {
            let (mean, all) = (self.seen / self.rays.max(1) as f32, importance(self.seen));
            if self.rays < 2 || all <= 0.0 {
                return mean * mean;
            }
            let scatter = self.squares * self.rays as f32 / (all * all) - 1.0;
            return mean * mean * (scatter.max(0.0) / (self.rays - 1) as f32 * WELL_SPREAD_FACTOR);
        }
        if !self.mixed {
            return Rgb::ZERO;
        }
        let share = self.blocked_share();
        // Well-spread points do better than random ones: the variance falls by about n^−1.5.
        let variance = share * (1.0 - share) / (self.known_rays() as f32).powf(1.5);
        self.unoccluded * self.unoccluded * variance
    }

    /// Share of the direct light that arrives, `seen / cast`; where lights are too many for the
    /// closed form, the estimated irradiance.
    pub fn share(&self, exact: bool) -> Rgb {
        if !exact {
            return self.seen / self.rays as f32;
        }
        Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO)
    }

    /// Whether rays here or around disagreed when they were last compared, or do so here since.
    pub fn is_disputed(&self) -> bool {
        self.disputed || self.mixed
    }

    /// Weight of a neighbour, 0 to 1, by how likely chance alone explains the difference between
    /// the two shares of blocked rays.
    pub fn alike(&self, other: &ShadowSums) -> f32 {
        let off = self.blocked_share() - other.blocked_share();
        alike(off, self.chance() + other.chance())
    }

    /// Whether its rays tell which share arrives of the light that `other` knows: any has gone to
    /// such light, and the sky is apart in both or in neither.
    pub fn tells_share_of(&self, other: &ShadowSums, exact: bool) -> bool {
        let same = self.apart.is_any == other.apart.is_any;
        self.known_rays() > 0 && (!exact || (same && self.cast != Rgb::ZERO))
    }

    /// Standard deviation of what one ray says of the irradiance, importance.
    pub fn deviation(&self) -> f32 {
        // Where all rays agree, and those around with them, another one hardly says otherwise.
        let unknown = if self.is_disputed() { 0.5 } else { 0.5 / RAYS_AROUND };
        let rays = self.known_rays() as f32;
        let share = (self.blocked + unknown) / (rays + 2.0 * unknown);
        let known = importance(self.unoccluded).powi(2) * share * (1.0 - share);
        let apart = self.apart_scatter() / (self.rays.max(2) - 1) as f32;
        (known + apart).sqrt()
    }

    /// Whether more rays are worth while.
    pub fn is_uneven(&self) -> bool {
        self.disputed || self.apart.is_any
    }

    /// Whether nothing shines on the fragment.
    pub fn is_dark(&self) -> bool {
        self.unoccluded == Rgb::ZERO && !self.apart.is_any
    }

    /// Mean irradiance through openings.
    pub fn apart_mean(&self) -> Rgb {
        self.apart.seen / self.rays.max(1) as f32
    }

    /// Σ squared difference of the rays' irradiances through openings from their mean, importance.
    pub fn apart_scatter(&self) -> f32 {
        let mean = importance(self.apart_mean());
        (self.apart.squares - mean * mean * self.rays as f32).max(0.0)
    }

    /// Variance of the mean irradiance through openings, by the fragment's rays alone.
    pub fn apart_variance(&self) -> Rgb {
        let (mean, rays) = (self.apart_mean(), self.rays as f32);
        let square = importance(mean).powi(2);
        if self.rays < 2 || square <= 0.0 {
            return mean * mean;
        }
        mean * mean * (self.apart_scatter() / (rays * (rays - 1.0) * square) * WELL_SPREAD_FACTOR)
    }

    /// Rays to light whose irradiance without occlusion is known.
    pub fn known_rays(&self) -> u32 {
        self.rays - self.apart.rays
    }

    /// Share of the light of those that was blocked.
    pub fn blocked_share(&self) -> f32 {
        self.blocked / self.known_rays().max(1) as f32
    }

    /// Variance of the share of blocked rays; where all agree, as if one half of a ray did not.
    pub fn chance(&self) -> f32 {
        let rays = self.known_rays();
        let share = (self.blocked + 0.5) / (rays + 1) as f32;
        share * (1.0 - share) / rays.max(1) as f32
    }

    /// The same where the rays around say which share arrives: a few rays may agree by chance.
    pub fn chance_around(&self, arrives: f32) -> f32 {
        let share = arrives.clamp(0.0, 1.0);
        self.chance().max(share * (1.0 - share) / self.known_rays().max(1) as f32)
    }

    /// Adds what a shadow ray found; `irradiance` is what its light point stands for.
    pub fn add_ray(&mut self, irradiance: Rgb, visibility: Rgb, exact: bool) {
        let blocked = 1.0 - importance(visibility);
        if self.first < 0.0 {
            self.first = blocked;
        }
        self.mixed |= (blocked - self.first).abs() > SAME_SHARE;
        self.blocked += blocked;
        self.seen += irradiance * visibility;
        if !exact {
            self.squares += importance(irradiance * visibility).powi(2);
        }
    }
}

/// Weight of a neighbour, 0 to 1, whose value is that far off, by the variance of the difference.
pub fn alike(off: f32, chance: f32) -> f32 {
    let variances = off * off / chance.max(f32::MIN_POSITIVE);
    ((UNLIKE_VARIANCES - variances) / (UNLIKE_VARIANCES - ALIKE_VARIANCES)).clamp(0.0, 1.0)
}
