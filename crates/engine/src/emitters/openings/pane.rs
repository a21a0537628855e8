//! A rectangle as it looks from a place: directions through it, uniform in solid angle (Ureña,
//! Fajardo, King: An area-preserving parametrization for spherical rectangles, 2013).

use super::rectangle::Rectangle;
use crate::angles::angles_of;
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::TAU;

/// A rectangle of a smaller solid angle, sr, is sampled by its area: the other form would lose its
/// digits.
const SMALL: f32 = 0.01;
/// A direction as near beside the rectangle, in edges, counts as through it: rounding puts some that
/// are drawn there.
const ROUNDING: f32 = 1e-4;
/// Lower bound of the cosine by which openings are picked: a part of one may be higher.
const LEAST_COSINE: f32 = 0.05;
/// A place is on a rectangle's inner side where it is as far from its plane, in its longer edges, at
/// least.
const WITHIN: f32 = 1e-4;

/// A rectangle seen from a place, along its own axes about that.
#[derive(Clone, Copy, Debug)]
pub struct Pane {
    /// Unit vectors along its edges.
    axes: [Vec3; 2],
    /// Unit normal, outwards.
    out: Vec3,
    /// Its corners along its axes.
    low: Vec2,
    high: Vec2,
    /// Distance of its plane.
    away: f32,
    /// Solid angle, sr.
    angle: f32,
    /// The angle at which those begin by which directions are drawn.
    turn: f32,
}

impl Pane {
    /// No opening.
    pub const NONE: Self = Self {
        axes: [Vec3::ZERO; 2],
        out: Vec3::ZERO,
        low: Vec2::ZERO,
        high: Vec2::ZERO,
        away: 0.0,
        angle: 0.0,
        turn: 0.0,
    };

    /// How it looks from a point; `None` from outside, and edge-on.
    pub fn new(rectangle: &Rectangle, point: Vec3) -> Option<Self> {
        let corner = rectangle.corner - point;
        let size = Vec2::from(rectangle.edges.map(Vec3::length));
        let axes = [rectangle.edges[0] / size.x, rectangle.edges[1] / size.y];
        let out = axes[0].cross(axes[1]);
        let low = Vec2::new(corner.dot(axes[0]), corner.dot(axes[1]));
        let away = corner.dot(out);
        let mut this = Self { axes, out, low, high: low + size, away, ..Self::NONE };
        if away <= WITHIN * size.max_element() {
            return None;
        }
        let n = this.normals();
        let cosines = Vec4::from_array([0, 1, 2, 3].map(|k| -n[k] * n[(k + 1) % 4]));
        let sines = (1.0 - cosines * cosines).max(Vec4::ZERO);
        let angles = angles_of(sines.map(f32::sqrt), cosines);
        this.angle = angles.element_sum() - TAU;
        this.turn = TAU - angles.z - angles.w;
        if this.angle < SMALL {
            let square = this.middle().length_squared();
            this.angle = size.x * size.y * away / (square * square.sqrt());
        }
        (this.angle > 0.0).then_some(this)
    }

    /// The components along the rectangle's normal of the unit normals of the planes through the place
    /// and each edge.
    fn normals(&self) -> [f32; 4] {
        let part = |x: f32| x / Vec2::new(x, self.away).length();
        [-part(self.low.y), part(self.high.x), part(self.high.y), -part(self.low.x)]
    }

    /// Its middle, along its axes.
    fn middle(&self) -> Vec3 {
        (0.5 * (self.low + self.high)).extend(self.away)
    }

    /// Solid angle times the mean cosine at a surface, about; 0 below its horizon.
    pub fn worth(&self, normal: Vec3) -> f32 {
        let [x, y] = self.axes;
        let normal = Vec3::new(normal.dot(x), normal.dot(y), normal.dot(self.out));
        let cosine = |place: Vec3| normal.dot(place) / place.length();
        let Self { low, high, .. } = *self;
        let corners = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
        let corners = corners.map(|corner| cosine(corner.extend(self.away)));
        if corners.iter().all(|cosine| *cosine <= 0.0) {
            return 0.0;
        }
        let around: f32 = corners.iter().map(|cosine| cosine.max(0.0)).sum();
        let mean = (around + 2.0 * cosine(self.middle()).max(0.0)) / 6.0;
        self.angle * mean.max(LEAST_COSINE)
    }

    /// A unit direction through it, by two uniform numbers.
    pub fn sample(&self, [u, v]: [f32; 2]) -> Vec3 {
        let place = match self.angle < SMALL {
            true => self.low + (self.high - self.low) * Vec2::new(u, v),
            false => self.place_by_solid_angle([u, v]),
        };
        let [right, up] = self.axes;
        (right * place.x + up * place.y + self.out * self.away).normalize()
    }

