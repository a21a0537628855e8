//! The picture from what the three tiers know, and how far it may be off.

use super::audit::{Corrected, Verdict};
use super::coarse::CoarseSolution;
use super::direct::DirectLighting;
use super::fragments::shine::ShineRange;
use super::fragments::textures::{Ahead, Textures};
use super::fragments::{Fragment, VisibleSurfaces};
use super::gather::IndirectLight;
use super::gloss::Gloss;
use super::settings::HemiluxSettings;
use crate::emitters::DirectLights;
use crate::image::Picture;
use crate::radiometry::Rgb;
use crate::render::{ErrorBounds, ErrorSource};
use crate::transport::ray_traced::Mapped;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Variance of a surface's share of a pixel is this times (number of samples)^−1.5, for samples
/// that are well spread; see [`VisibleSurfaces::edge_weight`].
const COVERAGE_VARIANCE: f32 = 0.04;
/// Most places of a fragment at which the map of caustics is read.
const MOST_MAP_READS: u32 = 8;
/// Relative error assumed of indirect light where a fragment shows the coarse mesh itself and too few
/// others say how far that is off.
const COARSE_ERROR: f32 = 0.2;
/// Least factor of a lobe's radiance that highlights, which it does not concern, are divided by.
const LEAST_FACTOR: f32 = 0.1;
/// Fragments that say so together: as many as will do, and fewest.
const COMPARED: usize = 4096;
const LEAST_COMPARED: usize = 64;
/// Relative error allowed for what no cause covers: the coarse mesh behind the gather rays.
const COARSE_MESH_ERROR: f64 = 0.0015;

/// Causes of a picture's error, by the names that reports use:
/// - `noise`: noise of the records' gather rays, from two pictures by either half of the rays;
/// - `bent`: scatter of the records about the planes fitted through them, beyond their noise, where
///   irradiance is not linear along the surface;
/// - `shadows`: shadow rays that disagree;
/// - `lobes`: scatter of lobe rays;
/// - `edges`: surfaces that share a pixel, by too few sub-pixel samples.
pub const CAUSES: [&str; 5] = ["noise", "bent", "shadows", "lobes", "edges"];
/// Factor of each cause's estimated variance in the predicted error, fitted to pictures of thirteen
/// views whose true error is known (docs/decisions/0027), and towards what 28 rooms made by chance ask
/// for; that of lobes by pictures that differ in their seed alone (docs/tiers.md). Why they are not 1:
/// halves of well-spread points are worse than points that are spread together; a plane fits better in
/// its middle than at its rim; errors of shadows are shared by neighbours; edges show the coarse mesh,
/// whose error is no scatter.
const CAUSE_FACTORS: [f64; 5] = [0.3, 0.9, 1.8, 1.0, 4.0];

/// What the true error is taken to lie between, over what the causes say, where no wide area is off
/// beyond what they know: about the ratios that predictions are judged by (docs/tiers.md).
const CAUSES_BETWEEN: [f64; 2] = [0.67, 1.5];

/// What arrives at a fragment, as far as it goes to the camera from there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arriving {
    /// Irradiance.
    pub irradiance: Rgb,
    /// Mean radiance that its lobes show.
    pub lobes: Rgb,
}

/// A pixel's radiance with its estimated variance.
#[derive(Clone, Copy)]
struct PixelEstimate {
    radiance: Rgb,
    /// Σ over channels of the estimated variance, by cause.
    variance: [f32; 5],
}

/// Estimated error of a picture: rRMSE over the pixels that see no emitter.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// rRMSE by cause, in the order of [`CAUSES`].
    pub by_cause: [f64; 5],
    /// rRMSE by noise of the links that wide areas have in common.
    pub by_links: f64,
    /// rRMSE by textures that are read too coarsely.
    pub by_textures: f64,
    /// rRMSE over wide areas that no cause has, as an audit finds it.
    pub by_audit: f64,
    /// rRMSE by the larger pixels of a draft.
    pub by_draft: f64,
    /// All causes together with the coarse mesh's error.
    pub total: f64,
    /// What the true error most likely lies between, once an audit can tell.
    pub bounds: Option<ErrorBounds>,
    /// Mean radiance over the pixels and channels that count.
    pub mean: f64,
    /// Whether an audit suspects more than these causes.
    pub is_suspect: bool,
}

impl Errors {
    /// Goes over to other pixels, whose edges have so many times the variance.
    pub fn with_edges(&mut self, factor: f64) {
        let edges = self.by_cause[4];
        self.by_cause[4] *= factor.sqrt();
        let square = self.total * self.total + (factor - 1.0) * edges * edges;
        self.total = square.max(0.0).sqrt();
    }

