//! Direct light on every fragment (tier 3): irradiance without occlusion in closed form, times the
//! share of it that shadow rays find unoccluded. There are few rays where they agree, and many
//! where they do not.

use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::{DirectLights, TRIES};
use crate::filter::Plane;
use crate::radiometry::{Rgb, importance};
use crate::random::Stream;
use crate::rays::Segment;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::World;
use crate::transport::hemilux::fragments::{Fragment, VisibleSurfaces};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Shadow rays of every fragment in the first pass, interleaved over tiles of 4 × 4 pixels.
const FIRST_RAYS: u32 = 1;
/// Shadow rays, in each pass, of a fragment where rays disagree.
const MORE_RAYS: u32 = 6;
/// The same in the first pass of a hasty job.
const MORE_RAYS_IN_HASTE: u32 = 2;
/// Shadow rays of every fragment in each pass where the setting `adaptive` is off.
const EVEN_RAYS: u32 = 2;
/// Shadow rays of every fragment in each pass where lights are too many for the closed form.
const MANY_RAYS: u32 = 4;
/// Pixels of a picture of ordinary size, 500 × 500: smaller pictures get up to four times
/// [`MORE_RAYS`].
const ORDINARY_PIXELS: u32 = 250_000;
/// A fragment where rays agree gets another one every so many passes.
const RECHECK_PASSES: u32 = 4;
/// Pixels in each direction whose rays are compared, and shared.
const NEIGHBOUR_REACH: i32 = 2;
/// A fragment with at least so many rays of its own takes none of its neighbours.
const ENOUGH_RAYS: u32 = 2048;
/// A fragment with at least so many rays takes those of adjacent pixels only.
const FEW_RAYS: u32 = 32;
/// Fragments of a parallel task.
const CHUNK: usize = 1024;
/// Shadow rays that are traced together, at least.
const BATCH: usize = 512;
/// Factor by which well-spread points are taken to lower the variance of random ones where lights
/// are too many for the closed form.
const WELL_SPREAD_FACTOR: f32 = 0.5;
/// Factor by which neighbours are taken to lower the variance where they are too few to measure it.
const NEIGHBOUR_VARIANCE_FACTOR: f32 = 0.15;
/// Squared difference between a neighbour's share of blocked rays and the fragment's own, in units
/// of its variance by chance, up to which the neighbour counts in full: 2.4 standard deviations.
const ALIKE_VARIANCES: f32 = 6.0;
/// The same from which it does not count, since a shadow's edge is in between: 4.9 standard
/// deviations.
const UNLIKE_VARIANCES: f32 = 24.0;
/// Shares of blocked light of two rays that differ by less count as the same: panes take a little
/// more of light that crosses them at another angle.
const SAME_SHARE: f32 = 0.02;

/// Bound on rays of a fragment read from a checkpoint: more than any run casts, so a larger number
/// means damage.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// [`ShadowSums`] as checkpoints store them: without the closed form, which is computed again. The
/// order of the fields is part of the format.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct StoredShadowSums {
    seen: Rgb,
    cast: Rgb,
    squares: f32,
    rays: u32,
    blocked: f32,
    first: f32,
    disputed: u32,
}

/// Sums over the shadow rays of a fragment. Where lights are too many for the closed form
/// ([`DirectLights::is_exact`]) the light points' irradiances are a Monte-Carlo estimate
/// themselves.
#[derive(Clone, Copy, Default)]
pub struct ShadowSums {
    /// Irradiance without occlusion in closed form; zero where lights are too many for that.
    unoccluded: Rgb,
    /// Σ irradiance that the unoccluded light points stand for.
    seen: Rgb,
    /// Σ irradiance that all light points stand for.
    cast: Rgb,
    /// Σ squared importance of the irradiance seen, where lights are too many for the closed form.
    squares: f32,
    /// Rays so far.
    rays: u32,
    /// Σ share of the light of each ray that something kept from arriving.
    blocked: f32,
    /// That share of the first ray; negative before that.
    first: f32,
    /// Whether that of another ray was another.
    mixed: bool,
    /// Whether rays here or in the neighbourhood disagreed when they were last compared.
    disputed: bool,
}

