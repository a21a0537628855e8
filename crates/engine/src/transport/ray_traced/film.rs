//! What passes over the picture add up to: means, and how far they may be off.

use super::pixels::Pixels;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::image::Picture;
use crate::radiometry::Rgb;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;

/// Fewer passes, or turns of passes, give no estimate of the error.
const FEWEST: u64 = 4;

/// More than any run comes to.
const MOST_PASSES: u64 = 1 << 48;

/// Sums of passes.
pub struct Film {
    width: u32,
    /// Passes of a turn: within it they depend on each other.
    period: u64,
    /// Whether its picture has an alpha channel.
    has_alpha: bool,
    rows: Vec<Row>,
}

/// A row of the picture.
struct Row {
    pixels: Vec<PixelSums>,
    /// Σ over passes of the share of each pixel that surfaces cover; empty without alpha.
    coverage: Vec<f32>,
    passes: u64,
    rays: u64,
    light_rays: u64,
}

/// What a pixel adds up to.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct PixelSums {
    /// Σ over passes of the squared value.
    squares: f64,
    /// Σ over complete turns of the squared mean of the turn.
    turn_squares: f64,
    /// Σ over passes.
    sum: Rgb,
    /// The same of the turn that is not complete.
    open: Rgb,
    /// Σ over passes of [`super::pixels::Estimate::by_map`].
    by_map: Rgb,
    /// Not 0 where any sample saw an emitter, or the pixel is not traced: then it doesn't count for
    /// the error.
    left_out: u32,
}

/// What error estimates sum over the pixels that count.
#[derive(Clone, Copy, Default)]
struct Scatter {
    /// Variance of the mean of the passes.
    variance: f64,
    /// Variance that passes have in common, as they read the same map.
    by_map: f64,
    sum: f64,
    pixels: u64,
}

impl Film {
    /// An empty film.
    pub fn new([width, height]: [u32; 2], period: u32, has_alpha: bool) -> Self {
        let pixels = vec![PixelSums::default(); width as usize];
        let coverage = vec![0.0; if has_alpha { width as usize } else { 0 }];
        let row = |_| Row {
            pixels: pixels.clone(),
            coverage: coverage.clone(),
            passes: 0,
            rays: 0,
            light_rays: 0,
        };
        let rows = (0..height).map(row).collect();
        Self { width, period: u64::from(period), has_alpha, rows }
    }

    /// Bytes of a film, and of its picture.
    pub fn needed_bytes(width: u32, height: u32) -> u64 {
        let pixel = size_of::<PixelSums>() + size_of::<Rgb>() + 2 * size_of::<f32>();
        u64::from(width) * u64::from(height) * pixel as u64
    }

    /// Writes it.
    pub fn save(&self, to: &mut Writer) {
        let counts = |row: &Row| [row.passes, row.rays, row.light_rays];
        to.slice(&self.rows.iter().map(counts).collect::<Vec<_>>());
        for row in &self.rows {
            to.slice(&row.pixels);
        }
        for row in self.rows.iter().filter(|_| self.has_alpha) {
            to.slice(&row.coverage);
        }
    }

