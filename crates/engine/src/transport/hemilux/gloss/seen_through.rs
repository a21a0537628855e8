//! What a camera sees in clear surfaces: behind glass, and mirrored by it.

use super::lobe_at::Way;
use super::lobe_rays::reflected_afresh;
use crate::measurement::Frame;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Hit};
use crate::sampling::Afresh;
use crate::surface::{Differentials, Passage, PassageEnd, World};
use crate::transport::hemilux::coarse::CoarseSolution;
use glam::Vec3;

/// Most holes that a ray passes before what is clear.
const MOST_HOLES: u32 = 64;

/// A ray of a camera's pixel.
#[derive(Clone, Copy)]
pub struct PixelRay {
    /// Of the camera.
    pub frame: Frame,
    /// Rows of the picture.
    pub height: u32,
    /// Its number of all of the pixel's, from 0.
    pub number: u32,
}

impl PixelRay {
    /// Its differentials at a point that it meets, where there are lights that rays seldom find.
    pub fn differentials(&self, coarse: &CoarseSolution, point: Vec3) -> Option<Differentials> {
        let steps = || self.frame.pixel_steps(point, self.height);
        coarse.lights.has_narrow().then(|| Differentials::of_pixel(steps(), self.number))
    }
}

/// What a ray of a camera brings from something clear.
#[derive(Clone, Copy, Default)]
pub struct SeenThrough {
    /// Radiance.
    pub radiance: Rgb,
    /// What of it is of narrow lights by way of clear or polished surfaces, which paths hardly find.
    pub mirrored: Rgb,
    /// 1 over the length of its way, 0 where that leads out of the scene.
    pub nearness: f32,
}

/// Radiance that a camera's ray brings from its first `hit`, which it may see through, without what
/// that surface emits.
pub fn of_camera(
    coarse: &CoarseSolution,
    (hit, ray): (&Hit, PixelRay),
    direction: Vec3,
    numbers: Afresh,
) -> Rgb {
    if coarse.world.is_clear(hit.triangle) {
        return seen_through(coarse, (hit, ray), direction, numbers).radiance;
    }
    let differing = ray.differentials(coarse, coarse.world.rays.spot(hit).point);
    reflected_by_hit(coarse, (hit, differing), direction, numbers)[0]
}

/// The same along a ray from `origin` to a surface that is clear, which some of a pixel's samples saw.
/// Materials in front of it that have holes have let the ray pass: met by chance again, they would
/// show twice.
pub fn behind_holes(
    coarse: &CoarseSolution,
    ([origin, direction], ray): ([Vec3; 2], PixelRay),
    numbers: Afresh,
) -> SeenThrough {
    let world = &*coarse.world;
    let (mut start, mut way) = (origin, 0.0);
    for _ in 0..MOST_HOLES {
        let Some(hit) = world.rays.closest(Eye::Camera, start, direction) else { break };
        if world.is_clear(hit.triangle) || !world.rays.has_holes(hit.triangle) {
            let hit = hit.after(way + hit.distance);
            return seen_through(coarse, (&hit, ray), direction, numbers);
        }
        way += hit.distance;
        start = world.surface_of(&hit).start_behind();
    }
    SeenThrough { radiance: world.beside_surfaces(direction), ..SeenThrough::default() }
}

/// What arrives along a camera's ray from something clear that it has met. The clear surface's own emission is
/// not in it.
///
/// From the first surface the ray goes both ways, so that a lamp mirrored by one part in
/// twenty-five is not found by chance.
fn seen_through(
    coarse: &CoarseSolution,
    (first, ray): (&Hit, PixelRay),
    direction: Vec3,
    numbers: Afresh,
) -> SeenThrough {
    let world = &*coarse.world;
    // Rays through the same place of a pixel are to go different ways.
    let number = numbers.light.x.to_bits() ^ numbers.light.y.to_bits().rotate_left(16);
    let mut seen = SeenThrough::default();
    let differing = ray.differentials(coarse, world.rays.spot(first).point);
    let passages = world.pass_both((*first, differing), direction, number);
    for (passage, differing) in passages.into_iter().flatten() {
        let [radiance, mirrored] = match passage.end {
            PassageEnd::Lost => [Rgb::ZERO; 2],
            PassageEnd::Escaped => beyond(world, &passage, differing),
            PassageEnd::Met(hit) => {
                seen.nearness = seen.nearness.max(1.0 / passage.way.max(1e-3));
                at_the_end(coarse, first, (&hit, &passage, differing), numbers)
            }
        };
        seen.radiance += passage.shine + passage.left * radiance;
        seen.mirrored += passage.left * mirrored;
    }
    seen
}

/// Radiance that comes from beyond the scene along a ray with these differentials, if it has any, and what of it is
/// a sun's that paths hardly find.
fn beyond(world: &World, passage: &Passage, differing: Option<Differentials>) -> [Rgb; 2] {
    let (environment, direction) = (&world.environment, passage.direction);
    let Some(differing) = differing.filter(|_| passage.is_bent) else {
        return [environment.background(direction), Rgb::ZERO];
    };
    let sun = environment.sun.map_or(Rgb::ZERO, |sun| sun.mean_over(direction, differing.seen()));
    [environment.radiance(direction) + sun, sun]
}

/// Radiance of what a way through clear surfaces leads to, of the first surface itself, where that
/// is opaque, without its emission; and what of it is of narrow lights that paths hardly find.
fn at_the_end(
    coarse: &CoarseSolution,
    first: &Hit,
    (hit, passage, differing): (&Hit, &Passage, Option<Differentials>),
    numbers: Afresh,
) -> [Rgb; 2] {
    let [reflected, mirrored] =
        reflected_by_hit(coarse, (hit, differing), passage.direction, numbers);
    if passage.way <= first.distance {
        return [reflected, mirrored];
    }
    let emission = coarse.world.surface(hit).map_or(Rgb::ZERO, |surface| surface.emission);
    [reflected + emission, mirrored]
}

/// Radiance that a hit reflects against the direction of the ray, and what of it is of narrow lights that paths hardly
/// find.
fn reflected_by_hit(
    coarse: &CoarseSolution,
    (hit, differing): (&Hit, Option<Differentials>),
    direction: Vec3,
    numbers: Afresh,
) -> [Rgb; 2] {
    let surface = coarse.world.surface(hit);
    surface.map_or([Rgb::ZERO; 2], |surface| {
        let way = Way { viewer: -direction, is_mapped: false, differing };
        let found = reflected_afresh(coarse, (&surface, hit), way, numbers);
        [found.radiance, found.mirrored]
    })
}
