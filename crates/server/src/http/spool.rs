//! Bytes on their way in: onto disk while they are counted, hashed and timed, so a sender that
//! never ends costs disk up to a limit, a file for as long as uploads may take, and no memory.

use super::app::App;
use super::problem::Problem;
use crate::hash::hex;
use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::time::{Instant, timeout_at};

/// Longest silence in the middle of an upload.
const IDLE: Duration = Duration::from_secs(30);
/// Fewest bytes a second, on average, of an upload that takes longer than that.
const LEAST_RATE: f64 = 1024.0;

/// What to answer where the disk does not keep an upload.
pub fn disk_trouble(error: io::Error) -> Problem {
    tracing::error!(%error, "cannot keep an upload");
    Problem::unavailable("the upload could not be kept; the disk may be full")
}

/// Counts the bytes of a request against the server's limit.
pub struct Allowance {
    left: u64,
    limit_mb: u64,
}

impl Allowance {
    /// All that an upload may have.
    pub fn new(app: &App) -> Self {
        Self {
            left: app.shared.config.max_upload_bytes(),
            limit_mb: app.shared.config.max_upload_mb,
        }
    }

    /// Counts bytes; refuses what is beyond the limit.
    pub fn take(&mut self, bytes: usize) -> Result<(), Problem> {
        match self.left.checked_sub(bytes as u64) {
            Some(left) => self.left = left,
            None => {
                let limit = self.limit_mb;
                return Err(Problem::too_large(format!("uploads may have at most {limit} MiB")));
            }
        }
        Ok(())
    }
}

/// How fast a request must arrive: without long silences, at a least rate, and in a total time.
pub struct Pace {
    began: Instant,
    most: Duration,
    bytes: u64,
}

impl Pace {
    /// A request that begins to arrive now and may take `most`.
    pub fn new(most: Duration) -> Self {
        Self { began: Instant::now(), most, bytes: 0 }
    }

    /// What comes next, if it comes in time.
    pub async fn next<T>(&self, coming: impl Future<Output = T>) -> Result<T, Problem> {
        let (silence, end) = (Instant::now() + IDLE, self.began + self.most);
        timeout_at(silence.min(end), coming).await.map_err(|_| {
            if end <= silence {
                self.too_long()
            } else {
                let seconds = IDLE.as_secs();
                Problem::too_slow(format!("nothing arrived for {seconds} seconds"))
            }
        })
    }

    /// Counts bytes that arrived; refuses a request that takes too long, however steadily it
    /// comes.
    pub fn arrived(&mut self, bytes: usize) -> Result<(), Problem> {
        self.bytes += bytes as u64;
        let passed = self.began.elapsed();
        if passed >= self.most {
            return Err(self.too_long());
        }
        if passed > IDLE && (self.bytes as f64) < LEAST_RATE * passed.as_secs_f64() {
            let detail = format!("fewer than {LEAST_RATE} bytes a second arrived");
            return Err(Problem::too_slow(detail));
        }
        Ok(())
    }

    fn too_long(&self) -> Problem {
        let seconds = self.most.as_secs();
        Problem::too_slow(format!("the upload did not arrive within {seconds} seconds"))
    }
}

/// An unnamed temporary file that uploads are written to, one after the other.
pub struct Spool {
    app: App,
    file: tokio::fs::File,
    size: u64,
}

/// A stretch of a spool: what was uploaded as one.
pub struct Piece {
    start: u64,
    /// Bytes.
    pub size: u64,
    /// SHA-256 of them, in hex.
    pub sha256: String,
}

/// Refuses to write so many bytes more where the disk is short, or would be: many uploads that began
/// while it was not can fill it together.
pub fn check_disk(app: &App, bytes: u64) -> Result<(), Problem> {
    match app.shared.disk.shortage_for(bytes) {
        None => Ok(()),
        Some(detail) => {
            app.shared.metrics.count_refusal("disk");
            Err(Problem::disk_full(detail))
        }
    }
}

