//! Tier 2's records: where they stand, and the smooth function that they are together.
//!
//! Records are placed where the picture needs them, coarsely first, and live in world space: a
//! second camera finds those of the first. A record counts within a radius that follows how near
//! other surfaces are (Ward, Rubinstein, Clear 1988), and not behind what stands on its horizon.

use super::kept_record;
use super::record::Record;
use super::splat::{LocalFit, splat};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use crate::sampling::Seed;
use crate::surface::World;
use crate::transport::hemilux::coarse::Coarse;
use crate::transport::hemilux::fragments::Seen;
use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Most records that get more rays at a time.
const REFINED: usize = 6000;
/// Most records that are made at a time; where that leaves a fragment uncovered, in foliage say,
/// it shows the coarse solution.
const MOST_NEW: usize = 16_384;
/// Distances in pixels between the places that are looked at, one after the other.
const SPACINGS: [u32; 5] = [16, 8, 4, 2, 1];
/// A place where the weights add up to less is not covered.
const COVERED: f32 = 0.6;
/// The same at the last: what is left over is filled only where there is next to nothing.
const NEARLY_NOTHING: f32 = 0.02;
/// Side of the picture that limits in pixels are for.
const SIDE: f32 = 500.0;
/// Rays of the first records, before it is known how many are worth their time.
const LOOK_RAYS: u32 = 16;
/// The noise of a record beside the light of the picture up to which fewer rays do; and in haste.
const NOISE: [f32; 2] = [0.07, 0.11];
/// Radius of a record in harmonic mean distances, and its limits in pixels.
const RADIUS: f32 = 0.35;
const LEAST_PIXELS: f32 = 6.0;
const MOST_PIXELS: f32 = 20.0;
/// Smallest radius in pixels of the picture itself.
const LEAST_OWN_PIXELS: f32 = 1.5;
/// Radius in pixels where it does not follow what is near.
const EVEN_PIXELS: f32 = 14.0;
/// Factors of the radii of records that are off the planes through them by more than so many times
/// the mean square.
const TIGHTER: [(f32, f32); 3] = [(10.0, 0.3), (2.0, 0.5), (0.0, 0.95)];
/// How much farther neighbours are heard than they are shown.
const HEARD: f32 = 1.8;
/// Pixels along a tile of the index of records.
const TILE: u32 = 16;

/// All records.
#[derive(Default)]
pub struct Cache {
    records: Vec<Record>,
    /// Records that another camera's picture had made.
    pub reused: usize,
    /// Random sequences that records have taken.
    sequences: u32,
    /// Per fragment, the sum of the weights of all records.
    coverage: Vec<f32>,
}

/// How records are made.
#[derive(Clone, Copy)]
pub struct Gathering {
    /// Seed of their random numbers.
    pub seed: Seed,
    /// Rays that every record gets.
    pub rays: u32,
    /// Rays of a new record.
    pub new_rays: u32,
    /// Whether direct light is found out afresh where they end.
    pub afresh: bool,
    /// What the radii follow.
    pub spacing: Spacing,
}

/// A first look at the light of a picture.
#[derive(Clone, Copy)]
pub struct FirstLook<'a> {
    /// Whether it had better be soon than good.
    pub hasty: bool,
    /// Direct irradiance of a fragment.
    pub direct: &'a dyn Fn(usize) -> Rgb,
}

/// What new records are made with.
struct Making<'a> {
    world: &'a World,
    coarse: &'a Coarse,
    seen: &'a Seen,
    gathering: Gathering,
    /// How tight they have to be, per fragment; empty where nothing is known of that.
    tight: &'a [f32],
    /// Times the footprint of a pixel.
    scaling: f32,
}

/// What the radii of records follow.
#[derive(Clone, Copy)]
pub struct Spacing {
    /// Factor of all radii.
    pub scale: f32,
    /// The same at least, where it is multiplied by how tight a record is.
    pub least: f32,
    /// Whether all are the same in the picture, rather than following what is near.
    pub even: bool,
}

