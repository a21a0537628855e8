//! What the three tiers keep. The coarse solution and the records are for any camera; direct light
//! and lobes are of the fragments that one camera sees.

use super::gather::{Obstacle, Record, SECTORS};
use super::links::{COVERED, Links, MOST_LINKS, Round};
use super::patch_light::Sampled;
use super::solver::Tiers;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::DeviceError;
use crate::radiometry::Rgb;
use crate::transport::checkpoints::Parts;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Iterations and rays that no run comes to.
const MOST_ITERATIONS: u64 = 1 << 40;
const MOST_RAYS: u32 = 1 << 30;
const MOST_RECORDS: u32 = 1 << 30;

/// A record without what follows from its neighbours.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct KeptRecord {
    point: Vec3,
    normal: Vec3,
    footprint: f32,
    number: u32,
    rays: u32,
    sum: Rgb,
    split: Rgb,
    nearness: f32,
    tight: f32,
    radius: f32,
    horizon: [Obstacle; SECTORS],
}

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

impl Tiers {
    /// Writes everything.
    pub fn write(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        let to = &mut parts.shared;
        to.value([self.done.max(self.before), self.before]);
        to.slice(&self.coarse.sampled);
        save_links(&self.coarse.links, self.coarse.sampled.len(), to);
        let records: Vec<KeptRecord> = self.cache.records.iter().map(KeptRecord::from).collect();
        to.value(self.cache.sequences);
        to.slice(&records);
        // Where sums of hemicube shots were, while tier 1 could be solved by those.
        to.value(0u64);
        to.slice::<Rgb>(&[]);
        let to = &mut parts.bound;
        let lit: Vec<KeptLight> = (self.direct.lit.iter())
            .map(|lit| KeptLight {
                seen: lit.seen,
                cast: lit.cast,
                squares: lit.squares,
                rays: lit.rays,
                blocked: lit.blocked,
                disputed: u32::from(lit.disputed),
            })
            .collect();
        to.value(self.direct.passes);
        to.value(self.direct.rays);
        to.slice(&lit);
        to.value(self.gloss.passes);
        to.value(self.gloss.brightness);
        to.slice(&self.gloss.sums);
        Ok(())
    }

    /// Takes the part for any camera, behind the patches' direct light, which [`restore_direct`]
    /// takes.
    pub fn restore_shared(&mut self, mut from: Reader<'_>) -> Result<(), DeviceError> {
        let patches = self.coarse.direct.len();
        self.coarse.links = restore_links(patches, &mut from)?;
        self.cache.sequences = from.value()?;
        let records: Vec<KeptRecord> = from.slice()?;
        if records.len() > MOST_RECORDS as usize || !records.iter().all(KeptRecord::is_sound) {
            return Err(CheckpointError::damaged("there can't be such a record").into());
        }
        self.cache.records = records.iter().map(Record::from).collect();
        from.count(0)?;
        from.exactly::<Rgb>(0)?;
        from.end()?;
        self.coarse.refresh();
        Ok(())
    }

    /// Takes the part of the same camera.
    pub fn restore_bound(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        self.direct.passes = from.value()?;
        self.direct.rays = from.value()?;
        let lit: Vec<KeptLight> = from.exactly(self.direct.lit.len())?;
        if lit.iter().any(|lit| lit.rays > MOST_RAYS || lit.blocked > lit.rays) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        for (place, lit) in self.direct.lit.iter_mut().zip(lit) {
            (place.seen, place.cast, place.squares) = (lit.seen, lit.cast, lit.squares);
            (place.rays, place.blocked) = (lit.rays, lit.blocked);
            place.disputed = lit.disputed != 0;
        }
        self.gloss.passes = from.value()?;
        self.gloss.brightness = from.value()?;
        self.gloss.sums = from.exactly(self.gloss.sums.len())?;
        if self.gloss.sums.iter().any(|sums| sums.rays > MOST_RAYS) {
            return Err(CheckpointError::damaged("there can't be that many rays"));
        }
        from.end()
    }
}

