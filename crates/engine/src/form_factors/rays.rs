//! Cosine-distributed rays: the only route besides the hemicube that sees blockers.

use super::{Polygon, Route, Unsuitable};
use crate::random::{Stream, uniform};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// The share of rays from random points of the first polygon, cosine-distributed about its
/// normal, whose first hit is the second one's front. Its standard error is √(F(1 − F)/rays) or
/// less: points and directions are stratified.
#[derive(Clone, Copy, Debug)]
pub struct CosineRays {
    /// Number of rays.
    pub rays: u32,
    /// Seed of the points and directions.
    pub seed: u64,
}

impl Route for CosineRays {
    fn name(&self) -> String {
        format!("{} rays", self.rays)
    }

    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable> {
        let normal = from.normal();
        let tangent = (from.corners()[1] - from.corners()[0]).normalize();
        let bitangent = normal.cross(tangent);
        let draw = |stream| f64::from(uniform(self.seed, stream, 0));
        let point_shift = DVec2::new(draw(Stream::PointU), draw(Stream::PointV));
        let direction_shift = DVec2::new(draw(Stream::JitterX), draw(Stream::JitterY));
        let mut hits = 0u32;
        for k in 0..self.rays {
            // The additive recurrence of the four-dimensional golden ratio.
            let k = f64::from(k);
            let xi = (point_shift
                + DVec2::new(0.856_674_883_854_502_9, 0.733_891_856_627_126_9) * k)
                .fract();
            let eta = (direction_shift
                + DVec2::new(0.628_706_721_037_811_8, 0.538_596_837_834_472_8) * k)
                .fract();
            let origin = point_on(from, xi);
            let (radius, angle) = (eta.x.sqrt(), TAU * eta.y);
            let direction = tangent * (radius * angle.cos())
                + bitangent * (radius * angle.sin())
                + normal * (1.0 - eta.x).max(0.0).sqrt();
            let front = direction.dot(to.normal()) < 0.0;
            let Some(distance) = hit(to, origin, direction).filter(|_| front) else { continue };
            let blocked = blockers
                .iter()
                .any(|blocker| hit(blocker, origin, direction).is_some_and(|t| t < distance));
            hits += u32::from(!blocked);
        }
        Ok(f64::from(hits) / f64::from(self.rays.max(1)))
    }
}

/// The point of a polygon for two uniform numbers.
fn point_on(polygon: &Polygon, xi: DVec2) -> DVec3 {
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    let total: f64 = polygon.triangles().map(area).sum();
    let mut left = xi.x * total;
    let mut last = DVec3::ZERO;
    for triangle in polygon.triangles() {
        let own = area(triangle);
        let share = (left / own).clamp(0.0, 1.0);
        let [a, b, c] = triangle;
        let root = share.sqrt();
        last = a * (1.0 - root) + b * (root * (1.0 - xi.y)) + c * (root * xi.y);
        if left < own {
            break;
        }
        left -= own;
    }
    last
}

/// Distance along a ray to a polygon, from either side.
fn hit(polygon: &Polygon, origin: DVec3, direction: DVec3) -> Option<f64> {
    let normal = polygon.normal();
    let along = direction.dot(normal);
    let distance = (polygon.corners()[0] - origin).dot(normal) / along;
    if along == 0.0 || distance <= 1e-12 {
        return None;
    }
    let at = origin + direction * distance;
    let inside = polygon.edges().all(|(a, b)| (b - a).cross(at - a).dot(normal) >= 0.0);
    inside.then_some(distance)
}
