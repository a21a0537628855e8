//! The sub-pixel samples of a pixel, and the squares that it is cut into.

use glam::Vec2;

/// Most sub-pixel samples: each has a bit of a fragment's mask.
pub const MOST_SAMPLES: u32 = 64;

/// A square of those that a pixel is cut into.
pub struct PixelSquare {
    /// Its middle, from the pixel's.
    pub middle: Vec2,
    /// The samples in it, a bit each.
    pub samples: u64,
}

/// So many squares along and across a pixel.
pub fn squares(count: u32, samples: &[Vec2]) -> Vec<PixelSquare> {
    let at = |index: u32| (index as f32 + 0.5) / count as f32 - 0.5;
    let along = |place: f32| (((place + 0.5) * count as f32) as u32).min(count - 1);
    let square = |index: u32| {
        let is_in = |sample: Vec2| along(sample.y) * count + along(sample.x) == index;
        let numbered = samples.iter().enumerate();
        let own = numbered.filter(|(_, sample)| is_in(**sample));
        PixelSquare {
            middle: Vec2::new(at(index % count), at(index / count)),
            samples: own.fold(0, |all, (number, _)| all | 1 << number),
        }
    };
    (0..count * count).map(square).collect()
}
