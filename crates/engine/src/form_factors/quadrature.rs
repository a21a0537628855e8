//! Gauss–Legendre rules.

use glam::DVec3;
use std::f64::consts::PI;

/// Nodes and weights on [0, 1] with `order` points; exact for polynomials of degree 2·order − 1.
pub fn gauss_legendre(order: usize) -> Vec<(f64, f64)> {
    let n = order.max(1);
    (0..n)
        .map(|i| {
            // Newton's iteration on the Legendre polynomial from Chebyshev's guess.
            let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut before, mut p) = (1.0, x);
                for k in 2..=n {
                    let k = k as f64;
                    (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
                }
                if n == 1 {
                    (before, p) = (1.0, x);
                }
                slope = n as f64 * (x * p - before) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            (0.5 * (x + 1.0), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// The rule on [0, 1] with nodes drawn to both ends, for integrands with logarithms there: t =
/// s³(10 − 15 s + 6 s²).
pub fn graded(order: usize) -> Vec<(f64, f64)> {
    let grade = |(s, weight): (f64, f64)| {
        let t = s * s * s * (10.0 + s * (6.0 * s - 15.0));
        (t, weight * 30.0 * (s * (1.0 - s)).powi(2))
    };
    gauss_legendre(order).into_iter().map(grade).collect()
}

/// Points and weights (that sum to 1) on a triangle, order² of them, by Duffy's transform.
pub fn on_triangle([a, b, c]: [DVec3; 3], order: usize) -> Vec<(DVec3, f64)> {
    let line = graded(order);
    let mut points = Vec::with_capacity(order * order);
    for (u, wu) in &line {
        for (v, wv) in &line {
            let at = a + (b - a) * *u + (c - b) * (*u * *v);
            points.push((at, 2.0 * wu * wv * u));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_integrate_what_they_should() {
        for order in [1, 2, 5, 16, 40] {
            let rule = gauss_legendre(order);
            let degree = 2 * order as i32 - 1;
            let integral: f64 = rule.iter().map(|(x, w)| w * x.powi(degree)).sum();
            assert!((integral * f64::from(degree + 1) - 1.0).abs() < 1e-12, "{order}");
        }
        let logarithm: f64 = graded(24).iter().map(|(x, w)| w * x.ln()).sum();
        assert!((logarithm + 1.0).abs() < 1e-5, "{logarithm}");
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let points = on_triangle(triangle, 16);
        let moment: f64 = points.iter().map(|(p, w)| w * p.x * p.y).sum();
        assert!((moment - 1.0 / 12.0).abs() < 1e-9, "{moment}");
    }
}
