//! Comparators; `tests/comparators.rs` shows that each fails on a planted error.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;

/// Largest |value/expected − 1| over all values.
pub fn largest_relative_deviation(values: &[f64], expected: f64) -> f64 {
    values.iter().map(|value| (value / expected - 1.0).abs()).fold(0.0, f64::max)
}

/// rRMSE = √mean((x − ref)²)/mean(ref) over the pixels that `counted` allows.
pub fn relative_rmse(x: &Picture, reference: &Picture, counted: impl Fn(usize) -> bool) -> f64 {
    assert_eq!((x.width, x.height), (reference.width, reference.height), "sizes differ");
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for (index, (a, b)) in x.pixels.iter().zip(&reference.pixels).enumerate() {
        if counted(index) {
            let difference: Rgb = *a - *b;
            squares += f64::from(difference.length_squared());
            sum += f64::from(b.element_sum());
            count += 3.0;
        }
    }
    (squares / count).sqrt() / (sum / count)
}

/// Mean of x over mean of the reference over the pixels that `counted` allows.
pub fn mean_ratio(x: &Picture, reference: &Picture, counted: impl Fn(usize) -> bool) -> f64 {
    let mean = |picture: &Picture| -> f64 {
        let counted = picture.pixels.iter().enumerate().filter(|(index, _)| counted(*index));
        counted.map(|(_, pixel)| f64::from(pixel.element_sum())).sum()
    };
    mean(x) / mean(reference)
}
