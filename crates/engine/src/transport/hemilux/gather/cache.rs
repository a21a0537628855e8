//! The irradiance cache (tier 2): where records are placed, and how they are interpolated.
//!
//! Records are placed where the picture needs them, on a coarse pixel grid first and on finer ones
//! after it. They live in world space, so that a second camera finds those of the first. A record
//! counts within a radius that goes by the harmonic mean distance to other surfaces (Ward,
//! Rubinstein, Clear 1988), and not behind what stands on its horizon.

use super::fitted::{FittedIrradiance, RecordPlane};
use super::in_time::TimeLimit;
use super::pilot::{PILOT_RAYS, PilotSampling, is_corrected_noisily, rays_for_noise};
use super::record::{NO_FRAGMENT, Record, Surroundings};
use super::splat::{LocalFit, splat};
use super::{stored_record, turned};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::{Rgb, importance};
use crate::sampling::Seed;
use crate::transport::hemilux::coarse::CoarseSolution;
use crate::transport::hemilux::fragments::VisibleSurfaces;
use rayon::prelude::*;
use std::time::Instant;

/// Most records that get more rays in one iteration; where there are more, they take turns. It
/// bounds the time of an iteration.
const MOST_REFINED: usize = 6000;
/// Most records that are added for one phase of a pixel grid, which bounds the time of an iteration
/// in large scenes. Where that leaves a fragment uncovered, in foliage for example, it shows the
/// coarse solution.
const MOST_NEW: usize = 16_384;
/// Spacings, in pixels, of the grids on which uncovered fragments are looked for, in this order.
const GRID_SPACINGS: [u32; 5] = [16, 8, 4, 2, 1];
/// Sum of the records' weights below which a fragment is uncovered. A record's weight is at most 1.
const COVERED_WEIGHT: f32 = 0.6;
/// The same on the last grid, of every pixel: at first it fills only what hardly any record reaches.
/// Later it fills what hears a record from afar only, such as thin things that lie between the pixels
/// of the coarser grids.
const LAST_COVERED_WEIGHTS: [f32; 2] = [0.02, 0.2];
/// Diffuse albedo up to which a fragment shows the coarse solution if no other's records reach it: metals
/// have none.
const LEAST_ALBEDO: f32 = 0.002;
/// Share of what radii would be below which light is so bent that the last grid fills all.
const LAST_BENT_FACTOR: f32 = 0.5;
/// The factor of new records next to one that is alone: nothing tells how bent light is there, and at the
/// foot of a box it differs within a pixel.
const LONE_RADIUS_FACTOR: f32 = 0.3;
/// Side, in pixels, of the square picture to which limits in pixels refer.
const ORDINARY_SIDE: f32 = 500.0;
/// Radius of a record as a multiple of the harmonic mean distance of its rays.
const RADIUS_PER_DISTANCE: f32 = 0.35;
/// Smallest radius of a record, in pixels of a picture of ordinary size.
const LEAST_PIXELS: f32 = 6.0;
/// Largest radius of a record, in pixels of a picture of ordinary size (docs/decisions/0007: better
/// than 40).
const MOST_PIXELS: f32 = 20.0;
/// Smallest radius in pixels of the picture itself, and the same where light is bent: with a smaller
/// one every record would stand alone.
const LEAST_OWN_PIXELS: f32 = 1.5;
const LEAST_BENT_PIXELS: f32 = 0.75;
/// Radius, in pixels of a picture of ordinary size, where the setting `adaptive` is off.
const EVEN_PIXELS: f32 = 14.0;
/// Factors by which radii shrink, `(times, factor)`: the first entry counts for which a record's
/// [`Record::bent`] is over so many `times` its mean over the picture (docs/decisions/0014).
const BENT_RADIUS_FACTORS: [(f32, f32); 3] = [(10.0, 0.3), (2.0, 0.5), (0.0, 0.95)];
/// Reach of the plane fit in radii: a record's fit takes neighbours from farther away than it is
/// itself interpolated to (docs/decisions/0007: better than 1.3).
const FIT_REACH: f32 = 1.8;
/// The same of the correction of what the coarse solution says, and of what comes of that.
const CORRECTION_REACHES: [f32; 2] = [3.0, 8.0];
/// About so many neighbours say what it is.
const MOST_HEARD: usize = 256;
/// Side, in pixels, of a tile of the grid by which neighbouring records are found.
const TILE: u32 = 16;

