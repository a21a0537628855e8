//! A least-squares plane through the values of neighbouring pixels.

use super::moments::Moments;
use crate::radiometry::Rgb;
use glam::{Mat3, Vec2};

/// Ridge of the regression, in squared pixels: it makes planes through few neighbours flat.
const RIDGE: f32 = 0.05;

/// Weighted least-squares plane through colours of pixels. Beside an edge, where neighbours are on
/// one side only, their mean would be biased by the gradient; the plane is not.
pub struct Plane {
    /// Moments of the pixels' places.
    moments: Moments,
    /// Σ w (1, x, y)ᵀ value, per channel.
    right: Mat3,
    /// Least and largest value.
    range: Option<(Rgb, Rgb)>,
    /// Σ w value².
    energy: Rgb,
    /// Σ w².
    squares: f32,
}

impl Plane {
    /// A plane through no pixels yet. (`Mat3::default()` is the identity.)
    pub fn new() -> Self {
        let (moments, right, energy) = (Moments::NONE, Mat3::ZERO, Rgb::ZERO);
        Self { moments, right, range: None, energy, squares: 0.0 }
    }

    /// Adds a pixel's value; the pixel is `across` to the right of the middle and `down` below it.
    pub fn add(&mut self, across: i32, down: i32, value: Rgb, weight: f32) {
        let weighted = self.moments.add(Vec2::new(across as f32, down as f32), weight);
        self.right += Mat3::from_cols(weighted * value.x, weighted * value.y, weighted * value.z);
        let (least, most) = self.range.unwrap_or((value, value));
        self.range = Some((least.min(value), most.max(value)));
        self.energy += value * value * weight;
        self.squares += weight * weight;
    }

    /// The weights of all pixels.
    pub fn weight(&self) -> f32 {
        self.moments.total
    }

    /// The weighted mean of all values.
    pub fn mean(&self) -> Rgb {
        let sums = [self.right.x_axis, self.right.y_axis, self.right.z_axis].map(|sum| sum.x);
        Rgb::from_array(sums) / self.moments.total.max(f32::MIN_POSITIVE)
    }

    /// Value of the plane in the middle, within the range of the pixels' values, and its variance
    /// by the residuals; no variance for fewer than five effective values, of which the plane takes
    /// three.
    pub fn center(self) -> (Rgb, Option<Rgb>) {
        let (value, residuals) = self.fit();
        (value, residuals.map(|Residuals { scatter, count }| scatter / count))
    }

    /// The value in the middle as far as values lie about the plane no more than by chance, which lets them
    /// scatter by the variance `noise`: what is more is bent, and by that over its sum with the variance of the
    /// middle's `own` value this counts (the linear estimate of Wiener). Variances are sums over the channels.
    pub fn center_unless_bent(self, (own, variance): (Rgb, f32), noise: f32) -> Center {
        let (value, residuals) = self.fit();
        let Some(Residuals { scatter, count }) = residuals else {
            return Center { value: own, variance, others: 0.0 };
        };
        let by_chance = (2.0 / (count - 3.0)).sqrt();
        let bent = (scatter.element_sum() - noise * (1.0 + by_chance)).max(0.0);
        let share = bent / (bent + variance).max(f32::MIN_POSITIVE);
        let others = 1.0 - share;
        Center {
            value: value + share * (own - value),
            variance: share * share * variance + others * others * (bent + noise / count),
            others,
        }
    }

    /// The value of [`Plane::center`], and how the pixels' values lie about the plane.
    pub fn fit(self) -> (Rgb, Option<Residuals>) {
        let Some((least, most)) = self.range else { return (Rgb::ZERO, None) };
        let total = self.moments.total;
        let solved = self.moments.inverse(RIDGE) * self.right;
        let channels = [solved.x_axis, solved.y_axis, solved.z_axis];
        let value = Rgb::from_array(channels.map(|channel| channel.x)).clamp(least, most);
        // Effective number of values; the plane takes three of them.
        let count = total * total / self.squares.max(f32::MIN_POSITIVE);
        if count < 5.0 {
            return (value, None);
        }
        let explained =
            Rgb::from_array(std::array::from_fn(|k| channels[k].dot(self.right.col(k))));
        let scatter = ((self.energy - explained) / total).max(Rgb::ZERO) * (count / (count - 3.0));
        // Σ w² of a value's weights in the middle is about that of their mean.
        (value, Some(Residuals { scatter, count }))
    }
}

/// What a pixel's own value and the plane through those around it say together.
pub struct Center {
    /// The value.
    pub value: Rgb,
    /// Variance of it, summed over the channels.
    pub variance: f32,
    /// How much of it is the plane's: 0 where there is none, or where values are bent.
    pub others: f32,
}

/// How values lie about the plane through them.
pub struct Residuals {
    /// Their variance about it.
    pub scatter: Rgb,
    /// Their effective number: more than the three that the plane takes.
    pub count: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    /// Beside an edge the neighbours are on one side only.
    #[test]
    fn a_plane_follows_what_changes_towards_one_side() {
        let value =
            |across: i32, down: i32| Rgb::new(3.0, 0.2, 0.01) + 0.001 * (across - down) as f32;
        for weight in [1e-3, 1.0, 1e3] {
            let (mut plane, mut mean, mut total) = (Plane::new(), Rgb::ZERO, 0.0);
            for down in -2..=2 {
                for across in 0..=2 {
                    plane.add(across, down, value(across, down), weight);
                    (mean, total) = (mean + value(across, down), total + 1.0);
                }
            }
            let (center, variance) = plane.center();
            assert!(variance.unwrap().max_element() < 1e-6, "{variance:?}");
            let off = (center - value(0, 0)).abs().max_element();
            let mean_off = (mean / total - value(0, 0)).abs().max_element();
            assert!(off < 1e-4, "{off}");
            assert!(mean_off > 9e-4, "{mean_off}");
        }
    }

    /// Values scattered by σ about a plane make its middle uncertain by about σ/√n.
    #[test]
    fn scatter_about_a_plane_tells_its_variance() {
        let mut random = crate::random::Numbers::new(5, Stream::Light, 0);
        let (mut squares, mut told) = (0.0, 0.0);
        const TRIES: usize = 2000;
        for _ in 0..TRIES {
            let mut plane = Plane::new();
            for across in -2..=2 {
                for down in -2..=2 {
                    let off = 0.2 * (random.uniform() - 0.5);
                    let value = 0.5 + 0.03 * across as f32 + off;
                    plane.add(across, down, Rgb::splat(value), 7.0);
                }
            }
            let (center, variance) = plane.center();
            squares += (center.x - 0.5).powi(2) / TRIES as f32;
            told += variance.unwrap().x / TRIES as f32;
        }
        assert!((0.8..1.25).contains(&(told / squares)), "{told} {squares}");
    }
}
