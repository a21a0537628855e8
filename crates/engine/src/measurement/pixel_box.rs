//! Boxes of triangles over the pixel grid: most triangles of a crowd are smaller than a pixel and lie
//! beside most of its samples.

use crate::raster::PixelTriangle;
use glam::Vec2;

/// Units of a pixel's side, as a power of two.
const BITS: u32 = 8;
const UNITS: f32 = (1 << BITS) as f32;
/// Boxes are larger by so many pixels for rounding: the edge functions decide.
const SLACK: f32 = 0.05;
/// Farther away than any pixel.
const FAR: i32 = 1 << 28;

/// A box, in parts of pixels from the middle of the first one.
#[derive(Clone, Copy, Debug)]
pub struct PixelBox {
    low: [i32; 2],
    high: [i32; 2],
}

/// A sub-pixel offset in the same units.
#[derive(Clone, Copy, Debug)]
pub struct BoxOffset([i32; 2]);

impl BoxOffset {
    /// Of an offset in pixels.
    pub fn new(offset: Vec2) -> Self {
        Self(offset.to_array().map(|along| (along * UNITS).round() as i32))
    }
}

impl PixelBox {
    /// Everything.
    pub const ALL: Self = Self { low: [-FAR; 2], high: [FAR; 2] };

    /// That of corners in pixels, column and row.
    pub fn new([a, b, c]: [Vec2; 3]) -> Self {
        let low = (a.min(b).min(c) - SLACK) * UNITS;
        let high = (a.max(b).max(c) + SLACK) * UNITS;
        if !(low.is_finite() && high.is_finite()) {
            return Self::ALL;
        }
        let far = FAR as f32;
        Self {
            low: low.floor().to_array().map(|low| low.clamp(-far, far) as i32),
            high: high.ceil().to_array().map(|high| high.clamp(-far, far) as i32),
        }
    }

    /// Whether any sample of a picture of so many columns may lie in it.
    pub fn meets_columns(&self, width: u32) -> bool {
        let side = 1 << BITS;
        self.high[0] >= -side && i64::from(self.low[0]) <= i64::from(width) * i64::from(side)
    }

    /// Whether samples at an offset from the pixels' middles may lie in it.
    #[inline(always)]
    pub fn is_met(&self, offset: BoxOffset) -> bool {
        let [columns, rows] =
            [0, 1].map(|along| self.first(along, offset) <= self.last(along, offset));
        columns & rows
    }

    /// Rows in which samples may lie in it, of those of a triangle that was moved by the offset.
    #[inline(always)]
    pub fn narrow(&self, triangle: PixelTriangle, offset: BoxOffset) -> PixelTriangle {
        let (first, end) = triangle.rows;
        let rows = (
            first.max(self.first(1, offset).max(0) as u32),
            end.min((self.last(1, offset) + 1).max(0) as u32),
        );
        PixelTriangle { rows, ..triangle }
    }

    /// The first pixel along an axis whose sample lies in it.
    #[inline(always)]
    fn first(&self, along: usize, BoxOffset(offset): BoxOffset) -> i32 {
        (self.low[along] - offset[along] + (1 << BITS) - 1) >> BITS
    }

    /// The last one.
    #[inline(always)]
    fn last(&self, along: usize, BoxOffset(offset): BoxOffset) -> i32 {
        (self.high[along] - offset[along]) >> BITS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};

    /// No sample that lies in a triangle is missed, and most boxes smaller than a pixel are missed by
    /// most samples.
    #[test]
    fn samples_in_a_triangle_are_in_its_box() {
        let mut numbers = Numbers::new(3, Stream::Gather, 0);
        let mut number = || numbers.uniform();
        let (mut met, mut tries) = (0, 0);
        for _ in 0..20_000 {
            let middle = Vec2::new(number(), number()) * 30.0;
            let corners = [(); 3].map(|()| middle + 0.5 * Vec2::new(number(), number()));
            let [a, b, c] = corners;
            let (x, y) = (number(), number());
            let inside = if x + y < 1.0 { (x, y) } else { (1.0 - x, 1.0 - y) };
            let sample = a + (b - a) * inside.0 + (c - a) * inside.1;
            let offset = sample - sample.round();
            let (pixel_box, units) = (PixelBox::new(corners), BoxOffset::new(offset));
            assert!(pixel_box.is_met(units), "{corners:?} {offset}");
            let row = sample.y.round() as i32;
            assert!((pixel_box.first(1, units)..=pixel_box.last(1, units)).contains(&row));
            let other = Vec2::new(number(), number()) - 0.5;
            met += i32::from(pixel_box.is_met(BoxOffset::new(other)));
            tries += 1;
        }
        assert!(met < tries / 4, "{met} of {tries}");
        assert!(PixelBox::ALL.is_met(BoxOffset::new(Vec2::splat(0.3))));
        assert!(!PixelBox::new([Vec2::splat(-9.0); 3]).meets_columns(40));
        assert!(PixelBox::new([Vec2::splat(f32::NAN); 3]).meets_columns(40));
    }
}
