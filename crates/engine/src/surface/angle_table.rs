//! What depends on a roughness and an angle alone and has no closed form, tabulated.

use rayon::prelude::*;

/// Rows of the table, by roughness √α from 0 to 1 in equal steps.
const ROWS: usize = 32;
/// Columns, by √cosθ from 0 to 1 in equal steps: albedos change fastest at grazing angles.
const COLUMNS: usize = 48;
/// Least cosine and width at which the function is asked; they stand for the limits.
const LEAST_COSINE: f32 = 1e-3;
const LEAST_ALPHA: f32 = 1e-3;

/// A function of α and cosθ, linear between its entries.
pub struct AngleTable(Vec<f32>);

impl AngleTable {
    /// Of that function.
    pub fn new(function: impl Fn(f32, f32) -> f32 + Sync) -> Self {
        let entry = |index: usize| {
            let number = |index: usize, count: usize| index as f32 / (count - 1) as f32;
            let [roughness, root] =
                [number(index / COLUMNS, ROWS), number(index % COLUMNS, COLUMNS)];
            function((roughness * roughness).max(LEAST_ALPHA), (root * root).max(LEAST_COSINE))
        };
        Self((0..ROWS * COLUMNS).into_par_iter().with_min_len(16).map(entry).collect())
    }

    /// For that α and cosθ.
    pub fn at(&self, alpha: f32, cosine: f32) -> f32 {
        let (row, down) = place(alpha.max(0.0).sqrt(), ROWS);
        let (column, across) = place(cosine.max(0.0).sqrt(), COLUMNS);
        let of_row = |row: usize| {
            let first = row * COLUMNS + column;
            self.0[first] + (self.0[first + 1] - self.0[first]) * across
        };
        of_row(row) + (of_row(row + 1) - of_row(row)) * down
    }
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

    #[test]
    fn entries_are_met_and_what_lies_between_is_near() {
        let function = |alpha: f32, cosine: f32| (3.0 * alpha).sin() + cosine * cosine;
        let table = AngleTable::new(function);
        for (alpha, cosine) in [(0.0f32, 0.0f32), (0.3, 0.04), (0.6, 0.5), (1.0, 1.0), (1.2, 7.0)] {
            let expected = function(alpha.clamp(LEAST_ALPHA, 1.0), cosine.clamp(0.0, 1.0));
            let off = table.at(alpha, cosine) - expected;
            assert!(off.abs() < 3e-3, "{alpha} {cosine}: {off}");
        }
    }
}