/// Iterations that it took to find the solution, those of them that another camera's picture had
/// done, and the direct light of all patches.
pub fn restore_direct(
    from: &mut Reader<'_>,
    patches: usize,
) -> Result<([u64; 2], Vec<Sampled>), CheckpointError> {
    let iterations = [from.count(MOST_ITERATIONS)?, from.count(MOST_ITERATIONS)?];
    Ok((iterations, from.exactly(patches)?))
}

/// Links take most of the bytes: two each where that suffices.
fn save_links(links: &Links, patches: usize, to: &mut Writer) {
    to.slice(&links.bounced);
    to.value(links.rounds.len() as u64);
    for Round { start, links } in &links.rounds {
        to.slice(start);
        if is_short(patches) {
            // The two marks are the largest numbers, in two bytes as in four.
            to.slice(&links.iter().map(|link| *link as u16).collect::<Vec<_>>());
        } else {
            to.slice(links);
        }
    }
}

/// Whether two bytes say which patch, and the two marks.
fn is_short(patches: usize) -> bool {
    patches < usize::from(u16::MAX) - 1
}

fn restore_links(patches: usize, from: &mut Reader<'_>) -> Result<Links, CheckpointError> {
    let damaged = |what: &str| Err(CheckpointError::damaged(what));
    let bounced: Vec<Rgb> = from.slice()?;
    let mut rounds = Vec::new();
    for _ in 0..from.count(MOST_LINKS as u64)? {
        let start: Vec<u32> = from.exactly(patches + 1)?;
        let count = start[patches] as usize;
        if start[0] != 0 || !start.is_sorted() {
            return damaged("its links are not in order");
        }
        let links: Vec<u32> = if is_short(patches) {
            let widen = |link: u16| match link {
                u16::MAX | 0xfffe => u32::from(link) | 0xffff_0000,
                link => u32::from(link),
            };
            from.exactly::<u16>(count)?.into_iter().map(widen).collect()
        } else {
            from.exactly(count)?
        };
        if links.iter().any(|link| *link as usize >= patches && *link < COVERED) {
            return damaged("a link leads nowhere");
        }
        rounds.push(Round { start, links });
    }
    if bounced.len() != if rounds.is_empty() { 0 } else { patches } {
        return damaged("its links are not of these patches");
    }
    Ok(Links { rounds, bounced })
}

impl From<&Record> for KeptRecord {
    fn from(record: &Record) -> Self {
        Self {
            point: record.point,
            normal: record.normal,
            footprint: record.footprint,
            number: record.number,
            rays: record.rays,
            sum: record.sum,
            split: record.split,
            nearness: record.nearness,
            tight: record.tight,
            radius: record.radius,
            horizon: record.horizon,
        }
    }
}

impl From<&KeptRecord> for Record {
    fn from(kept: &KeptRecord) -> Self {
        Record {
            rays: kept.rays,
            sum: kept.sum,
            split: kept.split,
            nearness: kept.nearness,
            tight: kept.tight,
            radius: kept.radius,
            horizon: kept.horizon,
            ..Record::new(kept.point, kept.normal, kept.footprint, kept.number)
        }
    }
}

impl KeptRecord {
    /// Whether it may be what gathering makes: numbers that are none have no place anywhere.
    fn is_sound(&self) -> bool {
        let numbers = [self.footprint, self.nearness, self.tight, self.radius];
        let positive = numbers.iter().all(|number| *number >= 0.0 && number.is_finite());
        let unit = (self.normal.length_squared() - 1.0).abs() < 1e-2;
        let obstacle = |one: &Obstacle| one.distance >= 0.0 && one.normal.is_finite();
        positive
            && unit
            && self.point.is_finite()
            && self.sum.is_finite()
            && self.split.is_finite()
            && self.rays <= MOST_RAYS
            && self.horizon.iter().all(obstacle)
    }
}
