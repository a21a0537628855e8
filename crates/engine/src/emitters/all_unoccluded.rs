//! What all lights shine on a surface without occlusion, in the groups that shadow rays go to.

use super::openings::Lookout;
use super::unoccluded::{LobeAxis, Unoccluded};
use crate::radiometry::Rgb;

/// Number of groups: polygons, sky, sun, and lights without extent.
pub const GROUPS: usize = 4;
/// Share of all light below which neither the sky nor all else is looked at by itself.
const LEAST_PART: f32 = 1e-3;
/// Share of the rays that go to the sky from dark places that know no opening.
const BLIND_SKY_SHARE: f32 = 0.2;

/// What lights shine in two parts, each to be sampled by itself.
pub struct BesideSky {
    /// All but the sky.
    pub others: AllUnoccluded,
    /// The sky.
    pub sky: AllUnoccluded,
}

/// What all lights shine on a surface without occlusion, by which they are picked.
#[derive(Clone, Copy)]
pub struct AllUnoccluded {
    /// Irradiance of all together, but for a sky that is seen through openings.
    pub irradiance: Rgb,
    pub(super) polygons: Unoccluded,
    /// Probability of each group; together less than 1 where a sharp lobe had better not be sampled
    /// by lights every time.
    pub(super) shares: [f32; GROUPS],
    /// The lobe, if lights are picked by what it may reflect of them.
    pub(super) lobe: Option<LobeAxis>,
    /// Where the sky is seen through openings, if it is.
    pub(super) lookout: Option<Lookout>,
    /// What the sky shines without occlusion.
    pub(super) sky: Rgb,
}

impl AllUnoccluded {
    /// The sky's part of it and that of all other lights, where both shine; `None` where either does not, or
    /// the sky is seen through openings.
    pub fn beside_sky(&self) -> Option<BesideSky> {
        let share = self.shares[1];
        if self.looks_out() || !(LEAST_PART..=1.0 - LEAST_PART).contains(&share) {
            return None;
        }
        let (mut others, mut sky) = (*self, *self);
        others.irradiance -= self.sky;
        others.shares = self.shares.map(|own| own / (1.0 - share));
        others.shares[1] = 0.0;
        sky.irradiance = self.sky;
        sky.shares = [0.0, 1.0, 0.0, 0.0];
        Some(BesideSky { others, sky })
    }

    /// Whether it is dark, so that the sky is seen through openings if at all: its light is no part of
    /// `irradiance` then.
    pub fn looks_out(&self) -> bool {
        self.lookout.is_some()
    }

    /// Gives the sky half of the rays where it is seen through openings, and a few where none is known:
    /// what it shines without occlusion, and what the sun does, say nothing of how much of either
    /// arrives.
    pub(super) fn give_half_to_sky(&mut self) {
        if let Some(lookout) = self.lookout.as_ref().filter(|_| self.shares[1] > 0.0) {
            let others: f32 = self.shares.iter().sum::<f32>() - self.shares[1];
            let wanted = if lookout.sees_any() { 0.5 } else { BLIND_SKY_SHARE };
            let (sky, factor) =
                if others > 0.0 { (wanted, (1.0 - wanted) / others) } else { (1.0, 0.0) };
            self.shares = self.shares.map(|share| share * factor);
            self.shares[1] = sky;
        }
    }

    /// The group for a uniform number, and the number that is left for picks within it.
    /// `None` where no light is to be sampled this time.
    pub(super) fn group(&self, x: f32) -> Option<(usize, f32)> {
        let (mut sum, mut last) = (0.0, None);
        for (group, share) in self.shares.into_iter().enumerate().filter(|(_, share)| *share > 0.0)
        {
            last = Some((group, ((x - sum) / share).clamp(0.0, 1.0 - f32::EPSILON)));
            sum += share;
            if x < sum {
                return last;
            }
        }
        // Rounding may leave the sum a little short of 1.
        last.filter(|_| sum > 1.0 - 1e-3)
    }
}
