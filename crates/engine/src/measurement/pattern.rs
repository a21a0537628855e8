//! Where in a pixel its samples are.

use glam::Vec2;

/// Steps of the sequence R2 along either axis: one over the plastic number, and over its square.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// `count` well-spread points in [−½, ½)², whose mean is the middle: the additive recurrence by the
/// plastic number (Roberts 2018, the sequence R2), turned about the square.
pub fn sample_pattern(count: u32) -> Vec<Vec2> {
    let along = |step: f64| centred((0..count).map(|i| step * f64::from(i)));
    let [x, y] = STEPS.map(along);
    x.into_iter().zip(y).map(|(x, y)| Vec2::new(x, y)).collect()
}

/// The n-th point of a pattern that begins with `first`, which goes on beyond its end: the more of them,
/// the finer they are spread.
pub fn nth_of_pattern(first: Vec2, n: u32) -> Vec2 {
    let along = |axis: usize| {
        let at = f64::from(first[axis]) + 0.5 + STEPS[axis] * f64::from(n);
        (at.fract() - 0.5) as f32
    };
    Vec2::new(along(0), along(1))
}

/// Numbers modulo 1, in [−½, ½), moved by what makes their mean zero: a pattern whose mean is 1/20 of
/// a pixel beside its middle moves the edges of a whole picture by that.
fn centred(numbers: impl Iterator<Item = f64>) -> Vec<f32> {
    let numbers: Vec<f64> = numbers.map(f64::fract).collect();
    let count = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / count;
    // Where k of them are moved past the end, their mean goes down by k/count.
    let moved = |by: f64| numbers.iter().map(move |x| (x + by).rem_euclid(1.0) - 0.5);
    let off = |by: &f64| (moved(*by).sum::<f64>() / count).abs();
    let ways = (0..numbers.len()).map(|k| 0.5 - mean + k as f64 / count);
    let by = ways.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default();
    moved(by).map(|x| x as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a straight edge cuts off of a pixel is found ever better.
    #[test]
    fn a_pattern_that_goes_on_becomes_finer() {
        let first = sample_pattern(64)[0];
        let slant = Vec2::new(0.3, 1.0);
        let off = |count: u32| {
            let below = |at: Vec2| slant.dot(at) < 0.1;
            let inside = (0..count).filter(|n| below(nth_of_pattern(first, *n))).count();
            (inside as f64 / f64::from(count) - 0.6).abs()
        };
        assert!(off(64) < 0.02 && off(4096) < 0.001, "{} {}", off(64), off(4096));
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
            for (n, at) in all.iter().enumerate() {
                assert!((nth_of_pattern(all[0], n as u32) - *at).abs().max_element() < 1e-6);
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