    /// Takes in what the larger pixels of a draft lose.
    pub fn lost(&mut self, by_draft: f64) {
        self.by_draft = by_draft;
        self.total = self.total.hypot(by_draft);
        self.bounds = self.bounds.map(|ErrorBounds { low, high, by }| {
            let [least, most] = CAUSES_BETWEEN.map(|factor| factor * by_draft);
            ErrorBounds { low: low.hypot(least), high: high.hypot(most), by }
        });
    }

    /// Takes in what an audit says of the same picture, and what it took off before.
    pub fn audited(&mut self, verdict: Verdict, corrected: Corrected) {
        self.is_suspect = corrected.is_suspect;
        let square = self.mean * self.mean;
        let known = self.by_links * self.by_links + COARSE_MESH_ERROR * COARSE_MESH_ERROR;
        let found = (verdict.found / square - known).max(0.0) + corrected.left / square;
        let by_causes = self.total;
        self.by_audit = found.sqrt();
        self.total = self.total.hypot(self.by_audit);
        let [low, high] = CAUSES_BETWEEN.map(|factor| factor * by_causes);
        self.bounds = verdict.hidden.map(|hidden| ErrorBounds {
            low: low.hypot(self.by_audit),
            high: high.hypot((hidden / square).max(found).sqrt()),
            by: if self.by_audit > by_causes { ErrorSource::Audit } else { ErrorSource::Scatter },
        });
    }
}

/// What a picture is computed from.
pub struct PictureInputs<'a> {
    /// What the camera sees.
    pub visible: &'a VisibleSurfaces,
    /// The emitters.
    pub lights: &'a DirectLights,
    /// Tier 1.
    pub coarse: &'a CoarseSolution,
    /// Tier 2: the indirect irradiance of every fragment, with its variance; `None` where no record
    /// counts.
    pub bounced: &'a [Option<IndirectLight>],
    /// Tier 3.
    pub direct: &'a DirectLighting,
    /// What lobes reflect.
    pub gloss: &'a Gloss,
    /// The job's settings, some of which switch parts off.
    pub options: &'a HemiluxSettings,
    /// Mean over channels of the variance of radiance by the links' noise, over wide areas.
    pub link_variance: f64,
    /// Textures, once it is known how far they are off.
    pub textures: Option<&'a Textures>,
    /// Relative error of the indirect light where no record counts: [`coarse_error`].
    pub coarse_error: f32,
}

/// How far tier 1 is off where fragments show it for want of records, relative to what it says: as far
/// as where there are records.
pub fn coarse_error(
    visible: &VisibleSurfaces,
    coarse: &CoarseSolution,
    bounced: &[Option<IndirectLight>],
) -> f32 {
    let shown = || visible.fragments.iter().zip(bounced).filter(|(one, _)| one.weight() > 0.0);
    if shown().all(|(_, own)| own.is_some()) {
        return COARSE_ERROR;
    }
    let covered: Vec<_> = shown().filter_map(|(one, own)| Some((one, (*own)?))).collect();
    if covered.len() < LEAST_COMPARED {
        return COARSE_ERROR;
    }
    let (mut square, mut all) = (0.0, 0.0);
    for (fragment, own) in covered.iter().step_by(covered.len().div_ceil(COMPARED)) {
        let said = coarse.bounced(visible.place_on_facet(fragment));
        let off = said - own.irradiance;
        let weight = fragment.weight() * fragment.weight();
        square += weight * (off * off - own.noise * own.noise).element_sum();
        all += weight * (said * said).element_sum();
    }
    if all > 0.0 { (square / all).max(0.0).sqrt() } else { COARSE_ERROR }
}

/// The picture with its estimated error; `None` of a black picture.
pub fn measure(known: &PictureInputs<'_>) -> (Picture, Option<Errors>) {
    let visible = known.visible;
    let mut gloss = Vec::new();
    if known.gloss.len() > 0 {
        gloss = known.gloss.of_fragments(visible);
    }
    let coverage = COVERAGE_VARIANCE / visible.edge_weight;
    let count = visible.shine.len();
    let estimates: Vec<PixelEstimate> = (0..count)
        .into_par_iter()
        .with_min_len(1024)
        .map(|pixel| known.pixel(&gloss, coverage, pixel))
        .collect();
    let pixels: Vec<Rgb> = estimates.iter().map(|estimate| estimate.radiance).collect();
    let counts = visible.counted(&pixels);
    let by_textures = known.texture_variance(&gloss, &counts);
    let errors = errors(&estimates, &counts, [known.link_variance, by_textures]);
    let alpha = (!visible.coverage.is_empty()).then(|| visible.coverage.clone());
    (Picture { alpha, ..Picture::new(visible.width, visible.height, pixels) }, errors)
}

