//! Pixels that show lamps. Light that surfaces send of their own is known without a ray, and lamps are
//! so bright that beside them no error of the rest would count. So errors are told without these
//! pixels. But real files let whole objects glow faintly: what shines less than it reflects is no
//! lamp.

use super::VisibleSurfaces;
use crate::radiometry::Rgb;

/// Share of what a pixel shows from which on light of its own makes it a lamp's.
const LAMP_SHARE: f32 = 0.8;

/// Whether what shines so much of what it shows is a lamp.
pub fn is_lamp(shine: Rgb, shown: Rgb) -> bool {
    shine != Rgb::ZERO && shine.element_sum() > LAMP_SHARE * shown.element_sum()
}

impl VisibleSurfaces {
    /// Whether a pixel that shows so much is a lamp's, or shares its place with something that shines.
    pub fn shows_lamp(&self, pixel: usize, shown: Rgb) -> bool {
        let shine = self.shine[pixel];
        shine != Rgb::ZERO && (self.filling(pixel as u32).is_none() || is_lamp(shine, shown))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::Specimen;

    #[test]
    fn what_reflects_as_much_as_it_shines_is_no_lamp() {
        assert!(is_lamp(Rgb::splat(5.0), Rgb::splat(5.3)));
        assert!(!is_lamp(Rgb::splat(0.2), Rgb::splat(0.6)) && !is_lamp(Rgb::ZERO, Rgb::ZERO));
    }

    /// In a room with a lamp that reflects nothing, all that shines is the lamp's; where all walls
    /// shine, they count by how much they reflect.
    #[test]
    fn pixels_of_a_lamp_are_left_out() {
        let visible = Specimen::new(&made::cornell(), 200).visible();
        let shine: Vec<usize> =
            (0..visible.shine.len()).filter(|pixel| visible.shine[*pixel] != Rgb::ZERO).collect();
        assert!(shine.len() > 3);
        for pixel in 0..visible.shine.len() {
            let shown = visible.shine[pixel] + Rgb::splat(0.1);
            assert_eq!(visible.shows_lamp(pixel, shown), shine.contains(&pixel), "{pixel}");
        }
        let furnace = Specimen::furnace().visible();
        let inside = (0..furnace.shine.len()).filter(|at| furnace.filling(*at as u32).is_some());
        for pixel in inside {
            let shine = furnace.shine[pixel];
            let found = [1.1, 2.0].map(|times| furnace.shows_lamp(pixel, times * shine));
            assert_eq!(found, [true, false], "{pixel}");
        }
    }
}
