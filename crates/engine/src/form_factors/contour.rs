//! Stokes' contour integral, F_ij = 1/(2πA_i) ∮∮ ln r dx_i·dx_j (Rogers §5-17; Goral et al. 1984).

use super::quadrature::graded;
use super::{Polygon, Route, Unsuitable};
use glam::DVec3;
use std::f64::consts::TAU;

/// The contour integral: the inner one exactly, the outer one by quadrature.
///
/// ∫ ln r along a straight edge has a closed form, which stays finite where the point lies on the
/// edge: polygons with a common edge are no special case, and the outer integrand has its
/// logarithms only at the ends of edges, to where the quadrature is graded.
#[derive(Clone, Copy, Debug)]
pub struct Contour {
    /// Points along each edge of the first polygon.
    pub order: usize,
}

impl Route for Contour {
    fn name(&self) -> String {
        format!("contour, order {}", self.order)
    }

    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable> {
        if !blockers.is_empty() {
            return Err(Unsuitable::Occlusion("the contour integral"));
        }
        // The formula takes for granted that all of each is in front of all of the other.
        let seen = from.in_front_of(to.corners()[0], to.normal());
        let seeing = to.in_front_of(from.corners()[0], from.normal());
        let (Ok(seen), Ok(seeing)) = (Polygon::new(seen), Polygon::new(seeing)) else {
            return Ok(0.0);
        };
        let rule = graded(self.order);
        let mut sum = 0.0;
        for (a, b) in seen.edges() {
            for (p, q) in seeing.edges() {
                let parallel = (b - a).dot((q - p).normalize());
                let along =
                    |(t, weight): &(f64, f64)| weight * log_distance(a + (b - a) * *t, p, q);
                sum += parallel * rule.iter().map(along).sum::<f64>();
            }
        }
        // Both go round counter-clockwise from their fronts, which face each other.
        Ok((sum / (TAU * from.area())).max(0.0))
    }
}

/// ∫ ln |x − y| dy along the edge from p to q.
fn log_distance(x: DVec3, p: DVec3, q: DVec3) -> f64 {
    let length = (q - p).length();
    let direction = (q - p) / length;
    let start = (p - x).dot(direction);
    let end = start + length;
    let away = ((p - x) - direction * start).length();
    // ∫ ½ ln(s² + d²) ds = s/2 ln(s² + d²) − s + d·atan(s/d).
    let primitive = |s: f64| {
        let square = s * s + away * away;
        let logarithm = if square > 0.0 { 0.5 * s * square.ln() } else { 0.0 };
        let arc = if away > 0.0 { away * (s / away).atan() } else { 0.0 };
        logarithm - s + arc
    };
    primitive(end) - primitive(start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inner_integral_is_exact_even_on_the_edge() {
        let (p, q) = (DVec3::ZERO, DVec3::X * 2.0);
        // On the edge's middle: 2 ∫₀¹ ln s ds = −2.
        assert!((log_distance(DVec3::X, p, q) + 2.0).abs() < 1e-14);
        let x = DVec3::new(0.3, 0.4, 0.0);
        let rule = super::super::quadrature::gauss_legendre(64);
        let numeric: f64 =
            rule.iter().map(|(t, w)| 2.0 * w * (x - DVec3::X * 2.0 * *t).length().ln()).sum();
        assert!((log_distance(x, p, q) - numeric).abs() < 1e-6);
    }
}
