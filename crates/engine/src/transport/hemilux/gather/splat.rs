//! Interpolation from records to the fragments of a picture: each record adds its weighted values
//! to the fragments within its radius, along the rows of the picture, eight fragments at a time.

use super::record::{Record, WeightFunction};
use crate::transport::hemilux::fragments::VisibleSurfaces;
use crate::transport::hemilux::places::{EightPlaces, LANES};
use glam::Vec3;
use rayon::prelude::*;

/// Rows of pixels of a parallel task.
const BAND: u32 = 8;

type Lanes = [f32; LANES];

/// N quantities around a record: their values where it stands, and for the first S of them a linear
/// change along its surface, within limits.
pub struct LocalFit<const N: usize, const S: usize> {
    /// Values at the record.
    pub value: [f32; N],
    /// Gradients of the first S, per ray unit.
    pub slope: [Vec3; S],
    /// Lower limits of the first S.
    pub least: [f32; S],
    /// Upper limits of the first S.
    pub most: [f32; S],
    /// What the sum at the fragment that the record was made for has beside that.
    pub at_home: [f32; N],
}

impl<const N: usize> LocalFit<N, 0> {
    /// The same values everywhere around the record.
    pub fn even(value: [f32; N]) -> Self {
        Self { value, slope: [], least: [], most: [], at_home: [0.0; N] }
    }
}

/// Sums over the records at eight fragments: Σ w, and Σ w value of each quantity.
#[derive(Clone, Copy)]
struct WeightedSums<const N: usize> {
    weight: Lanes,
    weighted: [Lanes; N],
}

impl<const N: usize> WeightedSums<N> {
    /// Adds to the sums at a record's own fragment what makes its weight 1 there.
    fn add_at_home<const S: usize>(&mut self, lane: usize, fit: &LocalFit<N, S>, rest: f32) {
        self.weight[lane] += rest;
        for (k, sum) in self.weighted.iter_mut().enumerate() {
            sum[lane] += fit.value[k] * rest + fit.at_home[k];
        }
    }
}

/// For every fragment, what `finish` makes of two sums over the records: of the quantities by
/// `each` record times its weight there, and of the weights. A record counts in full at the fragment
/// that it was made for, from all over which its rays start: where a pixel looks along a surface, the
/// middle of that is farther away than pixels are wide, or in a gap out of sight. Records are added in their order, so
/// that the bits do not depend on the threads.
pub fn splat<const N: usize, const S: usize, T: Clone + Default + Send>(
    visible: &VisibleSurfaces,
    records: &[Record],
    each: impl Fn(&Record) -> LocalFit<N, S> + Sync,
    finish: impl Fn([f32; N], f32) -> T + Sync,
) -> Vec<T> {
    let window = |record: &Record| record.window(visible, 1.0);
    let windows: Vec<Option<[u32; 4]>> = records.par_iter().with_min_len(256).map(window).collect();
    let mut all = vec![T::default(); visible.fragments.len()];
    let mut bands = Vec::new();
    let mut rest = &mut all[..];
    for first_row in (0..visible.height).step_by(BAND as usize) {
        let rows = [first_row, (first_row + BAND).min(visible.height)];
        let ends = rows.map(|row| visible.start[(row * visible.width) as usize] as usize);
        let (band, after) = rest.split_at_mut(ends[1] - ends[0]);
        bands.push((rows, ends, band));
        rest = after;
    }
    bands.into_par_iter().for_each(|(rows, [base, end], band)| {
        if base == end {
            return;
        }
        let first_eight = base / LANES;
        let count = end.div_ceil(LANES) - first_eight;
        let mut sums =
            vec![WeightedSums { weight: [0.0; LANES], weighted: [[0.0; LANES]; N] }; count];
        for record in records {
            let own = record.fragment as usize;
            if (base..end).contains(&own) {
                let (fit, rest) = (each(record), 1.0 - record.weight_at_home(visible));
                sums[own / LANES - first_eight].add_at_home(own % LANES, &fit, rest);
            }
        }
        for (record, window) in records.iter().zip(&windows) {
            let Some([x0, x1, y0, y1]) = *window else { continue };
            let [y0, y1] = [y0.max(rows[0]), y1.min(rows[1])];
            if y0 >= y1 {
                continue;
            }
            let (weight_at, contribution) = (record.weight_function(1.0), each(record));
            for row in y0..y1 {
                let [from, to] =
                    [x0, x1].map(|x| visible.start[(row * visible.width + x) as usize] as usize);
                if from < to {
                    let eights = from / LANES..to.div_ceil(LANES);
                    let there = &mut sums[eights.start - first_eight..eights.end - first_eight];
                    let skipped = [from - eights.start * LANES, eights.end * LANES - to];
                    add(&weight_at, &contribution, &visible.places.eights[eights], skipped, there);
                }
            }
        }
        for (index, out) in (base..end).zip(band) {
            let sums = &sums[index / LANES - first_eight];
            let lane = index % LANES;
            *out = finish(sums.weighted.map(|lanes| lanes[lane]), sums.weight[lane]);
        }
    });
    all
}

/// Adds a record's weighted quantities to the sums of consecutive fragments, leaving out the first
/// `skipped[0]` of the first eight and the last `skipped[1]` of the last eight.
fn add<const N: usize, const S: usize>(
    weight_at: &WeightFunction<'_>,
    contribution: &LocalFit<N, S>,
    places: &[EightPlaces],
    skipped: [usize; 2],
    sums: &mut [WeightedSums<N>],
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2<const N: usize, const S: usize>(
            weight_at: &WeightFunction<'_>,
            contribution: &LocalFit<N, S>,
            places: &[EightPlaces],
            skipped: [usize; 2],
            sums: &mut [WeightedSums<N>],
        ) {
            add_by_eights(weight_at, contribution, places, skipped, sums);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { with_avx2(weight_at, contribution, places, skipped, sums) };
        }
    }
    add_by_eights(weight_at, contribution, places, skipped, sums);
}

