//! The files of a service: kept, read and removed by key.

use super::content::{Content, PIECE};
use super::error::{ArtifactError, failpoint};
use super::sound::VerifiedFiles;
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::local::LocalFileSystem;
use object_store::path::Path as Key;
use object_store::{GetResultPayload, MultipartUpload, ObjectMeta, ObjectStore, ObjectStoreExt};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// The files of one service.
#[derive(Clone)]
pub struct Artifacts {
    pub(super) store: Arc<dyn ObjectStore>,
    /// The local folder of the storage.
    pub(super) folder: PathBuf,
    /// When this process began to use them: what lies half-written from before is nobody's.
    pub(super) since: SystemTime,
    /// Which of them were found to be sound.
    pub(super) sound: Arc<VerifiedFiles>,
}

impl Artifacts {
    /// Files under a local folder, which is created.
    ///
    /// # Errors
    /// Where the folder cannot be created or used.
    pub fn local(folder: &Path) -> std::io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let store = LocalFileSystem::new_with_prefix(folder).map_err(std::io::Error::other)?;
        let store = Arc::new(store.with_fsync(true).with_automatic_cleanup(true));
        let since = SystemTime::now();
        Ok(Self { store, folder: folder.to_owned(), since, sound: Arc::default() })
    }

    /// Keeps content, all or nothing; durable on return.
    pub(super) async fn put(&self, key: &Key, content: Content) -> Result<(), ArtifactError> {
        failpoint("artifact", key)?;
        match content {
            Content::Bytes(bytes) => drop(self.store.put(key, bytes.into()).await?),
            Content::File(file) => self.put_file(key, file).await?,
        }
        failpoint("artifact-kept", key)
    }

    async fn put_file(&self, key: &Key, mut file: File) -> Result<(), ArtifactError> {
        file.rewind()?;
        let mut upload = self.store.put_multipart(key).await?;
        let done = match send(file, &mut *upload).await {
            Ok(()) => upload.complete().await.map(drop).map_err(ArtifactError::from),
            Err(error) => Err(error),
        };
        if done.is_err() {
            // What it had written is under no name that anyone reads.
            let _ = upload.abort().await;
        }
        done
    }

    /// Content as it is stored, which may be damaged; that of a local folder is its file, which can
    /// be read even where it is removed meanwhile.
    pub(super) async fn content(&self, key: &Key) -> Result<Content, ArtifactError> {
        let got = self.store.get(key).await?;
        Ok(match got.payload {
            GetResultPayload::File(file, _) => Content::File(file),
            GetResultPayload::Stream(pieces) => {
                let pieces: Vec<Bytes> = pieces.try_collect().await?;
                pieces.concat().into()
            }
        })
    }

    /// What the storage says of a file; nothing where there is none.
    pub(super) async fn head(&self, key: &Key) -> Result<Option<ObjectMeta>, ArtifactError> {
        match self.store.head(key).await {
            Ok(file) => Ok(Some(file)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Removes a file; its not being there is fine.
    pub(super) async fn remove(&self, key: &Key) -> Result<(), ArtifactError> {
        match self.store.delete(key).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Hands a file over piece by piece, each stored before the next is read.
async fn send(mut file: File, upload: &mut dyn MultipartUpload) -> Result<(), ArtifactError> {
    loop {
        let read = tokio::task::spawn_blocking(move || {
            let mut piece = Vec::with_capacity(PIECE);
            let got = (&mut file).take(PIECE as u64).read_to_end(&mut piece);
            got.map(|_| (file, piece))
        });
        let (rest, piece) = read.await.map_err(io::Error::other)??;
        if piece.is_empty() {
            return Ok(());
        }
        file = rest;
        upload.put_part(piece.into()).await?;
    }
}

#[cfg(test)]
impl Artifacts {
    /// Files in a folder that goes with the test.
    pub(super) fn of_test() -> (tempfile::TempDir, Self) {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Self::local(folder.path()).unwrap();
        (folder, artifacts)
    }
}
