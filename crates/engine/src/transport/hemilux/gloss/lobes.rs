//! Glossy reflection seen by the camera: rays by the lobe of every glossy fragment. Neighbouring
//! pixels share these rays as far as the lobes blur what they show (docs/decisions/0024). What they
//! share is radiance over the lobe's albedo, so that textures of colour and metal stay sharp.

use super::lobe_at::{LightsAt, LobeRadiance, Way};
use super::lobe_rays::{LobePathNumbers, radiance_by_lobe};
use super::open_sky;
use super::placed_lobe::PlacedLobe;
use super::seen_through::{PixelRay, SeenThrough, behind_holes};
use super::sharing::{Shared, Shown};
use super::sums::{Found, LobeSums, open_factor};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::NarrowLimits;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::{Reflection, World};
use crate::transport::hemilux::coarse::CoarseSolution;
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use rayon::prelude::*;

/// Time of a batch of directions to an open sky, in that of a ray with its ray to the lights.
pub(super) const BATCH_COST: f32 = 1.5;
/// Error of the lobes, relative to the mean radiance, that is negligible in the first picture;
/// after n iterations it is this over √n.
const NEGLIGIBLE_ERROR: f64 = 0.006;
/// Of more lobes than so many, some are asked for their error.
const MOST_LOOKED_AT: usize = 4096;
/// Each so-manieth of them then: no multiple of the pixels in a row of most pictures.
const LOOKED_AT_EVERY: usize = 13;
/// Outliers get more rays so often in a pass, if they still are.
const OUTLIER_ROUNDS: u32 = 3;
/// Pixels in each direction that share rays.
pub(super) const NEIGHBOUR_REACH: i32 = 2;
/// What these have found together is shared again with pixels so many times as far away.
const WIDE_STRIDE: i32 = 4;
/// Bound on rays of a lobe read from a checkpoint: more than any run traces, so a larger number
/// means damage.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// Light that the lobes of glossy fragments reflect towards the camera.
pub struct Gloss {
    pub(super) lobes: Vec<PlacedLobe>,
    /// Of each of [`VisibleSurfaces::lobes`], whether narrow lights are left to others.
    leaves_narrow: Vec<bool>,
    /// Largest exponent of lobes that are broad beside narrow lights.
    broad_up_to: f32,
    /// Of each of them.
    pub(super) sums: Vec<LobeSums>,
    /// Of each of them, by how much its mean is corrected for the open sky; empty where there is none.
    factors: Vec<f32>,
    /// Of each of them, radiance over albedo with what neighbours share; empty before the first pass.
    pub(super) shown: Vec<Shown>,
    /// Passes that are in `shown`, and [`Gloss::cost`] then.
    shared: u32,
    cost_shared: f64,
    /// Whether neighbours share what they find.
    is_shared: bool,
    /// Lobes of pixel p: `start[p]..start[p + 1]`.
    start: Vec<u32>,
    /// Lobes that have rays of their own in the first pass, where faint ones take turns.
    pub(super) beginning: f32,
    /// Passes so far.
    pub passes: u32,
    /// Mean radiance of the picture, by what was known after the first pass.
    pub brightness: f32,
}

/// What a lobe gets in a pass.
#[derive(Clone, Copy, Default)]
pub(super) struct Work {
    /// Rays.
    pub rays: u32,
    /// Batches of directions to an open sky, if it sees any.
    pub batches: u32,
}