impl Cache {
    /// Writes the records.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.sequences);
        kept_record::save(&self.records, to);
    }

    /// Takes what [`Cache::save`] wrote.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.sequences = from.value()?;
        self.records = kept_record::restore(from)?;
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
    /// where there are many.
    pub fn refine(
        &mut self,
        world: &World,
        coarse: &Coarse,
        gathering: Gathering,
        enough: u32,
        turn: usize,
    ) {
        let mut wanted: Vec<&mut Record> =
            self.records.iter_mut().filter(|record| record.rays < enough).collect();
        let every = wanted.len().div_ceil(REFINED).max(1);
        let records = wanted.par_iter_mut().enumerate().with_max_len(16);
        records.filter(|(index, _)| (index + turn).is_multiple_of(every)).for_each(
            |(_, record)| {
                record.gather(world, coarse, gathering.seed, gathering.rays, gathering.afresh);
            },
        );
    }

    /// Adds records until every fragment is covered, each with as many rays as asked for, or, at the
    /// first look, as many as the noise of the first of them asks for; returns how many.
    pub fn fill(
        &mut self,
        world: &World,
        coarse: &Coarse,
        seen: &Seen,
        gathering: Gathering,
        look: Option<FirstLook<'_>>,
    ) -> u32 {
        let most = gathering.new_rays;
        let first_rays = if look.is_some() { LOOK_RAYS.min(most) } else { most };
        let mut rays = first_rays;
        let tight = self.tighten(seen);
        for record in &mut self.records {
            record.radius = radius(record, gathering.spacing);
        }
        self.coverage = vec![0.0; seen.fragments.len()];
        self.cover(seen, 0);
        let making =
            Making { world, coarse, seen, gathering, tight: &tight, scaling: scaling(seen) };
        for spacing in SPACINGS {
            let look = look.filter(|_| spacing == SPACINGS[0]);
            let mut direct = Rgb::ZERO;
            for phase in phases(spacing) {
                let wanted = thinned(self.wanted(seen, spacing, *phase));
                if let Some(look) = look {
                    direct +=
                        wanted.iter().map(|place| (look.direct)(*place as usize)).sum::<Rgb>();
                }
                self.make(&making, wanted, rays);
            }
            if let Some(look) = look {
                let allowed = NOISE[usize::from(look.hasty)];
                rays = self.worth(direct, allowed).clamp(first_rays, most);
                self.gather_more(&making, rays - first_rays);
            }
        }
        rays
    }

    /// Fragments in the pixels of a grid that are covered too little.
    fn wanted(&self, seen: &Seen, spacing: u32, [across, down]: [u32; 2]) -> Vec<u32> {
        let least = if spacing == 1 { NEARLY_NOTHING } else { COVERED };
        let double = 2 * spacing as usize;
        let mut wanted = Vec::new();
        for row in (down * spacing..seen.height).step_by(double) {
            for column in (across * spacing..seen.width).step_by(double) {
                let pixel = (row * seen.width + column) as usize;
                let range = seen.start[pixel]..seen.start[pixel + 1];
                wanted.extend(range.filter(|f| self.coverage[*f as usize] < least));
            }
        }
        wanted
    }

    /// Adds records on these fragments, each with so many rays.
    fn make(&mut self, making: &Making<'_>, wanted: Vec<u32>, rays: u32) {
        let Making { world, coarse, seen, gathering, tight, scaling } = *making;
        let first = self.records.len();
        let sequences = self.sequences;
        let new: Vec<Record> = wanted
            .into_par_iter()
            .enumerate()
            .with_max_len(16)
            .map(|(index, place)| {
                let fragment = &seen.fragments[place as usize];
                let footprint = scaling * seen.frame.footprint(fragment.point, seen.height);
                let number = sequences.wrapping_add(index as u32);
                let point = seen.middle_point(fragment);
                let mut record = Record::new(point, fragment.normal, footprint, number);
                record.gather(world, coarse, gathering.seed, rays, gathering.afresh);
                record.tight = tight.get(place as usize).copied().unwrap_or(1.0);
                record.radius = radius(&record, gathering.spacing);
                record
            })
            .collect();
        self.sequences = sequences.wrapping_add(new.len() as u32);
        self.records.extend(new);
        self.cover(seen, first);
    }

    /// Traces more rays of all records, whose radii then follow what these found.
    fn gather_more(&mut self, making: &Making<'_>, rays: u32) {
        let Making { world, coarse, seen, gathering, .. } = *making;
        self.records.par_iter_mut().with_max_len(16).for_each(|record| {
            record.gather(world, coarse, gathering.seed, rays, gathering.afresh);
            record.radius = radius(record, gathering.spacing);
        });
        self.coverage.fill(0.0);
        self.cover(seen, 0);
    }

    /// Rays of a record with which noise is as large as `allowed` beside all light, of which
    /// `all_direct` is what is direct at the records.
    fn worth(&self, all_direct: Rgb, allowed: f32) -> u32 {
        let (mut light, mut noise) = (all_direct.element_sum(), 0.0);
        for record in &self.records {
            light += record.irradiance().element_sum();
            noise += (record.noise() * record.noise()).element_sum() * record.rays as f32;
        }
        let mean = (light / (3.0 * self.records.len() as f32)).max(f32::MIN_POSITIVE);
        // Variance of a single ray.
        let noise = noise / (3.0 * self.records.len() as f32);
        (noise / (allowed * mean).powi(2) / 8.0).ceil().min(1e6) as u32 * 8
    }

    /// Tightens the records that are off the planes through them by more than most; returns how
    /// tight new records have to be, per fragment.
    fn tighten(&mut self, seen: &Seen) -> Vec<f32> {
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
            let tighter = TIGHTER.iter().find(|(times, _)| bent > times * mean);
            record.tight *= tighter.map_or(1.0, |(_, factor)| *factor);
        }
        splat(
            seen,
            &self.records,
            |record| LocalFit::even([record.tight]),
            |[tight], weight| if weight > 0.0 { tight / weight } else { 1.0 },
        )
    }

    /// Goes over to another camera: of the records, those stay that count for anything it sees.
    pub fn turn(&mut self, seen: &Seen, spacing: Spacing) {
        let scaling = scaling(seen);
        let counts = |record: &mut Record| {
            record.footprint = scaling * seen.frame.footprint(record.point, seen.height);
            record.radius = radius(record, spacing);
            let around = record.reach(1.0);
            let Some([x0, x1, y0, y1]) = record.window(seen, 1.0) else { return false };
            (y0..y1).any(|row| {
                let first = seen.start[(row * seen.width + x0) as usize] as usize;
                let last = seen.start[(row * seen.width + x1) as usize] as usize;
                let fragments = &mut seen.fragments[first..last].iter();
                fragments.any(|other| around.weight(other.point, other.normal) > 0.0)
            })
        };
        let all = std::mem::take(&mut self.records).into_par_iter().with_min_len(64);
        self.records = all.filter_map(|mut one| counts(&mut one).then_some(one)).collect();
        self.reused = self.records.len();
    }

    /// Adds the weights of the records from `first` on to the coverage.
    fn cover(&mut self, seen: &Seen, first: usize) {
        let added =
            splat(seen, &self.records[first..], |_| LocalFit::even([]), |[], weight: f32| weight);
        for (sum, more) in self.coverage.iter_mut().zip(added) {
            *sum += more;
        }
    }

    /// Lets every record hear its neighbours: a plane through their irradiances, weighted by how
    /// much they count here, says what its own is and how it changes.
    pub fn smooth(&mut self, seen: &Seen, fit: bool) {
        if !fit {
            for record in &mut self.records {
                record.take(Fit::alone(record));
            }
            return;
        }
        let across = seen.width.div_ceil(TILE);
        let down = seen.height.div_ceil(TILE);
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); (across * down) as usize];
        for (index, record) in self.records.iter().enumerate() {
            if let Some([x, y]) = seen.frame.pixel(record.point, seen.width, seen.height) {
                tiles[(y / TILE * across + x / TILE) as usize].push(index as u32);
            }
        }
        let records = &self.records;
        let fits: Vec<Fit> = records
            .par_iter()
            .with_min_len(16)
            .map(|record| {
                let around = record.reach(HEARD);
                let Some([x0, x1, y0, y1]) = record.window(seen, HEARD) else {
                    return Plane::new().fit(record);
                };
                let mut plane = Plane::new();
                for row in y0 / TILE..=(y1.max(1) - 1) / TILE {
                    for column in x0 / TILE..=(x1.max(1) - 1) / TILE {
                        for other in &tiles[(row * across + column) as usize] {
                            let other = &records[*other as usize];
                            let weight = around.weight(other.point, other.normal);
                            if weight > 0.0 {
                                plane.add(record, other, weight * other.rays as f32);
                            }
                        }
                    }
                }
                plane.fit(record)
            })
            .collect();
        for (record, fit) in self.records.iter_mut().zip(fits) {
            record.take(fit);
        }
    }

    /// Indirect irradiance of every fragment; `None` where no record counts.
    pub fn irradiance(&self, seen: &Seen) -> Vec<Option<Bounced>> {
        let said = |record: &Record| {
            let (value, noise, bent) = (record.value, record.noise, record.bent);
            let [a, b, c] = record.slope;
            let [d, e, f] = record.noise_slope;
            // A slope is a guess: it must not turn light into darkness.
            let (least, most) = (0.5 * value, 2.0 * value);
            let any = f32::INFINITY;
            LocalFit {
                value: [
                    value.x, value.y, value.z, noise.x, noise.y, noise.z, bent.x, bent.y, bent.z,
                ],
                slope: [a, b, c, d, e, f],
                least: [least.x, least.y, least.z, -any, -any, -any],
                most: [most.x, most.y, most.z, any, any, any],
            }
        };
        let mean = |sums: [f32; 9], weight: f32| {
            let mean = |first: usize| Rgb::from_slice(&sums[first..]) / weight;
            (weight > 0.0).then(|| Bounced { irradiance: mean(0), noise: mean(3), bent: mean(6) })
        };
        splat(seen, &self.records, said, mean)
    }
}

