//! Lambert's formula: the form factor of a small element and a polygon, exactly; and its mean
//! over a polygon.

use super::quadrature::on_triangle;
use super::{Polygon, Route, Unsuitable};
use glam::DVec3;
use std::f64::consts::TAU;

/// F_{dA→P} of an element at `point` with the given unit normal and the front of a polygon:
/// 1/(2π) Σ_k γ_k n·Γ_k over its edges, where γ_k is the angle that the edge subtends and Γ_k the
/// unit normal of the plane through it and the point. What lies behind the element is cut off.
pub fn point_to_polygon(point: DVec3, normal: DVec3, polygon: &Polygon) -> f64 {
    // The polygon's back can't be seen.
    if (point - polygon.corners()[0]).dot(polygon.normal()) <= 0.0 {
        return 0.0;
    }
    let corners = polygon.in_front_of(point, normal);
    let mut sum = 0.0;
    for (k, corner) in corners.iter().enumerate() {
        let (a, b) = (*corner - point, corners[(k + 1) % corners.len()] - point);
        let cross = a.cross(b);
        let sine = cross.length();
        // An edge whose line goes through the point subtends nothing of the hemisphere's plane.
        if sine > 0.0 {
            sum += sine.atan2(a.dot(b)) * cross.dot(normal) / sine;
        }
    }
    // Seen from its front, a polygon goes round clockwise.
    (-sum / TAU).max(0.0)
}

/// The mean of [`point_to_polygon`] over the first polygon, by quadrature.
#[derive(Clone, Copy, Debug)]
pub struct Lambert {
    /// Points along each side of a triangle of the first polygon.
    pub order: usize,
}

impl Route for Lambert {
    fn name(&self) -> String {
        format!("Lambert, order {}", self.order)
    }

    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable> {
        if !blockers.is_empty() {
            return Err(Unsuitable::Occlusion("Lambert's formula"));
        }
        let (normal, mut sum, mut total) = (from.normal(), 0.0, 0.0);
        for triangle in from.triangles() {
            let [a, b, c] = triangle;
            let area = 0.5 * (b - a).cross(c - a).length();
            for (point, weight) in on_triangle(triangle, self.order) {
                sum += area * weight * point_to_polygon(point, normal, to);
            }
            total += area;
        }
        Ok(sum / total)
    }
}
