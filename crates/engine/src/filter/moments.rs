//! Moments of weighted places, and the normal equations of a plane through values there by least
//! squares.

use glam::{Mat3, Vec2, Vec3};

/// Moments Σ w (1, x, y)ᵀ(1, x, y) of weighted places: the matrix of the fit's normal equations.
pub struct Moments {
    /// Σ w.
    pub total: f32,
    /// Σ w (x, y).
    first: Vec2,
    /// Σ w x², Σ w x y, Σ w y².
    second: [f32; 3],
}

impl Moments {
    /// The moments of no place.
    pub const NONE: Self = Self { total: 0.0, first: Vec2::ZERO, second: [0.0; 3] };

    /// Adds a place, and returns w (1, x, y).
    #[inline]
    pub fn add(&mut self, at: Vec2, weight: f32) -> Vec3 {
        let along = at * weight;
        self.total += weight;
        self.first += along;
        self.second[0] += along.x * at.x;
        self.second[1] += along.x * at.y;
        self.second[2] += along.y * at.y;
        Vec3::new(weight, along.x, along.y)
    }

    /// Inverse of the matrix of the normal equations. The `ridge`, a share of the weights that is
    /// added to the second moments, pulls slopes towards 0, so that a plane through few places is
    /// flat.
    pub fn inverse(&self, ridge: f32) -> Mat3 {
        let ridge = ridge * self.total;
        let (Vec2 { x, y }, [xx, xy, yy]) = (self.first, self.second);
        Mat3::from_cols(
            Vec3::new(self.total, x, y),
            Vec3::new(x, xx + ridge, xy),
            Vec3::new(y, xy, yy + ridge),
        )
        .inverse()
    }
}

/// Coefficients of weighted values in the least-squares plane's value at the middle, from which the
/// values lie at these `offsets`: the fit is linear in the values. The `ridge` is that of
/// [`Moments::inverse`] for offsets scaled to a mean square of 1. Where there is no plane, the
/// coefficients are the weights over their sum.
pub fn middle_coefficients(offsets: &[Vec2], weights: &[f32], ridge: f32) -> Vec<f32> {
    let total: f32 = weights.iter().sum();
    let spread = weights
        .iter()
        .zip(offsets)
        .map(|(w, o)| w * o.length_squared())
        .sum::<f32>()
        .max(f32::MIN_POSITIVE);
    let scale = (total / spread).sqrt();
    let mut moments = Moments::NONE;
    for (weight, offset) in weights.iter().zip(offsets) {
        moments.add(*offset * scale, *weight);
    }
    let solved = moments.inverse(ridge) * Vec3::X;
    if !solved.is_finite() {
        return weights.iter().map(|w| w / total).collect();
    }
    weights
        .iter()
        .zip(offsets)
        .map(|(w, o)| w * (solved.x + scale * (solved.y * o.x + solved.z * o.y)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is linear in the place is found without error, whatever the weights and units.
    #[test]
    fn coefficients_follow_what_is_linear() {
        let offsets = [(0.1, 0.2), (0.9, -0.1), (1.3, 0.8), (0.2, 1.1), (2.0, 0.4)].map(Vec2::from);
        let weights = [1.0, 0.7, 0.2, 0.5, 0.1];
        for unit in [1e-3, 1.0, 1e3] {
            let offsets = offsets.map(|offset| offset * unit);
            let coefficients = middle_coefficients(&offsets, &weights, 0.0);
            let value = |offset: &Vec2| 3.0 + (2.0 * offset.x - offset.y) / unit;
            let middle: f32 = coefficients.iter().zip(&offsets).map(|(c, o)| c * value(o)).sum();
            assert!((middle - 3.0).abs() < 1e-4, "{middle}");
            let mean = weights.iter().zip(&offsets).map(|(w, o)| w * value(o)).sum::<f32>()
                / weights.iter().sum::<f32>();
            assert!((mean - 3.0).abs() > 0.1, "a mean would do: {mean}");
        }
    }

    #[test]
    fn values_at_one_place_count_by_their_weights() {
        for ridge in [0.0, 0.02] {
            let found = middle_coefficients(&[Vec2::ZERO; 2], &[1.0, 3.0], ridge);
            assert!((found[0] - 0.25).abs() < 1e-6 && (found[1] - 0.75).abs() < 1e-6, "{found:?}");
        }
    }
}
