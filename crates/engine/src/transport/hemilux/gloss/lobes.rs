//! Gloss: what the lobes of the fragments show of the scene, by rays pixel by pixel. Neighbouring
//! pixels share their rays as far as the lobes blur what they show.

use super::lobe_rays::{Through, reflected};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::filter::Plane;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::{Reflection, World};
use crate::transport::hemilux::coarse::Coarse;
use crate::transport::hemilux::fragments::{Lobe, Seen};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

/// Lobe rays of a whole pixel in each pass, and as many to the lights.
const RAYS: f32 = 4.0;
/// An error of the first picture that is small beside the rest of its, and how much neighbours lower
/// the variance.
const ENOUGH: f64 = 0.004;
const HELPED: f64 = 0.5;
/// Where lobes scatter most, up to so many times as many.
const MOST_WORTH: f32 = 16.0;
/// Lobes that a ray follows from one to the next.
const MOST_LOBES: u32 = 8;
/// Pixels around, in each direction, that share rays.
const AROUND: i32 = 2;
/// What a lobe does not resolve: 1/√this of the angle where it has fallen to e^−½.
const NARROW: f32 = 4.0;
/// Squared differences of neighbours, in variances, up to which they count in full, and from which
/// they don't.
const ALIKE: f32 = 6.0;
const UNLIKE: f32 = 24.0;

/// Rays of a lobe that no run comes to.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// Light that the lobes of glossy fragments reflect towards the camera.
pub struct Gloss {
    lobes: Vec<Mirror>,
    /// Of each of [`Seen::lobes`].
    sums: Vec<LobeSums>,
    /// Lobes of pixel p: `start[p]..start[p + 1]`.
    start: Vec<u32>,
    /// Passes so far.
    pub passes: u32,
    /// Mean radiance of the picture, by what was known after the first pass.
    pub brightness: f32,
}

/// What the rays of a lobe found.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct LobeSums {
    /// Σ radiance.
    radiance: Rgb,
    /// Σ squared radiance.
    squares: Rgb,
    /// Σ 1/distance to what they met.
    nearness: f32,
    /// Rays so far.
    pub rays: u32,
}

/// Where a lobe looks.
#[derive(Clone, Copy)]
struct Mirror {
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