/// Direct light on all fragments of a picture.
pub struct DirectLighting {
    sums: Vec<ShadowSums>,
    /// Rays of a disputed fragment: in the first pass, and in each later one.
    more_rays: [u32; 2],
    /// Whether more rays go where they disagree, by the setting of that name.
    adaptive: bool,
    passes: u32,
    /// Shadow rays so far.
    pub rays: u64,
}

impl DirectLighting {
    /// Direct light without shadow rays yet; `hasty` if the first pass had better be short.
    pub fn new(
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        adaptive: bool,
        hasty: bool,
    ) -> Self {
        let unoccluded = |fragment: &Fragment| ShadowSums {
            unoccluded: lights.unoccluded(fragment.point, fragment.shading_normal).irradiance,
            first: -1.0,
            ..ShadowSums::default()
        };
        let sums = visible.fragments.par_iter().with_min_len(CHUNK).map(unoccluded).collect();
        // In small pictures neighbours are far apart, and rays are cheap.
        let generous = (ORDINARY_PIXELS / (visible.width * visible.height)).clamp(1, 4);
        let more_rays = MORE_RAYS * generous;
        let at_first = if hasty { MORE_RAYS_IN_HASTE } else { more_rays };
        Self { sums, more_rays: [at_first, more_rays], adaptive, passes: 0, rays: 0 }
    }

    /// Writes what the shadow rays found.
    pub fn save(&self, to: &mut Writer) {
        let stored = self.sums.iter().map(|sums| StoredShadowSums {
            seen: sums.seen,
            cast: sums.cast,
            squares: sums.squares,
            rays: sums.rays,
            blocked: sums.blocked,
            first: sums.first,
            disputed: u32::from(sums.disputed) | u32::from(sums.mixed) << 1,
        });
        to.value(self.passes);
        to.value(self.rays);
        to.slice(&stored.collect::<Vec<_>>());
    }

    /// Reads what [`DirectLighting::save`] wrote of the same fragments.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.rays = from.value()?;
        let stored: Vec<StoredShadowSums> = from.exactly(self.sums.len())?;
        if stored.iter().any(|stored| stored.rays > MOST_RAYS_OF_ALL || !stored.blocked.is_finite())
        {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        for (sums, stored) in self.sums.iter_mut().zip(stored) {
            (sums.seen, sums.cast, sums.squares) = (stored.seen, stored.cast, stored.squares);
            (sums.rays, sums.blocked, sums.first) = (stored.rays, stored.blocked, stored.first);
            (sums.disputed, sums.mixed) = (stored.disputed & 1 != 0, stored.disputed & 2 != 0);
        }
        Ok(())
    }

    /// Casts another pass of rays.
    pub fn pass(
        &mut self,
        world: &World,
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        seed: Seed,
    ) {
        let caster = Caster { world, lights, visible, seed };
        if !self.adaptive || !lights.is_exact() {
            let rays = if lights.is_exact() { EVEN_RAYS } else { MANY_RAYS };
            self.sums.iter_mut().for_each(|sums| sums.disputed = true);
            self.cast(&caster, |_, _| rays);
        } else if self.passes == 0 {
            self.cast(&caster, |_, _| FIRST_RAYS);
            self.mark_disputed(visible);
            let more = self.more_rays[0];
            self.cast(&caster, |_, sums| if sums.disputed { more } else { 0 });
        } else {
            self.mark_disputed(visible);
            let (passes, more) = (self.passes, self.more_rays[1]);
            self.cast(&caster, |fragment, sums| {
                let is_rechecked = (fragment.pixel + passes).is_multiple_of(RECHECK_PASSES);
                if sums.disputed { more } else { u32::from(is_rechecked) }
            });
        }
        self.passes += 1;
    }

