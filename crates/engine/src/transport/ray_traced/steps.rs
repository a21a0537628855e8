//! How much of a picture is traced at a time: as many rows, or passes, as take about a step's time.

use super::film::Film;
use super::pixels::Pixels;
use crate::transport::solver::STEP_SECONDS;
use std::time::Instant;

/// Most passes of a step.
const MOST_PASSES: u64 = 4096;
/// Rows of the first step, whose time nobody knows.
const FIRST_ROWS: u32 = 4;

/// The steps of a film. What a step does to the film depends on its rows alone, so the same passes
/// give the same bits however they are cut.
pub struct Steps {
    height: u32,
    /// Rows of the next step.
    rows: u32,
    /// Passes of the next step, where it has all rows.
    passes: u64,
}

impl Steps {
    /// Steps of a film of so many rows.
    pub fn new(height: u32) -> Self {
        Self { height, rows: height.min(FIRST_ROWS), passes: 1 }
    }

    /// Traces the next rows of a pass, or some whole passes but at most so many.
    pub fn advance(&mut self, film: &mut Film, pixels: &Pixels<'_>, most_passes: u64) {
        let (row, height) = (film.next_row(), self.height);
        let began = Instant::now();
        let rows = row..(row + self.rows).min(height);
        // Whole passes at once only where a step has all rows.
        let whole = self.rows == height && row == 0;
        let passes = if whole { self.passes.min(most_passes) } else { 1 };
        let work = f64::from(rows.end - rows.start) * passes as f64;
        let next = rows.end % height;
        film.advance(pixels, rows, passes);
        let wanted = STEP_SECONDS * work / began.elapsed().as_secs_f64().max(1e-9);
        self.rows = (wanted as u32).clamp(1, height - next);
        if next == 0 {
            self.passes = ((wanted / f64::from(height)) as u64).clamp(1, MOST_PASSES);
        }
    }
}
