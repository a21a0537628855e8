//! Files: uploaded scenes and finished pictures. Content is hashed, written atomically and
//! fsynced before it is named anywhere.

mod content;
mod kept;
mod orphans;
mod stream;

pub use content::{Content, Hashing};
pub use orphans::{Place, SetAside};
pub use stream::Opened;

use crate::api::jobs::{Picture, PictureFormat};
use crate::failpoints;
use futures_util::TryStreamExt;
use object_store::local::LocalFileSystem;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;
use uuid::Uuid;

/// Why a file could not be kept or found.
#[derive(Debug, thiserror::Error)]
pub enum ArtifactError {
    /// The storage refused or is unreachable.
    #[error("artifacts: {0}")]
    Storage(#[from] object_store::Error),
    /// What is to be stored, or was stored, cannot be read.
    #[error("artifacts: {0}")]
    Unreadable(#[from] std::io::Error),
    /// The file is there, but its content is not what was stored.
    #[error("artifacts: {file} is damaged; restore it from a backup")]
    Damaged {
        /// Where it lies, relative to the folder of files.
        file: String,
    },
}

impl ArtifactError {
    /// Whether there simply is no such file.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Storage(object_store::Error::NotFound { .. }))
    }

    /// Whether trying again cannot help: the file is lost or damaged.
    pub fn is_lasting(&self) -> bool {
        self.is_not_found() || matches!(self, Self::Damaged { .. })
    }
}

/// The files of one service.
#[derive(Clone)]
pub struct Artifacts {
    store: Arc<dyn ObjectStore>,
    /// The local folder of the storage.
    folder: PathBuf,
    /// When this process began to use them: what lies half-written from before is nobody's.
    since: SystemTime,
    sound: Arc<stream::Sound>,
}

/// SHA-256 in hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Bytes in lower-case hex.
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
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

    /// Whether a scene's file is there with that many bytes; says nothing about their content.
    pub async fn has_scene(&self, id: &str, size: u64) -> Result<bool, ArtifactError> {
        match self.store.head(&scene_key(id)).await {
            Ok(file) => Ok(file.size == size),
            Err(object_store::Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Keeps a picture of `job` and says where.
    pub async fn put_picture(
        &self,
        job: Uuid,
        format: PictureFormat,
        (width, height): (u32, u32),
        file: impl Into<Content>,
    ) -> Result<Picture, ArtifactError> {
        let (file, size, sha256) = file.into().hashed().await?;
        self.put(&picture_key(job, &sha256, format), file).await?;
        let url = picture_url(job, &sha256, format);
        Ok(Picture { format, url, sha256, size, width, height, base64: None })
    }

    /// Keeps a picture of one job for another one too, and says where. Each can be removed
    /// without the other; a local folder holds the content once.
    pub async fn share_picture(
        &self,
        from: Uuid,
        to: Uuid,
        picture: &Picture,
    ) -> Result<Picture, ArtifactError> {
        let Picture { sha256, format, .. } = picture;
        let source = picture_key(from, sha256, *format);
        let meta = self.store.head(&source).await?;
        self.verify(&source, &meta, sha256).await?;
        self.store.copy(&source, &picture_key(to, sha256, *format)).await?;
        Ok(Picture { url: picture_url(to, sha256, *format), ..picture.clone() })
    }

    /// Removes a picture of a job; its not being there is fine.
    pub async fn remove_picture(&self, job: Uuid, picture: &Picture) -> Result<(), ArtifactError> {
        self.remove(&picture_key(job, &picture.sha256, picture.format)).await
    }

    /// Removes all files of a job; none being there is fine.
    pub async fn remove_job(&self, job: Uuid) -> Result<(), ArtifactError> {
        let folder = Key::from(format!("jobs/{job}"));
        let files: Vec<_> = self.store.list(Some(&folder)).try_collect().await?;
        for file in files {
            self.remove(&file.location).await?;
        }
        Ok(())
    }

    /// Removes a scene's file; its not being there is fine.
    pub async fn remove_scene(&self, id: &str) -> Result<(), ArtifactError> {
        self.remove(&scene_key(id)).await
    }

    async fn remove(&self, key: &Key) -> Result<(), ArtifactError> {
        match self.store.delete(key).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Where a test may make the storage fail or the program die.
fn failpoint(point: &'static str, key: &Key) -> Result<(), ArtifactError> {
    failpoints::pass(point, || key.to_string()).map_err(|injected| {
        object_store::Error::Generic { store: "failpoint", source: Box::new(injected) }.into()
    })
}

/// Says that a file is damaged, to the log too.
fn damaged(key: &Key) -> ArtifactError {
    tracing::error!(file = %key, "a stored file is damaged");
    ArtifactError::Damaged { file: key.to_string() }
}

fn picture_url(job: Uuid, sha256: &str, format: PictureFormat) -> String {
    format!("/v1/jobs/{job}/snapshots/{sha256}.{}", format.suffix())
}

fn scene_key(id: &str) -> Key {
    Key::from(format!("scenes/{id}"))
}

fn picture_key(job: Uuid, sha256: &str, format: PictureFormat) -> Key {
    Key::from(format!("jobs/{job}/{}", picture_file(sha256, format)))
}

/// The name of a picture's file in its job's folder.
pub fn picture_file(sha256: &str, format: PictureFormat) -> String {
    format!("{sha256}.{}", format.suffix())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_the_published_ones() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256_hex(b"abc"), abc);
    }

    #[tokio::test]
    async fn pictures_come_back_until_removed() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::local(folder.path()).unwrap();
        let job = Uuid::now_v7();
        let kept =
            artifacts.put_picture(job, PictureFormat::Png, (2, 1), b"png".to_vec()).await.unwrap();
        assert_eq!(kept.size, 3);
        let opened = artifacts.open_picture(job, &kept.sha256, PictureFormat::Png).await.unwrap();
        assert_eq!(opened.whole().await.unwrap(), b"png");
        artifacts.remove_job(job).await.unwrap();
        artifacts.remove_job(job).await.unwrap();
        let gone = artifacts.open_picture(job, &kept.sha256, PictureFormat::Png).await;
        assert!(gone.err().unwrap().is_not_found());
    }

    #[tokio::test]
    async fn shared_pictures_outlive_each_other_and_damage_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::local(folder.path()).unwrap();
        let (first, second) = (Uuid::now_v7(), Uuid::now_v7());
        let png = PictureFormat::Png;
        let kept = artifacts.put_picture(first, png, (2, 1), b"png".to_vec()).await.unwrap();
        let shared = artifacts.share_picture(first, second, &kept).await.unwrap();
        assert!(shared.url.contains(&second.to_string()) && shared.sha256 == kept.sha256);
        artifacts.remove_job(first).await.unwrap();
        let opened = artifacts.open_picture(second, &shared.sha256, png).await.unwrap();
        assert_eq!(opened.whole().await.unwrap(), b"png");
        let file = folder.path().join(format!("jobs/{second}/{}.png", shared.sha256));
        std::fs::write(&file, b"damage").unwrap();
        let damaged = artifacts.open_picture(second, &shared.sha256, png).await.err().unwrap();
        assert!(damaged.is_lasting() && !damaged.is_not_found(), "{damaged}");
        assert!(damaged.to_string().contains(&shared.sha256), "{damaged}");
        assert!(artifacts.share_picture(second, first, &shared).await.is_err());
    }
}
