//! Tier 3, light: the emitters' own light on every fragment, exact but for what stands in between;
//! that is found out by shadow rays, few where they agree, many where they don't.

use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::emitters::{PolygonLights, TRIES};
use crate::filter::Plane;
use crate::radiometry::{Rgb, importance};
use crate::random::Stream;
use crate::rays::Segment;
use crate::sampling::{BAYER, Seed, Shifted};
use crate::surface::World;
use crate::transport::hemilux::fragments::{Fragment, Seen};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

/// Rays of every fragment at first, interleaved over tiles of 4 × 4 pixels.
const FIRST_RAYS: u32 = 1;
/// Rays of fragments where rays disagree, each pass.
const MORE_RAYS: u32 = 6;
/// The same in the first pass, in haste.
const MORE_RAYS_IN_HASTE: u32 = 2;
/// Rays of every fragment, each pass, where it does not matter whether they agree.
const EVEN_RAYS: u32 = 2;
/// The same where the lights are many.
const MANY_RAYS: u32 = 4;
/// Pixels of a picture of ordinary size; in smaller ones that is up to four times as many.
const ORDINARY_PIXELS: u32 = 250_000;
/// Every so many passes a fragment where they agree gets another ray.
const SECOND_LOOK: u32 = 4;
/// Pixels around, in each direction, whose rays must agree.
const AROUND: i32 = 2;
/// With at least so many rays the neighbours no longer help.
const ENOUGH_RAYS: u32 = 2048;
/// With at least so many only the nearest do.
const FEW_RAYS: u32 = 32;
/// Fragments per task.
const CHUNK: usize = 1024;
/// Shadow rays that are traced together, about.
const BATCH: usize = 512;
/// How much well-spread points lower the variance where the lights are many.
const SPREAD: f32 = 0.5;
/// How much neighbours lower the variance.
const HELPED: f32 = 0.15;
/// Squared differences of neighbours' shares, in variances, up to which they count in full, and from
/// which they don't.
const ALIKE: f32 = 6.0;
const UNLIKE: f32 = 24.0;

/// Rays of a fragment that no run comes to.
const MOST_RAYS_OF_ALL: u32 = 1 << 30;

/// Direct light of a fragment, but for what has no noise.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct KeptLight {
    seen: Rgb,
    cast: Rgb,
    squares: f32,
    rays: u32,
    blocked: u32,
    disputed: u32,
}

/// What is known of the direct light on a fragment.
#[derive(Clone, Copy, Default)]
pub struct Lit {
    /// Irradiance with nothing in between.
    unoccluded: Rgb,
    /// Σ irradiance of the light points that were seen.
    seen: Rgb,
    /// Σ irradiance of all light points.
    cast: Rgb,
    /// Of many lights, Σ of its square, as one number.
    squares: f32,
    /// Rays so far.
    rays: u32,
    /// Rays that were blocked.
    blocked: u32,
    /// Whether rays here or around disagree.
    disputed: bool,
}

/// Direct light on all fragments.
pub struct Direct {
    lit: Vec<Lit>,
    /// Rays of a disputed fragment in the first pass, and in each other.
    more_rays: [u32; 2],
    /// Whether more rays go where they disagree.
    adaptive: bool,
    passes: u32,
    /// Shadow rays so far.
    pub rays: u64,
}

impl Direct {
    /// Without a ray; `hasty` if the first pass had better be short.
    pub fn new(lights: &PolygonLights, seen: &Seen, adaptive: bool, hasty: bool) -> Self {
        let unoccluded = |fragment: &Fragment| Lit {
            unoccluded: lights.unoccluded(fragment.point, fragment.normal).irradiance,
            ..Lit::default()
        };
        let lit = seen.fragments.par_iter().with_min_len(CHUNK).map(unoccluded).collect();
        // In small pictures neighbours are far apart, and rays are cheap.
        let generous = (ORDINARY_PIXELS / (seen.width * seen.height)).clamp(1, 4);
        let more_rays = MORE_RAYS * generous;
        let at_first = if hasty { MORE_RAYS_IN_HASTE } else { more_rays };
        Self { lit, more_rays: [at_first, more_rays], adaptive, passes: 0, rays: 0 }
    }

    /// Writes all but what has no noise.
    pub fn save(&self, to: &mut Writer) {
        let kept = self.lit.iter().map(|lit| KeptLight {
            seen: lit.seen,
            cast: lit.cast,
            squares: lit.squares,
            rays: lit.rays,
            blocked: lit.blocked,
            disputed: u32::from(lit.disputed),
        });
        to.value(self.passes);
        to.value(self.rays);
        to.slice(&kept.collect::<Vec<_>>());
    }

