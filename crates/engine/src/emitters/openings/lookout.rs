//! The directions through openings that a place sees.

use crate::sampling::frame;
use glam::Vec3;
use std::f32::consts::TAU;

/// A place as near to an opening, in its radii, looks out by itself.
const NEAR: f32 = 1.2;
/// Lower bound of the cosine by which openings are picked: a part of one may be higher.
const LEAST_COSINE: f32 = 0.1;
/// Most openings that a place chooses from.
pub const MOST_SEEN: usize = 8;

/// A ball around places where rays from dark places come into the open, ray units.
#[derive(Clone, Copy, Debug)]
pub struct Opening {
    /// Of the ball.
    pub center: Vec3,
    /// Of the ball.
    pub radius: f32,
}

/// The directions through the openings that a place sees, as cones about their balls.
#[derive(Clone, Copy, Debug)]
pub struct Lookout {
    cones: [Cone; MOST_SEEN],
    count: usize,
    /// Whether any opening is known to be seen, with a cone or without.
    sees_any: bool,
}

/// The directions towards an opening.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: Vec3,
    /// 1 less the cosine of half its opening angle.
    height: f32,
    /// Its solid angle times the cosine at the surface, about.
    worth: f32,
    /// Probability that it is picked.
    probability: f32,
}

impl Lookout {
    /// The cones from a place towards openings; `None` where all are below the horizon, or one is
    /// so near that it fills much of the view.
    pub fn new(seen: impl Iterator<Item = Opening>, point: Vec3, normal: Vec3) -> Option<Self> {
        let mut this = Self::without_cones(true);
        let mut all = 0.0;
        for opening in seen.take(MOST_SEEN) {
            let between = opening.center - point;
            let distance = between.length();
            if distance <= NEAR * opening.radius {
                return None;
            }
            let height_above = normal.dot(between);
            if height_above <= -opening.radius {
                continue;
            }
            let sine = opening.radius / distance;
            // 1 − √(1 − sin²) without cancellation.
            let height = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
            let worth = TAU * height * (height_above / distance).max(LEAST_COSINE);
            this.cones[this.count] =
                Cone { axis: between / distance, height, worth, probability: 0.0 };
            this.count += 1;
            all += worth;
        }
        for cone in &mut this.cones[..this.count] {
            cone.probability = cone.worth / all;
        }
        (this.count > 0).then_some(this)
    }

    /// Of a dark place where no cones help: the sky's own directions have to do. Whether any opening is
    /// seen from there.
    pub fn without_cones(sees_any: bool) -> Self {
        Self { cones: [Cone::NONE; MOST_SEEN], count: 0, sees_any }
    }

    /// Whether there are cones.
    pub fn has_cones(&self) -> bool {
        self.count > 0
    }

    /// Whether any opening is seen.
    pub fn sees_any(&self) -> bool {
        self.sees_any
    }

    /// A unit direction through one of the openings, by three uniform numbers.
    pub fn sample(&self, xi: Vec3) -> Vec3 {
        let cones = &self.cones[..self.count];
        let mut sum = 0.0;
        let picked = cones.iter().find(|cone| {
            sum += cone.probability;
            xi.x < sum
        });
        picked.unwrap_or(&cones[self.count - 1]).sample([xi.y, xi.z])
    }

    /// Density of [`Lookout::sample`], 1/sr, for a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.cones[..self.count].iter().map(|cone| cone.pdf(direction)).sum()
    }
}

impl Cone {
    const NONE: Self = Self { axis: Vec3::ZERO, height: 0.0, worth: 0.0, probability: 0.0 };

    /// A direction in it, uniform in solid angle.
    fn sample(&self, [x, y]: [f32; 2]) -> Vec3 {
        let below = self.height * x;
        let sine = (below * (2.0 - below)).max(0.0).sqrt();
        let (tangent, _) = frame(self.axis, TAU * y);
        (self.axis * (1.0 - below) + tangent * sine).normalize()
    }

    fn pdf(&self, direction: Vec3) -> f32 {
        // 1 − cos = |difference|²/2, which small angles need.
        let below = 0.5 * (direction - self.axis).length_squared();
        if below <= self.height { self.probability / (TAU * self.height) } else { 0.0 }
    }
}