/// The irradiance cache: all records.
pub struct IrradianceCache {
    records: Vec<Record>,
    /// Whether there was no time for some.
    pub is_unfinished: bool,
    /// Records that another camera's picture had made.
    pub reused: usize,
    /// Random sequences that records have taken, a number for each record ever made.
    sequences: u32,
    /// Per fragment, the sum of the weights of all records.
    coverage: Vec<f32>,
    /// Whether records keep what the coarse solution says along their rays: the first ones do, and later ones
    /// where that has much less noise.
    asks_mesh: bool,
}

/// How records are made and refined in an iteration.
#[derive(Clone, Copy)]
pub struct Gathering {
    /// Seed of their random numbers.
    pub seed: Seed,
    /// Rays that every record gets.
    pub rays: u32,
    /// Rays of a new record.
    pub new_rays: u32,
    /// Whether direct light is found afresh, by a shadow ray, where gather rays end.
    pub afresh: bool,
    /// How records are spaced.
    pub spacing: Spacing,
    /// By when new ones had better be made.
    pub until: Option<Instant>,
}

impl Gathering {
    fn surroundings<'a>(
        &self,
        visible: &'a VisibleSurfaces,
        coarse: &'a CoarseSolution,
        asks_mesh: bool,
    ) -> Surroundings<'a> {
        let Self { seed, afresh, .. } = *self;
        let world = &*coarse.world;
        let by_direction = world.has_normal_maps();
        Surroundings { world, coarse, visible, seed, afresh, asks_mesh, by_direction }
    }
}

/// What new records are made with.
struct FillContext<'a> {
    known: Surroundings<'a>,
    gathering: Gathering,
    /// [`Record::radius_factor`] of a new record, by fragment; empty before there are records.
    radius_factor: &'a [f32],
    /// Side of the picture over [`ORDINARY_SIDE`].
    picture_scale: f32,
}

/// How records are spaced: what their radii go by.
#[derive(Clone, Copy)]
pub struct Spacing {
    /// Factor of all radii.
    pub scale: f32,
    /// Lower bound of `scale`.
    pub least: f32,
    /// Whether all radii are the same in the picture, rather than going by what is near.
    pub even: bool,
}

impl Default for IrradianceCache {
    fn default() -> Self {
        Self {
            records: Vec::new(),
            is_unfinished: false,
            reused: 0,
            sequences: 0,
            coverage: Vec::new(),
            asks_mesh: true,
        }
    }
}

