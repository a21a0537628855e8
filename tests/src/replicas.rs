//! Independent pictures of the same view: means of blocks of pixels and of all with what chance
//! leaves uncertain, and the noise of one picture. `tests/comparators.rs` shows that a planted
//! error is found.

use crate::oracle::statistics::Moments;
use hemilux_engine::image::Picture;

/// Pictures that differ by chance only.
#[derive(Clone, Debug, Default)]
pub struct Replicas {
    /// The pictures, of one size.
    pub pictures: Vec<Picture>,
}

impl Replicas {
    /// Means of the counted pixels of each of `across` × `across` blocks, channels summed. Blocks
    /// in which no pixel counts are left out.
    pub fn blocks(&self, across: u32, counted: impl Fn(usize) -> bool) -> Vec<Moments> {
        let first = &self.pictures[0];
        let (width, height) = (first.width, first.height);
        let block_of = |index: usize| {
            let (x, y) = (index as u32 % width, index as u32 / width);
            (y * across / height * across + x * across / width) as usize
        };
        let mut moments = vec![Moments::default(); (across * across) as usize];
        let mut pixels = vec![0.0; moments.len()];
        (0..first.pixels.len()).filter(|i| counted(*i)).for_each(|i| pixels[block_of(i)] += 1.0);
        for picture in &self.pictures {
            assert_eq!((picture.width, picture.height), (width, height), "sizes differ");
            let mut sums = vec![0.0; moments.len()];
            for (index, pixel) in picture.pixels.iter().enumerate().filter(|(i, _)| counted(*i)) {
                sums[block_of(index)] += f64::from(pixel.element_sum());
            }
            for ((moments, sum), pixels) in moments.iter_mut().zip(sums).zip(&pixels) {
                moments.push(sum / pixels);
            }
        }
        moments.into_iter().zip(pixels).filter(|(_, pixels)| *pixels > 0.0).map(|b| b.0).collect()
    }

    /// Mean of all counted pixels, channels summed.
    pub fn mean(&self, counted: impl Fn(usize) -> bool) -> Moments {
        self.blocks(1, counted)[0]
    }

    /// rRMSE of one picture over the counted pixels against what all converge to, from their
    /// scatter about their mean.
    pub fn noise(&self, counted: impl Fn(usize) -> bool) -> f64 {
        let count = self.pictures.len() as f32;
        assert!(count >= 2.0, "one picture does not scatter");
        let (mut squares, mut sum, mut values) = (0.0, 0.0, 0.0);
        for index in (0..self.pictures[0].pixels.len()).filter(|index| counted(*index)) {
            let all = || self.pictures.iter().map(|picture| picture.pixels[index]);
            let mean = all().sum::<glam::Vec3>() / count;
            squares += all().map(|x| f64::from((x - mean).length_squared())).sum::<f64>();
            sum += f64::from(mean.element_sum());
            values += 3.0;
        }
        (squares / (values * f64::from(count - 1.0))).sqrt() / (sum / values)
    }
}
