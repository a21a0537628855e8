//! Where in a pixel rays go: independent, jittered, or Dippé's adaptive rectangular jitter.

use super::path::{Tracer, Walk};
use super::settings::PixelSampling;
use crate::measurement::Frame;
use crate::radiometry::Rgb;
use crate::random::{Numbers, Stream};
use crate::sampling::{SparsePixels, Turn};
use glam::{Vec2, Vec3};

/// The camera, and how its pixels are sampled.
pub struct Pixels<'a> {
    /// What traces.
    pub tracer: Tracer<'a>,
    /// The camera.
    pub frame: Frame,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Which of them are traced.
    pub traced: SparsePixels,
    /// How.
    pub sampling: PixelSampling,
    /// Whether choices along paths are spread over cells as jittered samples are.
    pub path_strata: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// A part of a pixel with one sample in it.
#[derive(Clone, Copy)]
struct Cell {
    low: Vec2,
    high: Vec2,
    /// Where its sample is, and what was seen there.
    at: Vec2,
    value: Estimate,
}

/// An estimate of the radiance that a pixel sees.
#[derive(Clone, Copy, Default)]
pub struct Estimate {
    /// The radiance.
    pub radiance: Rgb,
    /// How far it would be off by chance if only the caustics' map were random: a value whose mean
    /// is 0, and whose variance is what the map adds to that of [`Estimate::radiance`].
    pub by_map: Rgb,
    /// Share of the pixel that surfaces cover.
    pub coverage: f32,
}

impl std::ops::Add for Estimate {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            radiance: self.radiance + other.radiance,
            by_map: self.by_map + other.by_map,
            coverage: self.coverage + other.coverage,
        }
    }
}

impl std::ops::Mul<f32> for Estimate {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            radiance: self.radiance * factor,
            by_map: self.by_map * factor,
            coverage: self.coverage * factor,
        }
    }
}

impl Cell {
    fn area(&self) -> f32 {
        let size = self.high - self.low;
        size.x * size.y
    }
}

impl Pixels<'_> {
    /// The estimate of one pass for a pixel, and the walk that it took.
    pub fn pixel(&self, column: u32, row: u32, pass: u64) -> (Estimate, Walk) {
        let pixel = u64::from(row) * u64::from(self.size[0]) + u64::from(column);
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let numbers = Numbers::new(self.seed, Stream::Path, pass * pixels + pixel);
        let mut walk = Walk::new(numbers);
        (self.sample(column, row, pass, &mut walk), walk)
    }

    fn sample(&self, column: u32, row: u32, pass: u64, walk: &mut Walk) -> Estimate {
        let corner = Vec2::new(column as f32, row as f32);
        match self.sampling {
            PixelSampling::Independent => {
                let at = Vec2::new(walk.numbers.uniform(), walk.numbers.uniform());
                self.look(corner + at, walk)
            }
            PixelSampling::Jittered(strata) => {
                let pixel = u64::from(row) * u64::from(self.size[0]) + u64::from(column);
                let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
                let turn = pass / u64::from(strata.cells()) * pixels + pixel;
                if self.path_strata {
                    let place = (pass % u64::from(strata.cells())) as u32;
                    walk.turn = Some(Turn::new(strata, self.seed, turn, place));
                }
                let start = Numbers::new(self.seed, Stream::Stratum, turn).uniform();
                let within = Vec2::new(walk.numbers.uniform(), walk.numbers.uniform());
                self.look(corner + strata.point(pass, start, within), walk)
            }
            PixelSampling::Adaptive { levels, contrast, fresh } => {
                let at = Vec2::new(walk.numbers.uniform(), walk.numbers.uniform());
                let value = self.look(corner + at, walk);
                let whole = Cell { low: Vec2::ZERO, high: Vec2::ONE, at, value };
                let refinement = Refinement { pixels: self, corner, contrast, fresh };
                if levels == 0 { value } else { refinement.split(whole, levels, walk) }
            }
        }
    }

    /// Radiance at picture position `at`, pixels from the upper left corner.
    fn look(&self, at: Vec2, walk: &mut Walk) -> Estimate {
        walk.by_map = Rgb::ZERO;
        let (origin, direction) = self.ray(at);
        let Some(origin) = origin else {
            let radiance = self.tracer.world.beside_surfaces(direction);
            return Estimate { radiance, ..Estimate::default() };
        };
        walk.missed = false;
        let radiance = self.tracer.radiance(origin, direction, walk);
        let coverage = if walk.missed { 0.0 } else { 1.0 };
        Estimate { radiance, by_map: walk.by_map, coverage }
    }

    /// Where the ray through a place of the picture comes near the scene, if it does, and its unit
    /// direction.
    fn ray(&self, at: Vec2) -> (Option<Vec3>, Vec3) {
        let size = Vec2::new(self.size[0] as f32, self.size[1] as f32);
        let at = 2.0 * at / size - 1.0;
        let (origin, direction) = self.frame.ray(Vec2::new(at.x, -at.y));
        (self.tracer.world.rays.approach(origin, direction), direction)
    }
}

/// Dippé's recursion in one pixel.
struct Refinement<'a> {
    pixels: &'a Pixels<'a>,
    corner: Vec2,
    contrast: f32,
    fresh: bool,
}

impl Refinement<'_> {
    /// Mean over a cell times its area: splits it along its longer side by a random plane, keeps
    /// its sample for the half that it lies in, draws one for the other, and goes on with both
    /// where they differ too much.
    fn split(&self, cell: Cell, levels: u32, walk: &mut Walk) -> Estimate {
        let size = cell.high - cell.low;
        let axis = usize::from(size.y > size.x);
        let plane = cell.low[axis] + walk.numbers.uniform() * size[axis];
        let (mut first, mut second) = (cell, cell);
        first.high[axis] = plane;
        second.low[axis] = plane;
        let in_first = cell.at[axis] < plane;
        let other = if in_first { &mut second } else { &mut first };
        (other.at, other.value) = self.draw(other, walk);
        if levels > 1 && contrast(first.value.radiance, second.value.radiance) > self.contrast {
            self.split(first, levels - 1, walk) + self.split(second, levels - 1, walk)
        } else {
            self.settle(first, walk) + self.settle(second, walk)
        }
    }

    fn settle(&self, cell: Cell, walk: &mut Walk) -> Estimate {
        let value = if self.fresh { self.draw(&cell, walk).1 } else { cell.value };
        value * cell.area()
    }

    fn draw(&self, cell: &Cell, walk: &mut Walk) -> (Vec2, Estimate) {
        let within = Vec2::new(walk.numbers.uniform(), walk.numbers.uniform());
        let at = cell.low + within * (cell.high - cell.low);
        (at, self.pixels.look(self.corner + at, walk))
    }
}

/// Michelson contrast |a − b|/(a + b) of the channel that differs most.
fn contrast(a: Rgb, b: Rgb) -> f32 {
    let sum = a + b;
    let ratio = (a - b).abs() / sum.max(Rgb::splat(f32::MIN_POSITIVE));
    ratio.max_element()
}