impl PictureInputs<'_> {
    /// What a pixel shows, and its variance by cause; `gloss` is mean and variance of the lobes of
    /// every fragment, or empty, `coverage` the variance of a surface's share.
    fn pixel(&self, gloss: &[(Rgb, Rgb)], coverage: f32, pixel: usize) -> PixelEstimate {
        let visible = self.visible;
        let background = visible.background.get(pixel).copied().unwrap_or_default();
        let stray = visible.strays.get(pixel).copied().unwrap_or_default();
        let mut radiance = visible.shine[pixel] + background + stray;
        let mut variance = [0.0; 5];
        let (mut least, mut most, mut all) = (Rgb::INFINITY, Rgb::ZERO, 0.0);
        for index in visible.start[pixel] as usize..visible.start[pixel + 1] as usize {
            let share = visible.fragments[index].share;
            let (mut own, mut own_variance) = self.fragment(gloss, index);
            if visible.has_beyond() {
                if visible.fragments[index].is_beyond {
                    continue;
                }
                if let Some(beyond) = visible.beyond(index) {
                    let (passed, passed_variance) = self.fragment(&[], beyond);
                    own += passed;
                    own_variance.iter_mut().zip(passed_variance).for_each(|(sum, own)| *sum += own);
                }
            }
            radiance += own * share;
            for (sum, own) in variance.iter_mut().zip(own_variance) {
                *sum += own.element_sum() * (share * share);
            }
            (least, most) = (least.min(own), most.max(own));
            all += share;
        }
        let mut range = visible.shines.get(pixel).map_or(Rgb::ZERO, ShineRange::span);
        if all > 0.0 {
            // Beside what the camera sees may be nothing but the background.
            if all < 0.99 {
                let beside = background / (1.0 - all);
                (least, most) = (least.min(beside), most.max(beside));
            }
            range += most - least;
        }
        variance[4] = (range * range * coverage).element_sum() * visible.border_length(pixel);
        PixelEstimate { radiance, variance }
    }

    /// Radiance that a fragment reflects, and its variance by all causes but edges.
    fn fragment(&self, gloss: &[(Rgb, Rgb)], index: usize) -> (Rgb, [Rgb; 4]) {
        let fragment = &self.visible.fragments[index];
        let (arriving, variances) = self.irradiance(index);
        let factor = fragment.diffuse / PI;
        let mut radiance = factor * arriving.max(Rgb::ZERO);
        let [noise, bent, shadows] = variances.map(|own| factor * factor * own);
        let mut variance = [noise, bent, shadows, Rgb::ZERO];
        if let Some((mean, own)) = gloss.get(index) {
            let (highlights, by_shadows) = self.direct.highlights(index);
            let factors = fragment.lobe_factor * fragment.lobe_factor;
            radiance += *mean * fragment.lobe_factor + highlights;
            // At a shadow's edge the diffuse part is shared with neighbours, and what Fresnel's term takes from
            // it is not.
            radiance = radiance.max(Rgb::ZERO);
            variance[2] += by_shadows;
            variance[3] = *own * factors;
        }
        (radiance, variance)
    }

    /// What a fragment's lobe reflects, before its factor.
    fn lobes(&self, gloss: &[(Rgb, Rgb)], index: usize) -> Rgb {
        let factor = self.visible.fragments[index].lobe_factor.max(Rgb::splat(LEAST_FACTOR));
        let highlights = || self.direct.highlights(index).0 / factor;
        gloss.get(index).map_or(Rgb::ZERO, |(mean, _)| *mean + highlights())
    }

    /// Irradiance of a fragment, and its variance by noise of records, bent irradiance and shadows.
    fn irradiance(&self, index: usize) -> (Rgb, [Rgb; 3]) {
        let PictureInputs { visible, coarse, options, .. } = *self;
        let fragment = &visible.fragments[index];
        let (direct, direct_variance) = if options.light {
            self.direct.irradiance(self.lights, visible, index, options.shadow_filter)
        } else {
            (coarse.direct(visible.place_on_facet(fragment)), Rgb::ZERO)
        };
        let bounced = self.bounced[index].unwrap_or_else(|| {
            let irradiance = coarse.bounced(visible.place_on_facet(fragment));
            let off = irradiance * self.coarse_error;
            IndirectLight { irradiance, noise: Rgb::ZERO, bent: off * off }
        });
        let caustics = self.caustics(fragment);
        let arriving = direct + bounced.irradiance + caustics.irradiance;
        let shadows = direct_variance + caustics.scatter * caustics.scatter;
        (arriving, [bounced.noise * bounced.noise, bounced.bent, shadows])
    }

    /// What arrives at each fragment.
    pub fn arriving(&self) -> Vec<Arriving> {
        let mut gloss = Vec::new();
        if self.gloss.len() > 0 {
            gloss = self.gloss.of_fragments(self.visible);
        }
        let of = |index: usize| Arriving {
            irradiance: self.irradiance(index).0,
            lobes: self.lobes(&gloss, index),
        };
        let count = self.visible.fragments.len();
        (0..count).into_par_iter().with_min_len(1024).map(of).collect()
    }
}

