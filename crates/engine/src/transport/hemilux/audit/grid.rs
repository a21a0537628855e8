//! Differences of a picture from the paths, by square.

use crate::radiometry::Rgb;
use glam::Vec2;

/// Fewest paths of a square that is judged.
pub const LEAST_PATHS: f64 = 64.0;

/// Differences of a picture from the paths, by square.
#[derive(Clone)]
pub struct Grid {
    /// Squares along a side.
    pub side: usize,
    /// Row by row.
    pub squares: Vec<Differences>,
}

/// Sums over the paths of a square.
#[derive(Clone, Copy, Default)]
pub struct Differences {
    /// Number of paths.
    pub count: f64,
    /// Σ of what the picture shows where they begin.
    pub shown: [f64; 3],
    /// Σ of the picture less what they brought.
    pub sum: [f64; 3],
    squares: [f64; 3],
}

impl Grid {
    /// Of so many squares along a side, without a path.
    pub fn new(side: usize) -> Self {
        Self { side, squares: vec![Differences::default(); side * side] }
    }

    /// Takes in a path from a place of the picture, from 0 to 1 in columns and rows.
    pub fn add(&mut self, at: Vec2, shown: Rgb, brought: Rgb) {
        let along = |at: f32| ((at * self.side as f32) as usize).min(self.side - 1);
        let own = &mut self.squares[along(at.y) * self.side + along(at.x)];
        own.count += 1.0;
        for channel in 0..3 {
            let difference = f64::from(shown[channel] - brought[channel]);
            own.shown[channel] += f64::from(shown[channel]);
            own.sum[channel] += difference;
            own.squares[channel] += difference * difference;
        }
    }

    /// The same by squares of twice the side.
    pub fn coarser(&self) -> Self {
        let mut coarser = Self::new(self.side / 2);
        for (index, own) in self.squares.iter().enumerate() {
            let (x, y) = (index % self.side / 2, index / self.side / 2);
            let sum = &mut coarser.squares[y * (self.side / 2) + x];
            sum.count += own.count;
            for channel in 0..3 {
                sum.shown[channel] += own.shown[channel];
                sum.sum[channel] += own.sum[channel];
                sum.squares[channel] += own.squares[channel];
            }
        }
        coarser
    }

    /// Mean over squares and channels of the squared mean difference, free of the paths' noise, and its
    /// standard deviation where there is nothing but noise. `None` where too few paths meet most squares.
    pub fn beyond_noise(&self) -> Option<(f64, f64)> {
        let all: f64 = self.squares.iter().map(|own| own.count).sum();
        let enough = self.squares.iter().filter(|own| own.count >= LEAST_PATHS);
        let (mut judged, mut square, mut variance) = (0.0, 0.0, 0.0);
        for own in enough {
            let (mean, noise) = own.mean_and_noise();
            judged += own.count;
            square += own.count * (mean - noise) / 3.0;
            // As if all channels had the same noise, which is nearly so.
            variance += 2.0 * (own.count * noise / 3.0).powi(2);
        }
        (judged > 0.5 * all).then(|| (square / judged, variance.sqrt() / judged))
    }
}

impl Differences {
    /// Σ over channels of the squared mean, and of the variance of the mean.
    fn mean_and_noise(&self) -> (f64, f64) {
        let square: f64 = self.sum.iter().map(|sum| (sum / self.count).powi(2)).sum();
        (square, self.scatter() / self.count)
    }

    /// Variance of one difference, summed over the channels.
    pub fn scatter(&self) -> f64 {
        let n = self.count;
        let of = |channel: usize| {
            let mean = self.sum[channel] / n;
            (self.squares[channel] / n - mean * mean).max(0.0)
        };
        (0..3).map(of).sum::<f64>() * n / (n - 1.0)
    }
}