#[inline(always)]
fn add_by_eights<const N: usize, const S: usize>(
    weight_at: &WeightFunction<'_>,
    contribution: &LocalFit<N, S>,
    places: &[EightPlaces],
    [before, after]: [usize; 2],
    sums: &mut [WeightedSums<N>],
) {
    let last = places.len() - 1;
    for (index, (eight, sums)) in places.iter().zip(sums).enumerate() {
        let [x, y, z] = &eight.point;
        let [nx, ny, nz] = &eight.normal;
        let (mut across, mut up, mut along) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let (mut square, mut height, mut weight) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            across[l] = x[l] - weight_at.point.x;
            up[l] = y[l] - weight_at.point.y;
            along[l] = z[l] - weight_at.point.z;
            square[l] = across[l] * across[l] + up[l] * up[l] + along[l] * along[l];
            let n = weight_at.normal;
            height[l] = n.x * across[l] + n.y * up[l] + n.z * along[l];
            let cosine = n.x * nx[l] + n.y * ny[l] + n.z * nz[l];
            weight[l] = weight_at.fading(square[l], height[l], cosine);
        }
        if index == 0 {
            weight[..before].fill(0.0);
        }
        if index == last {
            weight[LANES - after..].fill(0.0);
        }
        if weight == [0.0; LANES] {
            continue;
        }
        for (l, weight) in weight.iter_mut().enumerate() {
            if *weight > 0.0 && square[l] > weight_at.free_square {
                let between = Vec3::new(across[l], up[l], along[l]);
                *weight *= weight_at.clearance(between, height[l], square[l]);
            }
        }
        for (sum, weight) in sums.weight.iter_mut().zip(weight) {
            *sum += weight;
        }
        for k in 0..N {
            for l in 0..LANES {
                let mut value = contribution.value[k];
                if k < S {
                    let slope = contribution.slope[k];
                    value += slope.x * across[l] + slope.y * up[l] + slope.z * along[l];
                    value = value.max(contribution.least[k]).min(contribution.most[k]);
                }
                sums.weighted[k][l] += value * weight[l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::Cut;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::surface::World;
    use crate::transport::hemilux::specimen::Specimen;
    use std::sync::Arc;

    /// No window leaves out a fragment where a record counts, and eights count as ones do.
    #[test]
    fn all_that_counts_is_added_up() {
        let scene = import(&made::cornell(), &Resources::default(), &ImportLimits::default());
        let scene = Arc::new(scene.unwrap());
        let world = Arc::new(World::new(scene.clone()));
        let cut = Arc::new(Cut::new(scene.clone(), 500, None));
        let visible = VisibleSurfaces::new(&world, cut, &scene.cameras[0], [61, 47], 16);
        let records: Vec<Record> = (0..visible.fragments.len())
            .step_by(37)
            .map(|index| {
                let at = &visible.fragments[index];
                let footprint = visible.frame.footprint(at.point, visible.height);
                let mut record = Record::new(at.point, at.normal, footprint, index as u32);
                record.radius = footprint * (2 + index % 11) as f32;
                record
            })
            .collect();
        let place = |record: &Record| record.number as f32;
        let contribution = |record: &Record| LocalFit {
            value: [1.0, place(record)],
            slope: [record.tangents[0]],
            least: [0.9],
            most: [1.5],
            at_home: [0.0; 2],
        };
        let sums = splat(&visible, &records, contribution, |[a, b], weight| [a, b, weight]);
        let mut counted = 0;
        for (fragment, sums) in visible.fragments.iter().zip(sums) {
            let mut expected = [0.0; 3];
            for record in &records {
                let weight = record.weight_function(1.0).weight(fragment.point, fragment.normal);
                let slope = record.tangents[0].dot(fragment.point - record.point);
                expected[0] += (1.0 + slope).clamp(0.9, 1.5) * weight;
                expected[1] += place(record) * weight;
                expected[2] += weight;
                counted += usize::from(weight > 0.0);
            }
            for (sum, expected) in sums.into_iter().zip(expected) {
                assert!((sum - expected).abs() <= 1e-4 * expected.abs() + 1e-5, "{sum} {expected}");
            }
        }
        assert!(counted > visible.fragments.len(), "the test tests nothing: {counted}");
    }

    /// A record counts in full at its own fragment, though the place that it stands for is out of its reach.
    #[test]
    fn a_record_counts_at_home_however_far_that_is() {
        let visible = Specimen::furnace().visible();
        let home = visible.fragments.len() / 2;
        let (at, elsewhere) = (&visible.fragments[home], &visible.fragments[0]);
        let sums = |point: Vec3, fragment: usize| {
            let mut record = Record::new(point, at.normal, 1.0, 0);
            record.fragment = fragment as u32;
            record.radius = 0.1 * visible.frame.footprint(point, visible.height);
            let fit = |_: &Record| LocalFit { at_home: [-1.0], ..LocalFit::even([5.0]) };
            splat(&visible, &[record], fit, |[sum], weight| [sum, weight])
        };
        for (point, expected) in [(at.point, [4.0, 1.0]), (elsewhere.point, [4.0, 1.0])] {
            let all = sums(point, home);
            assert_eq!(all[home], expected);
            let lit = all.iter().filter(|[_, weight]| *weight > 0.0).count();
            assert!(lit <= 2, "{lit}");
        }
        assert_eq!(sums(elsewhere.point, usize::MAX)[home], [0.0, 0.0], "nobody's record");
    }
}