/// Where the pixels of a grid lie within cells of twice its spacing: those of the grid before need
/// no second look.
fn phases(spacing: u32) -> &'static [[u32; 2]] {
    if spacing == SPACINGS[0] {
        &[[0, 0], [1, 1], [0, 1], [1, 0]]
    } else {
        &[[1, 1], [0, 1], [1, 0]]
    }
}

/// Every n-th of more than [`MOST_NEW`].
fn thinned(wanted: Vec<u32>) -> Vec<u32> {
    let every = wanted.len().div_ceil(MOST_NEW).max(1);
    wanted.into_iter().step_by(every).collect()
}

/// Indirect irradiance of a fragment.
#[derive(Clone, Copy, Default)]
pub struct Bounced {
    /// The irradiance.
    pub irradiance: Rgb,
    /// Half the difference that either half of all rays makes to it.
    pub noise: Rgb,
    /// Variance of the records about the planes through them that is not noise.
    pub bent: Rgb,
}

/// Small pictures want as many records as large ones: their error is a share of the whole.
fn scaling(seen: &Seen) -> f32 {
    ((seen.width * seen.height) as f32).sqrt() / SIDE
}

/// The scale at which the smallest radius is as small as neighbouring pixels allow: with a smaller
/// one records would stand alone.
pub fn least_scale(seen: &Seen) -> f32 {
    (LEAST_OWN_PIXELS / (LEAST_PIXELS * scaling(seen))).min(1.0)
}

