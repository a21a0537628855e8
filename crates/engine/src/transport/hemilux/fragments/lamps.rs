//! Pixels that show lamps. Light that surfaces send of their own is known without a ray, and lamps are
//! so bright that beside them no error of the rest would count. So errors are told without these
//! pixels. But real files let whole objects glow faintly, and what shines no more than the rest is no
//! lamp (docs/decisions/0093, 0098).

use super::VisibleSurfaces;
use super::shine::ShineRange;
use crate::radiometry::{Rgb, importance};

/// Share of what a pixel shows up to which light of its own does not make it a lamp's, however bright.
const LAMP_SHARE: f32 = 0.8;
/// A lamp is so many times as bright as all that counts is in the mean.
const LAMP_BRIGHTNESS: f32 = 4.0;

impl VisibleSurfaces {
    /// Which pixels count, of a picture that shows this: all that show no lamp.
    pub fn counted(&self, shown: &[Rgb]) -> Vec<bool> {
        let is_dim = |pixel: usize| !self.may_show_lamp(pixel, shown[pixel]);
        let mut counted: Vec<bool> = (0..shown.len()).map(is_dim).collect();
        if counted.iter().all(|counts| *counts) {
            return counted;
        }
        let mut mean = mean_of(shown, &counted);
        if mean <= 0.0 {
            mean = mean_of(shown, &vec![true; shown.len()]);
        }
        // Rays at edges may have found what no sample did.
        let is_lamp = |shines: &ShineRange| {
            shines.most() == Rgb::ZERO || importance(shines.most()) > LAMP_BRIGHTNESS * mean
        };
        for (counts, shines) in counted.iter_mut().zip(&self.shines) {
            *counts |= !is_lamp(shines);
        }
        counted
    }

    /// Whether a pixel that shows so much shines for the most part, or shares its place with something
    /// that shines.
    fn may_show_lamp(&self, pixel: usize, shown: Rgb) -> bool {
        let shine = self.shine[pixel];
        let is_most = || shine.element_sum() > LAMP_SHARE * shown.element_sum();
        shine != Rgb::ZERO && (self.filling(pixel as u32).is_none() || is_most())
    }
}

/// Mean radiance of those pixels of a picture that count.
fn mean_of(shown: &[Rgb], counted: &[bool]) -> f32 {
    let counts = shown.iter().zip(counted).filter(|(_, counts)| **counts);
    let (mut sum, mut count) = (0.0, 0.0);
    for (own, _) in counts {
        sum += f64::from(importance(*own));
        count += 1.0;
    }
    (sum / f64::max(count, 1.0)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::Specimen;

    /// In a room with a lamp that is much brighter than the rest, all pixels count that do not show it.
    #[test]
    fn pixels_of_a_lamp_are_left_out() {
        let visible = Specimen::new(&made::cornell(), 200).visible();
        let shown: Vec<Rgb> = visible.shine.iter().map(|own| *own + Rgb::splat(0.1)).collect();
        let counted = visible.counted(&shown);
        let lamps = counted.iter().filter(|counts| !**counts).count();
        assert!(lamps > 3, "{lamps}");
        for (pixel, shine) in visible.shine.iter().enumerate() {
            assert_eq!(counted[pixel], *shine == Rgb::ZERO, "{pixel}");
        }
    }

    /// Where all walls shine they count, however little they reflect, but not what is far brighter; how
    /// much they differ within a pixel is known.
    #[test]
    fn what_shines_no_more_than_the_rest_counts() {
        let mut visible = Specimen::furnace().visible();
        assert!(visible.shines.iter().all(|own| own.span() == Rgb::ZERO));
        for times in [1.1, 2.0] {
            let shown: Vec<Rgb> = visible.shine.iter().map(|own| *own * times).collect();
            assert!(visible.counted(&shown).iter().all(|counts| *counts));
        }
        let mut shown = visible.shine.clone();
        let bright = 20.0 * shown[7];
        (visible.shine[7], shown[7]) = (bright, bright);
        visible.shines[7].add(bright);
        let expected: Vec<bool> = (0..shown.len()).map(|pixel| pixel != 7).collect();
        assert_eq!(visible.counted(&shown), expected);
    }
}
