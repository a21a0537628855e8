//! Where the next shadow rays go: to fragments where those so far disagree, and among them by how far one may
//! be off in the picture.

use super::shadows::{CHUNK, DirectLighting, NEIGHBOUR_REACH, SHARES_OF_MORE, around};
use super::sums::ShadowSums;
use crate::transport::hemilux::fragments::{Fragment, VisibleSurfaces};
use rayon::prelude::*;

/// Rays of a fragment and those around it, at least, for their agreement to tell anything: those of the first
/// pass at a corner of a wall. A surface that bends by more than a few degrees from pixel to pixel has none
/// around it that it could be compared with.
const ENOUGH_TO_AGREE: u32 = 9;

impl DirectLighting {
    /// Marks the fragments whose own or neighbouring rays disagree, or are too few to tell.
    pub(super) fn mark_disputed(&mut self, visible: &VisibleSurfaces) {
        let sums = &self.sums;
        let disputed: Vec<bool> = (0..sums.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|index| {
                let mine = &sums[index];
                if mine.is_disputed() {
                    return true;
                }
                let (mut disagrees, mut rays) = (false, mine.rays);
                around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
                    disagrees |= mine.differs_from(&sums[other]);
                    rays = rays.saturating_add(sums[other].rays);
                });
                disagrees || rays < ENOUGH_TO_AGREE
            })
            .collect();
        self.sums.iter_mut().zip(disputed).for_each(|(sums, disputed)| sums.disputed = disputed);
    }

    /// What one more ray of each fragment may be off in the picture, in means over those where rays disagree; 0
    /// for the others. A reveal under the open sky is a hundred times as bright as the room. By what the rays of
    /// all pixels around found: few rays that happened to find little light would be sent no more, and stay
    /// dark, while others were put right.
    pub(super) fn worth_around(&self, visible: &VisibleSurfaces) -> Vec<f32> {
        let own: Vec<f32> = self.sums.par_iter().map(|sums| sums.deviation().powi(2)).collect();
        let worth = |index: usize| {
            if !self.sums[index].is_uneven() {
                return 0.0;
            }
            let (mut sum, mut count) = (own[index], 1.0f32);
            around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
                sum += own[other];
                count += 1.0;
            });
            (sum / count).sqrt() * visible.fragments[index].weight()
        };
        let all: Vec<f32> =
            (0..self.sums.len()).into_par_iter().with_min_len(CHUNK).map(worth).collect();
        let count = self.sums.iter().filter(|sums| sums.is_uneven()).count();
        let sum: f64 = all.iter().map(|worth| f64::from(*worth)).sum();
        let mean = (sum as f32 / count.max(1) as f32).max(f32::MIN_POSITIVE);
        all.iter().map(|worth| (worth / mean).min(SHARES_OF_MORE[1])).collect()
    }

    /// Mean over the fragments where rays disagree of what one more ray of each may be off in the
    /// picture; positive.
    pub(super) fn mean_deviation(&self, visible: &VisibleSurfaces) -> f32 {
        let of = |(sums, fragment): (&ShadowSums, &Fragment)| {
            let deviation = f64::from(sums.deviation() * fragment.weight());
            if sums.is_uneven() { (deviation, 1.0) } else { (0.0, 0.0) }
        };
        // One after the other: sums in parallel would depend on the number of threads.
        let pairs = self.sums.iter().zip(&visible.fragments).map(of);
        let (sum, count) = pairs.fold((0.0, 0.0), |all, one| (all.0 + one.0, all.1 + one.1));
        ((sum / f64::max(count, 1.0)) as f32).max(f32::MIN_POSITIVE)
    }

    /// Factor by which the wanted rays of all fragments become no more than `most`, at most 1.
    pub(super) fn scale_to(
        &self,
        most: f64,
        visible: &VisibleSurfaces,
        wanted: &(impl Fn(&Fragment, &ShadowSums) -> f32 + Sync),
    ) -> f32 {
        if most.is_infinite() {
            return 1.0;
        }
        let pairs = visible.fragments.iter().zip(&self.sums);
        let all: f64 = pairs.map(|(fragment, sums)| f64::from(wanted(fragment, sums))).sum();
        (most / all.max(1.0)).min(1.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::importance;
    use crate::sampling::Seed;
    use crate::scene::made;
    use crate::transport::hemilux::direct::shadows::Caster;
    use crate::transport::hemilux::specimen::Specimen;

    /// Most rays go where the sky shines in, and the picture is as bright, in the mean over seeds, as it is with
    /// many rays everywhere.
    #[test]
    fn rays_by_need_leave_the_mean_as_it_is() {
        let mut house = made::real::wide_window();
        house.environment.sun = None;
        let specimen = Specimen::surrounded(&house.glb, house.environment, 1000);
        let Specimen { world, lights, .. } = &specimen;
        let visible = specimen.visible();
        let mean = |direct: &DirectLighting, filtered: bool| {
            let light = |(index, fragment): (usize, &Fragment)| {
                let (light, _) = direct.irradiance(lights, &visible, index, filtered);
                f64::from(importance(light) * fragment.weight())
            };
            visible.fragments.iter().enumerate().map(light).sum::<f64>()
        };
        let caster = |number| Caster {
            world,
            lights,
            visible: &visible,
            seed: Seed { number, well_spread: true },
        };
        let mut even = DirectLighting::new(lights, &visible, false, false);
        (0..400).for_each(|_| even.pass(&caster(0), f64::INFINITY));
        let exact = mean(&even, false);
        const SEEDS: u64 = 400;
        let all = (1..=SEEDS).into_par_iter().map(|seed| {
            let mut direct = DirectLighting::new(lights, &visible, true, false);
            direct.pass(&caster(seed), f64::INFINITY);
            [false, true].map(|filtered| mean(&direct, filtered) / exact)
        });
        let all: Vec<[f64; 2]> = all.collect();
        // Few rays are a little dark in any case, shared ones more so; by a pixel's own rays they would be .9 %.
        for (filtered, most) in [(0, 0.007), (1, 0.02)] {
            let count = SEEDS as f64;
            let mean = all.iter().map(|own| own[filtered]).sum::<f64>() / count;
            let squares = all.iter().map(|own| (own[filtered] - mean).powi(2)).sum::<f64>();
            let deviation = (squares / (count - 1.0) / count).sqrt();
            assert!(deviation < 0.001, "{deviation} tells nothing");
            assert!((mean - 1.0).abs() < most, "{filtered}: {mean} ± {deviation}");
        }
    }
}
