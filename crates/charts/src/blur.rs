//! What is left of a picture's errors where they are seen from afar: single pixels average out,
//! blotches stay.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;

/// Standard deviation of the Gaussian that errors are judged after, pixels.
pub const BLUR: f32 = 6.0;

/// Gaussian of standard deviation `deviation` over the counted pixels, over the weight that they
/// have there; black where a pixel does not count.
///
/// # Panics
/// Where the mask is for another size.
pub fn blurred(picture: &Picture, counted: &[bool], deviation: f32) -> Picture {
    assert_eq!(counted.len(), picture.pixels.len(), "a mask is for another size");
    let (width, height) = (picture.width as usize, picture.height as usize);
    let weighted = picture.pixels.iter().zip(counted);
    let weighted: Vec<(Rgb, f32)> = weighted
        .map(|(value, counted)| if *counted { (*value, 1.0) } else { (Rgb::ZERO, 0.0) })
        .collect();
    let rows = convolved(&weighted, width, height, deviation);
    // The result lies transposed, so the second pass goes along columns and puts it back.
    let both = convolved(&rows, height, width, deviation);
    let mean = |((sum, weight), counted): (&(Rgb, f32), &bool)| {
        if *counted { *sum / *weight } else { Rgb::ZERO }
    };
    let pixels = both.iter().zip(counted).map(mean).collect();
    Picture::new(picture.width, picture.height, pixels)
}

/// Convolved along rows, up to three standard deviations, and transposed.
fn convolved(
    values: &[(Rgb, f32)],
    width: usize,
    height: usize,
    deviation: f32,
) -> Vec<(Rgb, f32)> {
    let reach = (3.0 * deviation) as usize;
    let kernel: Vec<f32> =
        (0..=reach).map(|at| (-0.5 * (at as f32 / deviation).powi(2)).exp()).collect();
    let mut result = vec![(Rgb::ZERO, 0.0); values.len()];
    for y in 0..height {
        let row = &values[y * width..][..width];
        for x in 0..width {
            let near = x.saturating_sub(reach)..(x + reach + 1).min(width);
            result[x * height + y] = near.fold((Rgb::ZERO, 0.0), |(sum, total), at| {
                let weight = kernel[at.abs_diff(x)];
                (sum + row[at].0 * weight, total + row[at].1 * weight)
            });
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_even_stays_and_a_point_spreads_by_its_gaussian() {
        let mut picture = Picture::new(40, 30, vec![Rgb::splat(2.0); 1200]);
        let mut counted = vec![true; 1200];
        counted[5] = false;
        picture.pixels[5] = Rgb::splat(1000.0);
        let even = blurred(&picture, &counted, 3.0);
        for (at, pixel) in even.pixels.iter().enumerate().filter(|(at, _)| *at != 5) {
            assert!((pixel.x - 2.0).abs() < 1e-5, "{at}: {pixel}");
        }
        let mut point = Picture::black(41, 41);
        point.pixels[20 * 41 + 20] = Rgb::ONE;
        let spread = blurred(&point, &[true; 41 * 41], 2.0);
        let at = |x: usize, y: usize| f64::from(spread.pixels[y * 41 + x].x);
        let gaussian =
            |x: f64, y: f64| (-(x * x + y * y) / 8.0).exp() / (8.0 * std::f64::consts::PI);
        for (x, y) in [(0, 0), (1, 0), (0, 3), (2, 2)] {
            let (found, expected) = (at(20 + x, 20 + y), gaussian(x as f64, y as f64));
            assert!((found / expected - 1.0).abs() < 0.01, "{x} {y}: {found} {expected}");
        }
    }
}