/// A new file in the data folder without a name.
pub async fn unnamed_file(app: &App) -> Result<File, Problem> {
    let folder = app.shared.config.data_dir.join("tmp");
    tokio::task::spawn_blocking(move || tempfile::tempfile_in(folder))
        .await
        .map_err(|error| Problem::internal(error.to_string()))?
        .map_err(disk_trouble)
}

impl Spool {
    /// An empty one.
    pub async fn new(app: &App) -> Result<Self, Problem> {
        let file = tokio::fs::File::from_std(unnamed_file(app).await?);
        Ok(Self { app: app.clone(), file, size: 0 })
    }

    /// Writes all of `chunks` behind what is there.
    pub async fn take<E>(
        &mut self,
        mut chunks: impl Stream<Item = Result<Bytes, E>> + Unpin,
        (allowance, pace): (&mut Allowance, &mut Pace),
        refuse: impl Fn(E) -> Problem,
    ) -> Result<Piece, Problem> {
        let start = self.size;
        let mut hash = Sha256::new();
        while let Some(chunk) = pace.next(chunks.next()).await? {
            let chunk = chunk.map_err(&refuse)?;
            pace.arrived(chunk.len())?;
            allowance.take(chunk.len())?;
            check_disk(&self.app, 0)?;
            self.size += chunk.len() as u64;
            hash.update(&chunk);
            self.file.write_all(&chunk).await.map_err(disk_trouble)?;
        }
        self.file.flush().await.map_err(disk_trouble)?;
        Ok(Piece { start, size: self.size - start, sha256: hex(&hash.finalize()) })
    }

    /// The file, whatever its position.
    pub async fn into_file(self) -> File {
        self.file.into_std().await
    }
}

impl Piece {
    /// Where the piece begins in its spool's file, and its bytes.
    pub fn place(&self) -> (u64, u64) {
        (self.start, self.size)
    }

    /// Reads the piece from its spool's file, without moving the file's position.
    pub fn reader<'a>(&self, file: &'a File) -> impl Read + use<'a> {
        Stretch { file, at: self.start, left: self.size }
    }
}

struct Stretch<'a> {
    file: &'a File,
    at: u64,
    left: u64,
}

impl Read for Stretch<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let wanted = buffer.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let got = self.file.read_at(&mut buffer[..wanted], self.at)?;
        (self.at, self.left) = (self.at + got as u64, self.left - got as u64);
        Ok(got)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::Hashing;
    use crate::hash::sha256_hex;
    use std::io::Write;

    #[tokio::test]
    async fn requests_must_keep_coming_and_come_to_an_end() {
        let since = |seconds: u64, bytes: u64| Pace {
            began: Instant::now() - Duration::from_secs(seconds),
            most: Duration::from_secs(600),
            bytes,
        };
        assert!(since(0, 0).next(std::future::ready(1)).await.is_ok());
        // The average counts after half a minute.
        assert!(since(20, 0).arrived(1).is_ok());
        assert!(since(60, 1).arrived(60_000).is_err());
        assert!(since(60, 3_000).arrived(60_000).is_ok());
        // However fast it comes, it must end.
        assert!(since(601, 1 << 30).arrived(1 << 30).is_err());
        assert!(since(600, 1 << 30).next(std::future::pending::<()>()).await.is_err());
    }

    #[test]
    fn pieces_read_what_was_written_and_hashes_are_of_it() {
        let mut file = Hashing::new(tempfile::tempfile().unwrap());
        file.write_all(b"one, two, three").unwrap();
        let (file, size, sha256) = file.finish();
        assert_eq!((size, sha256), (15, sha256_hex(b"one, two, three")));
        let piece = Piece { start: 5, size: 3, sha256: String::new() };
        let mut read = String::new();
        piece.reader(&file).read_to_string(&mut read).unwrap();
        assert_eq!(read, "two");
    }
}
