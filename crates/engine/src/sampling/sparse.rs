//! A part of a picture's pixels that stands for all of them.

use crate::random::{Stream, pcg};

/// One pixel of each square of a grid over the picture, at a random place in it: every pixel is one of
/// them with the same probability, and they are the same in every picture of a size. A mean over them is
/// that over all pixels but for chance, and each can have as many samples more as there are fewer
/// of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SparsePixels {
    side: u32,
}

impl SparsePixels {
    /// Of squares of so many pixels along a side; 1 for all pixels.
    pub fn new(side: u32) -> Self {
        Self { side: side.max(1) }
    }

    /// Whether a pixel is one of them.
    pub fn has(self, column: u32, row: u32) -> bool {
        let Self { side } = self;
        if side == 1 {
            return true;
        }
        // The square's columns and rows are drawn apart, so that neighbouring squares differ.
        let square =
            pcg(pcg((column / side) ^ Stream::SparsePixel as u32).wrapping_add(row / side));
        let place = |bits: u32| ((u64::from(bits) * u64::from(side)) >> 32) as u32;
        column % side == place(square) && row % side == place(pcg(square))
    }

    /// Which pixels of a picture of this size are some of them, row by row.
    pub fn mask(self, [width, height]: [u32; 2]) -> Vec<bool> {
        (0..height).flat_map(|row| (0..width).map(move |column| self.has(column, row))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_squares_have_one_pixel_each() {
        assert!(SparsePixels::new(1).mask([7, 3]).iter().all(|traced| *traced));
        for side in [2, 5, 7] {
            let count = (6 * side, 4 * side);
            let mask = SparsePixels::new(side).mask([count.0, count.1]);
            let mut of_square = [0; 24];
            for (index, _) in mask.iter().enumerate().filter(|(_, traced)| **traced) {
                let (column, row) = (index as u32 % count.0, index as u32 / count.0);
                of_square[(row / side * 6 + column / side) as usize] += 1;
            }
            assert_eq!(of_square, [1; 24], "{side}");
        }
    }

    /// All places of a square are as likely, and so are all pairs of those of neighbouring squares: χ²
    /// of 24 degrees of freedom, which is above 52 once in a thousand times.
    #[test]
    fn every_place_is_as_likely() {
        const SIDE: u32 = 5;
        const SQUARES: u32 = 120;
        let sparse = SparsePixels::new(SIDE);
        let places: Vec<[u32; 2]> = (0..SQUARES * SQUARES)
            .map(|square| {
                let (x, y) = (square % SQUARES * SIDE, square / SQUARES * SIDE);
                let all = (0..SIDE * SIDE).map(|at| [at % SIDE, at / SIDE]);
                all.into_iter().find(|[u, v]| sparse.has(x + u, y + v)).unwrap()
            })
            .collect();
        let of = |at: usize| places[at];
        let kinds: [&dyn Fn(usize) -> [u32; 2]; 3] =
            [&of, &|at| [of(at)[0], of((at + 1) % places.len())[0]], &|at| {
                [of(at)[1], of((at + SQUARES as usize) % places.len())[1]]
            }];
        for (number, kind) in kinds.into_iter().enumerate() {
            let mut found = [0.0; (SIDE * SIDE) as usize];
            (0..places.len()).map(kind).for_each(|[u, v]| found[(v * SIDE + u) as usize] += 1.0);
            let expected = places.len() as f64 / found.len() as f64;
            let deviations = found.iter().map(|count| (count - expected).powi(2) / expected);
            let square = deviations.sum::<f64>();
            assert!(square < 52.0, "{number}: {square}");
        }
    }
}