impl PictureInputs<'_> {
    /// Variance of radiance by textures that are read too coarsely, the mean over channels and all pixels:
    /// by what smaller squares change of some; `counts` says which pixels are no lamps'.
    fn texture_variance(&self, gloss: &[(Rgb, Rgb)], counts: &[bool]) -> f64 {
        let Some((ahead, each)) = self.textures.map(Textures::ahead) else { return 0.0 };
        let visible = self.visible;
        let change = |own: &Ahead| {
            let arriving = self.irradiance(own.fragment).0 * own.diffuse / PI;
            let lobes = self.lobes(gloss, own.fragment);
            let beyond = visible.beyond(own.fragment);
            let passed = beyond.map_or(Rgb::ZERO, |beyond| self.irradiance(beyond).0);
            own.shine + arriving + lobes * own.lobe_factor + passed * own.passed / PI
        };
        let is_counted = |own: &&Ahead| counts[visible.fragments[own.fragment].pixel as usize];
        let squares = ahead.iter().filter(is_counted).map(change).map(|own| own.length_squared());
        let pixels = counts.iter().filter(|counts| **counts).count().max(1);
        squares.map(f64::from).sum::<f64>() * each / (3.0 * pixels as f64)
    }

    /// Mean of what the map of caustics says of a fragment's samples.
    fn caustics(&self, fragment: &Fragment) -> Mapped {
        let Some(caustics) = self.coarse.caustics().filter(|_| fragment.diffuse != Rgb::ZERO)
        else {
            return Mapped::default();
        };
        let all = self.visible.count(fragment);
        let count = all.min(MOST_MAP_READS);
        let mut sum = Mapped::default();
        for sample in 0..count {
            // Spread over all of them, where there are more.
            let sample = sample * all / count;
            let (triangle, back, at) = self.visible.place_on_triangle(fragment, sample);
            sum = sum + caustics.map().at(triangle, back, at);
        }
        sum * (1.0 / count as f32)
    }
}

/// Relative errors over the pixels that count, which are no lamps'; `None` where these are black.
///
/// The last two variances are the mean over all pixels and channels of what links and textures add.
fn errors(
    estimates: &[PixelEstimate],
    counts: &[bool],
    [by_links, by_textures]: [f64; 2],
) -> Option<Errors> {
    let (mut sum, mut variance, mut pixels) = (0.0, [0.0; 5], 0.0);
    for (estimate, counts) in estimates.iter().zip(counts) {
        if *counts {
            sum += f64::from(estimate.radiance.element_sum());
            for (all, own) in variance.iter_mut().zip(estimate.variance) {
                *all += f64::from(own);
            }
            pixels += 3.0;
        }
    }
    (sum > 0.0).then(|| {
        let mean = sum / pixels;
        let square = |k: usize| CAUSE_FACTORS[k] * variance[k] / pixels / (mean * mean);
        let squares: [f64; 5] = std::array::from_fn(square);
        let [by_links, by_textures] = [by_links, by_textures].map(|own| own / (mean * mean));
        let by_rest = by_links + by_textures + COARSE_MESH_ERROR * COARSE_MESH_ERROR;
        let all = squares.iter().sum::<f64>() + by_rest;
        Errors {
            by_cause: squares.map(f64::sqrt),
            by_links: by_links.sqrt(),
            by_textures: by_textures.sqrt(),
            total: all.sqrt(),
            mean,
            ..Errors::default()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::Specimen;

    /// Where records say that tier 1 is a tenth too dark, it is taken to be that where there are none.
    #[test]
    fn what_has_no_record_is_as_far_off_as_the_rest() {
        let specimen = Specimen::furnace();
        let (visible, coarse) = (specimen.visible(), &specimen.coarse);
        let of = |fragment: &Fragment| {
            let irradiance = 1.1 * coarse.bounced(visible.place_on_facet(fragment));
            Some(IndirectLight { irradiance, ..IndirectLight::default() })
        };
        let mut bounced: Vec<_> = visible.fragments.iter().map(of).collect();
        let error = |bounced: &[_]| coarse_error(&visible, coarse, bounced);
        assert_eq!(error(&bounced), COARSE_ERROR, "nothing is missing");
        bounced[7] = None;
        assert!((error(&bounced) - 0.1).abs() < 1e-3, "{}", error(&bounced));
        // Their own noise is no error of tier 1's.
        for own in bounced.iter_mut().flatten() {
            own.noise = own.irradiance * (0.1 / 1.1);
        }
        assert!(error(&bounced) < 1e-3, "{}", error(&bounced));
        bounced[LEAST_COMPARED - 1..].fill(None);
        assert_eq!(error(&bounced), COARSE_ERROR, "too few say so");
    }
}
