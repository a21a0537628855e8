//! Differences of a picture from the paths, by square.

use crate::radiometry::Rgb;
use glam::Vec2;

/// Fewest paths of a square that is judged.
pub const LEAST_PATHS: f64 = 64.0;

/// Standard deviations of noise beyond which what is beyond noise is no chance, although what paths bring is
/// skewed: of many squares, whose sum is about normal. Of few squares their square sum, χ², has a longer
/// tail: of k squares it is 1 + 1/√k as many, by which chance passes once in 200 to 10,000 grids.
const SURE: f64 = 4.0;
/// Least share of what a picture shows that paths are taken to have brought, where their deviation is told by it.
const LEAST_BROUGHT: f64 = 0.2;

/// What is left of differences without the paths' noise.
#[derive(Clone, Copy)]
pub struct BeyondNoise {
    /// Mean over squares and channels of the squared mean difference, free of noise.
    pub square: f64,
    /// Its standard deviation where there is nothing but noise.
    pub deviation: f64,
    /// Squares that have paths enough.
    judged: usize,
}

impl BeyondNoise {
    /// Whether it is no chance.
    pub fn is_sure(&self) -> bool {
        let sure = SURE * (1.0 + 1.0 / (self.judged as f64).sqrt());
        self.square > sure * self.deviation
    }
}

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

    /// What is left without the paths' noise; `None` where too few paths meet most squares.
    pub fn beyond_noise(&self) -> Option<BeyondNoise> {
        let all: f64 = self.squares.iter().map(|own| own.count).sum();
        let enough = self.squares.iter().filter(|own| own.count >= LEAST_PATHS);
        let (mut judged, mut square, mut variance) = (0, 0.0, 0.0);
        let mut paths = 0.0;
        for own in enough {
            let (mean, noise) = own.mean_and_noise();
            judged += 1;
            paths += own.count;
            square += own.count * (mean - noise) / 3.0;
            // As if all channels had the same noise, which is nearly so.
            variance += 2.0 * (own.count * noise / 3.0).powi(2);
        }
        let (square, deviation) = (square / paths, variance.sqrt() / paths);
        (paths > 0.5 * all).then_some(BeyondNoise { square, deviation, judged })
    }
}

impl Differences {
    /// Σ over channels of the squared mean, and of the variance of the mean.
    fn mean_and_noise(&self) -> (f64, f64) {
        let square: f64 = self.sum.iter().map(|sum| (sum / self.count).powi(2)).sum();
        (square, self.scatter() / self.count)
    }

    /// Variance of one difference if the picture is right, summed over the channels.
    pub fn scatter(&self) -> f64 {
        let n = self.count;
        let of = |channel: usize| {
            let mean = self.sum[channel] / n;
            (self.squares[channel] / n - mean * mean).max(0.0)
        };
        (0..3).map(of).sum::<f64>() * n / (n - 1.0) * self.missed()
    }

    /// How many times the variance of right paths is what was found. Most light comes by few paths: where they
    /// happen to be missing, mean and deviation are low together, and the mean seems surely low. If the picture
    /// is right, the deviation is too small by as much as the mean.
    fn missed(&self) -> f64 {
        let shown: f64 = self.shown.iter().sum();
        let brought = shown - self.sum.iter().sum::<f64>();
        (shown / brought.max(LEAST_BROUGHT * shown).max(f64::MIN_POSITIVE)).max(1.0).powi(2)
    }
}
