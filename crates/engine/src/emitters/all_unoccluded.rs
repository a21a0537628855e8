//! What all lights shine on a surface without occlusion, in the groups that shadow rays go to.

use super::openings::Lookout;
use super::unoccluded::{LobeAxis, Unoccluded};
use crate::radiometry::{Rgb, importance};

/// Number of groups: polygons, sky, sun, and lights without extent.
pub const GROUPS: usize = 4;
const SKY: usize = 1;
const SUN: usize = 2;
/// Share of all light below which neither the sky nor all else is looked at by itself.
const LEAST_PART: f32 = 1e-3;
/// Share of the rays that go to the sky from dark places that know no opening.
const BLIND_SKY_SHARE: f32 = 0.2;

/// What lights shine in two parts, each to be sampled by itself.
pub struct Split {
    /// All but one.
    pub others: AllUnoccluded,
    /// The one that is looked at by itself: the sky or, where that is seen through openings, the sun.
    pub one: AllUnoccluded,
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
    /// What the sun does.
    pub(super) sun: Rgb,
}

impl AllUnoccluded {
    /// The sky's part of it and that of all other lights, where both shine; where the sky is seen through
    /// openings, the sun's and that of lamps: a sun that hardly any ray finds would leave none for these.
    pub fn split(&self) -> Option<Split> {
        if !self.is_split() {
            return None;
        }
        let group = if self.looks_out() { SUN } else { SKY };
        let (mut others, mut one) = (*self, *self);
        [others.irradiance, one.irradiance] = self.in_parts();
        others.shares[group] = 0.0;
        // Half of the rays stay the sky's where it is seen through openings.
        let kept = others.shares[SKY];
        let left: f32 = others.shares.iter().sum::<f32>() - kept;
        others.shares = others.shares.map(|share| share * (1.0 - kept) / left);
        others.shares[SKY] = kept;
        one.shares = std::array::from_fn(|number| if number == group { 1.0 } else { 0.0 });
        Some(Split { others, one })
    }

    /// Whether both parts shine, so that either is sampled by itself.
    pub fn is_split(&self) -> bool {
        let share = importance(self.in_parts()[1]) / importance(self.irradiance);
        (LEAST_PART..=1.0 - LEAST_PART).contains(&share)
    }

    /// What all lights but one shine, and that one: the sky, or the sun where the sky is seen through openings.
    pub fn in_parts(&self) -> [Rgb; 2] {
        let one = if self.looks_out() { self.sun } else { self.sky };
        [self.irradiance - one, one]
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
            // Nor do lamps leave all other rays to a sun that hardly any of them finds, where they are split: picks
            // that are not by what shines would give their rays together no share in common.
            let sun = self.shares[SUN];
            let lamps = 1.0 - sky - sun;
            if sun > lamps && lamps > 2.0 * LEAST_PART * sun {
                let half = 0.5 * (1.0 - sky);
                self.shares = self.shares.map(|share| share * (half / lamps));
                self.shares[SUN] = half;
            }
            self.shares[SKY] = sky;
        }
    }

    /// The group for a uniform number, and the number that is left for picks within it.
    /// `None` where no light is to be sampled this time. A sky that is seen through openings comes first
    /// ([`DirectLights::in_turn`](super::DirectLights::in_turn)).
    pub(super) fn group(&self, x: f32) -> Option<(usize, f32)> {
        let (mut sum, mut last) = (0.0, None);
        let order = if self.looks_out() { [1, 0, 3, 2] } else { [0, 1, 2, 3] };
        for (group, share) in order.map(|group| (group, self.shares[group])) {
            if share <= 0.0 {
                continue;
            }
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