    /// Casts as many shadow rays from each fragment as `count` says.
    fn cast(&mut self, caster: &Caster<'_>, count: impl Fn(&Fragment, &ShadowSums) -> u32 + Sync) {
        let fragments = &caster.visible.fragments;
        let chunks = self.sums.par_chunks_mut(CHUNK).zip(fragments.par_chunks(CHUNK));
        let rays: u64 = chunks
            .map(|(sums, fragments)| {
                let (mut rays, mut batch) = (0, Batch::default());
                for (index, fragment) in fragments.iter().enumerate() {
                    let count = count(fragment, &sums[index]);
                    let dark = caster.lights.is_exact() && sums[index].unoccluded == Rgb::ZERO;
                    if count > 0 && !dark {
                        caster.aim(index, &mut sums[index], fragment, count, &mut batch);
                        rays += u64::from(count);
                    }
                    if batch.segments.len() >= BATCH {
                        batch.trace(caster, sums);
                    }
                }
                batch.trace(caster, sums);
                rays
            })
            .sum();
        self.rays += rays;
    }

    /// Marks the fragments whose own or neighbouring rays disagree.
    fn mark_disputed(&mut self, visible: &VisibleSurfaces) {
        let sums = &self.sums;
        let disputed: Vec<bool> = (0..sums.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|index| {
                let mine = &sums[index];
                if mine.is_disputed() {
                    return true;
                }
                if mine.rays == 0 {
                    return false;
                }
                let mut disagrees = false;
                around(visible, index, NEIGHBOUR_REACH, |other, _, _| {
                    let other = &sums[other];
                    let off = other.blocked_share() - mine.blocked_share();
                    disagrees |= other.rays > 0 && off.abs() > SAME_SHARE;
                });
                disagrees
            })
            .collect();
        self.sums.iter_mut().zip(disputed).for_each(|(sums, disputed)| sums.disputed = disputed);
    }

    /// Direct irradiance of a fragment and its estimated variance; where its own rays are few, with
    /// the help of its neighbours' if `filtered`: what a plane through the shares around says of
    /// it, where chance lets them be the same, and how far they are off that plane.
    pub fn irradiance(
        &self,
        lights: &DirectLights,
        visible: &VisibleSurfaces,
        index: usize,
        filtered: bool,
    ) -> (Rgb, Rgb) {
        let sums = &self.sums[index];
        if sums.rays == 0 {
            return (Rgb::ZERO, Rgb::ZERO);
        }
        let exact = lights.is_exact();
        let factor = if exact { sums.unoccluded } else { Rgb::ONE };
        let share = sums.share(exact);
        if !(filtered && sums.is_disputed() && sums.rays < ENOUGH_RAYS) {
            return (factor * share, self.own_variance(sums, exact));
        }
        let reach = if sums.rays < FEW_RAYS { NEIGHBOUR_REACH } else { 1 };
        let mut plane = Plane::new();
        plane.add(0, 0, share, sums.rays as f32);
        around(visible, index, reach, |other, across, down| {
            let other = &self.sums[other];
            let weight = 1.0 / (1.0 + (across * across + down * down) as f32 * 0.5);
            if other.rays > 0 {
                let alike = if exact { sums.alike(other) } else { 1.0 };
                plane.add(across, down, other.share(exact), other.rays as f32 * weight * alike);
            }
        });
        let (share, variance) = plane.center();
        let variance = variance.map_or_else(
            || self.own_variance(sums, exact) * NEIGHBOUR_VARIANCE_FACTOR,
            |variance| factor * factor * variance,
        );
        (factor * share, variance)
    }

    /// Estimated variance of the irradiance by the rays of the fragment alone.
    fn own_variance(&self, sums: &ShadowSums, exact: bool) -> Rgb {
        if !exact {
            let (mean, all) = (sums.seen / sums.rays.max(1) as f32, importance(sums.seen));
            if sums.rays < 2 || all <= 0.0 {
                return mean * mean;
            }
            let scatter = sums.squares * sums.rays as f32 / (all * all) - 1.0;
            return mean * mean * (scatter.max(0.0) / (sums.rays - 1) as f32 * WELL_SPREAD_FACTOR);
        }
        if !sums.mixed {
            return Rgb::ZERO;
        }
        let share = sums.blocked_share();
        // Well-spread points do better than random ones: the variance falls by about n^−1.5.
        let variance = share * (1.0 - share) / (sums.rays as f32).powf(1.5);
        sums.unoccluded * sums.unoccluded * variance
    }
}