impl IrradianceCache {
    /// Writes the records.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.sequences);
        to.value([self.asks_mesh, self.is_unfinished].map(u32::from));
        stored_record::save(&self.records, to);
    }

    /// Reads what [`IrradianceCache::save`] wrote.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.sequences = from.value()?;
        [self.asks_mesh, self.is_unfinished] = from.value::<[u32; 2]>()?.map(|is| is != 0);
        self.records = stored_record::restore(from)?;
        Ok(())
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Rays of all records.
    pub fn rays(&self) -> u64 {
        self.records.iter().map(|record| u64::from(record.rays)).sum()
    }

    /// Traces more rays: for every record that has not `enough` of them, or for every n-th in turn
    /// where there are many, or their rays more than `most`.
    pub fn refine(
        &mut self,
        (visible, coarse): (&VisibleSurfaces, &CoarseSolution),
        gathering: Gathering,
        enough: u32,
        turn: usize,
        most: f64,
    ) {
        let known = gathering.surroundings(visible, coarse, self.asks_mesh);
        let mut wanted: Vec<&mut Record> =
            self.records.iter_mut().filter(|record| record.rays < enough).collect();
        let allowed = (most / f64::from(gathering.rays.max(1))) as usize;
        if allowed == 0 {
            return;
        }
        let every = wanted.len().div_ceil(MOST_REFINED.min(allowed)).max(1);
        let records = wanted.par_iter_mut().enumerate().with_max_len(16);
        records
            .filter(|(index, _)| (index + turn).is_multiple_of(every))
            .for_each(|(_, record)| record.gather(&known, gathering.rays));
    }

    /// Adds records until every fragment is covered or the time is up, and returns the rays of each: as
    /// many as `gathering` says or, with a `pilot`, as many as the noise of the first grid's records asks
    /// for.
    pub fn fill(
        &mut self,
        coarse: &CoarseSolution,
        visible: &VisibleSurfaces,
        gathering: Gathering,
        pilot: Option<PilotSampling<'_>>,
    ) -> u32 {
        let most = gathering.new_rays;
        let first_rays = if pilot.is_some() { PILOT_RAYS.min(most) } else { most };
        let mut rays = first_rays;
        let mut time = TimeLimit::new(gathering.until);
        let radius_factor = self.shrink_bent(visible);
        for record in &mut self.records {
            record.radius = radius(record, gathering.spacing);
        }
        self.coverage = vec![0.0; visible.fragments.len()];
        self.cover(visible, 0);
        let mut context = FillContext {
            known: gathering.surroundings(visible, coarse, self.asks_mesh),
            gathering,
            radius_factor: &radius_factor,
            picture_scale: picture_scale(visible),
        };
        for spacing in GRID_SPACINGS {
            let pilot = pilot.filter(|_| spacing == GRID_SPACINGS[0]);
            let mut direct = Rgb::ZERO;
            for phase in phases(spacing) {
                let uncovered = thinned(self.uncovered(&context, spacing, *phase));
                if let Some(pilot) = pilot {
                    direct +=
                        uncovered.iter().map(|place| (pilot.direct)(*place as usize)).sum::<Rgb>();
                }
                let (places, rays) = time.records(uncovered, rays, PILOT_RAYS);
                time.count(places.len(), rays);
                self.add_records(&context, places, rays);
            }
            if let Some(pilot) = pilot.filter(|_| !self.records.is_empty()) {
                let wanted =
                    rays_for_noise(&self.records, direct, pilot.hasty).clamp(first_rays, most);
                let more = time.rays(self.records.len(), wanted - first_rays);
                rays = first_rays + more;
                self.asks_mesh = is_corrected_noisily(&self.records);
                context.known.asks_mesh = self.asks_mesh;
                time.count(self.records.len(), more);
                self.gather_more(&context, more);
            }
        }
        self.is_unfinished = time.is_felt;
        rays
    }

    /// Uncovered fragments in the pixels of one phase of a grid.
    fn uncovered(
        &self,
        context: &FillContext<'_>,
        spacing: u32,
        [across, down]: [u32; 2],
    ) -> Vec<u32> {
        let visible = context.known.visible;
        let is_bent = |fragment: u32| {
            let factor = context.radius_factor.get(fragment as usize);
            factor.is_some_and(|factor| *factor < LAST_BENT_FACTOR)
        };
        let last = LAST_COVERED_WEIGHTS[usize::from(!context.radius_factor.is_empty())];
        let least = |fragment: u32| match spacing == 1 && !is_bent(fragment) {
            true => last,
            false => COVERED_WEIGHT,
        };
        let double = 2 * spacing as usize;
        let mut uncovered = Vec::new();
        for row in (down * spacing..visible.height).step_by(double) {
            for column in (across * spacing..visible.width).step_by(double) {
                let pixel = (row * visible.width + column) as usize;
                let range = visible.start[pixel]..visible.start[pixel + 1];
                let is_wanted = |f: &u32| {
                    let albedo = importance(visible.fragments[*f as usize].diffuse);
                    albedo > LEAST_ALBEDO && self.coverage[*f as usize] < least(*f)
                };
                uncovered.extend(range.filter(is_wanted));
            }
        }
        uncovered
    }

    /// Adds records on these fragments, each with so many rays.
    fn add_records(&mut self, context: &FillContext<'_>, uncovered: Vec<u32>, rays: u32) {
        let FillContext { known, gathering, radius_factor, picture_scale } = *context;
        let visible = known.visible;
        let first = self.records.len();
        let sequences = self.sequences;
        let new: Vec<Record> = uncovered
            .into_par_iter()
            .enumerate()
            .with_max_len(16)
            .map(|(index, place)| {
                let fragment = &visible.fragments[place as usize];
                let footprint =
                    picture_scale * visible.frame.footprint(fragment.point, visible.height);
                let number = sequences.wrapping_add(index as u32);
                let point = visible.middle_point(fragment);
                let mut record = Record::new(point, fragment.normal, footprint, number);
                record.flat = visible.flat_normal(fragment);
                record.fragment = place;
                record.gather(&known, rays);
                record.radius_factor = radius_factor.get(place as usize).copied().unwrap_or(1.0);
                record.radius = radius(&record, gathering.spacing);
                record
            })
            .collect();
        self.sequences = sequences.wrapping_add(new.len() as u32);
        self.records.extend(new);
        self.cover(visible, first);
    }

    /// Traces more rays of all records, whose radii then follow what these found.
    fn gather_more(&mut self, context: &FillContext<'_>, rays: u32) {
        let FillContext { known, gathering, .. } = *context;
        self.records.par_iter_mut().with_max_len(16).for_each(|record| {
            record.gather(&known, rays);
            record.radius = radius(record, gathering.spacing);
        });
        self.coverage.fill(0.0);
        self.cover(known.visible, 0);
    }

    /// Shrinks the radii of all records by [`BENT_RADIUS_FACTORS`]; returns the radius factor of
    /// new records, by fragment, interpolated from those that are there.
    fn shrink_bent(&mut self, visible: &VisibleSurfaces) -> Vec<f32> {
        if self.records.is_empty() {
            return Vec::new();
        }
        let (mut sum, mut pixels) = (0.0, 0.0);
        for record in &self.records {
            let area = (record.radius / record.footprint).powi(2);
            (sum, pixels) = (sum + record.bent.element_sum() * area, pixels + area);
        }
        let mean = sum / pixels;
        for record in &mut self.records {
            let bent = record.bent.element_sum();
            let shrunk = BENT_RADIUS_FACTORS.iter().find(|(times, _)| bent > times * mean);
            record.radius_factor *= shrunk.map_or(1.0, |(_, factor)| *factor);
        }
        splat(
            visible,
            &self.records,
            |record| {
                let most = if record.is_alone { LONE_RADIUS_FACTOR } else { f32::INFINITY };
                LocalFit::even([record.radius_factor.min(most)])
            },
            |[radius_factor], weight| if weight > 0.0 { radius_factor / weight } else { 1.0 },
        )
    }

    /// Goes over to another camera: keeps the records that have weight at any fragment it sees.
    pub fn change_camera(&mut self, visible: &VisibleSurfaces, spacing: Spacing) {
        let picture_scale = picture_scale(visible);
        let counts = |record: &mut Record| {
            record.footprint =
                picture_scale * visible.frame.footprint(record.point, visible.height);
            record.radius = radius(record, spacing);
            record.fragment = NO_FRAGMENT;
            let around = record.weight_function(1.0);
            let Some([x0, x1, y0, y1]) = record.window(visible, 1.0) else { return false };
            (y0..y1).any(|row| {
                let first = visible.start[(row * visible.width + x0) as usize] as usize;
                let last = visible.start[(row * visible.width + x1) as usize] as usize;
                let fragments = &mut visible.fragments[first..last].iter();
                fragments.any(|other| around.weight(other.point, other.normal) > 0.0)
            })
        };
        let all = std::mem::take(&mut self.records).into_par_iter().with_min_len(64);
        self.records = all.filter_map(|mut one| counts(&mut one).then_some(one)).collect();
        self.reused = self.records.len();
    }

    /// Adds the weights of the records from `first` on to the coverage.
    fn cover(&mut self, visible: &VisibleSurfaces, first: usize) {
        let added = splat(
            visible,
            &self.records[first..],
            |_| LocalFit::even([]),
            |[], weight: f32| weight,
        );
        for (sum, more) in self.coverage.iter_mut().zip(added) {
            *sum += more;
        }
    }

    /// Fits a plane, for every record, through the irradiances of it and its neighbours, weighted
    /// by how much they count here: value and slope of the record are those of the plane. Without
    /// `fit` a record keeps its own irradiance, and has no slope.
    ///
    /// What finding light afresh says beyond the coarse solution has much noise and changes little from
    /// place to place: that correction is fitted before, over a wider reach.
    pub fn smooth(&mut self, visible: &VisibleSurfaces, fit: bool) {
        if !fit {
            for record in &mut self.records {
                record.set_fit(FittedIrradiance::alone([record.irradiance(), record.noise()]));
            }
            return;
        }
        let tiles = RecordTiles::new(visible, &self.records);
        let found: Vec<[Rgb; 2]> = self.records.iter().map(Record::correction).collect();
        let (mut corrections, mut bent) = (found.clone(), Vec::new());
        for reach in CORRECTION_REACHES.into_iter().filter(|_| self.asks_mesh) {
            let fits = self.fits(&tiles, &corrections, (reach, MOST_HEARD));
            bent = fits.iter().map(|fit| fit.bent).collect();
            corrections = fits.into_iter().map(|fit| [fit.value, fit.noise]).collect();
        }
        let corrected = |((record, found), correction): ((&Record, &[Rgb; 2]), &[Rgb; 2])| {
            let own = [record.irradiance(), record.noise()];
            std::array::from_fn(|k| own[k] + (correction[k] - found[k]))
        };
        let corrected: Vec<[Rgb; 2]> =
            self.records.iter().zip(&found).zip(&corrections).map(corrected).collect();
        let fits = self.fits(&tiles, &corrected, (FIT_REACH, usize::MAX));
        for (record, fit) in self.records.iter_mut().zip(fits) {
            record.set_fit(fit);
        }
        for (record, bent) in self.records.iter_mut().zip(bent) {
            record.correction_bent = bent;
        }
    }

    /// For every record the plane through values of it and its neighbours within so many radii, and through
    /// the noise of these; where there are more than so many neighbours, some of them are asked.
    fn fits(
        &self,
        tiles: &RecordTiles<'_>,
        values: &[[Rgb; 2]],
        (reach, most): (f32, usize),
    ) -> Vec<FittedIrradiance> {
        let fit = |(index, record): (usize, &Record)| {
            let mut plane = RecordPlane::new();
            let around = record.weight_function(reach);
            tiles.each_near((index, record), (reach, most), |number| {
                let other = &self.records[number];
                let weight = around.weight(other.point, other.normal);
                if weight > 0.0 {
                    plane.add(record, (other, values[number]), weight * other.rays as f32);
                }
            });
            plane.fit(record, values[index])
        };
        self.records.par_iter().enumerate().with_min_len(16).map(fit).collect()
    }

    /// Indirect irradiance of every fragment by weighted interpolation of the records; `None` where
    /// no record counts.
    pub fn irradiance(&self, visible: &VisibleSurfaces) -> Vec<Option<IndirectLight>> {
        let contribution = |record: &Record| {
            let (value, noise) = (record.value, record.noise);
            let (bent, between) = (record.bent + record.correction_bent, record.between);
            let [a, b, c] = record.slope;
            let [d, e, f] = record.noise_slope;
            // An extrapolated slope could make light negative.
            let (least, most) = (0.5 * value, 2.0 * value);
            let any = f32::INFINITY;
            LocalFit {
                value: [
                    value.x, value.y, value.z, noise.x, noise.y, noise.z, bent.x, bent.y, bent.z,
                ],
                slope: [a, b, c, d, e, f],
                least: [least.x, least.y, least.z, -any, -any, -any],
                most: [most.x, most.y, most.z, any, any, any],
                // Where it stands nothing is interpolated.
                at_home: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -between.x, -between.y, -between.z],
            }
        };
        let mean = |sums: [f32; 9], weight: f32| {
            let mean = |first: usize| Rgb::from_slice(&sums[first..]) / weight;
            (weight > 0.0).then(|| IndirectLight {
                irradiance: mean(0),
                noise: mean(3),
                bent: mean(6).max(Rgb::ZERO),
            })
        };
        let mut lit = splat(visible, &self.records, contribution, mean);
        for (lit, factor) in lit.iter_mut().zip(turned::factors(visible, &self.records)) {
            if let Some(lit) = lit {
                lit.irradiance *= factor;
                lit.noise *= factor;
                lit.bent *= factor * factor;
            }
        }
        lit
    }
}

