//! The picture from what the three tiers know, and how far it may be off.

use super::coarse::Coarse;
use super::direct::Direct;
use super::fragments::Seen;
use super::gather::Bounced;
use super::gloss::Gloss;
use super::settings::HemiluxSettings;
use crate::emitters::PolygonLights;
use crate::image::Picture;
use crate::radiometry::Rgb;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Variance of a surface's share of a pixel: this times (number of samples)^−1.5.
const COVERAGE: f32 = 0.04;
/// Relative error of indirect light that is shown as the coarse mesh has it.
const COARSE: f32 = 0.2;
/// Relative error that nothing here sees: the coarse mesh behind the gathers.
const ALLOWANCE: f64 = 0.002;

/// What pixels are off by, and why: `noise` of the records, by how much either half of their rays
/// changes the picture; `bent`, how far the records are off the planes through them by more than
/// noise, as a plane is off where light is bent; shadow rays that disagree; lobes; and pixels that
/// surfaces share.
pub const CAUSES: [&str; 5] = ["noise", "bent", "shadows", "lobes", "edges"];
/// What pictures turn out to have of each cause's variance. Halves of well-spread points are worse
/// than points that are spread together; a plane's middle is nearer than its rim; neighbours share
/// what their shadows are off by; lobes and edges see the coarse mesh, whose error is no scatter.
const FOUND: [f64; 5] = [0.3, 0.7, 1.8, 2.0, 7.5];

/// A pixel.
#[derive(Clone, Copy)]
struct Measured {
    radiance: Rgb,
    /// Σ over channels of the estimated variance, by cause.
    variance: [f32; 5],
}

/// Estimated error of a picture: rRMSE over the pixels that see no emitter.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// By cause.
    pub parts: [f64; 5],
    /// All together, with what no part knows of.
    pub all: f64,
}

/// What a picture is made of.
pub struct PictureParts<'a> {
    /// What the camera sees.
    pub seen: &'a Seen,
    /// The emitters.
    pub lights: &'a PolygonLights,
    /// Tier 1.
    pub coarse: &'a Coarse,
    /// Tier 2: the indirect irradiance of every fragment, with its variance; `None` where no record
    /// counts.
    pub bounced: &'a [Option<Bounced>],
    /// Tier 3.
    pub direct: &'a Direct,
    /// What lobes reflect.
    pub gloss: &'a Gloss,
    /// How it is to be shown.
    pub options: &'a HemiluxSettings,
}

/// The picture with its estimated error; `None` of a black picture.
pub fn measure(known: &PictureParts<'_>) -> (Picture, Option<Errors>) {
    let PictureParts { seen, options, .. } = *known;
    let mut gloss = Vec::new();
    if known.gloss.len() > 0 {
        gloss = known.gloss.of_fragments(seen, options.lobe_filter);
    }
    let coverage = COVERAGE * (options.samples as f32).powf(-1.5);
    let count = seen.shine.len();
    let measured: Vec<Measured> = (0..count)
        .into_par_iter()
        .with_min_len(1024)
        .map(|pixel| known.pixel(&gloss, coverage, pixel))
        .collect();
    let errors = errors(&measured, &seen.shine);
    let pixels = measured.iter().map(|measured| measured.radiance).collect();
    (Picture { width: seen.width, height: seen.height, pixels }, errors)
}

impl PictureParts<'_> {
    /// What a pixel shows, and its variance by cause; `gloss` is mean and variance of the lobes of
    /// every fragment, or empty, `coverage` the variance of a surface's share.
    fn pixel(&self, gloss: &[(Rgb, Rgb)], coverage: f32, pixel: usize) -> Measured {
        let seen = self.seen;
        let mut radiance = seen.shine[pixel];
        let mut variance = [0.0; 5];
        let (mut least, mut most, mut all) = (Rgb::INFINITY, Rgb::ZERO, 0.0);
        for index in seen.start[pixel] as usize..seen.start[pixel + 1] as usize {
            let share = seen.fragments[index].share;
            let (own, own_variance) = self.fragment(gloss, index);
            radiance += own * share;
            for (sum, own) in variance.iter_mut().zip(own_variance) {
                *sum += own.element_sum() * (share * share);
            }
            (least, most) = (least.min(own), most.max(own));
            all += share;
        }
        if all > 0.0 {
            // Beside what the camera sees may be nothing, which is black.
            if all < 0.99 {
                least = Rgb::ZERO;
            }
            variance[4] = ((most - least) * (most - least) * coverage).element_sum();
        }
        Measured { radiance, variance }
    }

    /// Radiance that a fragment reflects, and its variance by all causes but edges.
    fn fragment(&self, gloss: &[(Rgb, Rgb)], index: usize) -> (Rgb, [Rgb; 4]) {
        let PictureParts { seen, coarse, options, .. } = *self;
        let fragment = &seen.fragments[index];
        let (direct, direct_variance) = if options.light {
            self.direct.irradiance(self.lights, seen, index, options.shadow_filter)
        } else {
            (coarse.direct(seen.place_on_facet(fragment)), Rgb::ZERO)
        };
        let bounced = self.bounced[index].unwrap_or_else(|| {
            let irradiance = coarse.bounced(seen.place_on_facet(fragment));
            Bounced { irradiance, noise: irradiance * COARSE, bent: Rgb::ZERO }
        });
        let factor = fragment.diffuse / PI;
        let mut radiance = factor * (direct + bounced.irradiance).max(Rgb::ZERO);
        let square = factor * factor;
        let mut variance = [
            square * bounced.noise * bounced.noise,
            square * bounced.bent,
            square * direct_variance,
            Rgb::ZERO,
        ];
        if let Some((mean, own)) = gloss.get(index) {
            radiance += *mean;
            variance[3] = *own;
        }
        (radiance, variance)
    }
}

/// Relative errors over the pixels that see no emitter; `None` where these are black.
fn errors(measured: &[Measured], shine: &[Rgb]) -> Option<Errors> {
    let (mut sum, mut variance, mut pixels) = (0.0, [0.0; 5], 0.0);
    for (measured, shine) in measured.iter().zip(shine) {
        if *shine == Rgb::ZERO {
            sum += f64::from(measured.radiance.element_sum());
            for (all, own) in variance.iter_mut().zip(measured.variance) {
                *all += f64::from(own);
            }
            pixels += 3.0;
        }
    }
    (sum > 0.0).then(|| {
        let mean = sum / pixels;
        let square = |k: usize| FOUND[k] * variance[k] / pixels / (mean * mean);
        let squares: [f64; 5] = std::array::from_fn(square);
        let all = (squares.iter().sum::<f64>() + ALLOWANCE * ALLOWANCE).sqrt();
        Errors { parts: squares.map(f64::sqrt), all }
    })
}