impl ShadowSums {
    /// Share of the direct light that arrives, `seen / cast`; where lights are too many for the
    /// closed form, the estimated irradiance.
    fn share(&self, exact: bool) -> Rgb {
        if !exact {
            return self.seen / self.rays as f32;
        }
        Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO)
    }

    /// Whether rays here or around disagreed when they were last compared, or do so here since.
    fn is_disputed(&self) -> bool {
        self.disputed || self.mixed
    }

    /// Weight of a neighbour, 0 to 1, by how likely chance alone explains the difference between
    /// the two shares of blocked rays.
    fn alike(&self, other: &ShadowSums) -> f32 {
        let off = self.blocked_share() - other.blocked_share();
        let chance = self.chance() + other.chance();
        ((UNLIKE_VARIANCES - off * off / chance) / (UNLIKE_VARIANCES - ALIKE_VARIANCES))
            .clamp(0.0, 1.0)
    }

    fn blocked_share(&self) -> f32 {
        self.blocked / self.rays.max(1) as f32
    }

    /// Variance of the share of blocked rays; where all agree, as if one half of a ray did not.
    fn chance(&self) -> f32 {
        let share = (self.blocked + 0.5) / (self.rays + 1) as f32;
        share * (1.0 - share) / self.rays.max(1) as f32
    }

    /// Adds what a shadow ray found; `irradiance` is what its light point stands for.
    fn add_ray(&mut self, irradiance: Rgb, visibility: Rgb, exact: bool) {
        let blocked = 1.0 - importance(visibility);
        if self.first < 0.0 {
            self.first = blocked;
        }
        self.mixed |= (blocked - self.first).abs() > SAME_SHARE;
        self.blocked += blocked;
        self.seen += irradiance * visibility;
        if !exact {
            self.squares += importance(irradiance * visibility).powi(2);
        }
    }
}

/// What shadow rays are cast with.
struct Caster<'a> {
    world: &'a World,
    lights: &'a DirectLights,
    visible: &'a VisibleSurfaces,
    seed: Seed,
}

/// A batch of shadow rays that are traced together.
#[derive(Default)]
struct Batch {
    segments: Vec<Segment>,
    /// Of each ray, its fragment's index in the chunk, and the irradiance that its light point
    /// stands for.
    ends: Vec<(usize, Rgb)>,
    visible: Vec<Rgb>,
}

impl Caster<'_> {
    /// Picks light points for `count` more rays of a fragment and adds the rays to a batch.
    fn aim(
        &self,
        index: usize,
        sums: &mut ShadowSums,
        fragment: &Fragment,
        count: u32,
        to: &mut Batch,
    ) {
        let Self { lights, visible, .. } = self;
        let (x, y) = (fragment.pixel % visible.width, fragment.pixel / visible.width);
        let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
        let place = BAYER[(y % 4 * 4 + x % 4) as usize];
        let sequence = Shifted::new(self.seed, Stream::Light, tile);
        // Lights are picked by what they shine on the fragment's mean place, for all its points.
        let unoccluded = lights.unoccluded(fragment.point, fragment.shading_normal);
        for _ in 0..count {
            let from = visible.sample_point(fragment, sums.rays);
            let xi = |number: u32| sequence.at(number * 16 + place).triple();
            if !lights.is_exact() {
                let xi = xi(sums.rays);
                sums.rays += 1;
                if let Some((end, irradiance)) =
                    lights.one_of_many(from, fragment.shading_normal, xi)
                {
                    to.add(Segment { from, to: end }, index, irradiance);
                }
                continue;
            }
            let sample = |tries: u32| {
                let xi = xi(sums.rays * TRIES + tries);
                lights.sample(&unoccluded, from, fragment.shading_normal, xi)
            };
            // Where the horizon cuts a light, the ratio of seen to cast asks for points above it.
            let light = (0..TRIES).find_map(sample);
            sums.rays += 1;
            let Some(light) = light else { continue };
            sums.cast += light.irradiance;
            to.add(Segment { from, to: light.end }, index, light.irradiance);
        }
    }
}

