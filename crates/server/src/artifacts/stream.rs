//! Files that are sent piece by piece, so that no reader, however slow, holds a whole one in memory.
//!
//! A file is read and compared with its hash before any of it is sent: once for as long as it keeps
//! its size and its time, not once a request.

use super::content::Content;
use super::error::{ArtifactError, damaged};
use super::files::Artifacts;
use super::keys::{kept_key, picture_key};
use super::sound::Stamp;
use crate::api::jobs::PictureFormat;
use crate::api::solutions::KeptFile;
use crate::hash::hex;
use bytes::Bytes;
use futures_util::stream::BoxStream;
use futures_util::{StreamExt, TryStreamExt};
use object_store::path::Path as Key;
use object_store::{
    GetOptions, GetRange, GetResult, GetResultPayload, ObjectMeta, ObjectStore, ObjectStoreExt,
};
use sha2::{Digest, Sha256};
use std::io::SeekFrom;
use std::ops::Range;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;
use uuid::Uuid;

/// What is read and sent at once, bytes.
const PIECE: usize = 64 << 10;
/// A file that is open and known to be sound.
pub struct Opened {
    /// Its bytes.
    pub size: u64,
    key: Key,
    artifacts: Artifacts,
    payload: GetResultPayload,
}

impl Opened {
    /// The bytes of `range`, which must lie within the file, piece by piece.
    ///
    /// # Errors
    /// Where the storage does not give them.
    pub async fn pieces(
        self,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, Result<Bytes, ArtifactError>>, ArtifactError> {
        match self.payload {
            // Open files can be read on even where they are removed meanwhile.
            GetResultPayload::File(file, _) => {
                let mut file = tokio::fs::File::from_std(file);
                file.seek(SeekFrom::Start(range.start)).await?;
                let part = file.take(range.end - range.start);
                let pieces = ReaderStream::with_capacity(part, PIECE);
                Ok(pieces.map_err(ArtifactError::from).boxed())
            }
            GetResultPayload::Stream(_) => {
                let range = Some(GetRange::Bounded(range));
                let options = GetOptions { range, ..GetOptions::default() };
                let got = self.artifacts.store.get_opts(&self.key, options).await?;
                Ok(got.into_stream().map_err(ArtifactError::from).boxed())
            }
        }
    }

    /// All of it; for files that are known to be small.
    ///
    /// # Errors
    /// Where the storage does not give it.
    pub async fn whole(self) -> Result<Vec<u8>, ArtifactError> {
        let size = self.size;
        let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
        let mut pieces = self.pieces(0..size).await?;
        while let Some(piece) = pieces.try_next().await? {
            bytes.extend_from_slice(&piece);
        }
        Ok(bytes)
    }
}

impl Artifacts {
    /// Opens a picture to send it.
    ///
    /// # Errors
    /// Where it is not there, is damaged, or the storage does not answer.
    pub async fn open_picture(
        &self,
        job: Uuid,
        sha256: &str,
        format: PictureFormat,
    ) -> Result<Opened, ArtifactError> {
        self.open(picture_key(job, sha256, format), sha256).await
    }

    /// A picture's bytes, checked against their hash; for pictures that are known to be small.
    ///
    /// # Errors
    /// As [`Artifacts::open_picture`].
    pub async fn picture(
        &self,
        job: Uuid,
        sha256: &str,
        format: PictureFormat,
    ) -> Result<Bytes, ArtifactError> {
        Ok(self.open_picture(job, sha256, format).await?.whole().await?.into())
    }

    /// Opens a kept file whose hash is known to send it.
    ///
    /// # Errors
    /// Where it is not there, is damaged, or the storage does not answer.
    pub async fn open_kept(&self, job: Uuid, file: &KeptFile) -> Result<Opened, ArtifactError> {
        self.open(kept_key(job, &file.file), &file.sha256).await
    }

    async fn open(&self, key: Key, sha256: &str) -> Result<Opened, ArtifactError> {
        let GetResult { payload, meta, .. } = self.store.get(&key).await?;
        self.verify(&key, &meta, sha256).await?;
        Ok(Opened { size: meta.size, key, artifacts: self.clone(), payload })
    }

