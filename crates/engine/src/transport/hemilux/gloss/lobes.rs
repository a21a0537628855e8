//! Glossy reflection seen by the camera: rays by the lobe of every glossy fragment. Neighbouring
//! pixels share these rays as far as the lobes blur what they show (docs/decisions/0024). What they
//! share is radiance over the lobe's albedo, so that textures of colour and metal stay sharp.

use super::lobe_rays::{LobePathNumbers, radiance_by_lobe};
use super::seen_through::seen_through;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::filter::Plane;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::{Reflection, World};
use crate::transport::hemilux::coarse::CoarseSolution;
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

/// Lobe rays of a whole pixel in the first pass, with as many rays to the lights.
const RAYS_PER_PIXEL: f32 = 4.0;
/// Error of the lobes, relative to the mean radiance, that is negligible in the first picture;
/// after n iterations it is this over √n.
const NEGLIGIBLE_ERROR: f64 = 0.004;
/// Factor by which sharing rays with neighbours is taken to lower the variance.
const NEIGHBOUR_VARIANCE_FACTOR: f64 = 0.5;
/// Most lobe rays in a pass, as a multiple of those in the first pass, where lobes scatter most.
const MOST_RAYS_FACTOR: f32 = 16.0;
/// Most lobes that a ray from the camera follows one after the other.
const MOST_LOBES: u32 = 8;
/// Pixels in each direction that share rays.
const NEIGHBOUR_REACH: i32 = 2;
/// Lobes share rays if they look less than 1/√this beside each other, as a share of the angle at
/// which a lobe has fallen to e^−½: half of it. A wider reach flattens highlights on balls.
const NARROWNESS: f32 = 4.0;
/// Lobes share rays if their exponents, at least 1, differ by less than this factor.
const LIKE_EXPONENTS: f32 = 1.3;
/// Least albedo of a lobe that radiance is divided by.
const LEAST_ALBEDO: f32 = 1e-6;
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
    /// Lobes of pixel p: `start[p]..start[p + 1]`.
    start: Vec<u32>,
    /// Passes so far.
    pub passes: u32,
    /// Mean radiance of the picture, by what was known after the first pass.
    pub brightness: f32,
}