    /// Takes what [`Direct::save`] wrote of the same fragments.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.passes = from.value()?;
        self.rays = from.value()?;
        let kept: Vec<KeptLight> = from.exactly(self.lit.len())?;
        if kept.iter().any(|kept| kept.rays > MOST_RAYS_OF_ALL || kept.blocked > kept.rays) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        for (lit, kept) in self.lit.iter_mut().zip(kept) {
            (lit.seen, lit.cast, lit.squares) = (kept.seen, kept.cast, kept.squares);
            (lit.rays, lit.blocked) = (kept.rays, kept.blocked);
            lit.disputed = kept.disputed != 0;
        }
        Ok(())
    }

    /// Casts another pass of rays.
    pub fn pass(&mut self, world: &World, lights: &PolygonLights, seen: &Seen, seed: Seed) {
        let caster = Caster { world, lights, seen, seed };
        if !self.adaptive || !lights.is_exact() {
            let rays = if lights.is_exact() { EVEN_RAYS } else { MANY_RAYS };
            self.lit.iter_mut().for_each(|lit| lit.disputed = true);
            self.cast(&caster, |_, _| rays);
        } else if self.passes == 0 {
            self.cast(&caster, |_, _| FIRST_RAYS);
            self.dispute(seen);
            let more = self.more_rays[0];
            self.cast(&caster, |_, lit| if lit.disputed { more } else { 0 });
        } else {
            self.dispute(seen);
            let (passes, more) = (self.passes, self.more_rays[1]);
            self.cast(&caster, |fragment, lit| {
                let looks = (fragment.pixel + passes).is_multiple_of(SECOND_LOOK);
                if lit.disputed { more } else { u32::from(looks) }
            });
        }
        self.passes += 1;
    }

    /// Casts as many rays from each fragment as `count` says.
    fn cast(&mut self, caster: &Caster<'_>, count: impl Fn(&Fragment, &Lit) -> u32 + Sync) {
        let fragments = &caster.seen.fragments;
        let chunks = self.lit.par_chunks_mut(CHUNK).zip(fragments.par_chunks(CHUNK));
        let rays: u64 = chunks
            .map(|(lit, fragments)| {
                let (mut rays, mut batch) = (0, Batch::default());
                for (index, fragment) in fragments.iter().enumerate() {
                    let count = count(fragment, &lit[index]);
                    let dark = caster.lights.is_exact() && lit[index].unoccluded == Rgb::ZERO;
                    if count > 0 && !dark {
                        caster.aim(index, &mut lit[index], fragment, count, &mut batch);
                        rays += u64::from(count);
                    }
                    if batch.segments.len() >= BATCH {
                        batch.trace(caster, lit);
                    }
                }
                batch.trace(caster, lit);
                rays
            })
            .sum();
        self.rays += rays;
    }

    /// Finds the fragments whose own or neighbouring rays disagree.
    fn dispute(&mut self, seen: &Seen) {
        let lit = &self.lit;
        let disputed: Vec<bool> = (0..lit.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|index| {
                let mine = &lit[index];
                if mine.is_disputed() {
                    return true;
                }
                if mine.rays == 0 {
                    return false;
                }
                let mut disagrees = false;
                around(seen, index, AROUND, |other, _, _| {
                    let other = &lit[other];
                    disagrees |=
                        other.rays > 0 && (other.blocked * mine.rays != mine.blocked * other.rays);
                });
                disagrees
            })
            .collect();
        self.lit.iter_mut().zip(disputed).for_each(|(lit, disputed)| lit.disputed = disputed);
    }

    /// Direct irradiance of a fragment and its estimated variance; where its own rays are few, with
    /// the help of its neighbours' if `filtered`: what a plane through the shares around says of
    /// it, where chance lets them be the same, and how far they are off that plane.
    pub fn irradiance(
        &self,
        lights: &PolygonLights,
        seen: &Seen,
        index: usize,
        filtered: bool,
    ) -> (Rgb, Rgb) {
        let lit = &self.lit[index];
        if lit.rays == 0 {
            return (Rgb::ZERO, Rgb::ZERO);
        }
        let exact = lights.is_exact();
        let factor = if exact { lit.unoccluded } else { Rgb::ONE };
        let share = lit.share(exact);
        if !(filtered && lit.is_disputed() && lit.rays < ENOUGH_RAYS) {
            return (factor * share, self.own_variance(lit, exact));
        }
        let reach = if lit.rays < FEW_RAYS { AROUND } else { 1 };
        let mut plane = Plane::new();
        plane.add(0, 0, share, lit.rays as f32);
        around(seen, index, reach, |other, across, down| {
            let other = &self.lit[other];
            let weight = 1.0 / (1.0 + (across * across + down * down) as f32 * 0.5);
            if other.rays > 0 {
                let alike = if exact { lit.alike(other) } else { 1.0 };
                plane.add(across, down, other.share(exact), other.rays as f32 * weight * alike);
            }
        });
        let (share, variance) = plane.center();
        let variance = variance.map_or_else(
            || self.own_variance(lit, exact) * HELPED,
            |variance| factor * factor * variance,
        );
        (factor * share, variance)
    }

    /// Estimated variance of the irradiance by the rays of the fragment alone.
    fn own_variance(&self, lit: &Lit, exact: bool) -> Rgb {
        if !exact {
            let (mean, all) = (lit.seen / lit.rays.max(1) as f32, importance(lit.seen));
            if lit.rays < 2 || all <= 0.0 {
                return mean * mean;
            }
            let scatter = lit.squares * lit.rays as f32 / (all * all) - 1.0;
            return mean * mean * (scatter.max(0.0) / (lit.rays - 1) as f32 * SPREAD);
        }
        if lit.rays == 0 || lit.blocked == 0 || lit.blocked == lit.rays {
            return Rgb::ZERO;
        }
        let share = lit.blocked as f32 / lit.rays as f32;
        // Well-spread points do better than random ones: the variance falls by about n^−1.5.
        let variance = share * (1.0 - share) / (lit.rays as f32).powf(1.5);
        lit.unoccluded * lit.unoccluded * variance
    }
}

