//! Rectangles in space: the openings of a scene.

use glam::{Vec2, Vec3};

/// Cosine between the normals of rectangles that may be parts of one.
const ONE_PLANE: f32 = 0.995;
/// How far apart their planes may be, in lengths of the larger one's diagonal.
const PLANES_APART: f32 = 0.1;
/// By how much the area of one around both may be larger than theirs together.
const LOOSE: f32 = 1.25;

/// A rectangle, ray units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// One corner.
    pub corner: Vec3,
    /// The edges from there, at right angles; their cross product points out into the open.
    pub edges: [Vec3; 2],
}

/// A plane with a frame: where rectangles are fitted in.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// Unit normal.
    pub normal: Vec3,
    /// Unit vectors along it, at right angles.
    pub axes: [Vec3; 2],
    /// Distance from the origin along the normal.
    pub offset: f32,
}

impl Plane {
    /// With a horizontal axis, as windows mostly have.
    pub fn new(normal: Vec3, offset: f32) -> Self {
        let level = Vec3::Y.cross(normal);
        let level = if level.length_squared() > 1e-6 { level.normalize() } else { Vec3::X };
        Self { normal, axes: [level, normal.cross(level).normalize()], offset }
    }

    /// Where a line crosses it, along its axes; `None` if it hardly does.
    pub fn crossed_by(&self, from: Vec3, direction: Vec3) -> Option<Vec2> {
        const LEAST_SLANT: f32 = 0.02;
        let slant = self.normal.dot(direction);
        if slant.abs() < LEAST_SLANT {
            return None;
        }
        let at = from + direction * ((self.offset - self.normal.dot(from)) / slant);
        Some(self.along(at))
    }

    /// A place along its axes.
    pub fn along(&self, place: Vec3) -> Vec2 {
        Vec2::new(self.axes[0].dot(place), self.axes[1].dot(place))
    }

    /// The place at coordinates along its axes.
    pub fn at(&self, along: Vec2) -> Vec3 {
        self.normal * self.offset + self.axes[0] * along.x + self.axes[1] * along.y
    }

    /// The rectangle between two corners along its axes.
    pub fn rectangle(&self, low: Vec2, high: Vec2) -> Rectangle {
        let size = high - low;
        Rectangle { corner: self.at(low), edges: [self.axes[0] * size.x, self.axes[1] * size.y] }
    }
}

impl Rectangle {
    /// Area.
    pub fn area(&self) -> f32 {
        self.edges[0].length() * self.edges[1].length()
    }

    /// The plane that it lies in, with its edges as axes.
    pub fn plane(&self) -> Plane {
        let axes = self.edges.map(Vec3::normalize);
        let normal = axes[0].cross(axes[1]);
        Plane { normal, axes, offset: normal.dot(self.corner) }
    }

    /// Two opposite corners along the axes of a plane.
    pub fn bounds(&self, plane: &Plane) -> (Vec2, Vec2) {
        let [a, b] = [self.corner, self.corner + self.edges[0] + self.edges[1]];
        let [a, b] = [plane.along(a), plane.along(b)];
        (a.min(b), a.max(b))
    }

    /// One rectangle around both, if they are parts of one: in a plane and hardly apart.
    pub fn joined(&self, other: &Self) -> Option<Self> {
        let (large, small) =
            if self.area() >= other.area() { (self, other) } else { (other, self) };
        let (plane, theirs) = (large.plane(), small.plane());
        let middle = small.corner + 0.5 * (small.edges[0] + small.edges[1]);
        let diagonal = (large.edges[0] + large.edges[1]).length();
        let apart = (plane.normal.dot(middle) - plane.offset).abs();
        if plane.normal.dot(theirs.normal) < ONE_PLANE || apart > PLANES_APART * diagonal {
            return None;
        }
        let ([low, high], [their_low, their_high]) =
            (large.bounds(&plane).into(), small.bounds(&plane).into());
        let overlap = (high.min(their_high) - low.max(their_low)).max(Vec2::ZERO);
        let together = large.area() + small.area() - overlap.x * overlap.y;
        let both = plane.rectangle(low.min(their_low), high.max(their_high));
        (both.area() <= LOOSE * together).then_some(both)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_of_a_window_are_one_and_two_windows_are_two() {
        let plane = Plane::new(Vec3::Z, 2.0);
        let part = |low: [f32; 2], high: [f32; 2]| plane.rectangle(low.into(), high.into());
        let whole = part([0.0, 0.0], [1.0, 1.0]).joined(&part([0.9, 0.1], [2.0, 1.0]));
        assert_eq!(whole, Some(part([0.0, 0.0], [2.0, 1.0])));
        assert_eq!(part([0.0, 0.0], [1.0, 1.0]).joined(&part([2.0, 0.0], [3.0, 1.0])), None);
        let behind = Plane::new(Vec3::Z, 3.0).rectangle(Vec2::ZERO, Vec2::ONE);
        assert_eq!(part([0.0, 0.0], [1.0, 1.0]).joined(&behind), None);
        let across = Plane::new(Vec3::X, 0.0).rectangle(Vec2::ZERO, Vec2::ONE);
        assert_eq!(part([0.0, 0.0], [1.0, 1.0]).joined(&across), None);
    }

    #[test]
    fn places_in_a_plane_are_found_again() {
        for normal in [Vec3::X, Vec3::Y, Vec3::new(0.48, 0.6, 0.64)] {
            let plane = Plane::new(normal, -0.7);
            let along = Vec2::new(0.3, -1.2);
            let place = plane.at(along);
            assert!((plane.along(place) - along).length() < 1e-5);
            assert!((normal.dot(place) + 0.7).abs() < 1e-5);
            let from = place + Vec3::new(1.0, 2.0, 3.0);
            let crossed = plane.crossed_by(from, (place - from).normalize()).expect("it does");
            assert!((crossed - along).length() < 1e-4);
        }
    }
}
