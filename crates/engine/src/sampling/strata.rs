//! Jittered sampling: the cells of a pixel, and of the choices along its paths, one a pass.

use crate::random::{Numbers, Stream};
use glam::Vec2;

/// The cells of a pixel, each sampled once in as many passes as there are cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strata {
    across: u32,
    down: u32,
    /// Steps that go through all cells.
    steps: [u32; 8],
}

impl Strata {
    /// `cells` ≥ 1 cells, as square as the number allows.
    pub fn new(cells: u32) -> Self {
        let cells = cells.max(1);
        let side = (f64::from(cells).sqrt() + 0.5) as u32;
        let down = (1..=side).rev().find(|n| cells.is_multiple_of(*n)).unwrap_or(1);
        // In steps of about the golden section the first few passes are spread, too.
        let mut step = ((f64::from(cells) * 0.618) as u32).max(1);
        let steps = [(); 8].map(|()| {
            while gcd(step, cells) != 1 {
                step += 1;
            }
            step += 1;
            step - 1
        });
        Self { across: cells / down, down, steps }
    }

    /// Number of cells.
    pub fn cells(&self) -> u32 {
        self.across * self.down
    }

    /// The point of a pass: `start` and `within` are uniform random numbers, `start` the same for
    /// all passes of a turn.
    pub fn point(&self, pass: u64, start: f32, within: Vec2) -> Vec2 {
        let cells = u64::from(self.cells());
        let first = (f64::from(start) * cells as f64) as u64;
        let cell = (first + pass % cells * u64::from(self.steps[0])) % cells;
        let (across, down) = (u64::from(self.across), self.down as f32);
        let corner = Vec2::new((cell % across) as f32, (cell / across) as f32);
        (corner + within) / Vec2::new(self.across as f32, down)
    }
}

/// Choices of a path that are spread over cells.
pub const CHOICES: u64 = 8;

/// A pass of a turn: in the passes of a turn, each choice goes through all cells of its own
/// square, in an order that is random for each choice (Cook 1986). A single pass is as random as
/// without.
#[derive(Clone, Debug)]
pub struct Turn {
    strata: Strata,
    numbers: Numbers,
    place: u32,
}

impl Turn {
    /// Pass `place` of a turn, which has a number of its own among all of all pixels.
    pub fn new(strata: Strata, seed: u64, turn: u64, place: u32) -> Self {
        Self { strata, numbers: Numbers::new(seed, Stream::PathStratum, turn), place }
    }

    /// The cell of a choice, below [`CHOICES`]: an affine permutation of the places.
    #[inline]
    fn cell(&self, choice: u64) -> u32 {
        let (cells, steps) = (self.strata.cells(), self.strata.steps.len() as u32);
        let order = (self.numbers.ahead(choice) * (cells * steps) as f32) as u32;
        let (first, step) = (order / steps, self.strata.steps[(order % steps) as usize]);
        (first + self.place * step) % cells
    }

    /// Two numbers for a choice, from uniform ones.
    pub fn pair(&self, choice: u64, [u, v]: [f32; 2]) -> [f32; 2] {
        let (cell, across) = (self.cell(choice), self.strata.across);
        // Rounding must not make a 1 of the last cell.
        let place = |cell: u32, within: f32, cells: u32| {
            ((cell as f32 + within) / cells as f32).min(1.0 - 0.5 * f32::EPSILON)
        };
        [place(cell % across, u, across), place(cell / across, v, self.strata.down)]
    }

    /// A number for a choice, from a uniform one.
    pub fn single(&self, choice: u64, within: f64) -> f64 {
        (f64::from(self.cell(choice)) + within) / f64::from(self.strata.cells())
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cell_is_sampled_once_a_turn() {
        for cells in [1, 2, 3, 7, 12, 16, 25, 64, 255, 256] {
            let strata = Strata::new(cells);
            assert_eq!(strata.cells(), cells);
            let mut seen = vec![0; cells as usize];
            for pass in 0..u64::from(cells) {
                let at = strata.point(5 * u64::from(cells) + pass, 0.37, Vec2::splat(0.5));
                let grid = Vec2::new(strata.across as f32, strata.down as f32);
                let cell = (at * grid).floor();
                seen[(cell.y * grid.x + cell.x) as usize] += 1;
            }
            assert!(seen.iter().all(|count| *count == 1), "{cells}: {seen:?}");
        }
        assert_eq!(Strata::new(16).across, 4);
    }

    #[test]
    fn choices_go_through_all_cells_in_orders_of_their_own() {
        for cells in [1, 2, 7, 12, 16, 256] {
            let strata = Strata::new(cells);
            let places = 0..cells;
            let order = |choice: u64, turn: u64| -> Vec<u32> {
                places.clone().map(|i| Turn::new(strata, 3, turn, i).cell(choice)).collect()
            };
            let mut orders = Vec::new();
            for (choice, turn) in [(0, 0), (1, 0), (0, 1), (7, 5)] {
                let order = order(choice, turn);
                let mut sorted = order.clone();
                sorted.sort_unstable();
                assert!(sorted.into_iter().eq(places.clone()), "{cells}: {order:?}");
                orders.push(order);
            }
            orders.dedup();
            // Two of four may agree by chance.
            assert!(cells < 12 || orders.len() >= 3, "{orders:?}");
            let last = Turn::new(strata, 3, 0, 0);
            let [u, v] = last.pair(0, [1.0 - 0.5 * f32::EPSILON; 2]);
            assert!(u < 1.0 && v < 1.0 && last.single(0, 0.999) < 1.0);
        }
    }

    /// A pass alone is uniform: every cell as often as any other over many turns.
    #[test]
    fn every_pass_is_uniform() {
        let strata = Strata::new(16);
        for place in [0, 1, 9] {
            let mut counts = [0u32; 16];
            for turn in 0..16_000 {
                counts[Turn::new(strata, 3, turn, place).cell(2) as usize] += 1;
            }
            let worst = counts.iter().map(|n| n.abs_diff(1000)).max().unwrap_or(0);
            assert!(worst < 130, "place {place}: {counts:?}");
        }
    }
}
