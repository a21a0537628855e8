//! What surfaces within a pixel emit.

use crate::radiometry::{Rgb, importance};

/// Share of the most radiance by which what is emitted differs between surfaces that are not one.
const WIDE_RANGE: f32 = 0.1;

/// Least and most radiance that surfaces in a pixel emit, where the background emits none.
#[derive(Clone, Copy, Debug)]
pub struct ShineRange {
    least: Rgb,
    most: Rgb,
}

impl Default for ShineRange {
    /// Of nothing yet.
    fn default() -> Self {
        Self { least: Rgb::INFINITY, most: Rgb::ZERO }
    }
}

impl ShineRange {
    /// Takes in what something emits that is seen.
    pub fn add(&mut self, shine: Rgb) {
        (self.least, self.most) = (self.least.min(shine), self.most.max(shine));
    }

    /// Of all of these.
    pub fn of(shines: impl IntoIterator<Item = Rgb>) -> Self {
        let mut own = Self::default();
        shines.into_iter().for_each(|shine| own.add(shine));
        own
    }

    /// Whether it is so wide that different things shine.
    pub fn is_wide(&self) -> bool {
        importance(self.span()) > WIDE_RANGE * importance(self.most)
    }

    /// Most of these.
    pub fn most(&self) -> Rgb {
        self.most
    }

    /// By how much radiance that surfaces emit differs within the pixel.
    pub fn span(&self) -> Rgb {
        (self.most - self.least).max(Rgb::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_holds_all_that_is_seen() {
        let mut range = ShineRange::default();
        assert!(range.span() == Rgb::ZERO && !range.is_wide(), "nothing is");
        range.add(Rgb::splat(2.0));
        assert!(range.span() == Rgb::ZERO && !range.is_wide());
        range.add(Rgb::new(0.5, 3.0, 2.0));
        assert!(range.span() == Rgb::new(1.5, 1.0, 0.0) && range.is_wide());
        assert!(!ShineRange::of([Rgb::splat(2.0), Rgb::splat(1.9)]).is_wide());
    }
}
