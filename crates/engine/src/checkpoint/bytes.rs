//! Numbers to bytes and back: little more than copies, so that a checkpoint costs as much as its
//! memory does. What is read may be anything: nothing is allocated that the bytes don't fill.

use super::CheckpointError;
use bytemuck::{AnyBitPattern, NoUninit, Pod};

/// Collects the bytes of one part of a checkpoint.
pub struct Writer {
    bytes: Vec<u8>,
    /// Most bytes.
    room: usize,
    overflowed: bool,
}

impl Writer {
    /// Nothing yet; what goes beyond `room` bytes is dropped, and [`Writer::finish`] says so.
    pub fn new(room: u64) -> Self {
        let room = usize::try_from(room).unwrap_or(usize::MAX);
        Self { bytes: Vec::new(), room, overflowed: false }
    }

    fn raw(&mut self, bytes: &[u8]) {
        self.overflowed |= bytes.len() > self.room - self.bytes.len();
        if !self.overflowed {
            self.bytes.extend_from_slice(bytes);
        }
    }

    /// Appends a value.
    pub fn value<T: NoUninit>(&mut self, value: T) {
        self.raw(bytemuck::bytes_of(&value));
    }

    /// Appends values with their number.
    pub fn slice<T: NoUninit>(&mut self, values: &[T]) {
        self.value(values.len() as u64);
        self.raw(bytemuck::cast_slice(values));
    }

    /// What was written; `None` where it was more than there is room for.
    pub fn finish(self) -> Option<Vec<u8>> {
        (!self.overflowed).then_some(self.bytes)
    }
}

/// Reads back what a [`Writer`] wrote, in the same order.
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// From the start of a part.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    fn raw(&mut self, count: usize) -> Result<&'a [u8], CheckpointError> {
        let Some((first, rest)) = self.rest.split_at_checked(count) else {
            return Err(CheckpointError::damaged("it ends too early"));
        };
        self.rest = rest;
        Ok(first)
    }

    /// A value.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] where the bytes don't suffice; likewise below.
    pub fn value<T: AnyBitPattern>(&mut self) -> Result<T, CheckpointError> {
        Ok(bytemuck::pod_read_unaligned(self.raw(size_of::<T>())?))
    }

    /// A value from 0 to `most`.
    pub fn count(&mut self, most: u64) -> Result<u64, CheckpointError> {
        match self.value::<u64>()? {
            count if count <= most => Ok(count),
            count => Err(CheckpointError::damaged(format!("{count} is out of range"))),
        }
    }

    /// Values, as many as there are.
    pub fn slice<T: Pod>(&mut self) -> Result<Vec<T>, CheckpointError> {
        let count = self.value::<u64>()?;
        let bytes = count.saturating_mul(size_of::<T>() as u64);
        let bytes = self.raw(usize::try_from(bytes).unwrap_or(usize::MAX))?;
        let mut values = vec![T::zeroed(); count as usize];
        bytemuck::cast_slice_mut(&mut values).copy_from_slice(bytes);
        Ok(values)
    }

    /// Exactly `count` values.
    pub fn exactly<T: Pod>(&mut self, count: usize) -> Result<Vec<T>, CheckpointError> {
        let values = self.slice()?;
        let found = values.len();
        if found != count {
            let what = format!("{found} values where {count} were expected");
            return Err(CheckpointError::damaged(what));
        }
        Ok(values)
    }

    /// As many values as `place` has.
    pub fn replace<T: Pod>(&mut self, place: &mut Vec<T>) -> Result<(), CheckpointError> {
        *place = self.exactly(place.len())?;
        Ok(())
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Checks that nothing is left.
    pub fn end(self) -> Result<(), CheckpointError> {
        match self.rest.len() {
            0 => Ok(()),
            left => Err(CheckpointError::damaged(format!("{left} bytes too many"))),
        }
    }
}
