//! Where the next lobe rays go: at first to all lobes alike, but for faint ones, of which one of several
//! stands for those beside it; later to where rays scatter.

use super::lobes::{BATCH_COST, Gloss, NEIGHBOUR_REACH, Work};
use super::placed_lobe::PlacedLobe;
use super::sums::LobeSums;
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use rayon::prelude::*;
use std::f64::consts::GOLDEN_RATIO;

/// Lobe rays of a whole pixel in a pass, with as many rays to the lights.
const RAYS_PER_PIXEL: f32 = 2.0;
/// Rays of each lobe in the first pass: as few as tell scatter, by which the passes after it find where
/// rays are worth their time.
const FIRST_RAYS: u32 = 2;
/// Batches of directions to an open sky of a lobe that sees any, in the first pass.
const FIRST_BATCHES: u32 = 1;
/// Rays from which on a lobe may have none in a pass.
const RAYS_TO_REST: u32 = 8;
/// Most lobe rays in a pass, as a multiple of the mean, where lobes scatter most.
const MOST_RAYS_FACTOR: f32 = 128.0;
/// Least rays of a lobe in a pass, likewise: what all rays have missed so far must not be missed for ever.
const LEAST_RAYS_FACTOR: f32 = 0.05;
/// Of the pixels of a square so wide, one has rays for its faint lobes in the first pass.
const FAINT_STRIDE: u32 = 2;
/// A lobe is an outlier where its variance is so many times the mean one.
const OUTLIER_FACTOR: f64 = 100.0;
/// It gets so many times the rays that it had, if these were few.
const OUTLIER_TIMES: u32 = 4;
const FEW_RAYS: u32 = 32;

/// What a lobe gets in the first pass.
const FIRST: Work = Work { rays: FIRST_RAYS, batches: FIRST_BATCHES };

impl Gloss {
    /// Whether a lobe has rays of its own in the first pass, where faint ones take turns.
    pub(super) fn begins(
        &self,
        visible: &VisibleSurfaces,
        (placed, lobe): (&PlacedLobe, &Lobe),
    ) -> bool {
        let pixel = visible.fragments[lobe.fragment as usize].pixel;
        let [x, y] = [pixel % visible.width, pixel / visible.width];
        !placed.is_faint || x.is_multiple_of(FAINT_STRIDE) && y.is_multiple_of(FAINT_STRIDE)
    }

    /// Work of the first pass; `all` if faint lobes are to have rays like any other.
    pub(super) fn first_work(&self, visible: &VisibleSurfaces, all: bool) -> Vec<Work> {
        let work = |own| if all || self.begins(visible, own) { FIRST } else { Work::default() };
        self.lobes.iter().zip(&visible.lobes).map(work).collect()
    }

    /// Work of those lobes that have no ray yet, nor anything beside them that looks at the same and has one;
    /// `None` where there are none.
    pub(super) fn work_of_lonely(&self, visible: &VisibleSurfaces) -> Option<Vec<Work>> {
        let is_lonely = |lobe: usize| {
            let mut is_lonely = self.sums[lobe].rays == 0;
            if is_lonely {
                self.around(visible, lobe, (NEIGHBOUR_REACH, 1), |other, _, _| {
                    let helps = self.sums[other].rays > 0;
                    is_lonely &= !(helps && self.looks_at_the_same(lobe, other) > 0.0);
                });
            }
            is_lonely
        };
        let work = |lobe| if is_lonely(lobe) { FIRST } else { Work::default() };
        let all: Vec<Work> = (0..self.len()).into_par_iter().with_min_len(1024).map(work).collect();
        all.iter().any(|work| work.rays > 0).then_some(all)
    }

    /// More rays for the few lobes whose chance makes most of what is off in the picture: rays late in a pass may
    /// be the first to find a light that lobes see in one another, and nothing follows the last one. `None` where
    /// there are none.
    pub(super) fn work_of_outliers(&self, visible: &VisibleSurfaces) -> Option<Vec<Work>> {
        let variance = |lobe: usize| {
            let sums = &self.sums[lobe];
            let share = visible.share(&visible.lobes[lobe]);
            let one = sums.ray_variance(self.factor(lobe)) / sums.rays.max(1) as f32;
            share * share * self.left_by_sharing(lobe) * one
        };
        let all = (0..self.len()).into_par_iter().with_min_len(1024);
        let all: Vec<f32> = all.map(variance).collect();
        let sum: f64 = all.iter().map(|own| f64::from(*own)).sum();
        let much = OUTLIER_FACTOR * sum / all.len().max(1) as f64;
        let work = |(variance, sums): (&f32, &LobeSums)| {
            let is_outlier = f64::from(*variance) > much && (1..FEW_RAYS).contains(&sums.rays);
            Work { rays: if is_outlier { OUTLIER_TIMES * sums.rays } else { 0 }, batches: 0 }
        };
        let work: Vec<Work> = all.iter().zip(&self.sums).map(work).collect();
        work.iter().any(|work| work.rays > 0).then_some(work)
    }

    /// Lobes that a pass has rays for: all, but those that have begun where it is the second one, which follows
    /// at once.
    fn in_pass(&self) -> f32 {
        if self.passes <= 1 { self.beginning } else { self.len() as f32 }
    }

    /// Share of a whole pass that is so long, in time of rays.
    pub(super) fn share_of_pass(&self, most: f64) -> f32 {
        (most / f64::from(RAYS_PER_PIXEL * self.in_pass()).max(1.0)).min(1.0) as f32
    }

