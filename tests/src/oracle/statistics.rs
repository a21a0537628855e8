//! Whether means differ but for chance.

/// Mean and variance of a growing set of values, by Welford's recurrence.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    /// Adds a value.
    pub fn push(&mut self, value: f64) {
        self.count += 1.0;
        let difference = value - self.mean;
        self.mean += difference / self.count;
        self.squares += difference * (value - self.mean);
    }

    /// Mean.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Standard deviation of the mean.
    pub fn standard_error(&self) -> f64 {
        if self.count.is_infinite() {
            return 0.0;
        }
        (self.squares / (self.count - 1.0) / self.count).sqrt()
    }

    /// A value that is known.
    pub fn exact(value: f64) -> Self {
        Self { count: f64::INFINITY, mean: value, squares: 0.0 }
    }

    /// The same of values that are multiplied by a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { mean: self.mean * factor, squares: self.squares * factor * factor, ..*self }
    }

    /// Standard errors between two means; means that don't vary have to agree to 10⁻⁴, which is
    /// what f32 and finite hemicubes leave.
    pub fn z(&self, expected: &Self) -> f64 {
        let floor = 1e-4 * expected.mean.abs().max(f64::MIN_POSITIVE);
        let error = self.standard_error().hypot(expected.standard_error());
        (self.mean - expected.mean) / error.hypot(floor)
    }
}

/// z of many means against what is expected of each.
#[derive(Clone, Copy, Debug)]
pub struct Scores {
    /// √mean z²: about 1 where only chance differs.
    pub rms: f64,
    /// Largest |z|.
    pub largest: f64,
}

impl Scores {
    /// Scores of means against known values.
    pub fn new(means: &[Moments], expected: &[f64]) -> Self {
        let expected: Vec<Moments> = expected.iter().copied().map(Moments::exact).collect();
        Self::between(means, &expected)
    }

    /// Scores of means against expected values that are means themselves.
    pub fn between(means: &[Moments], expected: &[Moments]) -> Self {
        assert_eq!(means.len(), expected.len());
        let z: Vec<f64> = means.iter().zip(expected).map(|(m, e)| m.z(e)).collect();
        assert!(z.iter().all(|z| z.is_finite()), "{z:?}");
        Self {
            rms: (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt(),
            largest: z.iter().fold(0.0, |largest, z| largest.max(z.abs())),
        }
    }

    /// Whether only chance differs. Values that come from the same shots vary together, so the
    /// bounds are wide: a rms of 1.6, and 5 for the farthest of at most some hundreds.
    pub fn is_chance(&self) -> bool {
        self.rms < 1.6 && self.largest < 5.0
    }
}

/// χ² of counts against probabilities that sum to 1, in standard deviations of its distribution
/// above its mean. Cells that expect fewer than 5 counts are put together.
pub fn chi_square(counts: &[u64], probabilities: &[f64]) -> f64 {
    assert_eq!(counts.len(), probabilities.len());
    let total: u64 = counts.iter().sum();
    let (mut sum, mut cells) = (0.0, 0.0f64);
    let (mut rest_count, mut rest_expected) = (0.0, 0.0);
    for (count, probability) in counts.iter().zip(probabilities) {
        let (count, expected) = (*count as f64, probability * total as f64);
        if expected < 5.0 {
            rest_count += count;
            rest_expected += expected;
        } else {
            sum += (count - expected).powi(2) / expected;
            cells += 1.0;
        }
    }
    if rest_expected > 0.0 {
        sum += (rest_count - rest_expected).powi(2) / rest_expected;
        cells += 1.0;
    } else if rest_count > 0.0 {
        return f64::INFINITY;
    }
    let freedom = cells - 1.0;
    (sum - freedom) / (2.0 * freedom).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle::rays::Generator;

    fn samples(mean: f64, seed: u64) -> Moments {
        let mut generator = Generator::new(seed);
        let mut moments = Moments::default();
        for _ in 0..400 {
            moments.push(mean + generator.uniform() - 0.5);
        }
        moments
    }

    #[test]
    fn scores_pass_chance_and_fail_on_planted_errors() {
        let means: Vec<Moments> = (0..100).map(|seed| samples(2.0, seed)).collect();
        let others: Vec<Moments> = (100..200).map(|seed| samples(2.0, seed)).collect();
        let error = means[0].standard_error();
        assert!((error - (1.0f64 / 12.0 / 400.0).sqrt()).abs() < 0.1 * error);
        assert!(Scores::new(&means, &[2.0; 100]).is_chance());
        assert!(Scores::between(&means, &others).is_chance());
        // All 2 % off; one 5 % off.
        assert!(!Scores::new(&means, &[2.04; 100]).is_chance());
        let mut one = [2.0; 100];
        one[37] = 2.1;
        assert!(!Scores::new(&means, &one).is_chance());
        // What doesn't vary may differ by rounding only.
        let mut still = Moments::default();
        [3.0; 5].into_iter().for_each(|value| still.push(value));
        assert!(still.z(&Moments::exact(3.0 + 1e-5)).abs() < 1.0);
        assert!(still.z(&Moments::exact(3.01)).abs() > 5.0);
    }

    #[test]
    fn chi_square_passes_chance_and_fails_on_planted_errors() {
        let probabilities = [0.5, 0.25, 0.125, 0.0625, 0.0624, 0.0001];
        let mut generator = Generator::new(3);
        let mut counts = [0u64; 6];
        for _ in 0..10_000 {
            let mut at = generator.uniform();
            let cell = probabilities.iter().position(|p| {
                at -= p;
                at < 0.0
            });
            counts[cell.unwrap_or(5)] += 1;
        }
        assert!(chi_square(&counts, &probabilities).abs() < 4.0);
        let mut moved = counts;
        moved[0] -= 300;
        moved[1] += 300;
        assert!(chi_square(&moved, &probabilities) > 4.0);
        let uniform = [1.0 / 6.0; 6];
        assert!(chi_square(&counts, &uniform) > 100.0);
        // What cannot happen must not.
        assert!(chi_square(&[10, 1], &[1.0, 0.0]).is_infinite());
    }
}
