//! What had better follow a draft: by what it took, what it loses, and how much time is left.

use super::super::draft::Draft;

/// Parts of a first iteration that take the longer the more pixels there are.
pub const PARTS: [&str; 5] =
    ["seconds_fragments", "seconds_light", "seconds_gloss", "seconds_gather", "seconds_smooth"];
/// Power of the number of pixels by which the time of each of them grows, at most, as far as one draft can
/// tell: records lie where the scene asks for them, with fewer rays in a draft, and small pictures have
/// more shadow rays for each pixel.
const GROWTH: [f64; 5] = [0.55, 0.8, 0.85, 0.35, 0.6];
/// Those of [`PARTS`] that trace rays.
const RAYS: [usize; 3] = [1, 2, 3];
/// By how much less these powers may be by two drafts: what does not go by the pixels hides what does.
const LESS_GROWTH: f64 = 0.25;
/// What they may be at most.
const MOST_GROWTH: f64 = 1.05;
/// All of that, and the picture, in the time that these parts are expected to take: another draft, and the
/// whole picture. What the whole one is expected to take is rather too much.
const WITH_PICTURE: [f64; 2] = [1.2, 1.05];
/// Share of the time that there was at first by which the whole picture may be late: it is worth more than
/// any draft.
const GRACE: f64 = 0.05;

/// Share of the time that is left in which the picture itself comes next, whatever drafts may promise: what
/// they lose stays.
const COMFORTABLE: f64 = 0.25;

/// What the parts of a draft took, seconds, and the side of its pixels.
#[derive(Clone, Copy)]
pub struct Taken {
    pub shrink: u32,
    pub parts: [f64; 5],
}

/// What may follow a draft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Next {
    /// The side of its pixels, in the picture's; 1 is the picture itself.
    pub shrink: u32,
    /// Whether its light goes to the surfaces that the pixels asked for see.
    pub by_light: bool,
}

/// What is known of a draft, after one iteration, to tell what had better follow it.
pub struct Prospects<'a> {
    pub draft: Draft,
    /// The drafts so far, this one last.
    pub taken: &'a [Taken],
    /// Seconds that finding the surfaces takes which the pixels asked for see; none where they are known.
    pub surfaces: Option<f64>,
    /// Seconds that it takes to bring a draft to the size that was asked for.
    pub enlarging: f64,
    /// Relative errors by the draft's pixels and by its light.
    pub losses: [f64; 2],
    /// Relative error that rays lower, and that by edges.
    pub scatter: f64,
    pub edges: f64,
    /// Variance of surfaces' shares of the pixels asked for, in that of the draft's, by the samples.
    pub samples: f64,
    /// Seconds that there were for the job.
    pub seconds: f64,
}

