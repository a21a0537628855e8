//! Records in checkpoints.

use super::by_direction::ByDirection;
use super::record::{Obstacle, Record, SECTORS};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Bounds on records, and on rays of one, in a checkpoint: more than any run makes, so larger
/// numbers mean damage.
const MOST_RECORDS: usize = 1 << 30;
const MOST_RAYS: u32 = 1 << 30;

/// Writes records.
pub fn save(records: &[Record], to: &mut Writer) {
    to.slice(&records.iter().map(StoredRecord::from).collect::<Vec<_>>());
    let by_direction = records.iter().filter_map(|record| record.by_direction.as_deref().copied());
    to.slice(&by_direction.collect::<Vec<_>>());
}

/// Reads what [`save`] wrote.
pub fn restore(from: &mut Reader<'_>) -> Result<Vec<Record>, CheckpointError> {
    let records: Vec<StoredRecord> = from.slice()?;
    if records.len() > MOST_RECORDS || !records.iter().all(StoredRecord::is_sound) {
        return Err(CheckpointError::damaged("there can't be such a record"));
    }
    let mut records: Vec<Record> = records.iter().map(Record::from).collect();
    let by_direction: Vec<ByDirection> = from.slice()?;
    let fit = [0, records.len()].contains(&by_direction.len());
    if !fit || !by_direction.iter().all(ByDirection::is_finite) {
        return Err(CheckpointError::damaged("there can't be such radiance by direction"));
    }
    for (record, seen) in records.iter_mut().zip(by_direction) {
        record.by_direction = Some(Box::new(seen));
    }
    Ok(records)
}

/// A record as checkpoints store it, without what is fitted from its neighbours. The order of the
/// fields is part of the format.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct StoredRecord {
    point: Vec3,
    normal: Vec3,
    flat: Vec3,
    footprint: f32,
    number: u32,
    fragment: u32,
    rays: u32,
    aimed: u32,
    sum: Rgb,
    split: Rgb,
    by_mesh: Rgb,
    split_by_mesh: Rgb,
    nearness: f32,
    radius_factor: f32,
    radius: f32,
    horizon: [Obstacle; SECTORS],
}

impl From<&Record> for StoredRecord {
    fn from(record: &Record) -> Self {
        Self {
            point: record.point,
            normal: record.normal,
            flat: record.flat,
            footprint: record.footprint,
            number: record.number,
            fragment: record.fragment,
            rays: record.rays,
            aimed: record.aimed,
            sum: record.sum,
            split: record.split,
            by_mesh: record.by_mesh,
            split_by_mesh: record.split_by_mesh,
            nearness: record.nearness,
            radius_factor: record.radius_factor,
            radius: record.radius,
            horizon: record.horizon,
        }
    }
}

impl From<&StoredRecord> for Record {
    fn from(kept: &StoredRecord) -> Self {
        Record {
            fragment: kept.fragment,
            rays: kept.rays,
            aimed: kept.aimed,
            sum: kept.sum,
            split: kept.split,
            by_mesh: kept.by_mesh,
            split_by_mesh: kept.split_by_mesh,
            nearness: kept.nearness,
            radius_factor: kept.radius_factor,
            radius: kept.radius,
            horizon: kept.horizon,
            flat: kept.flat,
            ..Record::new(kept.point, kept.normal, kept.footprint, kept.number)
        }
    }
}

impl StoredRecord {
    /// Whether it may be what gathering makes: numbers that are none have no place anywhere.
    fn is_sound(&self) -> bool {
        let numbers = [self.footprint, self.nearness, self.radius_factor, self.radius];
        let positive = numbers.iter().all(|number| *number >= 0.0 && number.is_finite());
        let unit = (self.normal.length_squared() - 1.0).abs() < 1e-2;
        let obstacle = |one: &Obstacle| one.distance >= 0.0 && one.normal.is_finite();
        positive
            && unit
            && self.point.is_finite()
            && self.flat.is_finite()
            && self.sum.is_finite()
            && self.split.is_finite()
            && self.by_mesh.is_finite()
            && self.split_by_mesh.is_finite()
            && self.rays <= MOST_RAYS
            && self.aimed <= self.rays
            && self.horizon.iter().all(obstacle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        let mut record = Record::new(Vec3::ONE, Vec3::Z, 0.5, 9);
        (record.rays, record.sum, record.split) = (4, Rgb::ONE, Rgb::splat(0.25));
        (record.nearness, record.radius_factor, record.radius) = (3.0, 0.5, 7.0);
        record.aimed = 1;
        record.horizon[2] = Obstacle { distance: 2.0, normal: Vec3::X, offset: 1.0 };
        let mut seen = ByDirection::default();
        seen.add(Rgb::ONE, Vec3::Z, 1.0);
        record.by_direction = Some(Box::new(seen));
        record
    }

    fn kept(record: &Record) -> Result<Vec<Record>, CheckpointError> {
        let mut to = Writer::new(u64::MAX);
        save(std::slice::from_ref(record), &mut to);
        restore(&mut Reader::new(&to.finish().expect("there is room")))
    }

    #[test]
    fn records_come_back() {
        let (one, again) = (record(), kept(&record()).expect("sound").remove(0));
        assert_eq!((again.point, again.normal, again.number), (one.point, one.normal, one.number));
        assert_eq!((again.rays, again.sum, again.split), (one.rays, one.sum, one.split));
        assert_eq!(again.aimed, one.aimed);
        assert_eq!((again.radius_factor, again.radius), (one.radius_factor, one.radius));
        assert_eq!(again.horizon[2].distance, one.horizon[2].distance);
        assert_eq!(again.by_direction, one.by_direction);
    }

    #[test]
    fn numbers_that_no_gathering_makes_are_refused() {
        let damages: [fn(&mut Record); 8] = [
            |record| record.normal = Vec3::ZERO,
            |record| record.point.x = f32::NAN,
            |record| record.radius = -1.0,
            |record| record.sum.y = f32::INFINITY,
            |record| record.rays = u32::MAX,
            |record| record.aimed = record.rays + 1,
            |record| record.horizon[0].distance = -1.0,
            |record| {
                let seen = record.by_direction.as_mut().expect("it is there");
                seen.add(Rgb::splat(f32::NAN), Vec3::Z, 1.0);
            },
        ];
        for damage in damages {
            let mut record = record();
            damage(&mut record);
            assert!(kept(&record).is_err());
        }
    }
}