    /// Takes what [`Gloss::save`] wrote of the same lobes.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.brightness = from.value()?;
        self.sums = from.exactly(self.sums.len())?;
        if self.sums.iter().any(|sums| sums.rays > MOST_RAYS_OF_ALL) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        Ok(())
    }

    /// Without a ray.
    pub fn new(world: &World, seen: &Seen) -> Self {
        let mirror = |lobe: &Lobe| {
            let surface = seen.surface(world, lobe, 0);
            let viewer = seen.frame.towards_eye(surface.spot.point);
            Mirror {
                point: surface.spot.point,
                direction: surface.mirrored(viewer),
                exponent: surface.reflection().exponent(),
            }
        };
        let lobes: Vec<Mirror> = seen.lobes.par_iter().with_min_len(1024).map(mirror).collect();
        let mut start = Vec::new();
        if !lobes.is_empty() {
            start = vec![0; seen.shine.len() + 1];
            for lobe in &seen.lobes {
                start[seen.fragments[lobe.fragment as usize].pixel as usize + 1] += 1;
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

    /// Whether lobes may matter for the picture's error after so many iterations: what is far below
    /// the error of the rest can wait.
    pub fn matters(&self, seen: &Seen, iterations: u64) -> bool {
        let chunks = self.sums.par_chunks(1024).zip(seen.lobes.par_chunks(1024));
        let of_chunk = |(sums, lobes): (&[LobeSums], &[Lobe])| {
            let of_lobe = |(sums, lobe): (&LobeSums, &Lobe)| {
                f64::from(seen.share(lobe).powi(2) * sums.variance().element_sum())
            };
            sums.iter().zip(lobes).map(of_lobe).sum::<f64>()
        };
        let sums: Vec<f64> = chunks.map(of_chunk).collect();
        let square = HELPED * sums.iter().sum::<f64>() / (3 * seen.shine.len()) as f64;
        let enough = ENOUGH * f64::from(self.brightness);
        square * (iterations + 1) as f64 > enough * enough
    }

    /// Casts another pass of rays: of all lobes alike at first; later, if `adaptive`, by how much
    /// they scatter.
    pub fn pass(&mut self, coarse: &Coarse, seen: &Seen, seed: Seed, adaptive: bool) {
        let wanted = (adaptive && self.passes > 0).then(|| self.wanted(seen));
        let all = self.sums.par_iter_mut().zip(&seen.lobes).enumerate().with_max_len(256);
        all.for_each(|(index, (sums, lobe))| {
            let rays = wanted.as_ref().map_or_else(|| rays(seen, lobe), |wanted| wanted[index]);
            // Pixels of a tile take the points of a sequence in turn.
            let pixel = seen.fragments[lobe.fragment as usize].pixel;
            let (x, y) = (pixel % seen.width, pixel / seen.width);
            let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
            let sequence = Shifted::new(seed, Stream::Gloss, tile);
            let place = BAYER[(y % 4 * 4 + x % 4) as usize];
            for ray in sums.rays..sums.rays + rays {
                let at = sequence.at(ray.wrapping_mul(16).wrapping_add(place));
                let surface = seen.surface(&coarse.world, lobe, ray);
                let viewer = seen.frame.towards_eye(surface.spot.point);
                let through = Through { xi: at.pair(), numbers: at.afresh(), most: MOST_LOBES };
                let (radiance, nearness) = reflected(coarse, surface, viewer, through);
                sums.radiance += radiance;
                sums.squares += radiance * radiance;
                sums.nearness += nearness;
            }
            sums.rays += rays;
        });
        self.passes += 1;
    }

    /// Rays of each lobe in the next pass: as many together as if all had the same, spread so that
    /// the variance of the picture gets least.
    fn wanted(&self, seen: &Seen) -> Vec<u32> {
        let scatter = |lobe: usize| {
            let variance = self.sums[lobe].variance() * self.sums[lobe].rays as f32;
            seen.share(&seen.lobes[lobe]) * variance.element_sum().sqrt()
        };
        let own: Vec<f32> = (0..self.len()).into_par_iter().map(scatter).collect();
        // What the few rays of a lobe missed those beside it may have met.
        let around = |lobe: usize| {
            let mut most = own[lobe];
            self.around(seen, lobe, 1, |other, _, _| most = most.max(own[other]));
            most
        };
        let around: Vec<f32> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(around).collect();
        let mean = around.iter().map(|scatter| f64::from(*scatter)).sum::<f64>() as f32
            / self.len() as f32;
        let rays = |(scatter, lobe): (&f32, &Lobe)| {
            let worth = (scatter / mean.max(f32::MIN_POSITIVE)).min(MOST_WORTH);
            (RAYS * worth).round().max(1.0).min(MOST_WORTH * rays(seen, lobe) as f32) as u32
        };
        around.iter().zip(&seen.lobes).map(rays).collect()
    }

    /// Radiance of each fragment, and the variance of it; with the help of the neighbours if
    /// `filtered`.
    pub fn of_fragments(&self, seen: &Seen, filtered: bool) -> Vec<(Rgb, Rgb)> {
        let own = |lobe| match filtered {
            true => self.with_neighbours(seen, lobe),
            false => (self.sums[lobe].mean(), self.sums[lobe].variance()),
        };
        let lobes: Vec<(Rgb, Rgb)> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(own).collect();
        let mut fragments = vec![(Rgb::ZERO, Rgb::ZERO); seen.fragments.len()];
        for (lobe, (mean, own_variance)) in seen.lobes.iter().zip(lobes) {
            let fragment = lobe.fragment as usize;
            let weight = seen.share(lobe) / seen.fragments[fragment].share;
            let (radiance, variance) = &mut fragments[fragment];
            *radiance += mean * weight;
            *variance += own_variance * (weight * weight);
        }
        fragments
    }

    /// Mean and variance by a plane through what the lobes around say that look at about the same.
    fn with_neighbours(&self, seen: &Seen, index: usize) -> (Rgb, Rgb) {
        let mine = &self.sums[index];
        let (mean, variance) = (mine.mean(), mine.variance());
        let mut plane = Plane::new();
        plane.add(0, 0, mean, mine.rays as f32);
        self.around(seen, index, AROUND, |other, across, down| {
            let same = self.looks_at_the_same(index, other);
            if same <= 0.0 {
                return;
            }
            let theirs = &self.sums[other];
            let off = (theirs.mean() - mean).length_squared();
            let chance = (variance + theirs.variance()).element_sum();
            let alike = (UNLIKE - off / chance.max(f32::MIN_POSITIVE)) / (UNLIKE - ALIKE);
            let weight = same * alike.clamp(0.0, 1.0) * theirs.rays as f32;
            if weight > 0.0 {
                plane.add(across, down, theirs.mean(), weight);
            }
        });
        let (value, scatter) = plane.center();
        (value, scatter.unwrap_or(variance))
    }

    /// Calls `each` with the lobes of neighbouring pixels, and how many pixels they are to the right
    /// and down.
    fn around(&self, seen: &Seen, index: usize, reach: i32, mut each: impl FnMut(usize, i32, i32)) {
        let pixel = seen.fragments[seen.lobes[index].fragment as usize].pixel;
        let (x, y) = ((pixel % seen.width) as i32, (pixel / seen.width) as i32);
        let (width, height) = (seen.width as i32, seen.height as i32);
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

    /// 1 for lobes that look at the same place, 0 for those that look a lobe's width beside it: it
    /// is as far away as what they meet is on the harmonic mean.
    fn looks_at_the_same(&self, one: usize, other: usize) -> f32 {
        let (a, b) = (&self.lobes[one], &self.lobes[other]);
        if a.exponent != b.exponent {
            return 0.0;
        }
        let nearness = |lobe: usize| self.sums[lobe].nearness / self.sums[lobe].rays.max(1) as f32;
        let nearness = 0.5 * (nearness(one) + nearness(other));
        let between = (b.point - a.point) * nearness + (b.direction - a.direction);
        let across = between - a.direction * a.direction.dot(between);
        1.0 - (across.length_squared() * a.exponent * NARROW).min(1.0)
    }
}

impl LobeSums {
    fn mean(&self) -> Rgb {
        self.radiance / self.rays.max(1) as f32
    }

    /// Of the mean.
    fn variance(&self) -> Rgb {
        let (count, mean) = (self.rays.max(2) as f32, self.mean());
        (self.squares / count - mean * mean).max(Rgb::ZERO) / (count - 1.0)
    }
}

/// Rays of the first pass: by the share of the pixel, and as many as a variance takes.
fn rays(seen: &Seen, lobe: &Lobe) -> u32 {
    (RAYS * seen.share(lobe)).ceil().max(2.0) as u32
}