/// Sums over the rays of a lobe. Checkpoints store them as they are: the order of the fields is
/// part of the format.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct LobeSums {
    /// Σ radiance over the lobe's albedo.
    radiance: Rgb,
    /// Σ squares of the same.
    squares: Rgb,
    /// Σ albedos of the lobe towards the camera.
    albedo: Rgb,
    /// Σ 1/distance to what they met.
    nearness: f32,
    /// Rays so far.
    pub rays: u32,
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
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.brightness = from.value()?;
        self.sums = from.exactly(self.sums.len())?;
        if self.sums.iter().any(|sums| sums.rays > MOST_RAYS_OF_ALL) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        Ok(())
    }

    /// The lobes that a camera sees, without a ray yet.
    pub fn new(world: &World, visible: &VisibleSurfaces) -> Self {
        let placed = |lobe: &Lobe| {
            let surface = visible.surface(world, lobe, 0);
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
            start,
            passes: 0,
            brightness: 0.0,
        }
    }

    /// Number of lobes.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Whether the lobes' error may matter in the picture after so many iterations, rather than lie
    /// far below that of the rest ([`NEGLIGIBLE_ERROR`]).
    pub fn may_matter(&self, visible: &VisibleSurfaces, iterations: u64) -> bool {
        let chunks = self.sums.par_chunks(1024).zip(visible.lobes.par_chunks(1024));
        let of_chunk = |(sums, lobes): (&[LobeSums], &[Lobe])| {
            let of_lobe = |(sums, lobe): (&LobeSums, &Lobe)| {
                let [_, variance] = sums.reflected(sums.mean(), sums.variance());
                f64::from(visible.share(lobe).powi(2) * variance.element_sum())
            };
            sums.iter().zip(lobes).map(of_lobe).sum::<f64>()
        };
        let sums: Vec<f64> = chunks.map(of_chunk).collect();
        let square =
            NEIGHBOUR_VARIANCE_FACTOR * sums.iter().sum::<f64>() / (3 * visible.shine.len()) as f64;
        let enough = NEGLIGIBLE_ERROR * f64::from(self.brightness);
        square * (iterations + 1) as f64 > enough * enough
    }

    /// Casts another pass of rays: of all lobes alike at first; later, if `adaptive`, by how much
    /// they scatter.
    pub fn pass(
        &mut self,
        coarse: &CoarseSolution,
        visible: &VisibleSurfaces,
        seed: Seed,
        adaptive: bool,
    ) {
        let rays_by_scatter = (adaptive && self.passes > 0).then(|| self.rays_by_scatter(visible));
        let all = self.sums.par_iter_mut().zip(&visible.lobes).enumerate().with_max_len(256);
        all.for_each(|(index, (sums, lobe))| {
            let rays = rays_by_scatter.as_ref().map_or_else(
                || first_pass_rays(visible, lobe),
                |rays_by_scatter| rays_by_scatter[index],
            );
            // Pixels of a tile take the points of a sequence in turn.
            let pixel = visible.fragments[lobe.fragment as usize].pixel;
            let (x, y) = (pixel % visible.width, pixel / visible.width);
            let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
            let sequence = Shifted::new(seed, Stream::Gloss, tile);
            let place = BAYER[(y % 4 * 4 + x % 4) as usize];
            for ray in sums.rays..sums.rays + rays {
                let at = sequence.at(ray.wrapping_mul(16).wrapping_add(place));
                sums.add(trace(coarse, visible, (lobe, ray), &at));
            }
        });
        self.passes += 1;
    }

    /// Rays of each lobe in the next pass: about as many altogether as in the first pass, in
    /// proportion to the standard deviation that each adds to the picture, which minimises variance
    /// (Neyman allocation).
    fn rays_by_scatter(&self, visible: &VisibleSurfaces) -> Vec<u32> {
        let scatter = |lobe: usize| {
            let sums = &self.sums[lobe];
            let [_, variance] = sums.reflected(sums.mean(), sums.variance() * sums.rays as f32);
            visible.share(&visible.lobes[lobe]) * variance.element_sum().sqrt()
        };
        let own: Vec<f32> = (0..self.len()).into_par_iter().map(scatter).collect();
        // Few rays may have missed a highlight that those of a lobe beside it met.
        let around = |lobe: usize| {
            let mut most = own[lobe];
            self.around(visible, lobe, 1, |other, _, _| most = most.max(own[other]));
            most
        };
        let around: Vec<f32> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(around).collect();
        let mean = around.iter().map(|scatter| f64::from(*scatter)).sum::<f64>() as f32
            / self.len() as f32;
        let rays = |(scatter, lobe): (&f32, &Lobe)| {
            let factor = (scatter / mean.max(f32::MIN_POSITIVE)).min(MOST_RAYS_FACTOR);
            (RAYS_PER_PIXEL * factor)
                .round()
                .max(1.0)
                .min(MOST_RAYS_FACTOR * first_pass_rays(visible, lobe) as f32) as u32
        };
        around.iter().zip(&visible.lobes).map(rays).collect()
    }

    /// Radiance that each fragment's lobes reflect to the camera, with its variance; shared between
    /// neighbouring pixels if `filtered`.
    pub fn of_fragments(&self, visible: &VisibleSurfaces, filtered: bool) -> Vec<(Rgb, Rgb)> {
        let own = |lobe| {
            let sums: &LobeSums = &self.sums[lobe];
            let (mean, variance) = match filtered {
                true => self.with_neighbours(visible, lobe),
                false => (sums.mean(), sums.variance()),
            };
            let [mean, variance] = sums.reflected(mean, variance);
            (mean, variance)
        };
        let lobes: Vec<(Rgb, Rgb)> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(own).collect();
        let mut fragments = vec![(Rgb::ZERO, Rgb::ZERO); visible.fragments.len()];
        for (lobe, (mean, own_variance)) in visible.lobes.iter().zip(lobes) {
            let fragment = lobe.fragment as usize;
            let weight = visible.share(lobe) / visible.fragments[fragment].share;
            let (radiance, variance) = &mut fragments[fragment];
            *radiance += mean * weight;
            *variance += own_variance * (weight * weight);
        }
        fragments
    }

    /// Mean and variance of radiance over albedo by a plane fitted through the means of neighbouring lobes that look at
    /// about the same place.
    fn with_neighbours(&self, visible: &VisibleSurfaces, index: usize) -> (Rgb, Rgb) {
        let mine = &self.sums[index];
        let (mean, variance) = (mine.mean(), mine.variance());
        let mut plane = Plane::new();
        plane.add(0, 0, mean, mine.rays as f32);
        self.around(visible, index, NEIGHBOUR_REACH, |other, across, down| {
            let same = self.looks_at_the_same(index, other);
            if same <= 0.0 {
                return;
            }
            let theirs = &self.sums[other];
            let off = (theirs.mean() - mean).length_squared();
            let chance = (variance + theirs.variance()).element_sum();
            let alike = (UNLIKE_VARIANCES - off / chance.max(f32::MIN_POSITIVE))
                / (UNLIKE_VARIANCES - ALIKE_VARIANCES);
            let weight = same * alike.clamp(0.0, 1.0) * theirs.rays as f32;
            if weight > 0.0 {
                plane.add(across, down, theirs.mean(), weight);
            }
        });
        let (value, scatter) = plane.center();
        (value, scatter.unwrap_or(variance))
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
        let nearness = |lobe: usize| self.sums[lobe].nearness / self.sums[lobe].rays.max(1) as f32;
        let nearness = 0.5 * (nearness(one) + nearness(other));
        let between = (b.point - a.point) * nearness + (b.direction - a.direction);
        let across = between - a.direction * a.direction.dot(between);
        1.0 - (across.length_squared() * most.max(1.0) * NARROWNESS).min(1.0)
    }
}

