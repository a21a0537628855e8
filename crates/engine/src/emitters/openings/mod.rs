//! Openings through which dark places of a scene see the sky, as the window of a room: a direction
//! to the sky that is drawn by its light alone ends at a wall 99 times of a hundred there, one
//! towards an opening seldom does.
//!
//! `search` finds them by rays, `places` tells which of them a place sees, and [`Lookout`] draws
//! directions through those.

mod places;
mod search;

use super::sky::SkyLight;
use crate::sampling::frame;
use crate::surface::World;
use glam::Vec3;
use places::{Places, THROUGH_OPENINGS};
use std::f32::consts::TAU;

/// How much larger an opening's ball is made than what of it was found: rays seldom find the
/// corners.
const MARGIN: f32 = 1.25;
/// A place as near to an opening, in its radii, looks out by itself.
const NEAR: f32 = 1.2;
/// Lower bound of the cosine by which openings are picked: a part of one may be higher.
const LEAST_COSINE: f32 = 0.1;
/// Most openings that a place chooses from.
const MOST_SEEN: usize = 8;

/// A ball around places where rays from dark places come into the open, ray units.
#[derive(Clone, Copy, Debug)]
struct Opening {
    center: Vec3,
    radius: f32,
}

/// The openings of a scene.
pub struct Openings {
    openings: Vec<Opening>,
    places: Places,
}

/// The directions through the openings that a place sees, as cones about their balls.
#[derive(Clone, Copy, Debug)]
pub struct Lookout {
    cones: [Cone; MOST_SEEN],
    count: usize,
}

/// The directions towards an opening.
#[derive(Clone, Copy, Debug, Default)]
struct Cone {
    axis: Vec3,
    /// 1 less the cosine of half its opening angle.
    height: f32,
    /// Its solid angle times the cosine at the surface, about.
    worth: f32,
    /// Probability that it is picked.
    probability: f32,
}

impl Openings {
    /// Finds the openings of a world; `None` where no place is dark, or where directions through
    /// openings would find the sky little better than others.
    ///
    /// It takes 33 thousand rays in a scene without dark places and some 300 thousand in others.
    pub fn find(world: &World) -> Option<Self> {
        let sites = search::look_around(world)?;
        let views = search::views_of_dark(world, &sites);
        let openings = search::openings(&views);
        let places = Places::new(world, &sites, &views, &openings)?;
        Some(Self { openings, places })
    }

    /// The directions through openings from a surface at `point` with unit `normal`; `None` where
    /// the sky had better be found without them.
    pub fn seen_from(&self, point: Vec3, normal: Vec3) -> Option<Lookout> {
        let seen = self.places.openings_at(point, normal)?;
        Lookout::new(seen.map(|index| self.openings[index]), point, normal)
    }

    /// Number of openings.
    #[cfg(test)]
    fn count(&self) -> usize {
        self.openings.len()
    }
}

impl Lookout {
    /// The cones from a place towards openings; `None` where all are below the horizon, or one is
    /// so near that it fills much of the view.
    fn new(seen: impl Iterator<Item = Opening>, point: Vec3, normal: Vec3) -> Option<Self> {
        let mut this = Self { cones: [Cone::default(); MOST_SEEN], count: 0 };
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

/// A direction to the sky for a surface with unit `normal`, through one of the openings that it sees
/// for the most part, and its density, 1/sr.
pub fn sample_sky(
    sky: &SkyLight,
    lookout: Option<&Lookout>,
    normal: Vec3,
    xi: Vec3,
) -> (Vec3, f32) {
    let Some(lookout) = lookout else { return sky.sample(normal, [xi.y, xi.z]) };
    let direction = match xi.x < THROUGH_OPENINGS {
        true => lookout.sample(Vec3::new(xi.x / THROUGH_OPENINGS, xi.y, xi.z)),
        false => sky.sample(normal, [xi.y, xi.z]).0,
    };
    (direction, sky_pdf(sky, Some(lookout), normal, direction))
}

/// Density of [`sample_sky`], 1/sr, for a unit direction.
pub fn sky_pdf(sky: &SkyLight, lookout: Option<&Lookout>, normal: Vec3, direction: Vec3) -> f32 {
    let by_light = sky.pdf(normal, direction);
    lookout.map_or(by_light, |lookout| {
        THROUGH_OPENINGS * lookout.pdf(direction) + (1.0 - THROUGH_OPENINGS) * by_light
    })
}

#[cfg(test)]
mod tests;
