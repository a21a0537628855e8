//! How far pictures are from a reference: relative errors free of the reference's own noise,
//! split into noise and bias over repetitions.
//!
//! Relative errors are over linear RGB: √mean((x − ref)²)/mean(ref) over the counted pixels.

use crate::blur::{BLUR, blurred};
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;

/// Two independent pictures A and B of the same truth. mean((x − A)(x − B)) estimates the squared
/// error of an independent x without the noise of either.
pub struct Reference {
    first: Picture,
    second: Picture,
    single: bool,
}

impl Reference {
    /// Two halves.
    ///
    /// # Panics
    /// Where their sizes differ.
    pub fn new(first: Picture, second: Picture) -> Self {
        assert_eq!(size(&first), size(&second), "the halves of a reference differ in size");
        Self { first, second, single: false }
    }

    /// One picture, taken as exact: what noise it has counts as error.
    pub fn single(picture: Picture) -> Self {
        Self { first: picture.clone(), second: picture, single: true }
    }

    /// Whether there are no halves to tell its noise from.
    pub fn is_single(&self) -> bool {
        self.single
    }

    /// The halves; twice the same picture where there is only one.
    pub fn halves(&self) -> [&Picture; 2] {
        [&self.first, &self.second]
    }

    /// Mean of both halves.
    pub fn picture(&self) -> Picture {
        let both = self.first.pixels.iter().zip(&self.second.pixels);
        Picture::new(
            self.first.width,
            self.first.height,
            both.map(|(a, b)| (*a + *b) * 0.5).collect(),
        )
    }

    /// Mean radiance over the counted pixels.
    pub fn mean(&self, counted: &[bool]) -> f64 {
        0.5 * (mean(&self.first, counted) + mean(&self.second, counted))
    }

    /// Estimated relative error of [`Reference::picture`] itself; NaN of a single picture.
    pub fn own_error(&self, counted: &[bool]) -> f64 {
        if self.single {
            return f64::NAN;
        }
        let halves = (&self.first, &self.second);
        let squares = product(halves, halves, 1.0, counted);
        0.5 * squares.sqrt() / self.mean(counted)
    }

    /// Squared relative error of `x`: unbiased, so below 0 at times where `x` is about as good as
    /// the reference.
    pub fn squared_error(&self, x: &Picture, counted: &[bool]) -> f64 {
        product((x, &self.first), (x, &self.second), 1.0, counted) / self.mean(counted).powi(2)
    }

    /// [`Reference::squared_error`] with its standard error, by how the counted pixels scatter:
    /// noise of the reference is in it, and chance in which pixels are counted where these stand for
    /// all.
    pub fn judged(&self, x: &Picture, counted: &[bool]) -> Judged {
        let square = product((x, &self.first), (x, &self.second), 1.0, counted);
        let (mut scatter, mut count) = (0.0, 0.0);
        for (at, _) in counted.iter().enumerate().filter(|(_, counted)| **counted) {
            let off = |reference: &Picture| x.pixels[at] - reference.pixels[at];
            let own = f64::from((off(&self.first) * off(&self.second)).element_sum()) / 3.0;
            scatter += (own - square).powi(2);
            count += 1.0;
        }
        let deviation = (scatter / (count * (count - 1.0))).sqrt();
        let mean = self.mean(counted).powi(2);
        Judged { square: square / mean, deviation: deviation / mean }
    }

    /// The same after a Gaussian of [`BLUR`] pixels over the counted ones: what is left of the error
    /// from afar.
    pub fn blurred_squared_error(&self, x: &Picture, counted: &[bool]) -> f64 {
        let soft = |picture| blurred(picture, counted, BLUR);
        Self::new(soft(&self.first), soft(&self.second)).squared_error(&soft(x), counted)
    }

