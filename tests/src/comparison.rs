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

/// Pixels that see no emitter, in a picture where emitters are brighter than `limit`.
pub fn away_from_light(picture: &Picture, limit: f32) -> impl Fn(usize) -> bool {
    let (width, height) = (picture.width as i32, picture.height as i32);
    let bright: Vec<bool> = picture.pixels.iter().map(|p| p.max_element() > limit).collect();
    move |index| {
        let (x, y) = (index as i32 % width, index as i32 / width);
        !(-2..=2).any(|dy| {
            (-2..=2).any(|dx| {
                let (x, y) = (x + dx, y + dy);
                x >= 0 && y >= 0 && x < width && y < height && bright[(y * width + x) as usize]
            })
        })
    }
}

/// rRMSE against two independent halves of a reference, free of their noise:
/// √mean((x − a)(x − b)) over the mean.
pub fn error_by_halves(
    x: &Picture,
    a: &Picture,
    b: &Picture,
    counted: impl Fn(usize) -> bool,
) -> f64 {
    let (mut product, mut sum, mut count) = (0.0, 0.0, 0.0);
    let all = x.pixels.iter().zip(a.pixels.iter().zip(&b.pixels)).enumerate();
    for (_, (x, (a, b))) in all.filter(|(index, _)| counted(*index)) {
        product += (*x - *a).as_dvec3().dot((*x - *b).as_dvec3());
        sum += f64::from((*a + *b).element_sum()) / 2.0;
        count += 3.0;
    }
    (product / count).max(0.0).sqrt() / (sum / count)
}
