//! Where in a pixel its samples are.

use glam::Vec2;

/// Steps of the sequence R2 along either axis: one over the plastic number, and over its square.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// `count` well-spread points in [−½, ½)²: [`nth_of_pattern`].
pub fn sample_pattern(count: u32) -> Vec<Vec2> {
    (0..count).map(|n| nth_of_pattern(count, n)).collect()
}

/// The n-th point of a pattern of `count`, which goes on beyond its end: the more of them, the finer they are
/// spread. They are consecutive points of the additive recurrence by the plastic number (Roberts 2018, the
/// sequence R2), from the middle outwards: each is the mirror image of the one before, so that the mean of all,
/// as that of each even (odd) number of first ones of an even (odd) number, is the middle. A mean 1/20 of a pixel
/// beside it would move the edges of a whole picture by that.
pub fn nth_of_pattern(count: u32, n: u32) -> Vec2 {
    // 0, 1, −1, 2, −2 … of an odd number, and ½, −½, 1½, −1½ … of an even one.
    let is_even = n.is_multiple_of(2);
    let (way, side) = match count.is_multiple_of(2) {
        true => (f64::from(n / 2) + 0.5, is_even),
        false => (f64::from(n.div_ceil(2)), !is_even),
    };
    let along = |step: f64| {
        let turn = 0.5 + if side { way * step } else { -way * step };
        (turn - turn.floor() - 0.5) as f32
    };
    Vec2::from_array(STEPS.map(along))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What straight edges cut off of a pixel is found ever better.
    #[test]
    fn a_pattern_that_goes_on_becomes_finer() {
        let slant = Vec2::new(0.3, 1.0);
        let off = |count: u32| {
            let of_edge = |at: f32| {
                let below = |place: Vec2| slant.dot(place) < at;
                let inside = (0..count).filter(|n| below(nth_of_pattern(64, *n))).count();
                (inside as f64 / f64::from(count) - 0.5 - f64::from(at)).powi(2)
            };
            let edges = (-34..=34).map(|k| of_edge(0.01 * k as f32));
            (edges.sum::<f64>() / 69.0).sqrt()
        };
        // Random places are off by 0.12, 0.06 and 0.008.
        let all = [16, 64, 4096].map(off);
        assert!(all[0] < 0.05 && all[1] < 0.025 && all[2] < 0.001, "{all:?}");
    }

    #[test]
    fn a_pattern_is_spread_about_the_middle() {
        assert_eq!(sample_pattern(1), [Vec2::ZERO]);
        for count in [2, 3, 8, 16, 32, 64, 100] {
            let all = sample_pattern(count);
            let n = count as f32;
            let mean = all.iter().sum::<Vec2>() / n;
            assert!(mean.abs().max_element() < 1e-6, "{count}: {mean}");
            assert!(all.iter().all(|at| at.min_element() >= -0.5 && at.max_element() < 0.5));
            // So is what comes first of them.
            for first in (count % 2 + 2..count).step_by(2) {
                let mean = all[..first as usize].iter().sum::<Vec2>() / first as f32;
                assert!(mean.abs().max_element() < 1e-6, "{first} of {count}: {mean}");
            }
            for (n, at) in all.iter().enumerate() {
                assert!(nth_of_pattern(count, n as u32) == *at);
            }
            // Along either axis no strip is far from having its share.
            for axis in [0, 1] {
                let mut along: Vec<f32> = all.iter().map(|at| at[axis] + 0.5).collect();
                along.sort_by(f32::total_cmp);
                let off = |(k, x): (usize, &f32)| (x - (k as f32 + 0.5) / n).abs();
                let worst = along.iter().enumerate().map(off).fold(0.0, f32::max);
                assert!(worst < 2.0 / n, "{count}: {worst}");
            }
            // And no two are close.
            let close = |a: &Vec2, b: &Vec2| {
                let between = *a - *b;
                (between - between.round()).length()
            };
            let pairs =
                all.iter().enumerate().flat_map(|(k, a)| all[..k].iter().map(move |b| close(a, b)));
            assert!(pairs.fold(1.0, f32::min) > 0.5 / n.sqrt(), "{count}");
        }
    }
}
