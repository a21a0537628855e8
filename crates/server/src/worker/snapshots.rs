//! Pictures of a job as files, and how many snapshots it keeps: as many as its share of bytes
//! holds. Where they reach the share, every second one goes and the next ones come half as often,
//! so that a job may run for as long as it likes; where the disk or the payer's quota has no room,
//! none is kept until there is some. The job's last picture is no snapshot and is always kept.

use super::wire::PictureParts;
use crate::api::events::{Notice, NoticeEvent};
use crate::api::jobs::{Picture, PictureFormat, Progress};
use crate::artifacts::{ArtifactError, Content};
use crate::shared::Shared;
use crate::store::{Claim, Report};
use std::io;
use std::time::Instant;

/// Most notices of a run that nothing is kept: a disk that is short again every second must not
/// fill the rest of itself with them.
const MOST_PAUSE_NOTICES: u32 = 100;

/// What goes wrong with a snapshot: with its files, with its record.
type Trouble = Box<dyn std::error::Error + Send + Sync>;

/// A picture as an executor hands it over: its files.
pub struct PictureFiles {
    size: (u32, u32),
    files: Vec<(PictureFormat, Content)>,
}

impl PictureFiles {
    /// The parts of a message as what it says they are; `None` where they are not as many.
    pub fn new(
        PictureParts { width, height, formats }: PictureParts,
        parts: Vec<Content>,
    ) -> Option<Self> {
        let size = (width, height);
        (formats.len() == parts.len())
            .then(|| Self { size, files: formats.into_iter().zip(parts).collect() })
    }

    /// Bytes of all files.
    fn bytes(&self) -> io::Result<u64> {
        self.files.iter().map(|(_, file)| file.size()).sum()
    }

    /// Stores the files.
    ///
    /// # Errors
    /// Where the storage does not take them; it can be tried again.
    pub async fn store(
        &self,
        shared: &Shared,
        claim: Claim,
    ) -> Result<Vec<Picture>, ArtifactError> {
        let mut pictures = Vec::new();
        for (format, file) in &self.files {
            let file = file.try_clone()?;
            pictures.push(shared.artifacts.put_picture(claim.job, *format, self.size, file).await?);
        }
        Ok(pictures)
    }
}

/// The snapshots of one run.
pub struct Album {
    /// Most bytes of all snapshots of the job.
    share: u64,
    /// Bytes of those that are stored; `None` until the store was asked.
    stored: Option<u64>,
    /// How often the interval between them has doubled for want of room.
    slower: u32,
    /// Why none is kept at present.
    paused: Option<Pause>,
    pause_notices: u32,
}

/// Why a snapshot is not kept.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pause {
    Disk,
    Quota,
    Share,
}

impl Album {
    /// An album of so many bytes at most.
    pub fn new(share: u64) -> Self {
        Self { share, stored: None, slower: 0, paused: None, pause_notices: 0 }
    }

    /// How often the interval has doubled for want of room.
    pub fn slower(&self) -> u32 {
        self.slower
    }

    /// Keeps a snapshot where there is room for it, or can be made.
    ///
    /// # Errors
    /// Where it cannot be stored.
    pub async fn keep(
        &mut self,
        shared: &Shared,
        claim: Claim,
        picture: PictureFiles,
        progress: Progress,
    ) -> Result<(), Trouble> {
        if let Some(why) = shared.disk.shortage() {
            return self.pause(shared, claim, Pause::Disk, why).await;
        }
        let begun = Instant::now();
        let bytes = picture.bytes()?;
        if bytes > self.share {
            let (bytes, share) = (bytes >> 10, self.share >> 20);
            let why = format!(
                "a snapshot takes {bytes} KiB, and those of a job may have {share} MiB together (--max-job-mb)"
            );
            return self.pause(shared, claim, Pause::Share, why).await;
        }
        if shared.store.room(claim.job).await?.is_some_and(|room| room < bytes) {
            let why = "the pictures and solutions of this caller have as many bytes as they may";
            return self.pause(shared, claim, Pause::Quota, why.into()).await;
        }
        if self.stored.is_none() {
            let known = shared.store.snapshots(claim.job).await?;
            self.stored = Some(known.stored.iter().map(|(_, bytes)| bytes).sum());
            self.slower = known.thinned;
        }
        self.make_room(shared, claim, bytes).await?;
        let pictures = picture.store(shared, claim).await?;
        shared.metrics.count_snapshot(begun.elapsed().as_secs_f64());
        let report = Report { snapshots: vec![(pictures, progress)], ..Report::default() };
        shared.store.report(claim, report).await?;
        self.stored = self.stored.map(|stored| stored + bytes);
        self.paused = None;
        // Two may be too many already; the newest one stays until there is a newer one.
        self.make_room(shared, claim, 0).await?;
        shared.bell.ring(claim.job);
        Ok(())
    }