impl Gloss {
    /// Writes what the rays found.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.passes);
        to.value(self.brightness);
        to.slice(&self.sums);
    }

    /// Reads what [`Gloss::save`] wrote of the same lobes.
    pub fn restore(
        &mut self,
        visible: &VisibleSurfaces,
        from: &mut Reader<'_>,
    ) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.brightness = from.value()?;
        self.sums = from.exactly(self.sums.len())?;
        if !self.sums.iter().all(|sums| sums.is_possible(MOST_RAYS_OF_ALL)) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        self.find_factors(visible);
        self.share(visible);
        Ok(())
    }

    /// The lobes that a camera sees, without a ray yet; neighbours share what they find if `is_shared`.
    pub fn new(world: &World, visible: &VisibleSurfaces, is_shared: bool) -> Self {
        let placed = |lobe: &Lobe| PlacedLobe::new(world, visible, lobe);
        let lobes: Vec<PlacedLobe> =
            visible.lobes.par_iter().with_min_len(1024).map(placed).collect();
        let mut start = Vec::new();
        if !lobes.is_empty() {
            start = vec![0; visible.shine.len() + 1];
            for lobe in &visible.lobes {
                start[visible.fragments[lobe.fragment as usize].pixel as usize + 1] += 1;
            }
            for pixel in 1..start.len() {
                start[pixel] += start[pixel - 1];
            }
        }
        let mut gloss = Self {
            sums: vec![LobeSums::default(); lobes.len()],
            leaves_narrow: vec![false; lobes.len()],
            broad_up_to: 0.0,
            lobes,
            factors: Vec::new(),
            shown: Vec::new(),
            shared: 0,
            cost_shared: 0.0,
            is_shared,
            start,
            beginning: 0.0,
            passes: 0,
            brightness: 0.0,
        };
        let all = gloss.lobes.iter().zip(&visible.lobes);
        gloss.beginning =
            all.filter(|own| !is_shared || gloss.begins(visible, *own)).count() as f32;
        gloss
    }

    /// Leaves narrow lights out of what opaque lobes show, if they are no narrower than they may be: Phong's than
    /// the broad ones, microfacets than any.
    pub fn without_narrow(
        mut self,
        world: &World,
        visible: &VisibleSurfaces,
        most: NarrowLimits,
    ) -> Self {
        let is_left = |(placed, lobe): (&PlacedLobe, &Lobe)| {
            let fragment = &visible.fragments[lobe.fragment as usize];
            let (triangle, ..) = visible.place_on_triangle(fragment, 0);
            let is_opaque = !world.is_clear(triangle) && !world.is_translucent(triangle);
            let most = if placed.has_slopes { most.polished } else { most.broad };
            placed.exponent() <= most && is_opaque
        };
        self.leaves_narrow = self.lobes.iter().zip(&visible.lobes).map(is_left).collect();
        self.broad_up_to = most.broad;
        self
    }

    /// Numbers of the lobes without narrow lights, and whether they are polished, narrower than the broad ones.
    pub fn leaving_narrow(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let all = (0..).zip(&self.leaves_narrow).zip(&self.lobes);
        all.filter_map(|((lobe, leaves), placed)| {
            leaves.then_some((lobe, placed.exponent() > self.broad_up_to))
        })
    }

    /// Time of all that was done so far, in that of a ray with its ray to the lights.
    pub fn cost(&self) -> f64 {
        let of =
            |sums: &LobeSums| f64::from(sums.rays) + f64::from(BATCH_COST * sums.batches as f32);
        self.sums.iter().map(of).sum()
    }

    /// Rays so far, each with one to the lights.
    pub fn rays(&self) -> u64 {
        self.sums.iter().map(|sums| u64::from(sums.rays)).sum()
    }

    /// Number of lobes.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Whether the lobes' error may matter in the picture after so many iterations, rather than lie
    /// far below that of the rest ([`NEGLIGIBLE_ERROR`]): by what some of them show.
    pub fn may_matter(&self, visible: &VisibleSurfaces, iterations: u64) -> bool {
        let of_lobe = |lobe: usize| {
            let [_, variance] = self.reflected(visible, lobe);
            let lobe = &visible.lobes[lobe];
            let factor = visible.fragments[lobe.fragment as usize].lobe_factor;
            let share = visible.share(lobe);
            f64::from(share * share * (factor * factor * variance).element_sum())
        };
        let step = if self.len() > MOST_LOOKED_AT { LOOKED_AT_EVERY } else { 1 };
        let lobes: Vec<usize> = (0..self.len()).step_by(step).collect();
        let variances: Vec<f64> = lobes.into_par_iter().map(of_lobe).collect();
        let all = variances.iter().sum::<f64>() * step as f64 / (3 * visible.shine.len()) as f64;
        // What rays have found since.
        let all = all * self.cost_shared / self.cost().max(1.0);
        let enough = NEGLIGIBLE_ERROR * f64::from(self.brightness);
        all * (iterations + 1) as f64 > enough * enough
    }

    /// Casts another pass of rays: of all lobes alike at first, but that of faint ones only some begin; later,
    /// if `adaptive`, by how much they scatter, and then, about, no more than `most` of [`Gloss::cost`]
    /// altogether.
    pub fn pass(
        &mut self,
        coarse: &CoarseSolution,
        visible: &VisibleSurfaces,
        (seed, adaptive): (Seed, bool),
        most: f64,
    ) {
        let work = match adaptive && self.passes > 0 {
            true => self.work_by_scatter(visible, self.share_of_pass(most)),
            false => self.first_work(visible, !(adaptive && self.is_shared)),
        };
        self.cast((coarse, visible, seed), &work);
        if let Some(more) = self.work_of_lonely(visible) {
            self.cast((coarse, visible, seed), &more);
        }
        let rounds = if adaptive && self.passes > 0 { OUTLIER_ROUNDS } else { 0 };
        for _ in 0..rounds {
            let Some(more) = self.work_of_outliers(visible) else { break };
            self.cast((coarse, visible, seed), &more);
        }
        self.passes += 1;
        self.find_factors(visible);
        // The next pass goes by it already.
        if self.passes == 1 {
            self.share(visible);
        }
    }

    /// Casts rays, and looks at the open sky, as often as `work` says of each lobe.
    fn cast(
        &mut self,
        (coarse, visible, seed): (&CoarseSolution, &VisibleSurfaces, Seed),
        work: &[Work],
    ) {
        let all = self.sums.par_iter_mut().zip(&visible.lobes).enumerate().with_max_len(256);
        all.for_each(|(index, (sums, lobe))| {
            let work = work[index];
            if work.rays == 0 && work.batches == 0 {
                return;
            }
            // Pixels of a tile take the points of a sequence in turn.
            let fragment = &visible.fragments[lobe.fragment as usize];
            let (pixel, is_told) = (fragment.pixel, fragment.lobe_albedo.is_some());
            let (x, y) = (pixel % visible.width, pixel / visible.width);
            let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
            let sequence = Shifted::new(seed, Stream::Gloss, tile);
            let lights = match self.leaves_narrow[index] {
                true => LightsAt::Extended,
                false => LightsAt::Lobe,
            };
            let place = BAYER[(y % 4 * 4 + x % 4) as usize];
            for ray in sums.rays..sums.rays + work.rays {
                let at = sequence.of_pixel(place, ray);
                sums.add(trace(coarse, visible, (lobe, ray), (&at, lights)), is_told);
            }
            if !sums.sees_sky() {
                return;
            }
            let sequence = Shifted::new(seed, Stream::OpenLobe, u64::from(pixel));
            for batch in sums.batches..sums.batches + work.batches {
                let lit = (&*coarse.world, &*coarse.lights);
                sums.add_batch(open_sky::batch(lit, visible, (lobe, batch), &sequence), is_told);
            }
        });
    }

    /// Finds by how much each lobe's mean is corrected for the open sky: as the rays of those beside
    /// it say, or its own where there are none.
    fn find_factors(&mut self, visible: &VisibleSurfaces) {
        if !self.sums.iter().any(LobeSums::knows_open_sky) {
            return;
        }
        let covariances: Vec<[f32; 2]> = self.sums.par_iter().map(LobeSums::covariance).collect();
        let factor = |lobe: usize| {
            if !self.sums[lobe].knows_open_sky() {
                return 0.0;
            }
            let mut beside = Vec::new();
            self.around(visible, lobe, (1, 1), |other, _, _| beside.push(covariances[other]));
            if beside.is_empty() {
                beside.push(covariances[lobe]);
            }
            open_factor(beside.into_iter())
        };
        self.factors = (0..self.len()).into_par_iter().with_min_len(1024).map(factor).collect();
    }

    pub(super) fn factor(&self, lobe: usize) -> f32 {
        self.factors.get(lobe).copied().unwrap_or_default()
    }

    /// Mean and variance, summed over the channels, of radiance over albedo by a lobe's own rays.
    fn own(&self, lobe: usize) -> Shown {
        let (sums, factor) = (&self.sums[lobe], self.factor(lobe));
        let ((rest, rest_variance), (open, open_variance)) = (sums.rest(factor), sums.open_sky());
        Shown {
            mean: rest + factor * open,
            variance: rest_variance + factor * factor * open_variance,
            rays: sums.rays as f32,
        }
    }

    /// How much of the variance of a lobe's own mean is left by sharing.
    pub(super) fn left_by_sharing(&self, lobe: usize) -> f32 {
        let (shown, own) = (self.shown[lobe].rays, self.sums[lobe].rays as f32);
        own / shown.max(1.0)
    }

    /// Adds, by pixel, radiance of narrow lights that lobes see by way of polished or clear surfaces; there are no
    /// pixels yet where nothing is mirrored.
    pub fn add_mirrored(&self, visible: &VisibleSurfaces, to: &mut Vec<Rgb>) {
        for (sums, lobe) in self.sums.iter().zip(&visible.lobes) {
            let mirrored = sums.mirrored();
            if mirrored != Rgb::ZERO {
                to.resize(visible.shine.len(), Rgb::ZERO);
                let fragment = &visible.fragments[lobe.fragment as usize];
                to[fragment.pixel as usize] +=
                    visible.share(lobe) * fragment.lobe_factor * mirrored;
            }
        }
    }

    /// Radiance that each fragment's lobes reflect to the camera, with its variance.
    pub fn of_fragments(&self, visible: &VisibleSurfaces) -> Vec<(Rgb, Rgb)> {
        let own = |lobe| {
            let [mean, variance] = self.reflected(visible, lobe);
            (mean.max(Rgb::ZERO), variance)
        };
        let lobes: Vec<(Rgb, Rgb)> =
            (0..self.len()).into_par_iter().with_min_len(1024).map(own).collect();
        let mut fragments = vec![(Rgb::ZERO, Rgb::ZERO); visible.fragments.len()];
        // A fragment has one lobe, and the lobe all of its share, which rays at edges refine.
        for (lobe, own) in visible.lobes.iter().zip(lobes) {
            fragments[lobe.fragment as usize] = own;
        }
        fragments
    }

    /// Radiance that a lobe reflects to the camera, and its variance.
    pub(super) fn reflected(&self, visible: &VisibleSurfaces, lobe: usize) -> [Rgb; 2] {
        let Shown { mean, variance, .. } = self.shown.get(lobe).copied().unwrap_or_default();
        let fragment = &visible.fragments[visible.lobes[lobe].fragment as usize];
        let placed = (self.sums[lobe].rays == 0).then_some(self.lobes[lobe].albedo);
        self.sums[lobe].reflected((mean, variance), fragment.lobe_albedo.or(placed))
    }

    /// Finds what each lobe shows after the passes so far: with what neighbours found, if they share it, and
    /// then with what those farther away have together.
    pub fn share(&mut self, visible: &VisibleSurfaces) {
        if self.shared == self.passes {
            return;
        }
        self.shared = self.passes;
        self.cost_shared = self.cost();
        let all = || (0..self.len()).into_par_iter().with_min_len(1024);
        if !self.is_shared {
            self.shown = all().map(|lobe| self.own(lobe)).collect();
            return;
        }
        let near: Vec<Shown> = all().map(|lobe| self.with_neighbours(visible, lobe)).collect();
        let wide = |lobe: usize| self.with_wider_neighbours(visible, &near, lobe);
        self.shown = all().map(wide).collect();
    }

    /// Radiance over albedo by planes fitted through those of neighbouring lobes that look at about the
    /// same place: one through what rays find beside the open sky's share, the other through the open sky.
    fn with_neighbours(&self, visible: &VisibleSurfaces, index: usize) -> Shown {
        let (mine, factor) = (&self.sums[index], self.factor(index));
        if mine.rays == 0 {
            return self.of_neighbours(visible, index);
        }
        let mut rest = Shared::new(mine.rest(factor), mine.rays as f32);
        let mut open = Shared::new(mine.open_sky(), mine.batches as f32);
        let near = (NEIGHBOUR_REACH, 1);
        self.around(visible, index, near, |other, across, down| {
            let same = self.looks_at_the_same(index, other);
            if same <= 0.0 {
                return;
            }
            let theirs = &self.sums[other];
            rest.add([across, down], theirs.rest(factor), same * theirs.rays as f32);
            if factor > 0.0 {
                open.add([across, down], theirs.open_sky(), same * theirs.batches as f32);
            }
        });
        let (rest, open) = (rest.center(), open.center());
        if factor == 0.0 {
            return rest;
        }
        Shown {
            mean: rest.mean + factor * open.mean,
            variance: rest.variance + factor * factor * open.variance,
            rays: rest.rays,
        }
    }

    /// The same of a lobe that has no rays: through what neighbours found, each corrected for the open sky by its
    /// own factor, since some of them know nothing of that.
    fn of_neighbours(&self, visible: &VisibleSurfaces, index: usize) -> Shown {
        let mut all = Shared::of_others();
        self.around(visible, index, (NEIGHBOUR_REACH, 1), |other, across, down| {
            let weight = self.looks_at_the_same(index, other) * self.sums[other].rays as f32;
            let theirs = self.own(other);
            all.add([across, down], (theirs.mean, theirs.variance), weight);
        });
        all.center()
    }

    /// The same through what pixels farther away have found with their neighbours: broad lobes show much
    /// the same over dozens of pixels.
    fn with_wider_neighbours(
        &self,
        visible: &VisibleSurfaces,
        near: &[Shown],
        index: usize,
    ) -> Shown {
        let mine = near[index];
        if !self.is_seen_alike_widely(visible, index) {
            return mine;
        }
        let mut shared = Shared::new((mine.mean, mine.variance), mine.rays);
        let wide = (NEIGHBOUR_REACH, WIDE_STRIDE);
        self.around(visible, index, wide, |other, across, down| {
            let same = self.looks_at_the_same(index, other);
            if same > 0.0 {
                let Shown { mean, variance, rays } = near[other];
                shared.add([across, down], (mean, variance), same * rays);
            }
        });
        shared.center_unless_bent()
    }

    /// Whether any of the pixels a stride away, across or down, looks at the same place.
    fn is_seen_alike_widely(&self, visible: &VisibleSurfaces, index: usize) -> bool {
        let mut is_alike = false;
        self.around(visible, index, (1, WIDE_STRIDE), |other, across, down| {
            let is_beside = across == 0 || down == 0;
            is_alike |= is_beside && !is_alike && self.looks_at_the_same(index, other) > 0.0;
        });
        is_alike
    }

    /// Calls `each` with the lobes of neighbouring pixels, and how many strides they are to the
    /// right and down: up to `reach`.
    pub(super) fn around(
        &self,
        visible: &VisibleSurfaces,
        index: usize,
        (reach, stride): (i32, i32),
        mut each: impl FnMut(usize, i32, i32),
    ) {
        let pixel = visible.fragments[visible.lobes[index].fragment as usize].pixel;
        let (x, y) = ((pixel % visible.width) as i32, (pixel / visible.width) as i32);
        let (width, height) = (visible.width as i32, visible.height as i32);
        for down in -reach..=reach {
            for across in -reach..=reach {
                let (column, row) = (x + across * stride, y + down * stride);
                let is_inside = (0..width).contains(&column) && (0..height).contains(&row);
                if !is_inside || (across, down) == (0, 0) {
                    continue;
                }
                let near = (row * width + column) as usize;
                for other in self.start[near] as usize..self.start[near + 1] as usize {
                    each(other, across, down);
                }
            }
        }
    }

    /// Weight of two lobes for each other, 0 to 1. What they look at is as far away as the harmonic mean
    /// distance of their rays.
    pub(super) fn looks_at_the_same(&self, one: usize, other: usize) -> f32 {
        let (mine, theirs) = (&self.sums[one], &self.sums[other]);
        let nearness = match mine.rays {
            0 => theirs.nearness(),
            _ => 0.5 * (mine.nearness() + theirs.nearness()),
        };
        self.lobes[one].looks_at_the_same(&self.lobes[other], nearness)
    }
}