impl Lit {
    /// Share of the light that gets here; of many lights, irradiance.
    fn share(&self, exact: bool) -> Rgb {
        if !exact {
            return self.seen / self.rays as f32;
        }
        Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO)
    }

    /// Whether rays here or around disagreed when that was last looked at, or do so here since.
    fn is_disputed(&self) -> bool {
        self.disputed || (self.blocked > 0 && self.blocked < self.rays)
    }

    /// 1 where the shares of blocked rays are as near as chance lets them be, 0 where they are not:
    /// there is a shadow's edge in between.
    fn alike(&self, other: &Lit) -> f32 {
        let off = self.blocked_share() - other.blocked_share();
        let chance = self.chance() + other.chance();
        ((UNLIKE - off * off / chance) / (UNLIKE - ALIKE)).clamp(0.0, 1.0)
    }

    fn blocked_share(&self) -> f32 {
        self.blocked as f32 / self.rays.max(1) as f32
    }

    /// Variance of the share of blocked rays; where all agree, as if one half of a ray did not.
    fn chance(&self) -> f32 {
        let share = (self.blocked as f32 + 0.5) / (self.rays + 1) as f32;
        share * (1.0 - share) / self.rays.max(1) as f32
    }

    /// Takes what a ray to a point of a light found, which shines as much if nothing is in between.
    fn take(&mut self, irradiance: Rgb, blocked: bool, exact: bool) {
        if blocked {
            self.blocked += 1;
            return;
        }
        self.seen += irradiance;
        if !exact {
            self.squares += importance(irradiance).powi(2);
        }
    }
}

/// What shadow rays are cast by.
struct Caster<'a> {
    world: &'a World,
    lights: &'a PolygonLights,
    seen: &'a Seen,
    seed: Seed,
}

/// Shadow rays that are traced together.
#[derive(Default)]
struct Batch {
    segments: Vec<Segment>,
    /// Of each, whose it is, and what arrives if nothing is in between.
    ends: Vec<(usize, Rgb)>,
    blocked: Vec<bool>,
}

