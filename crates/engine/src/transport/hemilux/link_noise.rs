//! How much of the picture's error is noise of the links (tier 1) that wide areas have in common.
//!
//! Noise of one element is independent of its neighbour's, and gather rays average it away. But where
//! light reaches what is seen by a long way only, all of it hangs on the links along that way, and
//! everything there is too bright or too dark together. No scatter within the picture shows that.
//!
//! Links double whenever they are traced anew, so that a solution b is nearly the mean of the one before,
//! a, and of what the new links alone would give, c, both with twice the variance of b. Then b − a is
//! (c − a)/2, of which the variance is (2 + 2)/4 of b's: the change by the new links is as large as the
//! error that is left. (Where links have waited, more are new than were there, and the change is larger.)

use super::coarse::CoarseSolution;
use super::fragments::VisibleSurfaces;
use crate::radiometry::Rgb;
use std::f32::consts::PI;

/// Squares along a side of the picture over which differences are averaged.
const SQUARES: u32 = 4;
/// About how many pixels along a side of the picture are looked at.
const LOOKED_AT: u32 = 64;

/// What the coarse solution, seen directly, says of squares of the picture.
pub struct LinkNoise {
    /// Σ radiance that has bounced, by square.
    radiance: Vec<Rgb>,
    /// Pixels that were looked at, by square.
    pixels: Vec<u32>,
}

impl LinkNoise {
    /// Looks at the present solution.
    pub fn look(coarse: &CoarseSolution, visible: &VisibleSurfaces) -> Self {
        let squares = (SQUARES * SQUARES) as usize;
        let mut this = Self { radiance: vec![Rgb::ZERO; squares], pixels: vec![0; squares] };
        let step = |size: u32| (size / LOOKED_AT).max(1) as usize;
        for y in (0..visible.height).step_by(step(visible.height)) {
            for x in (0..visible.width).step_by(step(visible.width)) {
                let place = |at: u32, size: u32| (SQUARES * at / size).min(SQUARES - 1);
                let square = SQUARES * place(y, visible.height) + place(x, visible.width);
                let pixel = (y * visible.width + x) as usize;
                let own = visible.start[pixel] as usize..visible.start[pixel + 1] as usize;
                for fragment in &visible.fragments[own] {
                    let bounced = coarse.bounced(visible.place_on_facet(fragment));
                    let factor = fragment.diffuse * (fragment.share / PI);
                    this.radiance[square as usize] += factor * bounced;
                }
                this.pixels[square as usize] += 1;
            }
        }
        this
    }

    /// Variance of radiance, the mean over channels and squares, by what new links have changed since.
    pub fn variance(&self, before: &Self) -> f64 {
        let all = self.radiance.iter().zip(&before.radiance).zip(&self.pixels);
        let seen = all.filter(|(_, pixels)| **pixels > 0);
        let (mut sum, mut count) = (0.0, 0.0);
        for ((after, before), pixels) in seen {
            let change = (*after - *before) / *pixels as f32;
            sum += f64::from((change * change).element_sum());
            count += 3.0;
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen};

    /// In a furnace light comes from everywhere: what links say is almost exact, and what is seen in
    /// all squares is what has bounced, reflected once more.
    #[test]
    fn a_furnace_has_hardly_any() {
        let mut specimen = Specimen::furnace();
        let visible = specimen.visible();
        let before = LinkNoise::look(&specimen.coarse, &visible);
        let exact = EMISSION * ALBEDO * ALBEDO / (1.0 - ALBEDO);
        for (radiance, pixels) in before.radiance.iter().zip(&before.pixels) {
            let mean = radiance.x / *pixels as f32;
            assert!((mean / exact - 1.0).abs() < 0.05, "{mean} {exact}");
        }
        specimen.coarse.link(SEED, 2, 16);
        let after = LinkNoise::look(&specimen.coarse, &visible);
        let relative = after.variance(&before).sqrt() / f64::from(exact);
        assert!(relative < 0.01, "{relative}");
        let mut planted = LinkNoise::look(&specimen.coarse, &visible);
        planted.radiance.iter_mut().for_each(|radiance| *radiance *= 1.1);
        let found = planted.variance(&after).sqrt() / f64::from(exact);
        assert!((found - 0.1).abs() < 0.01, "{found}");
    }
}