/// Traces a ray of a lobe, by its number.
fn trace(
    coarse: &CoarseSolution,
    visible: &VisibleSurfaces,
    (lobe, ray): (&Lobe, u32),
    (at, lights): (&Shifted, LightsAt),
) -> Found {
    let surface = visible.surface(&coarse.world, lobe, (ray, ray));
    let of_pixel = PixelRay { frame: visible.frame, height: visible.height, number: ray };
    if coarse.world.is_clear(surface.triangle) {
        let (origin, direction) = visible.lobe_ray(lobe, ray);
        let line = ([origin, direction], of_pixel);
        let SeenThrough { radiance, mirrored, nearness } = behind_holes(coarse, line, at.afresh());
        let (sky, open_sky) = (Rgb::ZERO, Rgb::ZERO);
        return Found { radiance, sky, open_sky, mirrored, albedo: Rgb::ONE, nearness };
    }
    let viewer = visible.frame.towards_eye(surface.spot.point);
    let path_numbers = LobePathNumbers {
        xi: at.third_pair(),
        numbers: at.afresh(),
        tells_open_sky: coarse.lights.has_sky(),
        lights: lights.into(),
        by_mesh: false,
    };
    let differing = of_pixel.differentials(coarse, surface.spot.point);
    let way = Way { viewer, is_mapped: false, differing };
    let LobeRadiance { radiance, sky, open_sky, mirrored, nearness } =
        radiance_by_lobe(coarse, surface, way, path_numbers);
    let albedo = surface.lobe_only().reflection().albedo(viewer);
    Found { radiance, sky, open_sky, mirrored, albedo, nearness }
}

#[cfg(test)]
impl Gloss {
    /// What so many passes find, `adaptive` or not, when it has been shared if it is to be.
    pub(super) fn after(
        specimen: &crate::transport::hemilux::specimen::Specimen,
        visible: &VisibleSurfaces,
        is_shared: bool,
        (passes, adaptive): (u32, bool),
    ) -> Self {
        let how = (crate::transport::hemilux::specimen::SEED, adaptive);
        let mut gloss = Self::new(&specimen.world, visible, is_shared);
        for _ in 0..passes {
            gloss.pass(&specimen.coarse, visible, how, f64::INFINITY);
        }
        gloss.share(visible);
        gloss
    }
}

#[cfg(test)]
mod tests;
