//! Where an archive is: a stretch of a file.

use super::error::{ArchiveError, refused};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

/// How archives begin that are not empty.
const MAGIC: [u8; 4] = *b"PK\x03\x04";

/// A stretch of a file.
#[derive(Clone, Copy)]
pub struct Stretch<'a> {
    /// The file.
    pub file: &'a File,
    /// Where the stretch begins.
    pub start: u64,
    /// Its bytes.
    pub size: u64,
}

impl Stretch<'_> {
    /// Reads bytes from `offset` on; as many as there are.
    pub fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let left = self.size.saturating_sub(offset);
        let wanted = bytes.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        match wanted {
            0 => Ok(0),
            _ => self.file.read_at(&mut bytes[..wanted], self.start + offset),
        }
    }

    /// `length` bytes from `offset` on, which there have to be.
    pub fn bytes(&self, offset: u64, length: usize) -> Result<Vec<u8>, ArchiveError> {
        let there = offset.checked_add(length as u64).is_some_and(|end| end <= self.size);
        if !there {
            return Err(refused("archive", "ends too early; it may not be whole").into());
        }
        let mut bytes = vec![0; length];
        self.file.read_exact_at(&mut bytes, self.start + offset)?;
        Ok(bytes)
    }

    /// Whether this begins like a zip archive.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn is_archive(&self) -> io::Result<bool> {
        let mut magic = [0; MAGIC.len()];
        Ok(self.read_at(&mut magic, 0)? == magic.len() && magic == MAGIC)
    }
}
