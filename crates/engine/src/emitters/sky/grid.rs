//! How texels become fine cells along one axis, and fine cells parts of about equal size.

use std::ops::Range;

/// One axis of the fine cells: texels split into several cells, or joined by several to one.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    texels: usize,
    /// Pieces of a texel.
    split: usize,
    /// Pieces of the first and of the last texel that lie beyond the ends of the axis.
    beyond: usize,
    /// Pieces in a cell, but for the last one, which may have fewer.
    joined: usize,
    /// Cells.
    pub cells: usize,
}

impl Axis {
    /// Cells of so many texels, from `least` to `most` of them, whose edges are at both ends.
    pub fn new(texels: usize, least: usize, most: usize) -> Self {
        let split = least.div_ceil(texels).max(1);
        Self { texels, split, beyond: 0, joined: 1, cells: 0 }.joined(most)
    }

    /// The same of texels of which the first and the last have their centres at the ends.
    pub fn between_centres(texels: usize, least: usize, most: usize) -> Self {
        if texels == 1 {
            return Self::new(texels, least, most);
        }
        let split = least.div_ceil(texels - 1).next_multiple_of(2).max(2);
        Self { texels, split, beyond: split / 2, joined: 1, cells: 0 }.joined(most)
    }

    /// At most so many cells.
    fn joined(self, most: usize) -> Self {
        let joined = self.count().div_ceil(most).max(1);
        Self { joined, cells: self.count().div_ceil(joined), ..self }
    }

    /// Number of pieces.
    fn count(&self) -> usize {
        self.texels * self.split - 2 * self.beyond
    }

    /// The cell of a coordinate in [0, 1].
    pub fn cell(&self, coordinate: f32) -> usize {
        let pieces = self.count();
        let piece = (f64::from(coordinate) * pieces as f64) as usize;
        piece.min(pieces - 1) / self.joined
    }

    /// Coordinates of both ends of a cell.
    pub fn edges(&self, cell: usize) -> [f64; 2] {
        let pieces = self.count();
        [cell, cell + 1].map(|edge| (edge * self.joined).min(pieces) as f64 / pieces as f64)
    }

    /// The pieces of a cell: in which texel each lies, what the texels before it, it and after it
    /// count in the piece's mean, and the coordinates of its ends.
    pub fn pieces(&self, cell: usize) -> impl Iterator<Item = (usize, [f32; 3], [f64; 2])> {
        let Self { split, joined, beyond, .. } = *self;
        let pieces = self.count();
        (cell * joined..((cell + 1) * joined).min(pieces)).map(move |piece| {
            let ends = [piece, piece + 1].map(|edge| edge as f64 / pieces as f64);
            let place = piece + beyond;
            (place / split, tent(place % split, split), ends)
        })
    }
}

/// Means of the linear interpolation's three weights over a piece of a texel.
fn tent(piece: usize, split: usize) -> [f32; 3] {
    let [from, to] = [piece, piece + 1].map(|edge| edge as f32 / split as f32);
    // ∫ max(½ − t, 0) dt, the share of the texel before, from t to the texel's middle.
    let rest = |t: f32| 0.5 * (0.5 - t).max(0.0).powi(2);
    let before = (rest(from) - rest(to)) * split as f32;
    let after = (rest(1.0 - to) - rest(1.0 - from)) * split as f32;
    [before, 1.0 - before - after, after]
}

/// Things in a row, in parts of about equal numbers.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    /// Parts.
    pub count: usize,
    /// Things, at least as many.
    pub of: usize,
}

impl Parts {
    /// The things of a part.
    pub fn range(&self, part: usize) -> Range<usize> {
        part * self.of / self.count..(part + 1) * self.of / self.count
    }

    /// The part of a thing.
    pub fn part(&self, thing: usize) -> usize {
        ((thing + 1) * self.count - 1) / self.of
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_are_in_the_part_that_has_them() {
        for (count, of) in [(64, 64), (64, 65), (32, 100), (7, 2048)] {
            let parts = Parts { count, of };
            for part in 0..count {
                assert!(!parts.range(part).is_empty());
                assert!(parts.range(part).all(|thing| parts.part(thing) == part));
            }
            assert_eq!(parts.range(count - 1).end, of);
        }
    }

    #[test]
    fn cells_cover_the_axis_and_are_found_again() {
        let texels = [1, 3, 64, 100, 2048, 2049, 8191];
        let both = [Axis::new, Axis::between_centres];
        for axis in texels.into_iter().flat_map(|texels| both.map(|new| new(texels, 64, 2048))) {
            assert!((64..=2048).contains(&axis.cells), "{axis:?}");
            assert!((axis.edges(0)[0], axis.edges(axis.cells - 1)[1]) == (0.0, 1.0));
            for cell in 0..axis.cells {
                let [from, to] = axis.edges(cell);
                assert_eq!(axis.cell((0.5 * (from + to)) as f32), cell);
                let pieces: Vec<_> = axis.pieces(cell).collect();
                assert_eq!((pieces[0].2[0], pieces[pieces.len() - 1].2[1]), (from, to));
            }
            assert_eq!((axis.cell(0.0), axis.cell(1.0)), (0, axis.cells - 1));
        }
    }

    #[test]
    fn weights_are_means_of_linear_interpolation() {
        assert_eq!(tent(0, 1), [0.125, 0.75, 0.125]);
        for split in [2, 3, 64] {
            for piece in 0..split {
                let n = 1000;
                let mut exact = [0.0f32; 3];
                for k in 0..n {
                    let t = (piece as f32 + (k as f32 + 0.5) / n as f32) / split as f32;
                    let (before, after) = ((0.5 - t).max(0.0), (t - 0.5).max(0.0));
                    let weights = [before, 1.0 - before - after, after];
                    exact.iter_mut().zip(weights).for_each(|(e, w)| *e += w / n as f32);
                }
                for (weight, exact) in tent(piece, split).into_iter().zip(exact) {
                    assert!((weight - exact).abs() < 1e-4, "{piece} of {split}");
                }
            }
        }
    }
}
