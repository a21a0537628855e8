//! What is kept of a job beside its pictures. The files lie in the job's folder and go with it.

use super::{ArtifactError, Artifacts, failpoint};
use bytes::Bytes;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use uuid::Uuid;

/// How the names of kept files end.
pub(super) const ENDINGS: [&str; 2] = [".checkpoint", ".glb"];

pub(super) fn key(job: Uuid, file: &str) -> Key {
    Key::from(format!("jobs/{job}/{file}"))
}

impl Artifacts {
    /// Keeps a file of a job; durable on return.
    pub async fn put_kept(
        &self,
        job: Uuid,
        file: &str,
        bytes: Vec<u8>,
    ) -> Result<(), ArtifactError> {
        self.put(&key(job, file), bytes.into()).await
    }

    /// A kept file.
    pub async fn kept(&self, job: Uuid, file: &str) -> Result<Bytes, ArtifactError> {
        let key = key(job, file);
        failpoint("kept-read", &key)?;
        Ok(self.store.get(&key).await?.bytes().await?)
    }

    /// Keeps a file of one job for another one too: each can be removed without the other.
    pub async fn share_kept(&self, from: Uuid, file: &str, to: Uuid) -> Result<(), ArtifactError> {
        self.store.copy(&key(from, file), &key(to, file)).await?;
        Ok(())
    }

    /// Removes what a dead process has left half done: kept files that are not among those that are
    /// recorded.
    pub async fn tidy_kept(&self, job: Uuid, recorded: &[&str]) -> Result<(), ArtifactError> {
        let folder = Key::from(format!("jobs/{job}"));
        for object in self.store.list_with_delimiter(Some(&folder)).await?.objects {
            let name = object.location.filename().unwrap_or_default();
            let kept = ENDINGS.iter().any(|ending| name.ends_with(ending));
            if kept && !recorded.contains(&name) {
                self.remove_kept(job, name).await?;
            }
        }
        Ok(())
    }

    /// Removes a kept file; none being there is fine.
    pub async fn remove_kept(&self, job: Uuid, file: &str) -> Result<(), ArtifactError> {
        match self.store.delete(&key(job, file)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}
