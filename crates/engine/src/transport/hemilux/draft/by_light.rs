//! Joint bilateral upsampling (Kopf et al. 2007) of a draft: what its fragments are lit by goes to the
//! fragments that the pixels asked for see, from those around on the same surface alone. So edges and
//! textures are as fine as these pixels, and only the light is as coarse as the draft.

use super::super::coarse::CoarseSolution;
use super::super::estimate::{Arriving, Errors};
use super::super::fragments::{Fragment, VisibleSurfaces};
use super::by_pixels::{Draft, Mapping};
use crate::image::Picture;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::scene::Camera;
use crate::surface::World;
use glam::{IVec2, Vec2};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// Sub-pixel samples of the pixels asked for.
const SAMPLES: u32 = 8;
/// Powers of the numbers of samples and of pixels by which the time grows that rasterising takes, and
/// grouping what is seen by surfaces.
const GROWTH: [[f64; 2]; 2] = [[1.0, 0.5], [0.4, 0.72]];
/// Power of the cosine between shading normals by which fragments count less for each other: normal maps
/// turn them where surfaces are the same.
const LIKENESS_POWER: i32 = 32;
/// Cosine between shading normals above which they count as the same.
const ALIKE_COSINE: f32 = 0.9999;
/// How much the least alike on the same surface still counts.
const LEAST_LIKENESS: f32 = 1e-3;
/// How much the smallest share of a pixel counts beside a whole one.
const LEAST_SHARE: f32 = 0.05;
/// Square of the error by light that is linear between places one apart, in that of the mean of the
/// places beside as that of the one between: at a step 1/12 over one place beside 1/4 in two, and twice
/// that by seven views whose true error is known (docs/decisions/0071).
const STEP_ERROR: f64 = 1.0 / 3.0;
/// The same of light that changes within pixels, whose steps may be anywhere.
const UNRESOLVED_ERROR: f64 = 2.0;
/// Weight of a pixel that is a whole column or row away, in that of one that is in place, which of twelve
/// more has the inverse of this at most.
const LEAST_WEIGHT: f32 = 1e-3;

/// What the pixels that were asked for see.
pub struct Full(VisibleSurfaces);

/// A draft with the light that arrives at each of its fragments.
pub struct Lit<'a> {
    /// What its pixels see.
    pub visible: &'a VisibleSurfaces,
    /// Of its fragments.
    pub arriving: &'a [Arriving],
    /// What is known of the rest of the scene.
    pub coarse: &'a CoarseSolution,
}

/// The pixels of a draft, and where those that light is brought to lie among them.
#[derive(Clone, Copy)]
struct Grid {
    size: [u32; 2],
    mapping: Mapping,
}

impl Full {
    /// Rasterises the scene for the size that a draft's job asked for.
    pub fn new(world: &Arc<World>, cut: Arc<Cut>, camera: &Camera, size: [u32; 2]) -> Self {
        Self(VisibleSurfaces::new(world, cut, camera, size, SAMPLES))
    }

    /// Seconds that this can be expected to take, by what a draft's surfaces took.
    pub fn takes(draft: &Draft, visible: &VisibleSurfaces) -> f64 {
        let pixels = f64::from(draft.shrink).powi(2);
        let samples = f64::from(SAMPLES) / visible.samples() as f64;
        let grown = |k: usize| {
            let [by_samples, by_pixels] = GROWTH[k];
            visible.seconds[k] * samples.powf(by_samples) * pixels.powf(by_pixels)
        };
        grown(0) + grown(1)
    }

    /// Variance of surfaces' shares of its pixels, in that of a draft's, with that of how many pixels
    /// edges take.
    pub fn edge_factor(&self, draft: &VisibleSurfaces) -> f64 {
        f64::from(draft.width) / f64::from(self.0.width) * Self::edges(draft)
    }

    /// Variance of a surface's share of one of its pixels, in that of a draft's.
    pub fn edges(draft: &VisibleSurfaces) -> f64 {
        f64::from(draft.edge_weight) / f64::from(SAMPLES).powf(1.5)
    }

    /// The picture by a draft's light.
    pub fn picture(&self, draft: &Lit<'_>) -> Picture {
        let visible = &self.0;
        let [from, to] = [draft.visible, visible].map(|own| [own.width, own.height]);
        let grid = Grid { size: from, mapping: Mapping::new(from, to) };
        let pixel = |index: usize| {
            let background = visible.background.get(index).copied().unwrap_or_default();
            visible.shine[index] + background + draft.reflected(&grid, visible, index)
        };
        let count = visible.shine.len();
        let pixels = (0..count).into_par_iter().with_min_len(1024).map(pixel).collect();
        let alpha = (!visible.coverage.is_empty()).then(|| visible.coverage.clone());
        Picture { alpha, ..Picture::new(visible.width, visible.height, pixels) }
    }
}