    /// Relative error below which this reference can't tell pictures apart: √ of twice the standard
    /// error that the halves' noise gives [`Reference::squared_error`] of an exact picture, taken
    /// as normal and the channels of a pixel as one. NaN of a single picture.
    pub fn resolution(&self, counted: &[bool]) -> f64 {
        if self.single {
            return f64::NAN;
        }
        let (mut fourth, mut count) = (0.0, 0.0);
        let halves = self.first.pixels.iter().zip(&self.second.pixels);
        for ((a, b), _) in halves.zip(counted).filter(|(_, counted)| **counted) {
            // Of a difference with twice the variance, E d⁴ = 12 σ⁴.
            fourth += f64::from((*a - *b).length_squared()).powi(2) / 12.0;
            count += 3.0;
        }
        (2.0 * fourth.sqrt() / count).sqrt() / self.mean(counted)
    }

    /// Median of |x − ref|/ref over the counted pixels and channels where the reference is not
    /// black; NaN where there are none. The reference's noise is not taken off.
    pub fn median_error(&self, x: &Picture, counted: &[bool]) -> f64 {
        assert_eq!(size(x), size(&self.first), "pictures differ in size");
        let reference = self.picture();
        let pairs = x.pixels.iter().zip(&reference.pixels).zip(counted);
        let mut errors: Vec<f32> = pairs
            .filter(|(_, counted)| **counted)
            .flat_map(|((x, exact), _)| x.to_array().into_iter().zip(exact.to_array()))
            .filter(|(_, exact)| *exact > 0.0)
            .map(|(x, exact)| (x - exact).abs() / exact)
            .collect();
        if errors.is_empty() {
            return f64::NAN;
        }
        let middle = errors.len() / 2;
        f64::from(*errors.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// Mean radiance of `x` over that of the reference.
    pub fn energy(&self, x: &Picture, counted: &[bool]) -> f64 {
        mean(x, counted) / self.mean(counted)
    }
}

/// A squared relative error, and how far it may be off.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// See [`Reference::squared_error`].
    pub square: f64,
    /// Its standard error.
    pub deviation: f64,
}

impl Judged {
    /// Relative error; negative where its square is estimated to be.
    pub fn error(self) -> f64 {
        error(self.square)
    }

    /// Relative error that would be three standard errors: what is below is no figure, and what is
    /// above is right within a fifth.
    pub fn resolution(self) -> f64 {
        (3.0 * self.deviation).sqrt()
    }

    /// Whether the error is a figure.
    pub fn is_resolved(self) -> bool {
        self.error() >= self.resolution()
    }
}

/// √ of a squared error; an estimate below 0 stays visible as a negative error.
pub fn error(squared: f64) -> f64 {
    squared.abs().sqrt().copysign(squared)
}

/// Repetitions of a picture with independent seeds, for telling noise from bias.
pub struct Repetitions {
    sum: Picture,
    count: usize,
}

impl Repetitions {
    /// None yet.
    pub fn new(width: u32, height: u32) -> Self {
        Self { sum: Picture::black(width, height), count: 0 }
    }

    /// One more.
    pub fn add(&mut self, x: &Picture) {
        assert_eq!(size(x), size(&self.sum), "repetitions differ in size");
        self.sum.pixels.iter_mut().zip(&x.pixels).for_each(|(sum, x)| *sum += *x);
        self.count += 1;
    }