impl Caster<'_> {
    /// Picks points of the lights for so many more rays of a fragment.
    fn aim(&self, index: usize, lit: &mut Lit, fragment: &Fragment, count: u32, to: &mut Batch) {
        let Self { lights, seen, .. } = self;
        let (x, y) = (fragment.pixel % seen.width, fragment.pixel / seen.width);
        let tile = u64::from(y / 4) << 32 | u64::from(x / 4);
        let place = BAYER[(y % 4 * 4 + x % 4) as usize];
        let sequence = Shifted::new(self.seed, Stream::Light, tile);
        // Good enough to pick a light by, for all points of the pixel.
        let unoccluded = lights.unoccluded(fragment.point, fragment.normal);
        for _ in 0..count {
            let from = seen.sample_point(fragment, lit.rays);
            let xi = |number: u32| sequence.at(number * 16 + place).triple();
            if !lights.is_exact() {
                let xi = xi(lit.rays);
                lit.rays += 1;
                if let Some((end, irradiance)) = lights.one_of_many(from, fragment.normal, xi) {
                    to.add(Segment { from, to: end }, index, irradiance);
                }
                continue;
            }
            let sample = |tries: u32| {
                let xi = xi(lit.rays * TRIES + tries);
                lights.sample(&unoccluded, from, fragment.normal, xi)
            };
            // Where the horizon cuts a light, the ratio of seen to cast asks for points above it.
            let light = (0..TRIES).find_map(sample);
            lit.rays += 1;
            let Some(light) = light else { continue };
            lit.cast += light.irradiance;
            to.add(Segment { from, to: light.end }, index, light.irradiance);
        }
    }
}

impl Batch {
    fn add(&mut self, segment: Segment, index: usize, irradiance: Rgb) {
        self.segments.push(segment);
        self.ends.push((index, irradiance));
    }

    /// Tells those whose rays they are what the rays meet, and is empty then.
    fn trace(&mut self, caster: &Caster<'_>, lit: &mut [Lit]) {
        caster.world.rays.blocked_many(&self.segments, |_, _| false, &mut self.blocked);
        for ((index, irradiance), blocked) in self.ends.iter().zip(&self.blocked) {
            lit[*index].take(*irradiance, *blocked, caster.lights.is_exact());
        }
        self.segments.clear();
        self.ends.clear();
    }
}

/// Calls `each` with the fragments of neighbouring pixels that lie in the plane of fragment
/// `index`, and how many pixels they are to the right and down.
fn around(seen: &Seen, index: usize, reach: i32, mut each: impl FnMut(usize, i32, i32)) {
    let mine = &seen.fragments[index];
    let (x, y) = ((mine.pixel % seen.width) as i32, (mine.pixel / seen.width) as i32);
    let (width, height) = (seen.width as i32, seen.height as i32);
    let flat = seen.frame.footprint(mine.point, seen.height);
    for row in (y - reach).max(0)..=(y + reach).min(height - 1) {
        for column in (x - reach).max(0)..=(x + reach).min(width - 1) {
            let pixel = (row * width + column) as usize;
            if pixel == mine.pixel as usize {
                continue;
            }
            for other in seen.start[pixel] as usize..seen.start[pixel + 1] as usize {
                let theirs = &seen.fragments[other];
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
        let seen = specimen.seen();
        let mut direct = Direct::new(&specimen.lights, &seen, true, false);
        for _ in 0..2 {
            direct.pass(&specimen.world, &specimen.lights, &seen, SEED);
            let light = |index| direct.irradiance(&specimen.lights, &seen, index, false);
            let all = (0..seen.fragments.len()).map(light);
            let off = all.filter(|(light, variance)| {
                !is_near(*light, PI * EMISSION, 0.005) || *variance != Rgb::ZERO
            });
            let off = off.count();
            assert!(50 * off <= seen.fragments.len(), "{off} of {}", seen.fragments.len());
        }
        assert!(direct.rays > 0);
    }

    #[test]
    fn what_rays_found_comes_back() {
        let specimen = Specimen::new(&crate::scene::made::cornell(), 300);
        let seen = specimen.seen();
        let mut direct = Direct::new(&specimen.lights, &seen, true, false);
        direct.pass(&specimen.world, &specimen.lights, &seen, SEED);
        let mut to = Writer::new(u64::MAX);
        direct.save(&mut to);
        let bytes = to.finish().expect("there is room");
        let mut again = Direct::new(&specimen.lights, &seen, true, false);
        again.restore(&mut Reader::new(&bytes)).expect("sound");
        for index in 0..seen.fragments.len() {
            let [one, other] = [&direct, &again]
                .map(|direct| direct.irradiance(&specimen.lights, &seen, index, true));
            assert_eq!(one, other);
        }
        let mut damaged = Direct::new(&specimen.lights, &seen, true, false);
        damaged.lit.pop();
        assert!(damaged.restore(&mut Reader::new(&bytes)).is_err(), "of other fragments");
    }
}
