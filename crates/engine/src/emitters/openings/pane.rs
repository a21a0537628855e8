//! A rectangle as it looks from a place: directions through it, uniform in solid angle (Ureña,
//! Fajardo, King: An area-preserving parametrization for spherical rectangles, 2013).

use super::rectangle::Rectangle;
use glam::{Vec2, Vec3};
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

/// A rectangle seen from a place.
#[derive(Clone, Copy, Debug)]
pub struct Pane {
    /// From the place to a corner.
    corner: Vec3,
    edges: [Vec3; 2],
    /// Solid angle, sr.
    angle: f32,
    /// The angle at which those begin by which directions are drawn.
    turn: f32,
}

/// The rectangle along its own axes about the place.
struct Local {
    axes: [Vec3; 2],
    /// Outwards, unit.
    out: Vec3,
    low: Vec2,
    high: Vec2,
    /// Distance of its plane.
    away: f32,
}

impl Local {
    /// The components along the rectangle's normal of the unit normals of the planes through the place
    /// and each edge.
    fn normals(&self) -> [f32; 4] {
        let part = |x: f32| x / x.hypot(self.away);
        [-part(self.low.y), part(self.high.x), part(self.high.y), -part(self.low.x)]
    }
}

impl Pane {
    /// No opening.
    pub const NONE: Self =
        Self { corner: Vec3::ZERO, edges: [Vec3::ZERO; 2], angle: 0.0, turn: 0.0 };

    /// How it looks from a point; `None` from outside, and edge-on.
    pub fn new(rectangle: &Rectangle, point: Vec3) -> Option<Self> {
        let mut this =
            Self { corner: rectangle.corner - point, edges: rectangle.edges, ..Self::NONE };
        let local = this.local();
        let size = local.high - local.low;
        if local.away <= WITHIN * size.max_element() {
            return None;
        }
        let n = local.normals();
        let angles = [0, 1, 2, 3].map(|k| (-n[k] * n[(k + 1) % 4]).clamp(-1.0, 1.0).acos());
        this.angle = angles.iter().sum::<f32>() - TAU;
        this.turn = TAU - angles[2] - angles[3];
        if this.angle < SMALL {
            let middle = this.middle();
            let square = middle.length_squared();
            this.angle = size.x * size.y * local.away / (square * square.sqrt());
        }
        (this.angle > 0.0).then_some(this)
    }

    fn middle(&self) -> Vec3 {
        self.corner + 0.5 * (self.edges[0] + self.edges[1])
    }

    fn local(&self) -> Local {
        let [x, y] = self.edges.map(Vec3::normalize);
        let out = x.cross(y);
        let low = Vec2::new(self.corner.dot(x), self.corner.dot(y));
        let high = low + Vec2::new(self.edges[0].length(), self.edges[1].length());
        Local { axes: [x, y], out, low, high, away: self.corner.dot(out) }
    }

    /// Solid angle times the mean cosine at a surface, about; 0 below its horizon.
    pub fn worth(&self, normal: Vec3) -> f32 {
        let [x, y] = self.edges;
        let cosine = |place: Vec3| normal.dot(place) / place.length();
        let corners = [Vec3::ZERO, x, y, x + y].map(|from| cosine(self.corner + from));
        if corners.iter().all(|cosine| *cosine <= 0.0) {
            return 0.0;
        }
        let around: f32 = corners.iter().map(|cosine| cosine.max(0.0)).sum();
        let mean = (around + 2.0 * cosine(self.middle()).max(0.0)) / 6.0;
        self.angle * mean.max(LEAST_COSINE)
    }

    /// A unit direction through it, by two uniform numbers.
    pub fn sample(&self, [u, v]: [f32; 2]) -> Vec3 {
        if self.angle < SMALL {
            return (self.corner + self.edges[0] * u + self.edges[1] * v).normalize();
        }
        let local = self.local();
        let n = local.normals();
        let (sine, cosine) = (u * self.angle + self.turn).sin_cos();
        let f = (cosine * n[0] - n[2]) / sine;
        let c = f.hypot(n[0]).recip().min(1.0) * f.signum();
        let x = c * local.away / (1.0 - c * c).max(1e-12).sqrt();
        let x = x.clamp(local.low.x, local.high.x);
        let away = x.hypot(local.away);
        let [low, high] = [local.low.y, local.high.y].map(|y| y / y.hypot(away));
        let h = low + v * (high - low);
        let y = h * away / (1.0 - h * h).max(1e-12).sqrt();
        let y = y.clamp(local.low.y, local.high.y);
        let [right, up] = local.axes;
        (right * x + up * y + local.out * local.away).normalize()
    }

    /// Density of [`Pane::sample`], 1/sr, for a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let across = self.edges[0].cross(self.edges[1]);
        let away = across.dot(self.corner) / across.dot(direction);
        // Also where it runs along the plane.
        if !(away > 0.0 && away.is_finite()) {
            return 0.0;
        }
        let at = direction * away - self.corner;
        let inside = self.edges.iter().all(|edge| {
            let along = edge.dot(at) / edge.length_squared();
            (-ROUNDING..=1.0 + ROUNDING).contains(&along)
        });
        if !inside {
            return 0.0;
        }
        if self.angle >= SMALL {
            return self.angle.recip();
        }
        // A uniform density over the area.
        away * away / across.dot(direction).abs()
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
            let toward = pane.middle().normalize();
            const SAMPLES: u32 = 400_000;
            // Directions within the cap about the middle that holds all of it.
            let [x, y] = pane.edges;
            let corners = [Vec3::ZERO, x, y, x + y].map(|from| (pane.corner + from).normalize());
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
