//! How full the disk is. Taking work in that cannot be finished helps nobody, and a database on a
//! full disk cannot even say so.

use crate::failpoints;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long an answer of the system is good.
const FRESH: Duration = Duration::from_secs(1);

/// Watches the disk of the data folder.
pub struct Disk {
    folder: PathBuf,
    min_free_bytes: u64,
    last: Mutex<Option<(Instant, Option<u64>)>>,
}

impl Disk {
    /// Watches the disk that `folder` lies on.
    pub fn new(folder: PathBuf, min_free_mb: u64) -> Self {
        Self { folder, min_free_bytes: min_free_mb.saturating_mul(1 << 20), last: Mutex::default() }
    }

    /// Bytes that this process may still write, at most a second old; `None` where the system
    /// does not say.
    pub fn free_bytes(&self) -> Option<u64> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((at, free)) = *last
            && at.elapsed() < FRESH
        {
            return free;
        }
        let free = rustix::fs::statvfs(&self.folder)
            .inspect_err(|error| tracing::warn!(%error, "cannot ask how full the disk is"))
            .ok()
            .map(|disk| disk.f_bavail.saturating_mul(disk.f_frsize));
        *last = Some((Instant::now(), free));
        free
    }

    /// Why nothing new may be taken, where that is so. A disk that does not say is taken at its
    /// best.
    pub fn shortage(&self) -> Option<String> {
        self.shortage_for(0)
    }

    /// The same, where so many bytes more are to be written.
    pub fn shortage_for(&self, bytes: u64) -> Option<String> {
        let free = match failpoints::pass("disk", String::new) {
            Ok(()) => self.free_bytes()?,
            Err(_) => 0,
        };
        (free.saturating_sub(bytes) < self.min_free_bytes).then(|| {
            let (free_mb, min_mb) = (free >> 20, self.min_free_bytes >> 20);
            format!(
                "the server's disk has {free_mb} MiB free and keeps {min_mb} MiB; what is there can be read, cancelled and deleted"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_is_short_below_its_reserve() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Disk::new(folder.path().into(), 0).shortage(), None);
        let why = Disk::new(folder.path().into(), 1 << 40).shortage().unwrap();
        assert!(why.contains("MiB free"), "{why}");
        let large = Disk::new(folder.path().into(), 1);
        assert_eq!((large.shortage(), large.shortage_for(1 << 60).is_some()), (None, true));
        assert_eq!(Disk::new("/no/such/folder".into(), 1 << 40).shortage(), None);
    }
}