    /// A place on it along its axes, uniform in solid angle.
    fn place_by_solid_angle(&self, [u, v]: [f32; 2]) -> Vec2 {
        let n = self.normals();
        let (sine, cosine) = (u * self.angle + self.turn).sin_cos();
        let f = (cosine * n[0] - n[2]) / sine;
        let c = Vec2::new(f, n[0]).length_recip().min(1.0) * f.signum();
        let x = c * self.away / (1.0 - c * c).max(1e-12).sqrt();
        let x = x.clamp(self.low.x, self.high.x);
        let away = Vec2::new(x, self.away).length();
        let [low, high] = [self.low.y, self.high.y].map(|y| y / Vec2::new(y, away).length());
        let h = low + v * (high - low);
        let y = h * away / (1.0 - h * h).max(1e-12).sqrt();
        Vec2::new(x, y.clamp(self.low.y, self.high.y))
    }

    /// Density of [`Pane::sample`], 1/sr, for a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let cosine = self.out.dot(direction);
        let away = self.away / cosine;
        // Also where it runs along the plane.
        if !(away > 0.0 && away.is_finite()) {
            return 0.0;
        }
        let [x, y] = self.axes;
        let at = Vec2::new(x.dot(direction), y.dot(direction)) * away;
        let size = self.high - self.low;
        let along = (at - self.low) / size;
        if along.cmplt(Vec2::splat(-ROUNDING)).any()
            || along.cmpgt(Vec2::splat(1.0 + ROUNDING)).any()
        {
            return 0.0;
        }
        if self.angle >= SMALL {
            return self.angle.recip();
        }
        // A uniform density over the area.
        away * away / (size.x * size.y * cosine.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    fn panes() -> Vec<Pane> {
        let seen = |corner: [f32; 3], edges: [[f32; 3]; 2]| {
            let edges = edges.map(Vec3::from);
            Pane::new(&Rectangle { corner: corner.into(), edges }, Vec3::ZERO).expect("in view")
        };
        vec![
            seen([-0.3, 0.2, 1.0], [[1.0, 0.0, 0.0], [0.0, 0.7, 0.0]]),
            // So near that it fills half of the view.
            seen([-1.0, -1.0, -0.01], [[0.0, 2.0, 0.0], [2.0, 0.0, 0.0]]),
            seen([3.0, 2.0, -1.0], [[0.0, 0.0, 1.5], [0.0, -1.2, 0.0]]),
            // Far away, and almost edge-on.
            seen([30.0, 20.0, -1.0], [[0.0, 0.0, 1.5], [0.0, -1.2, 0.0]]),
            seen([2.0, 0.1, 0.0], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        ]
    }

    /// The solid angle is that of the share of all directions that pass, and the density's integral
    /// is one.
    #[test]
    fn directions_are_uniform_in_solid_angle() {
        let mut numbers = Numbers::new(1, Stream::Light, 0);
        for pane in panes() {
            let [right, up] = pane.axes;
            let place = |at: Vec2| right * at.x + up * at.y + pane.out * pane.away;
            let toward = place(0.5 * (pane.low + pane.high)).normalize();
            const SAMPLES: u32 = 400_000;
            // Directions within the cap about the middle that holds all of it.
            let (low, high) = (pane.low, pane.high);
            let corners = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
            let corners = corners.map(|corner| place(corner).normalize());
            let least = corners.iter().map(|corner| corner.dot(toward)).fold(1.0, f32::min);
            let cap = (1.0 - least).min(2.0);
            let (mut whole, mut angle, mut mean) = (0.0f64, 0.0f64, Vec3::ZERO);
            let mut drawn = Vec3::ZERO;
            for _ in 0..SAMPLES {
                let mut next = || numbers.uniform();
                let below = cap * next();
                let (tangent, _) = crate::sampling::frame(toward, TAU * next());
                let sine = (below * (2.0 - below)).sqrt();
                let direction = (toward * (1.0 - below) + tangent * sine).normalize();
                let pdf = pane.pdf(direction);
                let each = f64::from(TAU * cap) / f64::from(SAMPLES);
                whole += f64::from(pdf) * each;
                if pdf > 0.0 {
                    angle += each;
                    mean += direction * each as f32;
                }
                let direction = pane.sample([next(), next()]);
                assert!(pane.pdf(direction) > 0.0, "{pane:?} {direction}");
                drawn += direction / SAMPLES as f32;
            }
            assert!((whole - 1.0).abs() < 0.02, "{whole} {pane:?}");
            // By which one of several is picked, no more, where it is small.
            let near = if pane.angle < SMALL { 0.1 } else { 0.02 };
            assert!((angle / f64::from(pane.angle) - 1.0).abs() < near, "{angle} {pane:?}");
            let mean = mean / angle as f32;
            assert!((drawn - mean).length() < 0.02, "{drawn} {mean}");
        }
    }

    #[test]
    fn nothing_is_seen_edge_on_from_outside_or_below_the_horizon() {
        let edges = [Vec3::X, Vec3::Z];
        let level = Rectangle { corner: Vec3::new(1.0, 0.0, 0.0), edges };
        assert!(Pane::new(&level, Vec3::ZERO).is_none());
        assert!(Pane::new(&level, Vec3::NEG_Y).is_none());
        let below = Pane::new(&level, Vec3::Y).expect("seen from above");
        assert_eq!(below.worth(Vec3::Y), 0.0);
        assert!(below.worth(Vec3::NEG_Y) > 0.0);
    }
}
