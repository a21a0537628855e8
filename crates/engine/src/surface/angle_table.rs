//! What depends on a roughness and an angle alone and has no closed form, tabulated.
//!
//! Each row is found when it is first asked for: a scene has few roughnesses. It is found by one thread,
//! since a thread that waits for others may take on work that asks for the same row, and would wait
//! for itself.

use std::array::from_fn;
use std::sync::OnceLock;

/// Rows of the table, by roughness √α from 0 to 1 in equal steps.
const ROWS: usize = 48;
/// Columns, by √cosθ from 0 to 1 in equal steps: albedos change fastest at grazing angles.
const COLUMNS: usize = 48;
/// Least cosine and width at which the function is asked; they stand for the limits.
const LEAST_COSINE: f32 = 1e-4;
const LEAST_ALPHA: f32 = 1e-3;
/// Steps of the integral over cosθ of a mean.
const MEAN_STEPS: usize = 256;

/// N functions of α and cosθ, linear between their entries.
pub struct AngleTable<const N: usize> {
    functions: fn(f32, f32) -> [f32; N],
    rows: [OnceLock<AngleRow<N>>; ROWS],
}

/// N functions of cosθ, linear between their entries.
pub struct AngleRow<const N: usize> {
    entries: [[f32; N]; COLUMNS],
    /// 2 ∫ f(cosθ) cosθ dcosθ.
    mean: [f32; N],
}

impl<const N: usize> AngleTable<N> {
    /// Of those functions.
    pub const fn new(functions: fn(f32, f32) -> [f32; N]) -> Self {
        Self { functions, rows: [const { OnceLock::new() }; ROWS] }
    }

    /// For that α and cosθ.
    pub fn at(&self, alpha: f32, cosine: f32) -> [f32; N] {
        let (row, down) = place(alpha.max(0.0).sqrt(), ROWS);
        let [above, below] = [row, row + 1].map(|row| self.row(row).at(cosine));
        lerp(above, below, down)
    }

    /// The means over the hemisphere, weighed by cosθ/π.
    pub fn mean(&self, alpha: f32) -> [f32; N] {
        let (row, down) = place(alpha.max(0.0).sqrt(), ROWS);
        lerp(self.row(row).mean, self.row(row + 1).mean, down)
    }

    fn row(&self, row: usize) -> &AngleRow<N> {
        self.rows[row].get_or_init(|| {
            let roughness = row as f32 / (ROWS - 1) as f32;
            let alpha = (roughness * roughness).max(LEAST_ALPHA);
            AngleRow::new(|cosine| (self.functions)(alpha, cosine))
        })
    }
}

impl<const N: usize> AngleRow<N> {
    /// Of those functions of cosθ.
    pub fn new(functions: impl Fn(f32) -> [f32; N]) -> Self {
        let cosine_of = |column: usize| {
            let root = column as f32 / (COLUMNS - 1) as f32;
            (root * root).max(LEAST_COSINE)
        };
        let mut this =
            Self { entries: from_fn(|column| functions(cosine_of(column))), mean: [0.0; N] };
        for step in 0..MEAN_STEPS {
            let cosine = (step as f32 + 0.5) / MEAN_STEPS as f32;
            let weight = 2.0 * cosine / MEAN_STEPS as f32;
            let here = this.at(cosine);
            this.mean = from_fn(|k| this.mean[k] + here[k] * weight);
        }
        this
    }

    /// For that cosθ.
    pub fn at(&self, cosine: f32) -> [f32; N] {
        let (column, across) = place(cosine.max(0.0).sqrt(), COLUMNS);
        lerp(self.entries[column], self.entries[column + 1], across)
    }

    /// The means over the hemisphere, weighed by cosθ/π.
    pub fn mean(&self) -> [f32; N] {
        self.mean
    }
}

fn lerp<const N: usize>(from: [f32; N], to: [f32; N], share: f32) -> [f32; N] {
    from_fn(|k| from[k] + (to[k] - from[k]) * share)
}

/// Where a number in [0, 1] lies between so many entries.
fn place(at: f32, count: usize) -> (usize, f32) {
    let at = at.clamp(0.0, 1.0) * (count - 1) as f32;
    let first = (at as usize).min(count - 2);
    (first, at - first as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    fn functions(alpha: f32, cosine: f32) -> [f32; 2] {
        [(3.0 * alpha).sin() + cosine * cosine, alpha * cosine]
    }

    #[test]
    fn entries_are_met_and_what_lies_between_is_near() {
        let table = AngleTable::new(functions);
        for (alpha, cosine) in [(0.0f32, 0.0f32), (0.3, 0.04), (0.6, 0.5), (1.0, 1.0), (1.2, 7.0)] {
            let expected = functions(alpha.clamp(LEAST_ALPHA, 1.0), cosine.clamp(0.0, 1.0));
            let found = table.at(alpha, cosine);
            for k in 0..2 {
                let off = found[k] - expected[k];
                assert!(off.abs() < 3e-3, "{k} at {alpha} {cosine}: {off}");
            }
            // 2 ∫ c · c dc = ⅔.
            let mean = table.mean(alpha)[1];
            assert!((mean - expected[1] / cosine.clamp(1e-9, 1.0) * 2.0 / 3.0).abs() < 3e-3);
        }
    }

    /// Functions that take long, asked by all threads at once, by which a table that waits for other
    /// threads stands still.
    #[test]
    fn many_threads_may_ask_first() {
        fn slow(alpha: f32, cosine: f32) -> [f32; 1] {
            [(0..2000).map(|k| (alpha * cosine * k as f32).sin()).sum()]
        }
        let table = AngleTable::new(slow);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().expect("threads start");
        let sum = |k: u32| table.at((k % 97) as f32 / 97.0, (k % 89) as f32 / 89.0)[0];
        let all: Vec<f32> = pool.install(|| (0..10_000u32).into_par_iter().map(sum).collect());
        assert!((0..10_000).step_by(500).all(|k| all[k as usize] == sum(k)));
    }
}
