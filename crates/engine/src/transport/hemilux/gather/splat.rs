//! What records add up to at the fragments of a picture: along the rows of the picture, eight
//! fragments at a time.

use super::record::{Reach, Record};
use crate::transport::hemilux::fragments::Seen;
use crate::transport::hemilux::places::{Eight, LANES};
use glam::Vec3;
use rayon::prelude::*;

/// Rows of a task.
const BAND: u32 = 8;

type Lanes = [f32; LANES];

/// What a record says of N quantities: their values where it stands, and how the first S of them
/// change along its surface, within limits.
pub struct LocalFit<const N: usize, const S: usize> {
    pub value: [f32; N],
    pub slope: [Vec3; S],
    pub least: [f32; S],
    pub most: [f32; S],
}

impl<const N: usize> LocalFit<N, 0> {
    /// The same everywhere.
    pub fn even(value: [f32; N]) -> Self {
        Self { value, slope: [], least: [], most: [] }
    }
}

/// Sums over the records at eight fragments.
#[derive(Clone, Copy)]
struct WeightedSums<const N: usize> {
    weight: Lanes,
    weighted: [Lanes; N],
}

/// For every fragment, what `finish` makes of the sums over the records: of what `each` record
/// says times its weight there, and of the weights. Records are added in their order.
pub fn splat<const N: usize, const S: usize, T: Clone + Default + Send>(
    seen: &Seen,
    records: &[Record],
    each: impl Fn(&Record) -> LocalFit<N, S> + Sync,
    finish: impl Fn([f32; N], f32) -> T + Sync,
) -> Vec<T> {
    let window = |record: &Record| record.window(seen, 1.0);
    let windows: Vec<Option<[u32; 4]>> = records.par_iter().with_min_len(256).map(window).collect();
    let mut all = vec![T::default(); seen.fragments.len()];
    let mut bands = Vec::new();
    let mut rest = &mut all[..];
    for first_row in (0..seen.height).step_by(BAND as usize) {
        let rows = [first_row, (first_row + BAND).min(seen.height)];
        let ends = rows.map(|row| seen.start[(row * seen.width) as usize] as usize);
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
        for (record, window) in records.iter().zip(&windows) {
            let Some([x0, x1, y0, y1]) = *window else { continue };
            let [y0, y1] = [y0.max(rows[0]), y1.min(rows[1])];
            if y0 >= y1 {
                continue;
            }
            let (reach, said) = (record.reach(1.0), each(record));
            for row in y0..y1 {
                let [from, to] =
                    [x0, x1].map(|x| seen.start[(row * seen.width + x) as usize] as usize);
                if from < to {
                    let eights = from / LANES..to.div_ceil(LANES);
                    let there = &mut sums[eights.start - first_eight..eights.end - first_eight];
                    let skipped = [from - eights.start * LANES, eights.end * LANES - to];
                    add(&reach, &said, &seen.places.eights[eights], skipped, there);
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

/// Adds what a record says to the sums of a stretch of fragments, but for so many of the first
/// and last eight.
fn add<const N: usize, const S: usize>(
    reach: &Reach<'_>,
    said: &LocalFit<N, S>,
    places: &[Eight],
    skipped: [usize; 2],
    sums: &mut [WeightedSums<N>],
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2<const N: usize, const S: usize>(
            reach: &Reach<'_>,
            said: &LocalFit<N, S>,
            places: &[Eight],
            skipped: [usize; 2],
            sums: &mut [WeightedSums<N>],
        ) {
            add_by_eights(reach, said, places, skipped, sums);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { with_avx2(reach, said, places, skipped, sums) };
        }
    }
    add_by_eights(reach, said, places, skipped, sums);
}

#[inline(always)]
fn add_by_eights<const N: usize, const S: usize>(
    reach: &Reach<'_>,
    said: &LocalFit<N, S>,
    places: &[Eight],
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
            across[l] = x[l] - reach.point.x;
            up[l] = y[l] - reach.point.y;
            along[l] = z[l] - reach.point.z;
            square[l] = across[l] * across[l] + up[l] * up[l] + along[l] * along[l];
            let n = reach.normal;
            height[l] = n.x * across[l] + n.y * up[l] + n.z * along[l];
            let cosine = n.x * nx[l] + n.y * ny[l] + n.z * nz[l];
            weight[l] = reach.fading(square[l], height[l], cosine);
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
            if *weight > 0.0 && square[l] > reach.free_square {
                let between = Vec3::new(across[l], up[l], along[l]);
                *weight *= reach.clearance(between, height[l], square[l]);
            }
        }
        for (sum, weight) in sums.weight.iter_mut().zip(weight) {
            *sum += weight;
        }
        for k in 0..N {
            for l in 0..LANES {
                let mut value = said.value[k];
                if k < S {
                    let slope = said.slope[k];
                    value += slope.x * across[l] + slope.y * up[l] + slope.z * along[l];
                    value = value.max(said.least[k]).min(said.most[k]);
                }
                sums.weighted[k][l] += value * weight[l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::PatchedScene;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use crate::surface::World;
    use std::sync::Arc;

    /// No window leaves out a fragment where a record counts, and eights count as ones do.
    #[test]
    fn all_that_counts_is_added_up() {
        let scene = import(&made::cornell(), &Resources::default(), &ImportLimits::default());
        let scene = Arc::new(scene.unwrap());
        let world = World::new(scene.clone());
        let patched = Arc::new(PatchedScene::new(scene.clone(), 500));
        let seen = Seen::new(&world, patched, &scene.cameras[0], [61, 47], 16);
        let records: Vec<Record> = (0..seen.fragments.len())
            .step_by(37)
            .map(|index| {
                let at = &seen.fragments[index];
                let footprint = seen.frame.footprint(at.point, seen.height);
                let mut record = Record::new(at.point, at.normal, footprint, index as u32);
                record.radius = footprint * (2 + index % 11) as f32;
                record
            })
            .collect();
        let place = |record: &Record| record.number as f32;
        let said = |record: &Record| LocalFit {
            value: [1.0, place(record)],
            slope: [record.tangents[0]],
            least: [0.9],
            most: [1.5],
        };
        let sums = splat(&seen, &records, said, |[a, b], weight| [a, b, weight]);
        let mut counted = 0;
        for (fragment, sums) in seen.fragments.iter().zip(sums) {
            let mut expected = [0.0; 3];
            for record in &records {
                let weight = record.reach(1.0).weight(fragment.point, fragment.normal);
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
        assert!(counted > seen.fragments.len(), "the test tests nothing: {counted}");
    }
}