    /// Takes what [`Film::save`] wrote of the same size and period.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        let counts: Vec<[u64; 3]> = from.exactly(self.rows.len())?;
        for (row, [passes, rays, light_rays]) in self.rows.iter_mut().zip(counts) {
            (row.passes, row.rays, row.light_rays) = (passes, rays, light_rays);
            from.replace(&mut row.pixels)?;
        }
        for row in self.rows.iter_mut().filter(|_| self.has_alpha) {
            from.replace(&mut row.coverage)?;
        }
        // Rows are traced from the top, none a second time before all were.
        let (first, last) = (self.rows[0].passes, self.rows[self.rows.len() - 1].passes);
        let falls = self.rows.windows(2).all(|two| two[0].passes >= two[1].passes);
        match falls && first - last <= 1 && first <= MOST_PASSES {
            true => Ok(()),
            false => Err(CheckpointError::damaged("its rows were not traced in their order")),
        }
    }

    /// The row that is traced next.
    pub fn next_row(&self) -> u32 {
        let passes = self.passes();
        self.rows.iter().position(|row| row.passes == passes).unwrap_or(0) as u32
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.rows.len() as u32
    }

    /// Adds passes to rows.
    pub fn advance(&mut self, pixels: &Pixels<'_>, rows: Range<u32>, passes: u64) {
        let period = self.period;
        let (first, end) = (rows.start as usize, rows.end as usize);
        self.rows[first..end].par_iter_mut().zip(rows).for_each(|(row, index)| {
            for _ in 0..passes {
                row.advance(pixels, index, period);
            }
        });
    }

    /// Passes that all rows have.
    pub fn passes(&self) -> u64 {
        self.rows.iter().map(|row| row.passes).min().unwrap_or(0)
    }

    /// Rays so far.
    pub fn rays(&self) -> u64 {
        self.rows.iter().map(|row| row.rays).sum()
    }

    /// Those of them that were cast at a light.
    pub fn light_rays(&self) -> u64 {
        self.rows.iter().map(|row| row.light_rays).sum()
    }

    /// The mean of the passes.
    pub fn picture(&self) -> Picture {
        let mut pixels = Vec::with_capacity(self.width as usize * self.rows.len());
        let mut alpha = Vec::new();
        for row in &self.rows {
            let share = 1.0 / row.passes.max(1) as f32;
            pixels.extend(row.pixels.iter().map(|pixel| pixel.sum * share));
            alpha.extend(row.coverage.iter().map(|sum| (sum * share).min(1.0)));
        }
        let alpha = self.has_alpha.then_some(alpha);
        Picture { alpha, ..Picture::new(self.width, self.height(), pixels) }
    }

    /// Whether there are as many passes as an estimate takes.
    pub fn enough(&self) -> bool {
        self.passes() >= FEWEST
    }

    /// Estimated rRMSE of [`Film::picture`] from the scatter of whole turns, or of the passes as
    /// if they were independent until there are enough turns. Knows noise only. `None` with too
    /// few or a black picture.
    pub fn relative_error(&self) -> Option<f64> {
        if !self.enough() {
            return None;
        }
        let period = if self.passes() / self.period >= FEWEST { self.period } else { 1 };
        let rows: Vec<Scatter> = self.rows.par_iter().map(|row| row.scatter(period)).collect();
        let all = rows.iter().fold(Scatter::default(), |all, row| Scatter {
            variance: all.variance + row.variance,
            by_map: all.by_map + row.by_map,
            sum: all.sum + row.sum,
            pixels: all.pixels + row.pixels,
        });
        let values = 3.0 * all.pixels as f64;
        let variance = (all.variance.max(0.0) + all.by_map) / values;
        (all.sum > 0.0).then(|| variance.sqrt() / (all.sum / values))
    }
}

impl Row {
    fn advance(&mut self, pixels: &Pixels<'_>, row: u32, period: u64) {
        let closes = period > 1 && (self.passes + 1).is_multiple_of(period);
        for (column, sums) in self.pixels.iter_mut().enumerate() {
            if !pixels.traced.has(column as u32, row) {
                sums.left_out = 1;
                continue;
            }
            let (estimate, walk) = pixels.pixel(column as u32, row, self.passes);
            let value = estimate.radiance;
            self.rays += walk.rays;
            self.light_rays += walk.light_rays;
            sums.sum += value;
            sums.by_map += estimate.by_map;
            if let Some(sum) = self.coverage.get_mut(column) {
                *sum += estimate.coverage;
            }
            sums.squares += square(value);
            sums.left_out |= u32::from(walk.saw_emitter);
            if period > 1 {
                sums.open += value;
            }
            if closes {
                sums.turn_squares += square(std::mem::take(&mut sums.open) / period as f32);
            }
        }
        self.passes += 1;
    }

    /// Of turns of `period` passes, or of passes with 1.
    fn scatter(&self, period: u64) -> Scatter {
        let turns = (self.passes / period) as f64;
        let mut scatter = Scatter::default();
        for pixel in self.pixels.iter().filter(|pixel| pixel.left_out == 0) {
            let (squares, sum) = match period {
                1 => (pixel.squares, pixel.sum),
                _ => (pixel.turn_squares, (pixel.sum - pixel.open) / period as f32),
            };
            scatter.variance += (squares - square(sum) / turns) / (turns * (turns - 1.0));
            scatter.by_map += square(pixel.by_map / self.passes as f32);
            scatter.sum += f64::from(pixel.sum.element_sum()) / self.passes as f64;
            scatter.pixels += 1;
        }
        scatter
    }
}

fn square(value: Rgb) -> f64 {
    value.as_dvec3().length_squared()
}