    /// How many passes for all lobes take as long as what has been done so far.
    pub fn whole_passes(&self) -> f64 {
        self.cost() / f64::from(RAYS_PER_PIXEL * self.len() as f32).max(1.0)
    }

    /// Work at each lobe in the next pass: about as much altogether in each, or this share of it, in
    /// proportion to the standard deviation that each adds to the picture, which minimises variance
    /// (Neyman allocation).
    pub(super) fn work_by_scatter(&self, visible: &VisibleSurfaces, share: f32) -> Vec<Work> {
        // Of a ray, and of a batch of directions to an open sky; of what has no ray nothing is known.
        let scatter = |lobe: usize| {
            let sums = &self.sums[lobe];
            let factor = self.factor(lobe);
            let left = self.left_by_sharing(lobe);
            let scatter = [sums.ray_variance(factor), sums.batch_variance(factor)]
                .map(|variance| visible.share(&visible.lobes[lobe]) * (left * variance).sqrt());
            (sums.rays > 0).then_some(scatter)
        };
        let own: Vec<Option<[f32; 2]>> = (0..self.len()).into_par_iter().map(scatter).collect();
        // By what those beside it found as much as by its own rays: dark ones, which have missed a
        // highlight, would get no more by these and remain dark, while bright ones would be corrected.
        // But where those beside it see nothing in the way, as at an outline, its own alone tell.
        let around = |lobe: usize| {
            let (mut squares, mut count) = ([0.0; 2], 0.0f32);
            let mut add = |own: &Option<[f32; 2]>| {
                if let Some(own) = own {
                    squares
                        .iter_mut()
                        .zip(own)
                        .for_each(|(sum, scatter)| *sum += scatter * scatter);
                    count += 1.0;
                }
            };
            add(&own[lobe]);
            self.around(visible, lobe, (NEIGHBOUR_REACH, 1), |other, _, _| add(&own[other]));
            let [rays, batches] = squares.map(|sum| (sum / count.max(1.0)).sqrt());
            [rays, batches / BATCH_COST.sqrt()]
        };
        let around: Vec<[f32; 2]> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(around).collect();
        let cost = |[ray, batch]: &[f32; 2]| f64::from(ray + BATCH_COST * batch);
        let mean = around.iter().map(cost).sum::<f64>() as f32 / self.in_pass();
        let work = |(index, [ray, batch]): (usize, &[f32; 2])| {
            let (lobe, sums) = (&visible.lobes[index], &self.sums[index]);
            let times = |scatter: &f32| {
                let times = scatter / mean.max(f32::MIN_POSITIVE);
                let times = times.clamp(LEAST_RAYS_FACTOR, MOST_RAYS_FACTOR);
                share * RAYS_PER_PIXEL * times
            };
            // Rounded up or down in turn, so that what is worth a fourth of a ray gets one in every
            // fourth pass.
            let turn = GOLDEN_RATIO * (index as f64 + f64::from(self.passes));
            let rounded = |times: f32| (times + turn.fract() as f32).floor();
            // A faint one that has not begun yet goes by what is beside it.
            let has_begun = sums.rays > 0 || !self.lobes[index].is_faint;
            let has_few = has_begun && sums.rays < RAYS_TO_REST;
            let least = if has_few && share == 1.0 { 1.0 } else { 0.0 };
            let most = MOST_RAYS_FACTOR * mean_rays(visible, lobe) as f32;
            let rays = rounded(times(ray)).max(least).min(most) as u32;
            Work { rays, batches: rounded(times(batch)).max(least) as u32 }
        };
        around.iter().enumerate().map(work).collect()
    }
}

/// Rays of a lobe in a pass if all scatter alike: by the share of the pixel.
fn mean_rays(visible: &VisibleSurfaces, lobe: &Lobe) -> u32 {
    (RAYS_PER_PIXEL * visible.share(lobe)).ceil().max(FIRST_RAYS as f32) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::Specimen;

    /// Of faint lobes few have rays at first; the others show what those beside them found, and that is as much
    /// as rays of their own say.
    #[test]
    fn faint_lobes_begin_in_turn() {
        let specimen = Specimen::new(&crate::scene::made::kitchen(), 2000);
        let (world, cut) = (&specimen.world, specimen.cut.clone());
        let visible = VisibleSurfaces::new(world, cut, &world.scene.cameras[0], [240, 240], 8);
        let found = |passes: u32, adaptive: bool| {
            Gloss::after(&specimen, &visible, true, (passes, adaptive))
        };
        let (begun, known) = (found(1, true), found(16, false));
        let all = 0..begun.len();
        let waiting: Vec<usize> = all.filter(|lobe| begun.sums[*lobe].rays == 0).collect();
        assert!(2 * waiting.len() > begun.len(), "{} of {}", waiting.len(), begun.len());
        assert!(begun.rays() < u64::from(FIRST_RAYS) * begun.len() as u64 / 2);
        let sum = |gloss: &Gloss| {
            let shown =
                waiting.iter().map(|lobe| gloss.reflected(&visible, *lobe)[0].element_sum());
            shown.map(f64::from).sum::<f64>()
        };
        let [few, many] = [&begun, &known].map(sum);
        assert!((few / many - 1.0).abs() < 0.03, "{}", few / many);
        for lobe in waiting {
            assert!(begun.lobes[lobe].is_faint && known.sums[lobe].rays > 0);
            assert!(begun.shown[lobe].rays > 0.0, "nothing is known of {lobe}");
        }
        let after = found(2, true);
        assert!(after.work_of_lonely(&visible).is_none());
    }
}