impl Batch {
    fn add(&mut self, segment: Segment, index: usize, irradiance: Rgb) {
        self.segments.push(segment);
        self.ends.push((index, irradiance));
    }

    /// Traces the rays, adds what they found to the fragments' sums and empties the batch.
    fn trace(&mut self, caster: &Caster<'_>, sums: &mut [ShadowSums]) {
        caster.world.visibility_many(&self.segments, &mut self.visible);
        for ((index, irradiance), visibility) in self.ends.iter().zip(&self.visible) {
            sums[*index].add_ray(*irradiance, *visibility, caster.lights.is_exact());
        }
        self.segments.clear();
        self.ends.clear();
    }
}

/// Calls `each` with the fragments of neighbouring pixels that lie in the plane of fragment
/// `index`, and how many pixels they are to the right and down.
fn around(
    visible: &VisibleSurfaces,
    index: usize,
    reach: i32,
    mut each: impl FnMut(usize, i32, i32),
) {
    let mine = &visible.fragments[index];
    let (x, y) = ((mine.pixel % visible.width) as i32, (mine.pixel / visible.width) as i32);
    let (width, height) = (visible.width as i32, visible.height as i32);
    let flat = visible.frame.footprint(mine.point, visible.height);
    for row in (y - reach).max(0)..=(y + reach).min(height - 1) {
        for column in (x - reach).max(0)..=(x + reach).min(width - 1) {
            let pixel = (row * width + column) as usize;
            if pixel == mine.pixel as usize {
                continue;
            }
            for other in visible.start[pixel] as usize..visible.start[pixel + 1] as usize {
                let theirs = &visible.fragments[other];
                if theirs.normal.dot(mine.normal) > 0.98
                    && mine.normal.dot(theirs.point - mine.point).abs() < flat
                {
                    each(other, column - x, row - y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen, is_near};
    use std::f32::consts::PI;

    /// In a furnace nothing is in between: E = π L^e without noise, by any number of rays. (In its
    /// edges rounding may hide one wall from a ray along the other.)
    #[test]
    fn light_without_shadows_has_no_noise() {
        let specimen = Specimen::furnace();
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        for _ in 0..2 {
            direct.pass(&specimen.world, &specimen.lights, &visible, SEED);
            let light = |index| direct.irradiance(&specimen.lights, &visible, index, false);
            let all = (0..visible.fragments.len()).map(light);
            let off = all.filter(|(light, variance)| {
                !is_near(*light, PI * EMISSION, 0.005) || *variance != Rgb::ZERO
            });
            let off = off.count();
            assert!(50 * off <= visible.fragments.len(), "{off} of {}", visible.fragments.len());
        }
        assert!(direct.rays > 0);
    }

    #[test]
    fn what_rays_found_comes_back() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 300);
        let visible = specimen.visible();
        let mut direct = DirectLighting::new(&specimen.lights, &visible, true, false);
        direct.pass(&specimen.world, &specimen.lights, &visible, SEED);
        let mut to = Writer::new(u64::MAX);
        direct.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let mut again = DirectLighting::new(&specimen.lights, &visible, true, false);
        again.restore(&mut Reader::new(&bytes)).expect("sound");
        for index in 0..visible.fragments.len() {
            let [one, other] = [&direct, &again]
                .map(|direct| direct.irradiance(&specimen.lights, &visible, index, true));
            assert_eq!(one, other);
        }
        let mut damaged = DirectLighting::new(&specimen.lights, &visible, true, false);
        damaged.sums.pop();
        assert!(damaged.restore(&mut Reader::new(&bytes)).is_err(), "of other fragments");
    }
}