/// Relative error that a draft's light makes, about, where it is brought to smaller pixels: by what each of
/// its pixels would show in the light of those beside it, noise and all. `mean` is the draft's, of the
/// pixels that are `counted`.
pub fn loss_of_light(draft: &Lit<'_>, counted: &[bool], mean: f64) -> f64 {
    let counted = counted.par_iter().enumerate().with_min_len(1024);
    let counted = counted.filter(|(_, counts)| **counts);
    let all: Vec<[Rgb; 2]> = counted.map(|(pixel, _)| draft.changes(pixel)).collect();
    let square = |of: &dyn Fn(&[Rgb; 2]) -> Rgb| {
        let squares = all.iter().map(|own| f64::from(of(own).length_squared()));
        let counted = 3.0 * all.len().max(1) as f64;
        squares.sum::<f64>() / counted / (mean * mean).max(f64::MIN_POSITIVE)
    };
    let [steps, unresolved] = [square(&|own| own[0]), square(&|own| own[1])];
    (STEP_ERROR * steps + UNRESOLVED_ERROR * unresolved).sqrt()
}

/// What of that is noise, in a draft with these errors.
pub fn noise_of_light(errors: &Errors) -> f64 {
    let [noise, bent, shadows, lobes, _] = errors.by_cause;
    let steps = noise * noise + bent * bent + shadows * shadows;
    (STEP_ERROR * steps + UNRESOLVED_ERROR * lobes * lobes).sqrt()
}

/// The pixels beside one of a picture, with their weights.
fn beside(pixel: usize, [width, height]: [u32; 2]) -> impl Iterator<Item = (usize, f32)> {
    let at = IVec2::new((pixel as u32 % width) as i32, (pixel as u32 / width) as i32);
    let all = (-1..2).flat_map(|y| (-1..2).map(move |x| IVec2::new(x, y)));
    all.filter_map(move |step| {
        let other = at + step;
        let is_inside =
            (0..width as i32).contains(&other.x) && (0..height as i32).contains(&other.y);
        let weight = 1.0 / step.length_squared() as f32;
        let index = || other.y as usize * width as usize + other.x as usize;
        (is_inside && step != IVec2::ZERO).then(|| (index(), weight))
    })
}

impl Fragment {
    /// Radiance that it sends to the camera by what arrives, times its share of the pixel. What lobes
    /// near by show is nothing to one without any.
    fn reflected(&self, arriving: &Arriving) -> Rgb {
        let diffuse = self.diffuse / PI * arriving.irradiance.max(Rgb::ZERO);
        let lobes = if self.glossy { arriving.lobes * self.lobe_factor } else { Rgb::ZERO };
        (diffuse + lobes) * self.share
    }
}

