//! Exact form factors of simple configurations (Howell, "A Catalog of Radiation Heat Transfer
//! Configuration Factors", C-11, C-14, C-41, C-122 and B-33).

use super::{Polygon, Route, Unsuitable};
use glam::DVec3;
use std::f64::consts::PI;

/// Two equal rectangles a × b, parallel and opposite at distance `gap`.
pub fn parallel_rectangles(a: f64, b: f64, gap: f64) -> f64 {
    let (x, y) = (a / gap, b / gap);
    let (x1, y1) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let logarithm = (x1 * y1 / (1.0 + x * x + y * y).sqrt()).ln();
    let arcs = x * y1 * (x / y1).atan() + y * x1 * (y / x1).atan() - x * x.atan() - y * y.atan();
    2.0 / (PI * x * y) * (logarithm + arcs)
}

/// Two rectangles with a common edge of length `edge` at a right angle: from the one of the given
/// `depth` to the one of the given `height`.
pub fn perpendicular_rectangles(edge: f64, depth: f64, height: f64) -> f64 {
    let (h, w) = (height / edge, depth / edge);
    let (h2, w2) = (h * h, w * w);
    let r = (h2 + w2).sqrt();
    let arcs = w * (1.0 / w).atan() + h * (1.0 / h).atan() - r * (1.0 / r).atan();
    let all = 1.0 + w2 + h2;
    let logarithms = ((1.0 + w2) * (1.0 + h2) / all).ln()
        + w2 * (w2 * all / ((1.0 + w2) * (w2 + h2))).ln()
        + h2 * (h2 * all / ((1.0 + h2) * (w2 + h2))).ln();
    (arcs + 0.25 * logarithms) / (PI * w)
}

/// From a disk of radius `from` to a parallel, coaxial one of radius `to` at distance `gap`.
pub fn coaxial_disks(from: f64, to: f64, gap: f64) -> f64 {
    let (r1, r2) = (from / gap, to / gap);
    let s = 1.0 + (1.0 + r2 * r2) / (r1 * r1);
    // s − √(s² − q) without its cancellation.
    let q = 4.0 * (to / from).powi(2);
    0.5 * q / (s + (s * s - q).sqrt())
}

/// From a small flat element to a sphere of the given radius, whose centre lies at `distance` and
/// at the given cosine to the element's normal, all of it above the element's plane.
pub fn element_to_sphere(radius: f64, distance: f64, cosine: f64) -> f64 {
    (radius / distance).powi(2) * cosine
}

/// From a sphere to a disk of the given radius, whose axis goes through the sphere's centre at
/// distance `gap`.
pub fn sphere_to_coaxial_disk(radius: f64, gap: f64) -> f64 {
    let ratio = (radius / gap).powi(2);
    // ½ (1 − 1/√(1 + ratio)) without its cancellation.
    let root = (1.0 + ratio).sqrt();
    0.5 * ratio / (root * (root + 1.0))
}

/// The closed forms of rectangles: equal and opposite, or at a right angle with a common edge.
#[derive(Clone, Copy, Debug)]
pub struct ClosedForm;

/// Equal within this share of the size.
const SAME: f64 = 1e-9;

impl Route for ClosedForm {
    fn name(&self) -> String {
        "closed form".into()
    }

    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable> {
        const NAME: &str = "closed form";
        if !blockers.is_empty() {
            return Err(Unsuitable::Occlusion(NAME));
        }
        let (Some(a), Some(b)) = (Rectangle::of(from), Rectangle::of(to)) else {
            return Err(Unsuitable::Configuration(NAME));
        };
        a.opposite(&b).or_else(|| a.beside(&b)).ok_or(Unsuitable::Configuration(NAME))
    }
}

struct Rectangle {
    corners: [DVec3; 4],
    normal: DVec3,
    size: f64,
}

impl Rectangle {
    fn of(polygon: &Polygon) -> Option<Self> {
        let corners: [DVec3; 4] = polygon.corners().try_into().ok()?;
        let [a, b, c, d] = corners;
        let size = (c - a).length();
        let right = (b - a).dot(d - a).abs() <= SAME * size * size;
        let closed = (a + c - b - d).length() <= SAME * size;
        (right && closed).then(|| Self { corners, normal: polygon.normal(), size })
    }

    fn same(&self, a: DVec3, b: DVec3) -> bool {
        (a - b).length() <= SAME * self.size
    }

    /// Where each corner of the other lies straight in front of one of ours.
    fn opposite(&self, other: &Self) -> Option<f64> {
        let gap = (other.corners[0] - self.corners[0]).dot(self.normal);
        let facing = self.normal.dot(other.normal) < -1.0 + SAME;
        let all = self.corners.iter().all(|corner| {
            other.corners.iter().any(|there| self.same(*there, *corner + self.normal * gap))
        });
        let [a, b, _, d] = self.corners;
        (facing && gap > 0.0 && all)
            .then(|| parallel_rectangles((b - a).length(), (d - a).length(), gap))
    }

    /// Where the other stands on one of our edges, facing us.
    fn beside(&self, other: &Self) -> Option<f64> {
        for i in 0..4 {
            let [a, b, c] = [0, 1, 2].map(|k| self.corners[(i + k) % 4]);
            for j in 0..4 {
                let [p, q, r] = [0, 1, 2].map(|k| other.corners[(j + k) % 4]);
                let inward = (c - b).normalize();
                // Counter-clockwise from both fronts, so the edge runs the other way there.
                let upright =
                    other.normal.dot(inward) > 1.0 - SAME && (r - q).dot(self.normal) > 0.0;
                if self.same(a, q) && self.same(b, p) && upright {
                    let (edge, depth, height) =
                        ((b - a).length(), (c - b).length(), (r - q).length());
                    return Some(perpendicular_rectangles(edge, depth, height));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms_obey_reciprocity_closure_and_limits() {
        // Depth 2 to height 3 and back: A₁F₁₂ = A₂F₂₁.
        let (there, back) =
            (perpendicular_rectangles(1.5, 2.0, 3.0), perpendicular_rectangles(1.5, 3.0, 2.0));
        assert!((2.0 * there - 3.0 * back).abs() < 1e-12);
        // A cube: one opposite face and four beside.
        let sum =
            parallel_rectangles(1.0, 1.0, 1.0) + 4.0 * perpendicular_rectangles(1.0, 1.0, 1.0);
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        // A disk that fills the view; one far away, A/(π d²).
        assert!((coaxial_disks(1.0, 1e6, 1.0) - 1.0).abs() < 1e-9);
        assert!((coaxial_disks(1e-3, 2.0, 100.0) / (4.0 / 1e4) - 1.0).abs() < 1e-3);
        // Disks from both sides.
        let pair = (coaxial_disks(1.0, 2.0, 0.7), coaxial_disks(2.0, 1.0, 0.7));
        assert!((pair.0 - 4.0 * pair.1).abs() < 1e-12);
        // A plane takes half of a sphere's light.
        assert!((sphere_to_coaxial_disk(1e9, 1.0) - 0.5).abs() < 1e-8);
        // A sphere seen from a small disk, by reciprocity with the disk seen from the sphere.
        let (radius, distance, disk) = (0.3, 2.0, 1e-4);
        let there = element_to_sphere(radius, distance, 1.0) * PI * disk * disk;
        let back = sphere_to_coaxial_disk(disk, distance) * 4.0 * PI * radius * radius;
        assert!((there / back - 1.0).abs() < 1e-6);
    }
}
