//! Picks of one thing of many by running sums in single precision.

/// Share of the probability that is spread evenly over all things of any weight, so that next to a
/// very bright one the others don't drown in rounding.
const EVEN: f64 = 0.01;

/// What a uniform number picked.
#[derive(Clone, Copy, Debug)]
pub struct Pick {
    /// The thing.
    pub index: usize,
    /// What is left of the uniform number, uniform in [0, 1) again.
    pub rest: f32,
}

/// Turns weights into running sums of probabilities: proportional to weight but for a small share,
/// zero where the weight is, 1 at the end; all zero where there is no weight.
pub fn accumulate(weights: &mut [f32]) {
    let total: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    let count = weights.iter().filter(|w| **w > 0.0).count();
    if count == 0 {
        return;
    }
    let (mut sum, mut left) = (0.0, count);
    for weight in weights {
        if *weight > 0.0 {
            sum += (1.0 - EVEN) * f64::from(*weight) / total + EVEN / count as f64;
            left -= 1;
        }
        *weight = if left == 0 { 1.0 } else { sum as f32 };
    }
}

/// The thing for a uniform number in [0, 1), by running sums that end with 1.
pub fn pick(sums: &[f32], xi: f32) -> Pick {
    let index = sums.partition_point(|sum| *sum <= xi).min(sums.len() - 1);
    let before = if index == 0 { 0.0 } else { sums[index - 1] };
    let rest = (xi - before) / (sums[index] - before);
    Pick { index, rest: rest.clamp(0.0, 1.0 - f32::EPSILON) }
}

/// The probability of a thing.
pub fn probability(sums: &[f32], index: usize) -> f32 {
    sums[index] - if index == 0 { 0.0 } else { sums[index - 1] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picks_are_by_weight_and_never_of_nothing() {
        let mut sums = [0.0, 1.0, 0.0, 3.0, 1e-9, 0.0];
        accumulate(&mut sums);
        let exact = [0.0, 0.2475, 0.0, 0.7425, 0.0, 0.0].map(|p| p + 0.01 / 3.0);
        let mut counts = [0; 6];
        let n = 10_000;
        for k in 0..n {
            let Pick { index, rest } = pick(&sums, (k as f32 + 0.5) / n as f32);
            assert!((0.0..1.0).contains(&rest));
            counts[index] += 1;
        }
        for index in [1, 3, 4] {
            let probability = probability(&sums, index);
            assert!((probability - exact[index]).abs() < 1e-6, "{index}: {probability}");
            assert!((counts[index] as f32 / n as f32 - probability).abs() < 2e-4);
        }
        assert_eq!([counts[0], counts[2], counts[5]], [0; 3]);
        assert_eq!(pick(&sums, 1.0 - f32::EPSILON / 2.0).index, 4);
        let mut dark = [0.0; 3];
        accumulate(&mut dark);
        assert_eq!(dark, [0.0; 3]);
    }
}
