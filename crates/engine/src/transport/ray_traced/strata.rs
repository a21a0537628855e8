//! Jittered sampling: a pixel's cells, one a pass.

use glam::Vec2;

/// The cells of a pixel, each sampled once in as many passes as there are cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strata {
    across: u32,
    down: u32,
    step: u32,
}

impl Strata {
    /// `cells` ≥ 1 cells, as square as the number allows.
    pub fn new(cells: u32) -> Self {
        let cells = cells.max(1);
        let side = (f64::from(cells).sqrt() + 0.5) as u32;
        let down = (1..=side).rev().find(|n| cells.is_multiple_of(*n)).unwrap_or(1);
        // In steps of about the golden section the first few passes are spread, too.
        let mut step = ((f64::from(cells) * 0.618) as u32).max(1);
        while gcd(step, cells) != 1 {
            step += 1;
        }
        Self { across: cells / down, down, step }
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
        let cell = (first + pass % cells * u64::from(self.step)) % cells;
        let (across, down) = (u64::from(self.across), self.down as f32);
        let corner = Vec2::new((cell % across) as f32, (cell / across) as f32);
        (corner + within) / Vec2::new(self.across as f32, down)
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
}
