//! Flat polygons.

use super::unsuitable::Unsuitable;
use glam::DVec3;

/// A flat polygon with three or more corners, counter-clockwise seen from its front; convex.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    corners: Vec<DVec3>,
}

/// Corners may lie off the plane, and turns go the wrong way, by this share of the size.
const FLAT: f64 = 1e-9;

impl Polygon {
    /// Checks and keeps the corners.
    ///
    /// # Errors
    /// [`Unsuitable::Polygon`].
    pub fn new(corners: Vec<DVec3>) -> Result<Self, Unsuitable> {
        let this = Self { corners };
        let normal = this.area_vector();
        let size =
            this.corners.iter().fold(0f64, |size, c| size.max((*c - this.corners[0]).length()));
        let usable = this.corners.len() >= 3
            && this.corners.iter().all(|corner| corner.is_finite())
            && normal.length() > FLAT * size * size;
        let unit = normal.normalize_or_zero();
        let turns_left =
            |[a, b, c]: [DVec3; 3]| (b - a).cross(c - b).dot(unit) >= -FLAT * size * size;
        let in_plane =
            |corner: &DVec3| (*corner - this.corners[0]).dot(unit).abs() <= 1e3 * FLAT * size;
        let count = this.corners.len();
        let convex =
            (0..count).all(|i| turns_left([0, 1, 2].map(|k| this.corners[(i + k) % count])));
        if usable && convex && this.corners.iter().all(in_plane) {
            Ok(this)
        } else {
            Err(Unsuitable::Polygon)
        }
    }

    /// A parallelogram that faces u × v.
    ///
    /// # Errors
    /// [`Unsuitable::Polygon`] where it has no area.
    pub fn parallelogram(origin: DVec3, u: DVec3, v: DVec3) -> Result<Self, Unsuitable> {
        Self::new(vec![origin, origin + u, origin + u + v, origin + v])
    }

    /// The corners.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners
    }

    /// Area.
    pub fn area(&self) -> f64 {
        self.area_vector().length()
    }

    /// Unit normal of the front.
    pub fn normal(&self) -> DVec3 {
        self.area_vector().normalize()
    }

    pub(super) fn area_vector(&self) -> DVec3 {
        let fan = self.corners.windows(2).skip(1);
        fan.map(|pair| (pair[0] - self.corners[0]).cross(pair[1] - self.corners[0])).sum::<DVec3>()
            * 0.5
    }

    /// The edges, corner to corner.
    pub(super) fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().copied().zip(next.copied())
    }

    /// Triangles of a fan around the first corner.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.corners.windows(2).skip(1).map(|pair| [self.corners[0], pair[0], pair[1]])
    }

    /// The part in front of a plane through `point` with `normal`; fewer than three corners where
    /// there is none.
    pub(super) fn in_front_of(&self, point: DVec3, normal: DVec3) -> Vec<DVec3> {
        let height = |corner: DVec3| (corner - point).dot(normal);
        let mut kept = Vec::with_capacity(self.corners.len() + 1);
        for (a, b) in self.edges() {
            let (ha, hb) = (height(a), height(b));
            if ha >= 0.0 {
                kept.push(a);
            }
            if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
                kept.push(a + (b - a) * (ha / (ha - hb)));
            }
        }
        kept
    }
}
