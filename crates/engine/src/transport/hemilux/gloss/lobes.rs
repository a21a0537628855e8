//! Glossy reflection seen by the camera: rays by the lobe of every glossy fragment. Neighbouring
//! pixels share these rays as far as the lobes blur what they show (docs/decisions/0024). What they
//! share is radiance over the lobe's albedo, so that textures of colour and metal stay sharp.

use super::lobe_rays::{LobePathNumbers, LobeRadiance, albedo_towards, radiance_by_lobe};
use super::open_sky;
use super::seen_through::seen_through;
use super::sums::{Found, LobeSums, open_factor};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::filter::Plane;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::{Reflection, World};
use crate::transport::hemilux::coarse::CoarseSolution;
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::GOLDEN_RATIO;

/// Lobe rays of a whole pixel in a pass, with as many rays to the lights.
const RAYS_PER_PIXEL: f32 = 2.0;
/// Rays of each lobe in the first pass: as few as tell scatter, by which the passes after it find where
/// rays are worth their time.
const FIRST_RAYS: u32 = 2;
/// Batches of directions to an open sky of a lobe that sees any, in the first pass.
const FIRST_BATCHES: u32 = 1;
/// Time of such a batch, in that of a ray with its ray to the lights.
const BATCH_COST: f32 = 1.5;
/// Rays from which on a lobe may have none in a pass.
const RAYS_TO_REST: u32 = 8;
/// Error of the lobes, relative to the mean radiance, that is negligible in the first picture;
/// after n iterations it is this over √n.
const NEGLIGIBLE_ERROR: f64 = 0.006;
/// Of more lobes than so many, some are asked for their error.
const MOST_LOOKED_AT: usize = 4096;
/// Each so-manieth of them then: no multiple of the pixels in a row of most pictures.
const LOOKED_AT_EVERY: usize = 13;
/// Most lobe rays in a pass, as a multiple of the mean, where lobes scatter most.
const MOST_RAYS_FACTOR: f32 = 128.0;
/// Pixels in each direction that share rays.
const NEIGHBOUR_REACH: i32 = 2;
/// Lobes share rays if they look less than 1/√this beside each other, as a share of the angle at
/// which a lobe has fallen to e^−½: half of it. A wider reach flattens highlights on balls.
const NARROWNESS: f32 = 4.0;
/// Lobes share rays if their exponents, at least 1, differ by less than this factor.
const LIKE_EXPONENTS: f32 = 1.3;
/// Squared difference between two neighbours' means, in units of its variance, up to which they
/// count in full: 2.4 standard deviations. As with shadows.
const ALIKE_VARIANCES: f32 = 6.0;
/// The same from which they do not count: 4.9 standard deviations.
const UNLIKE_VARIANCES: f32 = 24.0;

/// Bound on rays of a lobe read from a checkpoint: more than any run traces, so a larger number
/// means damage.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// Light that the lobes of glossy fragments reflect towards the camera.
pub struct Gloss {
    lobes: Vec<PlacedLobe>,
    /// Of each of [`VisibleSurfaces::lobes`].
    sums: Vec<LobeSums>,
    /// Of each of them, by how much its mean is corrected for the open sky; empty where there is none.
    factors: Vec<f32>,
    /// Lobes of pixel p: `start[p]..start[p + 1]`.
    start: Vec<u32>,
    /// Passes so far.
    pub passes: u32,
    /// Mean radiance of the picture, by what was known after the first pass.
    pub brightness: f32,
}

/// A value that neighbours share as far as theirs are alike.
struct Shared {
    plane: Plane,
    /// The lobe's own mean.
    mean: Rgb,
    /// And its variance, summed over the channels.
    variance: f32,
}

impl Shared {
    fn new((mean, variance): (Rgb, f32)) -> Self {
        Self { plane: Plane::new(), mean, variance }
    }

    /// Adds that of a neighbour, so many pixels to the right and down, unless chance does not explain
    /// by how much it differs.
    fn add(&mut self, [across, down]: [i32; 2], (mean, variance): (Rgb, f32), weight: f32) {
        let off = (mean - self.mean).length_squared();
        let chance = self.variance + variance;
        let alike = (UNLIKE_VARIANCES - off / chance.max(f32::MIN_POSITIVE))
            / (UNLIKE_VARIANCES - ALIKE_VARIANCES);
        let weight = weight * alike.clamp(0.0, 1.0);
        if weight > 0.0 {
            self.plane.add(across, down, mean, weight);
        }
    }