    /// Squared relative bias: mean over pairs s ≠ t of mean((x_s − A)(x_t − B)), unbiased, so at
    /// times below 0. `squared_errors` are those of the repetitions over the same pixels. NaN with
    /// fewer than two.
    pub fn squared_bias(
        &self,
        reference: &Reference,
        squared_errors: &[f64],
        counted: &[bool],
    ) -> f64 {
        assert_eq!(squared_errors.len(), self.count, "one error a repetition");
        let n = self.count as f64;
        if self.count < 2 {
            return f64::NAN;
        }
        let (a, b) = (&reference.first, &reference.second);
        let all =
            product((&self.sum, a), (&self.sum, b), n, counted) / reference.mean(counted).powi(2);
        (all - squared_errors.iter().sum::<f64>()) / (n * (n - 1.0))
    }
}

/// Mean over counted pixels and channels of (x − scale·a)(y − scale·b).
fn product(
    (x, a): (&Picture, &Picture),
    (y, b): (&Picture, &Picture),
    scale: f64,
    counted: &[bool],
) -> f64 {
    for other in [a, y, b] {
        assert_eq!(size(x), size(other), "pictures differ in size");
    }
    assert_eq!(counted.len(), x.pixels.len(), "a mask is for another size");
    let scale = scale as f32;
    let (mut sum, mut count) = (0.0, 0.0);
    for (at, _) in counted.iter().enumerate().filter(|(_, counted)| **counted) {
        let left: Rgb = x.pixels[at] - scale * a.pixels[at];
        let right: Rgb = y.pixels[at] - scale * b.pixels[at];
        sum += f64::from((left * right).element_sum());
        count += 3.0;
    }
    sum / count
}

/// Mean radiance over the counted pixels and the channels.
pub fn mean(x: &Picture, counted: &[bool]) -> f64 {
    assert_eq!(counted.len(), x.pixels.len(), "a mask is for another size");
    let (mut sum, mut count) = (0.0, 0.0);
    for (pixel, _) in x.pixels.iter().zip(counted).filter(|(_, counted)| **counted) {
        sum += f64::from(pixel.element_sum());
        count += 3.0;
    }
    sum / count
}

fn size(x: &Picture) -> (u32, u32) {
    (x.width, x.height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_engine::random::{Stream, uniform};

    const SIDE: u32 = 64;

    /// 2 + bias + uniform noise of standard deviation `noise`.
    fn noisy(seed: u64, bias: f32, noise: f32) -> Picture {
        let mut at = 0;
        let mut value = || {
            at += 1;
            2.0 + bias + noise * 12f32.sqrt() * (uniform(seed, Stream::PointU, at) - 0.5)
        };
        let pixels = (0..SIDE * SIDE).map(|_| Rgb::new(value(), value(), value())).collect();
        Picture::new(SIDE, SIDE, pixels)
    }

    fn all() -> Vec<bool> {
        vec![true; (SIDE * SIDE) as usize]
    }

    fn exact() -> Reference {
        Reference::new(noisy(1, 0.0, 0.0), noisy(1, 0.0, 0.0))
    }

    #[test]
    fn a_planted_error_is_found_where_it_is_counted() {
        let reference = exact();
        let mut x = noisy(1, 0.0, 0.0);
        assert_eq!(reference.squared_error(&x, &all()), 0.0);
        assert_eq!(reference.energy(&x, &all()), 1.0);
        x.pixels[5].y += 3.0;
        let expected = (9.0 / (3.0 * f64::from(SIDE * SIDE))).sqrt() / 2.0;
        let found = error(reference.squared_error(&x, &all()));
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
        assert!(reference.energy(&x, &all()) > 1.0);
        let mut without = all();
        without[5] = false;
        assert_eq!(reference.squared_error(&x, &without), 0.0);
    }

    /// A reference noisier than the picture hides its error from the plain formula, not from this.
    #[test]
    fn noise_of_the_reference_is_left_out() {
        let reference = Reference::new(noisy(1, 0.0, 0.4), noisy(2, 0.0, 0.4));
        let own = reference.own_error(&all());
        assert!((own / (0.4 / 2f64.sqrt() / 2.0) - 1.0).abs() < 0.03, "{own}");
        let found = error(reference.squared_error(&noisy(3, 0.0, 0.2), &all()));
        assert!((found / 0.1 - 1.0).abs() < 0.1, "{found}");
        let found = error(reference.squared_error(&noisy(3, 0.0, 0.1), &all()));
        assert!((found / 0.05 - 1.0).abs() < 0.2, "{found}");
    }

    /// Exact pictures against references of many seeds: their squared errors scatter about 0 by
    /// half the square of what is called the resolution, but for the channels, which are
    /// independent here: √(4.4/3) = 1.2 for such noise.
    #[test]
    fn the_resolution_is_twice_the_standard_error_of_exact_pictures() {
        let exact = noisy(1, 0.0, 0.0);
        let (mut squares, mut resolution, seeds) = (0.0, 0.0, 40);
        for seed in 0..seeds {
            let halves = [2 * seed + 10, 2 * seed + 11].map(|seed| noisy(seed, 0.0, 0.4));
            let [first, second] = halves;
            let reference = Reference::new(first, second);
            squares += reference.squared_error(&exact, &all()).powi(2) / seeds as f64;
            resolution += reference.resolution(&all()) / seeds as f64;
        }
        let ratio = resolution.powi(2) / 2.0 / squares.sqrt();
        assert!((0.9..1.6).contains(&ratio), "{ratio}, expected 1.2");
    }

    /// A tenth of the pixels, with a reference as noisy, say what all of them do, within what they
    /// say of themselves.
    #[test]
    fn some_pixels_stand_for_all() {
        let exact = noisy(1, 0.0, 0.0);
        let mut x = noisy(3, 0.0, 0.2);
        // One in eight is far more wrong than the rest.
        x.pixels.iter_mut().step_by(8).for_each(|pixel| *pixel *= 1.5);
        let all = exact_error(&x);
        let (mut off, mut told, parts) = (0.0, 0.0, 13);
        for part in 0..parts {
            let of = |at: usize| (13.0 * uniform(7, Stream::PointV, at as u64)) as usize;
            let some: Vec<bool> = (0..x.pixels.len()).map(|at| of(at) == part).collect();
            let halves = [20, 21].map(|seed| noisy(seed + 2 * part as u64, 0.0, 0.1));
            let [first, second] = halves;
            let judged = Reference::new(first, second).judged(&x, &some);
            off += (judged.square - all).powi(2) / parts as f64;
            told += judged.deviation.powi(2) / parts as f64;
            assert!(judged.is_resolved());
        }
        let ratio = (off / told).sqrt();
        assert!((0.6..1.5).contains(&ratio), "{ratio}");
        let nothing = Reference::new(noisy(4, 0.0, 0.4), noisy(5, 0.0, 0.4));
        let judged = nothing.judged(&exact, &self::all());
        assert!(!judged.is_resolved(), "{judged:?}");
    }

    /// Squared error over all pixels, by an exact reference.
    fn exact_error(x: &Picture) -> f64 {
        exact().squared_error(x, &all())
    }

    #[test]
    fn noise_and_bias_are_told_apart() {
        let reference = Reference::new(noisy(1, 0.0, 0.2), noisy(2, 0.0, 0.2));
        for bias in [0.0f32, 0.1] {
            let mut repetitions = Repetitions::new(SIDE, SIDE);
            let mut errors = Vec::new();
            for seed in 10..16 {
                let x = noisy(seed, bias, 0.3);
                errors.push(reference.squared_error(&x, &all()));
                repetitions.add(&x);
            }
            let squared_bias = repetitions.squared_bias(&reference, &errors, &all());
            let total = errors.iter().sum::<f64>() / errors.len() as f64;
            let expected = f64::from(bias / 2.0).powi(2);
            assert!((squared_bias - expected).abs() < 5e-4, "{squared_bias} {expected}");
            let noise = error(total - squared_bias);
            assert!((noise / 0.15 - 1.0).abs() < 0.05, "{noise}");
        }
    }

    /// Most pixels 10 % off, some by far: the median sees the first, the mean square the others.
    #[test]
    fn the_median_is_that_of_most_pixels() {
        let reference = Reference::single(noisy(1, 0.0, 0.0));
        assert!(reference.is_single() && reference.own_error(&all()).is_nan());
        let mut x = noisy(1, 0.2, 0.0);
        for pixel in x.pixels.iter_mut().step_by(10) {
            *pixel *= 9.0;
        }
        let median = reference.median_error(&x, &all());
        assert!((median - 0.1).abs() < 1e-5, "{median}");
        assert!(error(reference.squared_error(&x, &all())) > 1.0);
        let mut first_only = vec![false; x.pixels.len()];
        first_only[0] = true;
        assert!((reference.median_error(&x, &first_only) - 8.9).abs() < 1e-4);
        assert!(reference.median_error(&x, &vec![false; x.pixels.len()]).is_nan());
    }

    #[test]
    fn negative_estimates_stay_visible() {
        assert_eq!(error(-0.04), -0.2);
        assert_eq!(error(0.04), 0.2);
    }
}