/// Records by tiles of the picture.
struct RecordTiles<'a> {
    visible: &'a VisibleSurfaces,
    across: u32,
    tiles: Vec<Vec<u32>>,
}

impl<'a> RecordTiles<'a> {
    fn new(visible: &'a VisibleSurfaces, records: &[Record]) -> Self {
        let across = visible.width.div_ceil(TILE);
        let down = visible.height.div_ceil(TILE);
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); (across * down) as usize];
        for (index, record) in records.iter().enumerate() {
            if let Some([x, y]) = visible.frame.pixel(record.point, visible.width, visible.height) {
                tiles[(y / TILE * across + x / TILE) as usize].push(index as u32);
            }
        }
        Self { visible, across, tiles }
    }

    /// Calls `each` with the numbers of the records in the tiles where a record may count for so many radii,
    /// itself among them: all of them, or every n-th where there are more than so many.
    fn each_near(
        &self,
        (index, record): (usize, &Record),
        (reach, most): (f32, usize),
        mut each: impl FnMut(usize),
    ) {
        let Some([x0, x1, y0, y1]) = record.window(self.visible, reach) else { return };
        let rows = y0 / TILE..=(y1.max(1) - 1) / TILE;
        let columns = x0 / TILE..=(x1.max(1) - 1) / TILE;
        let tiles = rows.flat_map(|row| {
            let first = (row * self.across) as usize;
            &self.tiles[first + *columns.start() as usize..=first + *columns.end() as usize]
        });
        let count: usize = tiles.clone().map(Vec::len).sum();
        let every = count.div_ceil(most).max(1);
        for (place, other) in tiles.flatten().enumerate() {
            let other = *other as usize;
            if (place + index).is_multiple_of(every) || other == index {
                each(other);
            }
        }
    }
}