/// What a ray of a lobe found.
struct Found {
    /// Radiance over the lobe's albedo.
    radiance: Rgb,
    /// Albedo of the lobe towards the camera; 1 of what is clear.
    albedo: Rgb,
    /// 1/distance to what it met.
    nearness: f32,
}

/// Traces a ray of a lobe, by its number.
fn trace(
    coarse: &CoarseSolution,
    visible: &VisibleSurfaces,
    (lobe, ray): (&Lobe, u32),
    at: &Shifted,
) -> Found {
    let surface = visible.surface(&coarse.world, lobe, ray);
    if coarse.world.is_clear(surface.triangle) {
        let (origin, direction) = visible.lobe_ray(lobe, ray);
        let (radiance, nearness) = seen_through(coarse, origin, direction, at.afresh());
        return Found { radiance, albedo: Rgb::ONE, nearness };
    }
    let viewer = visible.frame.towards_eye(surface.spot.point);
    let path_numbers = LobePathNumbers {
        xi: at.pair(),
        numbers: at.afresh(),
        most_lobes: MOST_LOBES,
        is_mapped: false,
    };
    let (radiance, nearness) = radiance_by_lobe(coarse, surface, viewer, path_numbers);
    let albedo = surface.lobe_only().reflection().albedo(viewer);
    Found { radiance: radiance / albedo.max(Rgb::splat(LEAST_ALBEDO)), albedo, nearness }
}

impl LobeSums {
    fn add(&mut self, found: Found) {
        self.radiance += found.radiance;
        self.squares += found.radiance * found.radiance;
        self.albedo += found.albedo;
        self.nearness += found.nearness;
        self.rays += 1;
    }

    fn mean(&self) -> Rgb {
        self.radiance / self.rays.max(1) as f32
    }

    /// What the lobe reflects of radiance with that mean and variance, by its mean albedo: mean and
    /// variance.
    fn reflected(&self, mean: Rgb, variance: Rgb) -> [Rgb; 2] {
        let albedo = self.albedo / self.rays.max(1) as f32;
        [mean * albedo, variance * albedo * albedo]
    }

    /// Variance of the mean.
    fn variance(&self) -> Rgb {
        let (count, mean) = (self.rays.max(2) as f32, self.mean());
        (self.squares / count - mean * mean).max(Rgb::ZERO) / (count - 1.0)
    }
}

/// Rays of the first pass: by the share of the pixel, and as many as a variance takes.
fn first_pass_rays(visible: &VisibleSurfaces, lobe: &Lobe) -> u32 {
    (RAYS_PER_PIXEL * visible.share(lobe)).ceil().max(2.0) as u32
}
