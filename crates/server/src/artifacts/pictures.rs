//! Pictures of jobs, each named by the SHA-256 of its file.

use super::content::Content;
use super::error::ArtifactError;
use super::files::Artifacts;
use super::keys::{picture_key, picture_url};
use crate::api::jobs::{Picture, PictureFormat};
use futures_util::TryStreamExt;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use uuid::Uuid;

impl Artifacts {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn pictures_come_back_until_removed() {
        let (_folder, artifacts) = Artifacts::of_test();
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
        let (folder, artifacts) = Artifacts::of_test();
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
