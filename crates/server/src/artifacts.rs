//! Files: uploaded scenes and finished pictures. Content is hashed, written atomically and
//! fsynced before it is named anywhere.

mod kept;

use crate::api::jobs::{Picture, PictureFormat};
use bytes::Bytes;
use object_store::local::LocalFileSystem;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use sha2::{Digest, Sha256};
use std::path::Path;
use std::sync::Arc;
use uuid::Uuid;

/// Why a file could not be kept or found.
#[derive(Debug, thiserror::Error)]
#[error("artifacts: {0}")]
pub struct ArtifactError(#[from] object_store::Error);

impl ArtifactError {
    /// Whether there simply is no such file.
    pub fn is_not_found(&self) -> bool {
        matches!(self.0, object_store::Error::NotFound { .. })
    }
}

/// The files of one service.
#[derive(Clone)]
pub struct Artifacts {
    store: Arc<dyn ObjectStore>,
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
        Ok(Self { store: Arc::new(store.with_fsync(true)) })
    }

    /// Keeps a scene's bytes under its id.
    pub async fn put_scene(&self, id: &str, bytes: Bytes) -> Result<(), ArtifactError> {
        self.store.put(&scene_key(id), bytes.into()).await?;
        Ok(())
    }

    /// A scene's bytes.
    pub async fn scene(&self, id: &str) -> Result<Bytes, ArtifactError> {
        Ok(self.store.get(&scene_key(id)).await?.bytes().await?)
    }

    /// Keeps a picture of `job` and says where.
    pub async fn put_picture(
        &self,
        job: Uuid,
        format: PictureFormat,
        (width, height): (u32, u32),
        bytes: Vec<u8>,
    ) -> Result<Picture, ArtifactError> {
        let sha256 = sha256_hex(&bytes);
        let size = bytes.len() as u64;
        self.store.put(&picture_key(job, &sha256, format), bytes.into()).await?;
        let url = format!("/v1/jobs/{job}/snapshots/{sha256}.{}", format.suffix());
        Ok(Picture { format, url, sha256, size, width, height, base64: None })
    }

    /// A picture's bytes.
    pub async fn picture(
        &self,
        job: Uuid,
        sha256: &str,
        format: PictureFormat,
    ) -> Result<Bytes, ArtifactError> {
        Ok(self.store.get(&picture_key(job, sha256, format)).await?.bytes().await?)
    }

    /// Removes all pictures of a job; none being there is fine.
    pub async fn remove_job(&self, job: Uuid) -> Result<(), ArtifactError> {
        let folder = Key::from(format!("jobs/{job}"));
        let listed = self.store.list_with_delimiter(Some(&folder)).await?;
        for object in listed.objects {
            match self.store.delete(&object.location).await {
                Ok(()) | Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }
}

fn scene_key(id: &str) -> Key {
    Key::from(format!("scenes/{id}"))
}

fn picture_key(job: Uuid, sha256: &str, format: PictureFormat) -> Key {
    Key::from(format!("jobs/{job}/{sha256}.{}", format.suffix()))
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
        let bytes = artifacts.picture(job, &kept.sha256, PictureFormat::Png).await.unwrap();
        assert_eq!(&bytes[..], b"png");
        artifacts.remove_job(job).await.unwrap();
        artifacts.remove_job(job).await.unwrap();
        let gone = artifacts.picture(job, &kept.sha256, PictureFormat::Png).await;
        assert!(gone.unwrap_err().is_not_found());
    }
}
