//! Records in checkpoints.

use super::record::{Obstacle, Record, SECTORS};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Records and rays of one that no run comes to.
const MOST_RECORDS: usize = 1 << 30;
const MOST_RAYS: u32 = 1 << 30;

/// Writes records.
pub fn save(records: &[Record], to: &mut Writer) {
    to.slice(&records.iter().map(KeptRecord::from).collect::<Vec<_>>());
}

/// Takes what [`save`] wrote.
pub fn restore(from: &mut Reader<'_>) -> Result<Vec<Record>, CheckpointError> {
    let records: Vec<KeptRecord> = from.slice()?;
    if records.len() > MOST_RECORDS || !records.iter().all(KeptRecord::is_sound) {
        return Err(CheckpointError::damaged("there can't be such a record"));
    }
    Ok(records.iter().map(Record::from).collect())
}

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