/// Phases of a grid: positions of its pixels, in units of the spacing, within cells of twice the
/// spacing. A finer grid leaves out the phase that the grid before has covered.
fn phases(spacing: u32) -> &'static [[u32; 2]] {
    if spacing == GRID_SPACINGS[0] {
        &[[0, 0], [1, 1], [0, 1], [1, 0]]
    } else {
        &[[1, 1], [0, 1], [1, 0]]
    }
}

/// At most [`MOST_NEW`] of the fragments: every n-th where there are more.
fn thinned(uncovered: Vec<u32>) -> Vec<u32> {
    let every = uncovered.len().div_ceil(MOST_NEW).max(1);
    uncovered.into_iter().step_by(every).collect()
}

/// Indirect irradiance of a fragment.
#[derive(Clone, Copy, Default)]
pub struct IndirectLight {
    /// The irradiance.
    pub irradiance: Rgb,
    /// Half the difference between the irradiances by either half of the gather rays: its square is
    /// the variance of the irradiance by noise.
    pub noise: Rgb,
    /// Variance of the records about the planes fitted through them, beyond their noise.
    pub bent: Rgb,
}

/// Scale of all limits in pixels, so that small pictures have as many records as large ones: the
/// error is relative to the whole picture.
fn picture_scale(visible: &VisibleSurfaces) -> f32 {
    ((visible.width * visible.height) as f32).sqrt() / ORDINARY_SIDE
}

/// The scale at which the smallest radius is as small as neighbouring pixels allow: with a smaller
/// one records would stand alone.
pub fn least_scale(visible: &VisibleSurfaces) -> f32 {
    (LEAST_OWN_PIXELS / (LEAST_PIXELS * picture_scale(visible))).min(1.0)
}

/// Radius of a record, ray units.
fn radius(record: &Record, Spacing { scale, least, even }: Spacing) -> f32 {
    if even {
        return EVEN_PIXELS * record.footprint * scale;
    }
    let pixels = [LEAST_PIXELS, MOST_PIXELS].map(|pixels| pixels * record.footprint);
    let radius = (RADIUS_PER_DISTANCE * record.distance()).clamp(pixels[0], pixels[1]);
    let scale = scale.max(least);
    radius * (scale * record.radius_factor).max(LEAST_BENT_PIXELS / LEAST_OWN_PIXELS * least)
}

#[cfg(test)]
mod tests;
