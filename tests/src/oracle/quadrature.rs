//! Gauss–Legendre quadrature, also graded towards both ends of the range, so that logarithms and
//! kinks there cost nothing.

use std::f64::consts::PI;

/// Nodes in (0, 1) and weights that sum to 1.
#[derive(Clone, Debug)]
pub struct Rule {
    /// (node, weight).
    pub points: Vec<(f64, f64)>,
}

impl Rule {
    /// Gauss–Legendre with `count` nodes on [0, 1].
    pub fn gauss(count: usize) -> Self {
        let n = count as f64;
        let points = (0..count)
            .map(|i| {
                // Newton's iteration from Tricomi's guess.
                let mut x = (PI * (i as f64 + 0.75) / (n + 0.5)).cos();
                let mut slope = 1.0;
                for _ in 0..100 {
                    let (mut last, mut value) = (1.0, x);
                    for k in 2..=count {
                        let k = k as f64;
                        (last, value) =
                            (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * last) / k);
                    }
                    slope = n * (x * value - last) / (x * x - 1.0);
                    let step = value / slope;
                    x -= step;
                    if step.abs() < 1e-15 {
                        break;
                    }
                }
                (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
            })
            .collect();
        Self { points }
    }

    /// Gauss–Legendre with `count` nodes on each of 2·`levels` pieces that halve towards 0 and 1.
    pub fn graded(count: usize, levels: u32) -> Self {
        let gauss = Self::gauss(count);
        let mut points = Vec::new();
        for level in 1..=levels {
            let high = 0.5f64.powi(level as i32);
            let low = if level == levels { 0.0 } else { 0.5 * high };
            for (x, weight) in &gauss.points {
                let (at, weight) = (low + (high - low) * x, (high - low) * weight);
                points.push((at, weight));
                points.push((1.0 - at, weight));
            }
        }
        Self { points }
    }

    /// ∫₀¹ f.
    pub fn integrate(&self, f: impl Fn(f64) -> f64) -> f64 {
        self.points.iter().map(|(x, weight)| weight * f(*x)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_exact_and_logarithms_nearly() {
        let gauss = Rule::gauss(8);
        assert!((gauss.integrate(|_| 1.0) - 1.0).abs() < 1e-14);
        assert!((gauss.integrate(|x| x.powi(15)) - 1.0 / 16.0).abs() < 1e-14);
        let graded = Rule::graded(12, 30);
        assert!((graded.integrate(f64::ln) + 1.0).abs() < 1e-9);
        assert!((graded.integrate(|x| (1.0 - x).ln()) + 1.0).abs() < 1e-7);
        // Plain nodes do miss the logarithm.
        assert!((gauss.integrate(f64::ln) + 1.0).abs() > 1e-3);
    }
}
