//! Takes off a picture what paths say is surely wrong with it over wide areas.
//!
//! What all rays have wrong together stays however long a job runs: a coarse mesh that is too coarse, lobes
//! taken for diffuse after the second bounce. Mean differences from the paths over the squares of grids, from
//! one square to the finest, are unbiased, so where those of a grid together exceed their noise they are
//! taken off: as a factor of what a pixel shows beyond emission, smooth between the middles of squares. Where
//! b² is the mean square beyond noise, and σ² the noise of a square's mean, the share b²/(b² + σ²) of a
//! difference leaves the least error (linear shrinkage).

use super::grid::{Differences, Grid, LEAST_PATHS};
use crate::image::Picture;
use crate::radiometry::Rgb;

/// Squares along the sides of the grids, one after the other: each takes off what the ones before left.
pub const SIDES: [usize; 4] = [1, 2, 4, 8];
/// Standard deviations of the mean square that are left out of it where it is no chance.
const LEFT_OUT: f64 = 2.0;
/// Most by which a grid changes a pixel. What is farther off than this the predicted error tells, but
/// paths that hardly ever find the light may be wrong, too.
const MOST: f64 = 0.1;

/// What is to be done about what is wrong with a picture by a grid.
pub struct Correction {
    /// By what the pixels in the middles of its squares are to be multiplied.
    pub factors: Vec<Rgb>,
    /// Expected squared error, the mean over channels, that is left of it then: b² σ²/(b² + σ²).
    pub left: f64,
}

/// What is to be done by a grid; `None` where nothing is surely wrong.
pub fn correction(grid: &Grid) -> Option<Correction> {
    let beyond = grid.beyond_noise()?;
    let wrong = beyond.square - LEFT_OUT * beyond.deviation;
    let noise = |own: &Differences| own.scatter() / (3.0 * own.count);
    let of_square = |own: &Differences| {
        if own.count < LEAST_PATHS {
            return Rgb::ONE;
        }
        let share = wrong / (wrong + noise(own));
        let factor = |channel: usize| {
            let relative = own.sum[channel] / own.shown[channel].max(f64::MIN_POSITIVE);
            (1.0 - (share * relative).clamp(-MOST, MOST)) as f32
        };
        Rgb::new(factor(0), factor(1), factor(2))
    };
    let judged = || grid.squares.iter().filter(|own| own.count >= LEAST_PATHS);
    beyond.is_sure().then(|| {
        let left = judged().map(|own| own.count * wrong * noise(own) / (wrong + noise(own)));
        let count: f64 = judged().map(|own| own.count).sum();
        let left = left.sum::<f64>() / count;
        Correction { factors: grid.squares.iter().map(of_square).collect(), left }
    })
}

/// Multiplies what pixels show beyond what of it is `exact` by factors at the middles of
/// squares of equal size, interpolated bilinearly between them.
pub fn apply(picture: &mut Picture, exact: &[Rgb], factors: &[Rgb]) {
    let side = factors.len().isqrt();
    let (width, height) = (picture.width as usize, picture.height as usize);
    // The two middles around a pixel, and how far it is from the first to the second.
    let between = |at: usize, of: usize| {
        let place = (at as f32 + 0.5) / of as f32 * side as f32 - 0.5;
        let place = place.clamp(0.0, side as f32 - 1.0);
        let first = (place as usize).min(side.saturating_sub(2));
        (first, (first + 1).min(side - 1), place - first as f32)
    };
    for (index, (pixel, exact)) in picture.pixels.iter_mut().zip(exact).enumerate() {
        let (left, right, across) = between(index % width, width);
        let (above, below, down) = between(index / width, height);
        let row = |row: usize| factors[row * side + left].lerp(factors[row * side + right], across);
        let factor = row(above).lerp(row(below), down);
        *pixel = *exact + (*pixel - *exact) * factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use glam::Vec2;

    /// A grid of paths that bring 1 on average, in a picture that shows so much by place.
    fn grid(paths: usize, seed: u64, shown: impl Fn(Vec2) -> f32) -> Grid {
        let mut numbers = Numbers::new(seed, Stream::Audit, 3);
        let mut grid = Grid::new(8);
        for _ in 0..paths {
            let at = Vec2::new(numbers.uniform(), numbers.uniform());
            grid.add(at, Rgb::splat(shown(at)), Rgb::splat(2.0 * numbers.uniform()));
        }
        grid
    }

    #[test]
    fn what_is_right_is_left_alone() {
        let changed = (0..200).filter(|seed| correction(&grid(20_000, *seed, |_| 1.0)).is_some());
        assert!(changed.count() <= 3);
        assert!(correction(&Grid::new(8)).is_none());
        // A single bright path is no difference.
        let mut bright = grid(20_000, 1, |_| 1.0);
        bright.add(Vec2::splat(0.3), Rgb::ONE, Rgb::splat(1e4));
        assert!(correction(&bright).is_none());
    }

    #[test]
    fn what_is_wrong_is_taken_off() {
        let planted = |at: Vec2| if at.x < 0.5 { 1.05 } else { 0.97 };
        let found = correction(&grid(2_000_000, 2, planted)).expect("it is wrong");
        // The noise of uniform numbers up to 2, with 31,250 a square.
        assert!((found.left / (1.0 / 3.0 / 31_250.0) - 1.0).abs() < 0.1, "{}", found.left);
        for (square, factor) in found.factors.iter().enumerate() {
            let expected = if square % 8 < 4 { 1.0 / 1.05 } else { 1.0 / 0.97 };
            assert!((factor.x - expected).abs() < 0.01, "{square}: {factor}");
        }
        let far = correction(&grid(200_000, 3, |_| 3.0)).expect("it is wrong");
        assert!(far.factors.iter().all(|factor| (f64::from(factor.y) - 1.0 + MOST).abs() < 1e-6));
    }

    #[test]
    fn factors_are_of_the_middles_of_squares_and_not_of_emitters() {
        let mut picture = Picture::new(4, 2, vec![Rgb::ONE; 8]);
        let mut shine = vec![Rgb::ZERO; 8];
        shine[3] = Rgb::ONE;
        let factors = [1.0, 2.0, 1.0, 2.0].map(Rgb::splat);
        apply(&mut picture, &shine, &factors);
        let row: Vec<f32> = picture.pixels[..4].iter().map(|pixel| pixel.x).collect();
        assert_eq!(row, [1.0, 1.25, 1.75, 1.0]);
        assert_eq!(picture.pixels[7].x, 2.0);
    }
}