impl Lit<'_> {
    /// Radiance that what a pixel sees reflects by this light.
    fn reflected(&self, grid: &Grid, visible: &VisibleSurfaces, pixel: usize) -> Rgb {
        let own = visible.start[pixel] as usize..visible.start[pixel + 1] as usize;
        let of =
            |fragment: &Fragment| fragment.reflected(&self.arriving_at(grid, visible, fragment));
        visible.fragments[own].iter().map(of).sum()
    }

    /// By how much a pixel's radiance would be off in the light of those beside it, as far as surfaces go on
    /// there, and as far as they do not, or their lobes may show what is smaller than a pixel.
    fn changes(&self, pixel: usize) -> [Rgb; 2] {
        let visible = self.visible;
        let size = [visible.width, visible.height];
        let (mut steps, mut unresolved) = (Rgb::ZERO, Rgb::ZERO);
        for at in visible.start[pixel] as usize..visible.start[pixel + 1] as usize {
            let (fragment, own) = (&visible.fragments[at], self.arriving[at]);
            let alike = |other: &Fragment| self.likeness(other, fragment);
            let going_on = self.between(beside(pixel, size), alike);
            let other = going_on.or_else(|| self.between(beside(pixel, size), |_| 1.0));
            let Some(other) = other else { continue };
            let [diffuse, lobes] = [
                Arriving { lobes: own.lobes, ..other },
                Arriving { irradiance: own.irradiance, ..other },
            ]
            .map(|changed| fragment.reflected(&changed) - fragment.reflected(&own));
            *(if going_on.is_some() { &mut steps } else { &mut unresolved }) += diffuse;
            unresolved += lobes;
        }
        [steps, unresolved]
    }

    /// Light at a fragment of another picture: between that of fragments around it on the same surface or,
    /// where there is none, as the coarse mesh has it, with lobes that show what those nearby do.
    fn arriving_at(&self, grid: &Grid, visible: &VisibleSurfaces, fragment: &Fragment) -> Arriving {
        let [column, row] = [fragment.pixel % visible.width, fragment.pixel / visible.width];
        let pixel = Vec2::new(column as f32, row as f32);
        let alike = |other: &Fragment| self.likeness(other, fragment);
        let near = self.between(grid.around(pixel, false), alike);
        let found = near.or_else(|| self.between(grid.around(pixel, true), alike));
        found.unwrap_or_else(|| {
            let place = visible.place_on_facet(fragment);
            let irradiance = self.coarse.direct(place) + self.coarse.bounced(place);
            let glossy = |other: &Fragment| f32::from(u8::from(other.glossy));
            let near = self.between(grid.around(pixel, true), glossy);
            let lobes = near.map_or(irradiance / PI, |near| near.lobes);
            Arriving { irradiance, lobes }
        })
    }

    /// How much the light of one of its fragments counts for another fragment, by their surfaces.
    fn likeness(&self, own: &Fragment, other: &Fragment) -> f32 {
        let is_alike = own.code == other.code || self.visible.is_same_surface(own, other);
        if own.is_beyond != other.is_beyond || !is_alike {
            return 0.0;
        }
        let cosine = own.shading_normal.dot(other.shading_normal).max(0.0);
        if cosine > ALIKE_COSINE {
            return 1.0;
        }
        cosine.powi(LIKENESS_POWER).max(LEAST_LIKENESS)
    }

    /// Light between that of the fragments in some pixels, by weights of these and of the fragments.
    fn between(
        &self,
        pixels: impl Iterator<Item = (usize, f32)>,
        weight: impl Fn(&Fragment) -> f32,
    ) -> Option<Arriving> {
        let (mut sum, mut all) = (Arriving::default(), 0.0);
        for (pixel, of_pixel) in pixels {
            let first = self.visible.start[pixel] as usize;
            for index in first..self.visible.start[pixel + 1] as usize {
                let fragment = &self.visible.fragments[index];
                let own = of_pixel * weight(fragment) * fragment.share.max(LEAST_SHARE);
                sum.irradiance += self.arriving[index].irradiance * own;
                sum.lobes += self.arriving[index].lobes * own;
                all += own;
            }
        }
        let mean = || Arriving { irradiance: sum.irradiance / all, lobes: sum.lobes / all };
        (all > 0.0).then(mean)
    }
}

