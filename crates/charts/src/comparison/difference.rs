//! Pictures of relative differences: white where two pictures agree, red where one is brighter,
//! blue where it is darker.

use crate::accuracy::mean;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::{IMPORTANCE_WEIGHTS, Rgb};

/// Display colours (linear) of a difference at the negative and the positive end of the scale.
const DARKER: Rgb = Rgb::new(0.0, 0.08, 0.55);
const BRIGHTER: Rgb = Rgb::new(0.6, 0.01, 0.0);
/// Pixels that see an emitter.
const LEFT_OUT: Rgb = Rgb::new(0.25, 0.25, 0.25);
/// Reference values below this share of their mean don't make a difference larger.
const FLOOR: f32 = 0.02;
/// Scales to choose from.
const SCALES: [f32; 8] = [0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0];

/// Relative differences of luminance (x − ref)/ref by pixel; NaN where a pixel doesn't count.
pub fn relative(x: &Picture, reference: &Picture, counted: &[bool]) -> Vec<f32> {
    let floor = FLOOR * mean(reference, counted) as f32;
    let pairs = x.pixels.iter().zip(&reference.pixels).zip(counted);
    let difference = |((x, exact), counted): ((&Rgb, &Rgb), &bool)| {
        let exact = exact.dot(IMPORTANCE_WEIGHTS);
        let away = x.dot(IMPORTANCE_WEIGHTS) - exact;
        if *counted { away / exact.max(floor).max(f32::MIN_POSITIVE) } else { f32::NAN }
    };
    pairs.map(difference).collect()
}

/// One scale for all: the smallest that holds 80 % of the pixels of the middle one of them.
pub fn scale(differences: &[Vec<f32>]) -> f32 {
    let mut wanted: Vec<f32> = differences
        .iter()
        .filter_map(|one| {
            let mut sizes: Vec<f32> =
                one.iter().filter(|d| d.is_finite()).map(|d| d.abs()).collect();
            let at = sizes.len() * 4 / 5;
            (at < sizes.len()).then(|| *sizes.select_nth_unstable_by(at, f32::total_cmp).1)
        })
        .collect();
    wanted.sort_by(f32::total_cmp);
    let middle = wanted.get(wanted.len() / 2).copied().unwrap_or(0.0);
    let largest = SCALES[SCALES.len() - 1];
    SCALES.into_iter().find(|scale| *scale >= middle).unwrap_or(largest)
}

/// Colour of a difference, for display at exposure 1.
fn color(difference: f32, scale: f32) -> Rgb {
    if difference.is_nan() {
        return LEFT_OUT;
    }
    let share = (difference / scale).clamp(-1.0, 1.0);
    Rgb::ONE.lerp(if share < 0.0 { DARKER } else { BRIGHTER }, share.abs())
}

/// The differences as a picture for display at exposure 1.
pub fn picture(differences: &[f32], width: u32, height: u32, scale: f32) -> Picture {
    let pixels = differences.iter().map(|difference| color(*difference, scale)).collect();
    Picture::new(width, height, pixels)
}

/// The colours of the scale, the brightest difference on top, in five steps a side.
pub fn key(width: u32, height: u32) -> Picture {
    let row = |y: u32| {
        let step = (11 * y / height.max(1)) as f32;
        color(1.0 - step / 5.0, 1.0)
    };
    let pixels = (0..height).flat_map(|y| std::iter::repeat_n(row(y), width as usize)).collect();
    Picture::new(width, height, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brighter_is_red_and_darker_is_blue() {
        let flat = |value: f32| Picture::new(4, 1, vec![Rgb::splat(value); 4]);
        let reference = flat(2.0);
        let mut x = flat(2.0);
        x.pixels[1] = Rgb::splat(2.4);
        x.pixels[2] = Rgb::splat(1.6);
        let differences = relative(&x, &reference, &[true, true, true, false]);
        for (found, expected) in differences.iter().zip([0.0, 0.2, -0.2]) {
            assert!((found - expected).abs() < 1e-5, "{differences:?}");
        }
        assert!(differences[3].is_nan());
        let shown = picture(&differences, 4, 1, 0.2);
        assert_eq!(shown.pixels[0], Rgb::ONE);
        assert!(shown.pixels[1].abs_diff_eq(BRIGHTER, 1e-4));
        assert!(shown.pixels[2].abs_diff_eq(DARKER, 1e-4));
        assert_eq!(shown.pixels[3], LEFT_OUT);
    }

    #[test]
    fn the_scale_holds_most_pixels_of_the_middle_picture() {
        let all = |value: f32| vec![value; 10];
        assert_eq!(scale(&[all(0.01), all(0.15), all(9.0)]), 0.2);
        assert_eq!(scale(&[all(9.0)]), 2.0);
        assert_eq!(scale(&[]), 0.02);
        let mut outliers = all(0.04);
        outliers[3] = 5.0;
        assert_eq!(scale(&[outliers]), 0.05);
    }
}