impl Prospects<'_> {
    /// What leaves the least error after so many seconds of that which fits into them.
    pub fn best(&self, left: f64) -> Next {
        let now = Next { shrink: self.draft.shrink, by_light: self.surfaces.is_none() };
        let whole = Next { shrink: 1, by_light: true };
        if self.takes(whole) <= COMFORTABLE * left {
            return whole;
        }
        let shrinks = (0..=self.draft.shrink.ilog2()).map(|level| 1 << level);
        let fits = |next: &Next| self.takes(*next) <= left + self.grace(*next);
        // By its light where there is time for it: no draft is worse by that.
        let all = shrinks.filter_map(|shrink| {
            let [by_pixels, by_light] = [false, true].map(|by_light| Next { shrink, by_light });
            Some(by_light).filter(fits).or_else(|| Some(by_pixels).filter(fits))
        });
        let error = |next: &Next| self.error(*next, (left - self.takes(*next)).max(0.0));
        all.min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or(now)
    }

    /// Square of the relative error that it is expected to have, if more rays are traced for so many seconds
    /// after it. Edges, of shadows too, have the square of what larger pixels lose grow by their side.
    fn error(&self, next: Next, rest: f64) -> f64 {
        let [finest, finer] =
            [1, next.shrink].map(|side| f64::from(side) / f64::from(self.draft.shrink));
        let [by_pixels, by_light] = self.losses;
        let edges = self.edges * self.edges;
        let lost = match next {
            Next { shrink: 1, .. } => edges * finest,
            Next { by_light: false, .. } => by_pixels * by_pixels * finer + edges * finer,
            Next { by_light: true, .. } => {
                by_light.min(by_pixels).powi(2) * finer + edges * finest * self.samples
            }
        };
        let rays: f64 = RAYS.iter().map(|k| self.part(*k, next.shrink)).sum();
        lost + self.scatter * self.scatter * rays / (rays + rest).max(f64::MIN_POSITIVE)
    }

    /// Seconds by which it may be late.
    fn grace(&self, next: Next) -> f64 {
        if next.shrink == 1 { GRACE * self.seconds } else { 0.0 }
    }

    /// Seconds that it can be expected to take.
    fn takes(&self, next: Next) -> f64 {
        let surfaces = if next.by_light { self.surfaces.unwrap_or_default() } else { 0.0 };
        let beside = if next.shrink > 1 { surfaces + self.enlarging } else { 0.0 };
        if next.shrink == self.draft.shrink {
            return beside;
        }
        let parts = (0..PARTS.len()).map(|k| self.part(k, next.shrink));
        let is_whole = next.shrink == 1;
        WITH_PICTURE[usize::from(is_whole)] * parts.sum::<f64>() + beside
    }

    /// Seconds that a part can be expected to take in pixels of some side.
    fn part(&self, k: usize, shrink: u32) -> f64 {
        let Some((last, before)) = self.taken.split_last() else { return 0.0 };
        let pixels = |one: u32, other: u32| (f64::from(one) / f64::from(other)).powi(2);
        let by_both = before.last().map(|before| {
            (last.parts[k] / before.parts[k]).ln() / pixels(before.shrink, last.shrink).ln()
        });
        let by_both = by_both.filter(|power| power.is_finite());
        let most = GROWTH[k];
        let power = by_both.map_or(most, |power| power.clamp(most - LESS_GROWTH, MOST_GROWTH));
        last.parts[k] * pixels(last.shrink, shrink).powf(power)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS_TAKEN: [f64; 5] = [0.01, 0.01, 0.0, 0.03, 0.005];

    fn prospects(taken: &[Taken]) -> Prospects<'_> {
        Prospects {
            draft: Draft::of_size([500, 500], taken[taken.len() - 1].shrink),
            taken,
            surfaces: Some(0.1),
            enlarging: 0.02,
            losses: [0.2, 0.04],
            scatter: 0.03,
            edges: 0.02,
            samples: 1.0,
            seconds: 0.0,
        }
    }

    /// With more time comes what errs less, and nothing that doesn't fit.
    #[test]
    fn more_time_is_used_for_less_error() {
        let taken = [Taken { shrink: 8, parts: PARTS_TAKEN }];
        let known = prospects(&taken);
        let mut before = f64::INFINITY;
        for left in [0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.5, 3.0] {
            let next = known.best(left);
            let takes = known.takes(next);
            assert!(
                takes <= left || next == Next { shrink: 8, by_light: false },
                "{left} {next:?}"
            );
            let error = known.error(next, (left - takes).max(0.0));
            assert!(error <= before, "{left} {next:?}: {error} after {before}");
            before = error;
        }
        assert_eq!(known.best(3.0).shrink, 1);
        let good = Prospects { losses: [0.0; 2], edges: 0.0, ..prospects(&taken) };
        assert_eq!(good.best(3.0).shrink, 1, "there is time enough");
        assert_eq!(known.best(0.0), Next { shrink: 8, by_light: false });
        assert!(known.best(0.2).by_light, "there is time for the surfaces");
    }

    /// Where surfaces are known, a finer draft is by its light; and where scatter is all that is wrong, rays
    /// are worth more than pixels.
    #[test]
    fn what_is_wrong_decides() {
        let taken = [Taken { shrink: 8, parts: PARTS_TAKEN }];
        let lossy = Prospects { surfaces: None, ..prospects(&taken) };
        let next = lossy.best(0.5);
        assert!(next.by_light && (2..8).contains(&next.shrink), "{next:?}");
        let noisy = Prospects { losses: [1e-4; 2], scatter: 0.3, ..lossy };
        assert_eq!(noisy.best(0.5), Next { shrink: 8, by_light: true });
    }

    /// Two drafts say how the time grows, within bounds.
    #[test]
    fn two_drafts_tell_how_time_grows() {
        let one = Taken { shrink: 8, parts: [0.01; 5] };
        let grown = |factor: f64| {
            let taken = [one, Taken { shrink: 4, parts: [0.01 * factor; 5] }];
            prospects(&taken).part(1, 2) / taken[1].parts[1]
        };
        assert!((grown(3.0) - 3.0).abs() < 1e-9, "as from the one to the other");
        assert!((grown(1.0) - 4f64.powf(GROWTH[1] - LESS_GROWTH)).abs() < 1e-9);
        assert!((grown(40.0) - 4f64.powf(MOST_GROWTH)).abs() < 1e-9);
        let alone = [one];
        assert!((prospects(&alone).part(1, 4) - 0.01 * 4f64.powf(GROWTH[1])).abs() < 1e-12);
    }
}