fn radius(record: &Record, Spacing { scale, least, even }: Spacing) -> f32 {
    if even {
        return EVEN_PIXELS * record.footprint * scale;
    }
    let pixels = [LEAST_PIXELS, MOST_PIXELS].map(|pixels| pixels * record.footprint);
    let radius = (RADIUS * record.distance()).clamp(pixels[0], pixels[1]);
    radius * (scale * record.tight).max(least)
}

/// What a plane says of a record.
struct Fit {
    value: Rgb,
    slope: [Vec3; 3],
    noise: Rgb,
    noise_slope: [Vec3; 3],
    bent: Rgb,
}

impl Fit {
    /// Of a record without neighbours.
    fn alone(record: &Record) -> Self {
        let (value, noise) = (record.irradiance(), record.noise());
        Self { value, slope: [Vec3::ZERO; 3], noise, noise_slope: [Vec3::ZERO; 3], bent: Rgb::ZERO }
    }
}

impl Record {
    fn take(&mut self, fit: Fit) {
        (self.value, self.slope) = (fit.value, fit.slope);
        (self.noise, self.noise_slope) = (fit.noise, fit.noise_slope);
        self.bent = fit.bent;
    }
}

/// Sums of a least-squares plane.
struct Plane {
    /// Σ w (1, x, y)ᵀ(1, x, y).
    matrix: Mat3,
    /// Σ w (1, x, y)ᵀ E, per channel.
    right: Mat3,
    /// The same of the noise.
    noise: Mat3,
    squares: f32,
    /// Σ w E².
    energy: Rgb,
    /// Σ w noise².
    noise_energy: Rgb,
    /// Least and largest irradiance heard.
    range: Option<(Rgb, Rgb)>,
}

