//! What is kept of a job beside its pictures. The files lie in the job's folder and go with it.

use super::content::Content;
use super::error::{ArtifactError, failpoint};
use super::files::Artifacts;
use super::keys::{FilePlace, KEPT_ENDINGS, kept_key};
use super::orphans::SetAside;
use jiff::Timestamp;
use object_store::ObjectStoreExt;
use uuid::Uuid;

impl Artifacts {
    /// Keeps a file of a job; durable on return.
    pub async fn put_kept(
        &self,
        job: Uuid,
        file: &str,
        content: impl Into<Content>,
    ) -> Result<(), ArtifactError> {
        self.put(&kept_key(job, file), content.into()).await
    }

    /// A kept file. It was read once when this returns: a storage that does not give it shows here,
    /// not in the middle of its use.
    pub async fn kept_file(&self, job: Uuid, file: &str) -> Result<Content, ArtifactError> {
        let key = kept_key(job, file);
        failpoint("kept-read", &key)?;
        let (content, ..) = self.content(&key).await?.hashed().await?;
        Ok(content)
    }

    /// Keeps a file of one job for another one too: each can be removed without the other.
    pub async fn share_kept(&self, from: Uuid, file: &str, to: Uuid) -> Result<(), ArtifactError> {
        self.store.copy(&kept_key(from, file), &kept_key(to, file)).await?;
        Ok(())
    }

    /// Sets aside kept files that are not among those that are recorded: a dead process has left
    /// them, or the database is an older one that does not know them.
    pub async fn tidy_kept(
        &self,
        job: Uuid,
        recorded: &[&str],
        now: Timestamp,
    ) -> Result<(), ArtifactError> {
        for name in self.files_of(job).await? {
            let is_kept = KEPT_ENDINGS.iter().any(|ending| name.ends_with(ending));
            if is_kept && !recorded.contains(&name.as_str()) {
                let place = FilePlace::Job(job, name);
                self.set_aside(&SetAside { at: now, place }).await?;
            }
        }
        Ok(())
    }

    /// Removes a kept file; none being there is fine.
    pub async fn remove_kept(&self, job: Uuid, file: &str) -> Result<(), ArtifactError> {
        self.remove(&kept_key(job, file)).await
    }
}