    /// The plane's value and its variance.
    fn center(self) -> (Rgb, f32) {
        let (value, scatter) = self.plane.center();
        (value, scatter.map_or(self.variance, Rgb::element_sum))
    }
}

/// What a lobe gets in a pass.
#[derive(Clone, Copy)]
struct Work {
    /// Rays.
    rays: u32,
    /// Batches of directions to an open sky, if it sees any.
    batches: u32,
}

/// The lobe of a fragment: its place, and the mirrored direction to the camera.
#[derive(Clone, Copy)]
struct PlacedLobe {
    point: Vec3,
    /// Unit vector.
    direction: Vec3,
    exponent: f32,
}

impl Gloss {
    /// Writes what the rays found.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.passes);
        to.value(self.brightness);
        to.slice(&self.sums);
    }

    /// Reads what [`Gloss::save`] wrote of the same lobes.
    pub fn restore(
        &mut self,
        visible: &VisibleSurfaces,
        from: &mut Reader<'_>,
    ) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.brightness = from.value()?;
        self.sums = from.exactly(self.sums.len())?;
        if !self.sums.iter().all(|sums| sums.is_possible(MOST_RAYS_OF_ALL)) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        self.find_factors(visible);
        Ok(())
    }

    /// The lobes that a camera sees, without a ray yet.
    pub fn new(world: &World, visible: &VisibleSurfaces) -> Self {
        let placed = |lobe: &Lobe| {
            let surface = visible.surface(world, lobe, (0, 0));
            let viewer = visible.frame.towards_eye(surface.spot.point);
            let exponent = surface
                .clear
                .map_or_else(|| surface.reflection().exponent(), |clear| clear.exponent());
            PlacedLobe { point: surface.spot.point, direction: surface.mirrored(viewer), exponent }
        };
        let lobes: Vec<PlacedLobe> =
            visible.lobes.par_iter().with_min_len(1024).map(placed).collect();
        let mut start = Vec::new();
        if !lobes.is_empty() {
            start = vec![0; visible.shine.len() + 1];
            for lobe in &visible.lobes {
                start[visible.fragments[lobe.fragment as usize].pixel as usize + 1] += 1;
            }
            for pixel in 1..start.len() {
                start[pixel] += start[pixel - 1];
            }
        }
        Self {
            sums: vec![LobeSums::default(); lobes.len()],
            lobes,
            factors: Vec::new(),
            start,
            passes: 0,
            brightness: 0.0,
        }
    }

    /// Time of all that was done so far, in that of a ray with its ray to the lights.
    pub fn cost(&self) -> f64 {
        let of =
            |sums: &LobeSums| f64::from(sums.rays) + f64::from(BATCH_COST * sums.batches as f32);
        self.sums.iter().map(of).sum()
    }

    /// Rays so far, each with one to the lights.
    pub fn rays(&self) -> u64 {
        self.sums.iter().map(|sums| u64::from(sums.rays)).sum()
    }

    /// Number of lobes.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Whether the lobes' error may matter in the picture after so many iterations, rather than lie
    /// far below that of the rest ([`NEGLIGIBLE_ERROR`]): by what some of them show, shared with
    /// their neighbours if `filtered`.
    pub fn may_matter(&self, visible: &VisibleSurfaces, iterations: u64, filtered: bool) -> bool {
        let of_lobe = |lobe: usize| {
            let [_, variance] = self.shown(visible, lobe, filtered);
            let lobe = &visible.lobes[lobe];
            let factor = visible.fragments[lobe.fragment as usize].lobe_factor;
            let share = visible.share(lobe);
            f64::from(share * share * (factor * factor * variance).element_sum())
        };
        let step = if self.len() > MOST_LOOKED_AT { LOOKED_AT_EVERY } else { 1 };
        let lobes: Vec<usize> = (0..self.len()).step_by(step).collect();
        let variances: Vec<f64> = lobes.into_par_iter().map(of_lobe).collect();
        let all = variances.iter().sum::<f64>() * step as f64 / (3 * visible.shine.len()) as f64;
        let enough = NEGLIGIBLE_ERROR * f64::from(self.brightness);
        all * (iterations + 1) as f64 > enough * enough
    }

    /// Casts another pass of rays: of all lobes alike at first; later, if `adaptive`, by how much
    /// they scatter, and then, about, no more than `most` of [`Gloss::cost`] altogether.
    pub fn pass(
        &mut self,
        coarse: &CoarseSolution,
        visible: &VisibleSurfaces,
        (seed, adaptive): (Seed, bool),
        most: f64,
    ) {
        let share = most / (f64::from(RAYS_PER_PIXEL) * self.len() as f64).max(1.0);
        let share = share.min(1.0) as f32;
        let work_by_scatter =
            (adaptive && self.passes > 0).then(|| self.work_by_scatter(visible, share));
        let all = self.sums.par_iter_mut().zip(&visible.lobes).enumerate().with_max_len(256);
        all.for_each(|(index, (sums, lobe))| {
            let work = work_by_scatter.as_ref().map_or_else(
                || Work { rays: FIRST_RAYS, batches: FIRST_BATCHES },
                |work_by_scatter| work_by_scatter[index],
            );
            // Pixels of a tile take the points of a sequence in turn.
            let pixel = visible.fragments[lobe.fragment as usize].pixel;
            let (x, y) = (pixel % visible.width, pixel / visible.width);
            let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
            let sequence = Shifted::new(seed, Stream::Gloss, tile);
            let place = BAYER[(y % 4 * 4 + x % 4) as usize];
            for ray in sums.rays..sums.rays + work.rays {
                let at = sequence.at(ray.wrapping_mul(16).wrapping_add(place));
                sums.add(trace(coarse, visible, (lobe, ray), &at));
            }
            if !sums.sees_sky() {
                return;
            }
            let sequence = Shifted::new(seed, Stream::OpenLobe, u64::from(pixel));
            for batch in sums.batches..sums.batches + work.batches {
                let lit = (&*coarse.world, &*coarse.lights);
                let (mean, albedo) = open_sky::batch(lit, visible, (lobe, batch), &sequence);
                sums.add_batch(mean, albedo);
            }
        });
        self.passes += 1;
        self.find_factors(visible);
    }

    /// Finds by how much each lobe's mean is corrected for the open sky: as the rays of those beside
    /// it say, or its own where there are none.
    fn find_factors(&mut self, visible: &VisibleSurfaces) {
        if !self.sums.iter().any(LobeSums::knows_open_sky) {
            return;
        }
        let covariances: Vec<[f32; 2]> = self.sums.par_iter().map(LobeSums::covariance).collect();
        let factor = |lobe: usize| {
            if !self.sums[lobe].knows_open_sky() {
                return 0.0;
            }
            let mut beside = Vec::new();
            self.around(visible, lobe, 1, |other, _, _| beside.push(covariances[other]));
            if beside.is_empty() {
                beside.push(covariances[lobe]);
            }
            open_factor(beside.into_iter())
        };
        self.factors = (0..self.len()).into_par_iter().with_min_len(1024).map(factor).collect();
    }

    fn factor(&self, lobe: usize) -> f32 {
        self.factors.get(lobe).copied().unwrap_or_default()
    }

    /// Mean and variance, summed over the channels, of radiance over albedo by a lobe's own rays.
    fn own(&self, lobe: usize) -> (Rgb, f32) {
        let (sums, factor) = (&self.sums[lobe], self.factor(lobe));
        let ((rest, rest_variance), (open, open_variance)) = (sums.rest(factor), sums.open_sky());
        (rest + factor * open, rest_variance + factor * factor * open_variance)
    }

    /// Work at each lobe in the next pass: about as much altogether in each, or this share of it, in
    /// proportion to the standard deviation that each adds to the picture, which minimises variance
    /// (Neyman allocation).
    fn work_by_scatter(&self, visible: &VisibleSurfaces, share: f32) -> Vec<Work> {
        // Of a ray, and of a batch of directions to an open sky.
        let scatter = |lobe: usize| {
            let sums = &self.sums[lobe];
            let factor = self.factor(lobe);
            [sums.ray_variance(factor), sums.batch_variance(factor)]
                .map(|variance| visible.share(&visible.lobes[lobe]) * variance.sqrt())
        };
        let own: Vec<[f32; 2]> = (0..self.len()).into_par_iter().map(scatter).collect();
        // By what those beside it found, not its own rays: dark ones, which have missed a highlight,
        // would get no more and remain dark, while bright ones would be corrected.
        let around = |lobe: usize| {
            let (mut squares, mut count) = ([0.0; 2], 0.0);
            self.around(visible, lobe, NEIGHBOUR_REACH, |other, _, _| {
                for (sum, scatter) in squares.iter_mut().zip(own[other]) {
                    *sum += scatter * scatter;
                }
                count += 1.0;
            });
            let scatter = match count > 0.0 {
                true => squares.map(|sum| (sum / count).sqrt()),
                false => own[lobe],
            };
            [scatter[0], scatter[1] / BATCH_COST.sqrt()]
        };
        let around: Vec<[f32; 2]> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(around).collect();
        let cost = |[ray, batch]: &[f32; 2]| f64::from(ray + BATCH_COST * batch);
        let mean = around.iter().map(cost).sum::<f64>() as f32 / self.len() as f32;
        let work = |(index, [ray, batch]): (usize, &[f32; 2])| {
            let (lobe, sums) = (&visible.lobes[index], &self.sums[index]);
            let times = |scatter: &f32| {
                let times = (scatter / mean.max(f32::MIN_POSITIVE)).min(MOST_RAYS_FACTOR);
                share * RAYS_PER_PIXEL * times
            };
            // Rounded up or down in turn, so that what is worth a fourth of a ray gets one in every
            // fourth pass.
            let turn = GOLDEN_RATIO * (index as f64 + f64::from(self.passes));
            let rounded = |times: f32| (times + turn.fract() as f32).floor();
            let least = if sums.rays < RAYS_TO_REST && share == 1.0 { 1.0 } else { 0.0 };
            let most = MOST_RAYS_FACTOR * mean_rays(visible, lobe) as f32;
            let rays = rounded(times(ray)).max(least).min(most) as u32;
            Work { rays, batches: rounded(times(batch)).max(least) as u32 }
        };
        around.iter().enumerate().map(work).collect()
    }

    /// Radiance that each fragment's lobes reflect to the camera, with its variance; shared between
    /// neighbouring pixels if `filtered`.
    pub fn of_fragments(&self, visible: &VisibleSurfaces, filtered: bool) -> Vec<(Rgb, Rgb)> {
        let own = |lobe| {
            let [mean, variance] = self.shown(visible, lobe, filtered);
            (mean.max(Rgb::ZERO), variance)
        };
        let lobes: Vec<(Rgb, Rgb)> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(own).collect();
        let mut fragments = vec![(Rgb::ZERO, Rgb::ZERO); visible.fragments.len()];
        // A fragment has one lobe, and the lobe all of its share, which rays at edges refine.
        for (lobe, own) in visible.lobes.iter().zip(lobes) {
            fragments[lobe.fragment as usize] = own;
        }
        fragments
    }

    /// Radiance that a lobe reflects to the camera, and its variance; shared with those of
    /// neighbouring pixels if `filtered`.
    fn shown(&self, visible: &VisibleSurfaces, lobe: usize, filtered: bool) -> [Rgb; 2] {
        let (mean, variance) = match filtered {
            true => self.with_neighbours(visible, lobe),
            false => self.own(lobe),
        };
        self.sums[lobe].reflected(mean, variance)
    }

    /// Mean and variance, summed over the channels, of radiance over albedo by planes fitted through
    /// those of neighbouring lobes that look at about the same place: one through what rays find
    /// beside the open sky's share, the other through the open sky.
    fn with_neighbours(&self, visible: &VisibleSurfaces, index: usize) -> (Rgb, f32) {
        let (mine, factor) = (&self.sums[index], self.factor(index));
        let (mut rest, mut open) = (Shared::new(mine.rest(factor)), Shared::new(mine.open_sky()));
        rest.plane.add(0, 0, rest.mean, mine.rays as f32);
        open.plane.add(0, 0, open.mean, mine.batches as f32);
        self.around(visible, index, NEIGHBOUR_REACH, |other, across, down| {
            let same = self.looks_at_the_same(index, other);
            if same <= 0.0 {
                return;
            }
            let theirs = &self.sums[other];
            rest.add([across, down], theirs.rest(factor), same * theirs.rays as f32);
            if factor > 0.0 {
                open.add([across, down], theirs.open_sky(), same * theirs.batches as f32);
            }
        });
        let (mean, variance) = rest.center();
        if factor == 0.0 {
            return (mean, variance);
        }
        let (open, open_variance) = open.center();
        (mean + factor * open, variance + factor * factor * open_variance)
    }

    /// Calls `each` with the lobes of neighbouring pixels, and how many pixels they are to the
    /// right and down.
    fn around(
        &self,
        visible: &VisibleSurfaces,
        index: usize,
        reach: i32,
        mut each: impl FnMut(usize, i32, i32),
    ) {
        let pixel = visible.fragments[visible.lobes[index].fragment as usize].pixel;
        let (x, y) = ((pixel % visible.width) as i32, (pixel / visible.width) as i32);
        let (width, height) = (visible.width as i32, visible.height as i32);
        for row in (y - reach).max(0)..=(y + reach).min(height - 1) {
            for column in (x - reach).max(0)..=(x + reach).min(width - 1) {
                let near = (row * width + column) as usize;
                if near == pixel as usize {
                    continue;
                }
                for other in self.start[near] as usize..self.start[near + 1] as usize {
                    each(other, column - x, row - y);
                }
            }
        }
    }

    /// Weight of two lobes for each other: 1 where they look at the same place, 0 where they look
    /// half a lobe's width beside each other. The place is as far away as the harmonic mean
    /// distance of their rays.
    fn looks_at_the_same(&self, one: usize, other: usize) -> f32 {
        let (a, b) = (&self.lobes[one], &self.lobes[other]);
        let [least, most] = [a.exponent.min(b.exponent), a.exponent.max(b.exponent)];
        if most.max(1.0) > least.max(1.0) * LIKE_EXPONENTS {
            return 0.0;
        }
        let nearness = 0.5 * (self.sums[one].nearness() + self.sums[other].nearness());
        let between = (b.point - a.point) * nearness + (b.direction - a.direction);
        let across = between - a.direction * a.direction.dot(between);
        1.0 - (across.length_squared() * most.max(1.0) * NARROWNESS).min(1.0)
    }
}