impl Plane {
    /// Of nothing. (A matrix is one by default.)
    fn new() -> Self {
        Self {
            matrix: Mat3::ZERO,
            right: Mat3::ZERO,
            noise: Mat3::ZERO,
            squares: 0.0,
            energy: Rgb::ZERO,
            noise_energy: Rgb::ZERO,
            range: None,
        }
    }

    fn add(&mut self, center: &Record, other: &Record, weight: f32) {
        let between = (other.point - center.point) / center.radius;
        let [tangent, bitangent] = center.tangents;
        let at = Vec3::new(1.0, between.dot(tangent), between.dot(bitangent));
        let (e, noise) = (other.irradiance(), other.noise());
        let (least, most) = self.range.unwrap_or((e, e));
        self.range = Some((least.min(e), most.max(e)));
        let weighted = at * weight;
        self.matrix += Mat3::from_cols(weighted * at.x, weighted * at.y, weighted * at.z);
        self.right += Mat3::from_cols(weighted * e.x, weighted * e.y, weighted * e.z);
        self.noise += Mat3::from_cols(weighted * noise.x, weighted * noise.y, weighted * noise.z);
        self.energy += e * e * weight;
        self.noise_energy += noise * noise * weight;
        self.squares += weight * weight;
    }

    fn fit(mut self, record: &Record) -> Fit {
        let total = self.matrix.x_axis.x;
        // Effective number of records.
        let count = total * total / self.squares.max(f32::MIN_POSITIVE);
        if total.is_nan() || total <= 0.0 || count < 3.0 {
            return Fit::alone(record);
        }
        let ridge = 0.01 * total;
        self.matrix.y_axis.y += ridge;
        self.matrix.z_axis.z += ridge;
        let inverse = self.matrix.inverse();
        if !inverse.is_finite() {
            return Fit::alone(record);
        }
        let [tangent, bitangent] = record.tangents;
        let along = |channel: Vec3| (tangent * channel.y + bitangent * channel.z) / record.radius;
        let solved = inverse * self.right;
        let channels = [solved.x_axis, solved.y_axis, solved.z_axis];
        // Neither value nor slope may leave what was heard.
        let (least, most) = self.range.unwrap_or_default();
        let value = Rgb::from_array(channels.map(|c| c.x)).clamp(least, most);
        let range = (most - least) / record.radius;
        let slope = std::array::from_fn(|k| along(channels[k]).clamp_length_max(range[k]));
        let noise = inverse * self.noise;
        let noise = [noise.x_axis, noise.y_axis, noise.z_axis];
        // Σ w (E − plane)², by the normal equations; the plane takes three of the records.
        let explained =
            Rgb::from_array(std::array::from_fn(|k| channels[k].dot(self.right.col(k))));
        let scatter = (self.energy - explained) / total * (count / (count - 2.0).max(1.0));
        let bent = (scatter - self.noise_energy / total).max(Rgb::ZERO);
        Fit {
            value,
            slope,
            noise: Rgb::from_array(noise.map(|c| c.x)),
            noise_slope: noise.map(along),
            bent,
        }
    }
}
