//! Picks of one thing of many.

/// A discrete distribution: things by probability.
pub struct Discrete {
    /// Running sums of the probabilities.
    cumulative: Vec<f64>,
}

impl Discrete {
    /// Things with probabilities in proportion to weights, whose sum is positive.
    pub fn new(weights: impl Iterator<Item = f64>) -> Self {
        let mut total = 0.0;
        let mut cumulative: Vec<f64> = weights
            .map(|weight| {
                total += weight;
                total
            })
            .collect();
        cumulative.iter_mut().for_each(|sum| *sum /= total);
        Self { cumulative }
    }

    /// The thing for a uniform number.
    pub fn pick(&self, xi: f64) -> usize {
        self.cumulative.partition_point(|sum| *sum <= xi).min(self.cumulative.len() - 1)
    }

    /// The probability of a thing.
    pub fn probability(&self, index: usize) -> f64 {
        let before = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        self.cumulative[index] - before
    }
}
