//! What passes over the picture add up to: means, and how far they may be off.

use super::pixels::Pixels;
use crate::image::Picture;
use crate::radiometry::Rgb;
use glam::Vec2;
use rayon::prelude::*;
use std::ops::Range;

/// Fewer passes, or turns of passes, give no estimate of the error.
const FEWEST: u64 = 4;

/// Sums of passes.
pub struct Film {
    width: u32,
    /// Passes of a turn: within it they depend on each other.
    period: u64,
    rows: Vec<Row>,
}

/// A row of the picture.
struct Row {
    /// Σ over passes, per pixel.
    sums: Vec<Rgb>,
    /// The same of the turn that is not complete.
    open: Vec<Rgb>,
    /// Pixels that see an emitter don't count for the error; found out with the first pass.
    emitters: Vec<bool>,
    passes: u64,
    rays: u64,
    /// Σ over passes and counted pixels of the squared value.
    squares: f64,
    /// Σ over complete turns and counted pixels of the squared mean of the turn.
    turn_squares: f64,
}

/// What error estimates sum over the pixels that count.
#[derive(Clone, Copy, Default)]
struct Scatter {
    /// Variance of the mean of the passes as if they were independent.
    by_passes: f64,
    /// The same from complete turns; `None` with too few.
    by_turns: Option<f64>,
    sum: f64,
    pixels: u64,
}

impl Film {
    /// An empty film.
    pub fn new([width, height]: [u32; 2], period: u32) -> Self {
        let row = |_| Row {
            sums: vec![Rgb::ZERO; width as usize],
            open: vec![Rgb::ZERO; if period > 1 { width as usize } else { 0 }],
            emitters: Vec::new(),
            passes: 0,
            rays: 0,
            squares: 0.0,
            turn_squares: 0.0,
        };
        Self { width, period: u64::from(period), rows: (0..height).map(row).collect() }
    }

    /// Bytes of a film.
    pub fn needed_bytes(width: u32, height: u32) -> u64 {
        // Sums, the open turn, the mask, and the picture.
        u64::from(width) * u64::from(height) * 40
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

    /// The mean of the passes.
    pub fn picture(&self) -> Picture {
        let mut pixels = Vec::with_capacity(self.width as usize * self.rows.len());
        for row in &self.rows {
            let share = 1.0 / row.passes.max(1) as f32;
            pixels.extend(row.sums.iter().map(|sum| *sum * share));
        }
        Picture { width: self.width, height: self.height(), pixels }
    }

    /// Whether there are as many passes as an estimate takes.
    pub fn enough(&self) -> bool {
        self.passes() >= FEWEST
    }

    /// Estimated rRMSE of [`Film::picture`] from the scatter of the passes, or of whole turns
    /// once there are enough. Knows noise only. `None` with too few or a black picture.
    pub fn relative_error(&self) -> Option<f64> {
        if !self.enough() {
            return None;
        }
        let rows: Vec<Scatter> = self.rows.par_iter().map(|row| row.scatter(self.period)).collect();
        let mut all = Scatter { by_turns: Some(0.0), ..Scatter::default() };
        for row in &rows {
            all.by_passes += row.by_passes;
            all.by_turns = all.by_turns.zip(row.by_turns).map(|(sum, more)| sum + more);
            all.sum += row.sum;
            all.pixels += row.pixels;
        }
        let values = 3.0 * all.pixels as f64;
        let variance = all.by_turns.unwrap_or(all.by_passes).max(0.0) / values;
        (all.sum > 0.0).then(|| variance.sqrt() / (all.sum / values))
    }
}

impl Row {
    fn advance(&mut self, pixels: &Pixels<'_>, row: u32, period: u64) {
        if self.emitters.is_empty() {
            self.emitters = emitters(pixels, row);
        }
        let closes = period > 1 && (self.passes + 1).is_multiple_of(period);
        let (mut squares, mut turn_squares) = (0.0, 0.0);
        for column in 0..self.sums.len() {
            let (value, rays) = pixels.pixel(column as u32, row, self.passes);
            self.rays += rays;
            self.sums[column] += value;
            let counts = !self.emitters[column];
            if counts {
                squares += square(value);
            }
            if period > 1 {
                self.open[column] += value;
            }
            if closes {
                let mean = std::mem::take(&mut self.open[column]) / period as f32;
                if counts {
                    turn_squares += square(mean);
                }
            }
        }
        self.squares += squares;
        self.turn_squares += turn_squares;
        self.passes += 1;
    }

    fn scatter(&self, period: u64) -> Scatter {
        let (passes, turns) = (self.passes as f64, self.passes / period);
        let turned = (turns * period) as f32;
        let mut scatter = Scatter::default();
        let (mut means, mut turn_means) = (0.0, 0.0);
        let counted = (0..self.sums.len()).filter(|column| !self.emitters[*column]);
        for column in counted {
            let mean = self.sums[column] / self.passes as f32;
            means += square(mean);
            if period > 1 {
                turn_means += square((self.sums[column] - self.open[column]) / turned);
            }
            scatter.sum += f64::from(mean.element_sum());
            scatter.pixels += 1;
        }
        scatter.by_passes = (self.squares - passes * means) / (passes * (passes - 1.0));
        if period > 1 && turns >= FEWEST {
            let turns = turns as f64;
            scatter.by_turns =
                Some((self.turn_squares - turns * turn_means) / (turns * (turns - 1.0)));
        }
        scatter
    }
}

/// Which pixels of a row see an emitter, at their centres and corners.
fn emitters(pixels: &Pixels<'_>, row: u32) -> Vec<bool> {
    let width = pixels.size[0];
    let corners = |row: u32| -> Vec<bool> {
        let at = |column| Vec2::new(column as f32, row as f32);
        (0..=width).map(|column| pixels.sees_emitter(at(column))).collect()
    };
    let (above, below) = (corners(row), corners(row + 1));
    let sees = |column: usize| {
        let center = Vec2::new(column as f32 + 0.5, row as f32 + 0.5);
        [above[column], above[column + 1], below[column], below[column + 1]].contains(&true)
            || pixels.sees_emitter(center)
    };
    (0..width as usize).map(sees).collect()
}

fn square(value: Rgb) -> f64 {
    value.as_dvec3().length_squared()
}