impl Grid {
    /// Pixels that are looked at for the light of another pixel, with their weights: the four around
    /// it or, `wider`, twelve more.
    fn around(self, pixel: Vec2, wider: bool) -> impl Iterator<Item = (usize, f32)> {
        let at = self.mapping.at(pixel);
        let low = at.floor().as_ivec2();
        let [columns, rows] = self.size.map(|side| side as i32);
        let reach = if wider { -1..3 } else { 0..2 };
        let all = reach.clone().flat_map(move |y| reach.clone().map(move |x| IVec2::new(x, y)));
        all.filter_map(move |step| {
            let cell = low + step;
            let off = (cell.as_vec2() - at).abs();
            let weight = match wider {
                true => off.length_squared().max(LEAST_WEIGHT).recip(),
                false => ((1.0 - off.x) * (1.0 - off.y)).max(LEAST_WEIGHT),
            };
            let is_inside = (0..columns).contains(&cell.x) && (0..rows).contains(&cell.y);
            is_inside.then(|| ((cell.y * columns + cell.x) as usize, weight))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::Specimen;
    use glam::Vec3;

    const SIZE: [u32; 2] = [160, 120];

    /// What a draft of the box sees, with light that is linear in place.
    fn lit(
        specimen: &Specimen,
        shrink: u32,
        light: &dyn Fn(&Fragment) -> Rgb,
    ) -> (VisibleSurfaces, Vec<Arriving>) {
        let camera = &specimen.world.scene.cameras[0];
        let size = SIZE.map(|side| side / shrink);
        let visible = VisibleSurfaces::new(&specimen.world, specimen.cut.clone(), camera, size, 16);
        let arriving = visible.fragments.iter();
        let arriving = arriving.map(|own| Arriving { irradiance: light(own), lobes: Rgb::ZERO });
        let arriving = arriving.collect();
        (visible, arriving)
    }

    /// Light that changes slowly along surfaces and starkly from one to the next comes out as it is in
    /// the pixels asked for, and the draft says that it loses little; light that changes within its
    /// pixels doesn't, and it says so.
    #[test]
    fn light_stays_on_its_surface() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 200);
        let camera = &specimen.world.scene.cameras[0];
        let full = Full::new(&specimen.world, specimen.cut.clone(), camera, SIZE);
        let slow = |own: &Fragment| {
            Rgb::splat(2.0 + own.normal.dot(Vec3::new(0.9, 0.5, 0.3)) + 0.2 * own.point.x)
        };
        let quick = |own: &Fragment| Rgb::splat(1.0 + (60.0 * own.point.x).sin());
        for (light, low, high) in
            [(&slow as &dyn Fn(&Fragment) -> Rgb, 0.0, 0.02), (&quick, 0.15, 2.0)]
        {
            let (visible, arriving) = lit(&specimen, 4, light);
            let draft = Lit { visible: &visible, arriving: &arriving, coarse: &specimen.coarse };
            let picture = full.picture(&draft);
            let (mut off, mut sum, mut count) = (0.0, 0.0, 0.0);
            for pixel in 0..full.0.shine.len() {
                if full.0.shine[pixel] != Rgb::ZERO {
                    continue;
                }
                let own = full.0.start[pixel] as usize..full.0.start[pixel + 1] as usize;
                let exact = full.0.fragments[own].iter().map(|own| {
                    own.reflected(&Arriving { irradiance: light(own), lobes: Rgb::ZERO })
                });
                let exact: Rgb = exact.sum();
                off += f64::from((picture.pixels[pixel] - exact).length_squared());
                sum += f64::from(exact.element_sum());
                count += 3.0;
            }
            let (error, mean) = ((off / count).sqrt() / (sum / count), sum / count);
            let counted: Vec<bool> = visible.shine.iter().map(|own| *own == Rgb::ZERO).collect();
            let predicted = loss_of_light(&draft, &counted, mean);
            assert!((low..high).contains(&error), "{error}");
            assert!((0.4..4.0).contains(&(predicted / error)), "{predicted} beside {error}");
        }
    }

    /// A pixel that lies exactly on one of the draft has finite weights, however far is looked.
    #[test]
    fn weights_are_finite_in_place() {
        let (from, to) = ([17, 17], [129, 129]);
        let grid = Grid { size: from, mapping: Mapping::new(from, to) };
        let middle = Vec2::splat(64.0);
        assert_eq!(grid.mapping.at(middle), Vec2::splat(8.0));
        for wider in [false, true] {
            let weights: Vec<f32> = grid.around(middle, wider).map(|(_, weight)| weight).collect();
            assert!(
                weights.iter().all(|weight| weight.is_finite() && *weight > 0.0),
                "{weights:?}"
            );
            assert!(weights.len() >= 4);
        }
    }

    /// Where nothing of a surface is near, lobes beside it lend their light to lobes alone.
    #[test]
    fn what_has_no_lobe_shows_none() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 200);
        let (visible, _) = lit(&specimen, 4, &|_| Rgb::ONE);
        let mut one = visible.fragments[0];
        (one.glossy, one.share, one.lobe_factor) = (false, 1.0, Rgb::ONE);
        let arriving = Arriving { irradiance: Rgb::ZERO, lobes: Rgb::splat(100.0) };
        assert_eq!(one.reflected(&arriving), Rgb::ZERO);
        one.glossy = true;
        assert_eq!(one.reflected(&arriving), arriving.lobes);
    }

    /// More samples leave less at edges, and so do smaller pixels.
    #[test]
    fn edges_are_those_of_the_pixels_asked_for() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 200);
        let camera = &specimen.world.scene.cameras[0];
        let full = Full::new(&specimen.world, specimen.cut.clone(), camera, SIZE);
        let (visible, _) = lit(&specimen, 4, &|_| Rgb::ONE);
        let by_samples = (16f64 / f64::from(SAMPLES)).powf(1.5);
        assert!((full.edge_factor(&visible) - by_samples / 4.0).abs() < 1e-6);
    }
}