/// Traces a ray of a lobe, by its number.
fn trace(
    coarse: &CoarseSolution,
    visible: &VisibleSurfaces,
    (lobe, ray): (&Lobe, u32),
    at: &Shifted,
) -> Found {
    let surface = visible.surface(&coarse.world, lobe, (ray, ray));
    if coarse.world.is_clear(surface.triangle) {
        let (origin, direction) = visible.lobe_ray(lobe, ray);
        let (radiance, nearness) = seen_through(coarse, origin, direction, at.afresh());
        let (sky, open_sky) = (Rgb::ZERO, Rgb::ZERO);
        return Found { radiance, sky, open_sky, albedo: Rgb::ONE, nearness };
    }
    let viewer = visible.frame.towards_eye(surface.spot.point);
    let path_numbers = LobePathNumbers {
        xi: at.pair(),
        numbers: at.afresh(),
        tells_open_sky: coarse.lights.has_sky(),
        is_mapped: false,
    };
    let LobeRadiance { radiance, sky, open_sky, nearness } =
        radiance_by_lobe(coarse, surface, viewer, path_numbers);
    let albedo = albedo_towards(&surface.lobe_only(), viewer);
    Found { radiance, sky, open_sky, albedo, nearness }
}

/// Rays of a lobe in a pass if all scatter alike: by the share of the pixel.
fn mean_rays(visible: &VisibleSurfaces, lobe: &Lobe) -> u32 {
    (RAYS_PER_PIXEL * visible.share(lobe)).ceil().max(FIRST_RAYS as f32) as u32
}
