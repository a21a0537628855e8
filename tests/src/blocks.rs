//! Pictures compared by means over blocks of pixels, in which noise averages out and a wrong light
//! does not.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::{Rgb, importance};

/// Means over blocks of `side` × `side` pixels, row by row; what is left over at the right and at
/// the bottom is in none.
pub fn block_means(picture: &Picture, side: u32) -> Vec<Rgb> {
    let (columns, rows) = (picture.width / side, picture.height / side);
    let mut sums = vec![Rgb::ZERO; (columns * rows) as usize];
    for y in 0..rows * side {
        for x in 0..columns * side {
            let pixel = picture.pixels[(y * picture.width + x) as usize];
            sums[(y / side * columns + x / side) as usize] += pixel / (side * side) as f32;
        }
    }
    sums
}

/// The largest difference between blocks of two pictures, by luminance, relative to the block of the
/// reference or, where that is darker, to a fifth of the reference's mean.
pub fn largest_deviation(blocks: &[Rgb], reference: &[Rgb]) -> f64 {
    assert_eq!(blocks.len(), reference.len(), "pictures of different sizes");
    let mean = reference.iter().map(|block| f64::from(importance(*block))).sum::<f64>()
        / reference.len() as f64;
    let deviation = |(own, other): (&Rgb, &Rgb)| {
        let [own, other] = [own, other].map(|block| f64::from(importance(*block)));
        (own - other).abs() / other.max(0.2 * mean)
    };
    blocks.iter().zip(reference).map(deviation).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_that_is_off_is_found() {
        let mut picture = Picture::new(9, 8, vec![Rgb::new(1.0, 2.0, 3.0); 72]);
        let reference = block_means(&picture, 4);
        assert_eq!(reference.len(), 4);
        assert!(largest_deviation(&block_means(&picture, 4), &reference) < 1e-6);
        for x in 4..8 {
            picture.pixels[9 * 5 + x] *= 1.4;
        }
        let found = largest_deviation(&block_means(&picture, 4), &reference);
        assert!((found - 0.1).abs() < 1e-4, "{found}");
    }
}