    /// Makes sure that a file with these figures has the content that it should have.
    pub(super) async fn verify(
        &self,
        key: &Key,
        meta: &ObjectMeta,
        sha256: &str,
    ) -> Result<(), ArtifactError> {
        let stamp = Stamp::of(meta);
        if self.sound.knows(key, &stamp) {
            return Ok(());
        }
        let closed = |_| std::io::Error::other("no turn to read the file");
        let turn = self.sound.turns.clone().acquire_owned().await.map_err(closed)?;
        // Whoever had the turn before may have read the same file.
        if self.sound.knows(key, &stamp) {
            return Ok(());
        }
        let (artifacts, own_key, expected) = (self.clone(), key.clone(), sha256.to_owned());
        // A task of its own: a client that goes away in the middle gives no turn back early.
        let reading = tokio::spawn(async move {
            let _turn = turn;
            let got = artifacts.store.get(&own_key).await?;
            let is_the_same = Stamp::of(&got.meta) == stamp;
            let is_sound = hash(got).await? == expected;
            // Another file of the same content took its place: sound, but to be looked at again.
            if is_sound && is_the_same {
                artifacts.sound.remember(own_key, stamp);
            }
            Ok::<_, ArtifactError>(is_sound)
        });
        match reading.await {
            Ok(Ok(true)) => Ok(()),
            Ok(Ok(false)) => Err(damaged(key)),
            Ok(Err(error)) => Err(error),
            Err(error) => Err(std::io::Error::other(error).into()),
        }
    }
}

/// SHA-256 of a file in hex, read piece by piece.
async fn hash(got: GetResult) -> Result<String, ArtifactError> {
    match got.payload {
        GetResultPayload::File(file, _) => {
            let (_, _, sha256) = Content::from(file).hashed().await?;
            Ok(sha256)
        }
        GetResultPayload::Stream(mut pieces) => {
            let mut hasher = Sha256::new();
            while let Some(piece) = pieces.try_next().await? {
                hasher.update(&piece);
            }
            Ok(hex(&hasher.finalize()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sound::HASHINGS_AT_ONCE;
    use super::*;

    async fn parts(opened: Opened, range: Range<u64>) -> (Vec<u8>, usize) {
        let pieces: Vec<Bytes> = opened.pieces(range).await.unwrap().try_collect().await.unwrap();
        let longest = pieces.iter().map(Bytes::len).max().unwrap_or(0);
        (pieces.concat(), longest)
    }

    #[tokio::test]
    async fn files_come_in_pieces_and_in_part() {
        let (_folder, artifacts) = Artifacts::of_test();
        let (job, png) = (Uuid::now_v7(), PictureFormat::Png);
        let content: Vec<u8> = (0..300_000u32).map(|i| (i / 7) as u8).collect();
        let kept = artifacts.put_picture(job, png, (2, 1), content.clone()).await.unwrap();
        let open = || artifacts.open_picture(job, &kept.sha256, png);
        let (whole, longest) = parts(open().await.unwrap(), 0..300_000).await;
        assert!(whole == content && longest <= PIECE, "{longest}");
        for range in [0..1, 70_000..200_001, 299_999..300_000, 5..5] {
            let (part, _) = parts(open().await.unwrap(), range.clone()).await;
            assert!(part == content[range.start as usize..range.end as usize], "{range:?}");
        }
        assert_eq!(open().await.unwrap().whole().await.unwrap(), content);
        // Removed while it is read: what was begun goes on.
        let opened = open().await.unwrap();
        artifacts.remove_job(job).await.unwrap();
        assert_eq!(parts(opened, 0..300_000).await.0, content);
        assert!(open().await.err().unwrap().is_not_found());
    }

    #[tokio::test]
    async fn a_file_is_hashed_once_until_it_changes() {
        let (folder, artifacts) = Artifacts::of_test();
        let (job, png) = (Uuid::now_v7(), PictureFormat::Png);
        let kept = artifacts.put_picture(job, png, (2, 1), b"png".to_vec()).await.unwrap();
        let open = || artifacts.open_picture(job, &kept.sha256, png);
        let file = folder.path().join(format!("jobs/{job}/{}.png", kept.sha256));
        let key = picture_key(job, &kept.sha256, png);
        open().await.unwrap();
        let stamp = Stamp::of(&artifacts.store.head(&key).await.unwrap());
        assert!(artifacts.sound.knows(&key, &stamp));
        // With all turns taken, only what needs no hashing is opened.
        let turns = artifacts.sound.turns.clone();
        let all = turns.acquire_many(HASHINGS_AT_ONCE as u32).await.unwrap();
        open().await.unwrap();
        drop(all);
        // Another content, of the same size and a second later.
        std::fs::write(&file, b"pnf").unwrap();
        let later = std::time::SystemTime::now() + std::time::Duration::from_secs(1);
        std::fs::File::options().write(true).open(&file).unwrap().set_modified(later).unwrap();
        for _ in 0..2 {
            let damaged = open().await.err().unwrap();
            assert!(damaged.is_lasting() && !damaged.is_not_found(), "{damaged}");
        }
        std::fs::write(&file, b"png").unwrap();
        open().await.unwrap();
    }
}