    /// Removes every second snapshot but the newest, until so many bytes more are within the share
    /// or one snapshot is left.
    async fn make_room(&mut self, shared: &Shared, claim: Claim, more: u64) -> Result<(), Trouble> {
        while self.stored.unwrap_or(0) + more > self.share {
            let stored = shared.store.snapshots(claim.job).await?.stored;
            let (gone, left) = every_second(&stored);
            if gone.is_empty() {
                break;
            }
            let notice = NoticeEvent {
                what: Notice::SnapshotsThinned,
                detail: format!(
                    "the snapshots of this job reached {} MiB, which is its share: every second one was removed, and the next ones come half as often",
                    self.share >> 20
                ),
                removed: gone.len() as u64,
            };
            let unnamed = shared.store.drop_snapshots(claim, &gone, notice).await?;
            self.stored = Some(left);
            self.slower += 1;
            for picture in unnamed {
                // What stays behind is found by the next sweep.
                if let Err(error) = shared.artifacts.remove_picture(claim.job, &picture).await {
                    tracing::warn!(job = %claim.job, %error, "cannot remove a snapshot");
                }
            }
            shared.bell.ring(claim.job);
        }
        Ok(())
    }

    /// Leaves a snapshot out, and says so where that begins.
    async fn pause(
        &mut self,
        shared: &Shared,
        claim: Claim,
        pause: Pause,
        why: String,
    ) -> Result<(), Trouble> {
        if self.paused == Some(pause) || self.pause_notices >= MOST_PAUSE_NOTICES {
            return Ok(());
        }
        tracing::warn!(job = %claim.job, why, "keeps no snapshots for now");
        let detail = format!("no snapshots are kept until there is room: {why}");
        let notice = NoticeEvent { what: Notice::SnapshotsPaused, detail, removed: 0 };
        let report = Report { notices: vec![notice], ..Report::default() };
        shared.store.report(claim, report).await?;
        self.paused = Some(pause);
        self.pause_notices += 1;
        shared.bell.ring(claim.job);
        Ok(())
    }
}

/// Of snapshots by number and bytes, oldest first: the numbers of every second one, and the bytes
/// of the others, of which the newest is one.
fn every_second(stored: &[(u64, u64)]) -> (Vec<u64>, u64) {
    let from_newest = || stored.iter().rev();
    let gone = from_newest().skip(1).step_by(2).map(|(number, _)| *number).collect();
    (gone, from_newest().step_by(2).map(|(_, bytes)| bytes).sum())
}

#[cfg(test)]
mod tests {
    use super::every_second;

    #[test]
    fn every_second_snapshot_goes_and_the_newest_stays() {
        assert_eq!(every_second(&[]), (vec![], 0));
        assert_eq!(every_second(&[(7, 10)]), (vec![], 10));
        assert_eq!(every_second(&[(3, 1), (7, 10)]), (vec![3], 10));
        let stored: Vec<_> = (1..=7).map(|number| (number, 1 << number)).collect();
        assert_eq!(every_second(&stored), (vec![6, 4, 2], 2 + 8 + 32 + 128));
    }
}
