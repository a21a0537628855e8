//! Files that no record names: how they are found, set aside and put back; and the id that says
//! which store the files belong to.
//!
//! What is set aside lies under `quarantine/` of the same storage, below a folder that is named
//! by the moment, so how long it has been there survives a restart.

use super::error::ArtifactError;
use super::files::Artifacts;
use super::keys::{FilePlace, KEPT_ENDINGS};
use crate::api::jobs::PictureFormat;
use futures_util::TryStreamExt;
use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use std::path::Path;
use std::time::SystemTime;
use uuid::Uuid;

/// The folder of what is set aside.
const QUARANTINE: &str = "quarantine";
/// How the moments of setting aside are written in names.
const MOMENT: &str = "%Y%m%dT%H%M%SZ";
/// The file that says which store the files belong to.
const STORE_ID: &str = "store-id";

/// A file that was set aside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetAside {
    /// When.
    pub at: Timestamp,
    /// Where it belongs.
    pub place: FilePlace,
}

impl SetAside {
    fn key(&self) -> Key {
        let moment = self.at.strftime(MOMENT);
        Key::from(format!("{QUARANTINE}/{moment}/{}", self.place.key()))
    }

    fn of(key: &Key) -> Option<Self> {
        let rest = key.as_ref().strip_prefix(QUARANTINE)?.strip_prefix('/')?;
        let (moment, place) = rest.split_once('/')?;
        let at = DateTime::strptime(MOMENT, moment).ok()?.to_zoned(TimeZone::UTC).ok()?;
        Some(Self { at: at.timestamp(), place: FilePlace::of(place)? })
    }
}

/// Whether a file of that name in a job's folder is of a kind that records name: another part may
/// keep files of its own there.
fn is_recorded_kind(name: &str) -> bool {
    let is_hash = |hash: &str| hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit());
    let is_picture = name
        .split_once('.')
        .is_some_and(|(hash, suffix)| is_hash(hash) && PictureFormat::parse(suffix).is_some());
    is_picture || KEPT_ENDINGS.iter().any(|ending| name.ends_with(ending))
}

impl Artifacts {
    /// Jobs that have files.
    pub async fn jobs_with_files(&self) -> Result<Vec<Uuid>, ArtifactError> {
        let listed = self.store.list_with_delimiter(Some(&Key::from("jobs"))).await?;
        let names = listed.common_prefixes.iter().filter_map(|folder| folder.filename());
        Ok(names.filter_map(|name| name.parse().ok()).collect())
    }

    /// Names of a job's files of the kinds that records name.
    pub async fn files_of(&self, job: Uuid) -> Result<Vec<String>, ArtifactError> {
        let folder = Key::from(format!("jobs/{job}"));
        let listed = self.store.list_with_delimiter(Some(&folder)).await?;
        let names = listed.objects.iter().filter_map(|file| file.location.filename());
        Ok(names.filter(|name| is_recorded_kind(name)).map(str::to_owned).collect())
    }

    /// Ids of scenes that have files.
    pub async fn scenes_with_files(&self) -> Result<Vec<String>, ArtifactError> {
        let listed = self.store.list_with_delimiter(Some(&Key::from("scenes"))).await?;
        let names = listed.objects.iter().filter_map(|file| file.location.filename());
        Ok(names.map(str::to_owned).collect())
    }

    /// Whether there is any file of a scene or a job.
    pub async fn any_files(&self) -> Result<bool, ArtifactError> {
        for folder in ["scenes", "jobs"] {
            if self.store.list(Some(&Key::from(folder))).try_next().await?.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Moves a file out of the way, as one that no record names.
    pub async fn set_aside(&self, file: &SetAside) -> Result<(), ArtifactError> {
        self.store.rename(&file.place.key(), &file.key()).await?;
        if let FilePlace::Job(job, _) = &file.place {
            // The last one leaves an empty folder behind, which says nothing to anybody.
            let _ = std::fs::remove_dir(self.folder.join("jobs").join(job.to_string()));
        }
        Ok(())
    }

    /// Puts a file back where it belongs, unless there is one already; whether it did.
    pub async fn put_back(&self, file: &SetAside) -> Result<bool, ArtifactError> {
        if self.head(&file.place.key()).await?.is_some() {
            return Ok(false);
        }
        self.store.rename(&file.key(), &file.place.key()).await?;
        Ok(true)
    }

    /// All that is set aside.
    pub async fn all_set_aside(&self) -> Result<Vec<SetAside>, ArtifactError> {
        let files = self.store.list(Some(&Key::from(QUARANTINE)));
        let files: Vec<_> = files.map_ok(|file| SetAside::of(&file.location)).try_collect().await?;
        Ok(files.into_iter().flatten().collect())
    }

    /// Removes what was set aside, for ever.
    pub async fn remove_set_aside(&self, file: &SetAside) -> Result<(), ArtifactError> {
        self.remove(&file.key()).await
    }

    /// The id of the store that the files belong to; `None` where they bear none.
    pub async fn store_id(&self) -> Result<Option<String>, ArtifactError> {
        match self.store.get(&Key::from(STORE_ID)).await {
            Ok(file) => {
                let bytes = file.bytes().await?;
                Ok(Some(String::from_utf8_lossy(&bytes).trim().to_owned()))
            }
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Makes the files bear the id of a store; durable on return.
    pub async fn put_store_id(&self, id: Uuid) -> Result<(), ArtifactError> {
        self.store.put(&Key::from(STORE_ID), format!("{id}\n").into()).await?;
        Ok(())
    }

    /// Removes what an earlier process left half-written; how many files.
    pub async fn remove_half_written(&self) -> std::io::Result<u64> {
        let (folder, since) = (self.folder.clone(), self.since);
        let removed = tokio::task::spawn_blocking(move || remove_half_written(&folder, since));
        removed.await.map_err(std::io::Error::other)?
    }
}

/// The storage writes to `name#1` and renames. A clock that jumps back meanwhile can make a file
/// look older than it is: then its writer hears that it failed, and tries again.
fn remove_half_written(folder: &Path, since: SystemTime) -> std::io::Result<u64> {
    let mut removed = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.rsplit_once('#')).map(|(_, n)| n);
        let is_half =
            number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
        // Whatever is gone when it is looked at was removed by somebody else.
        let Ok(about) = entry.metadata() else { continue };
        if about.is_dir() {
            removed += remove_half_written(&entry.path(), since).unwrap_or(0);
        } else if is_half && about.modified()? < since {
            std::fs::remove_file(entry.path())?;
            removed += 1;
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_is_set_aside_keeps_its_moment_and_comes_back() {
        let (folder, artifacts) = Artifacts::of_test();
        let job = Uuid::now_v7();
        let png = PictureFormat::Png;
        let kept = artifacts.put_picture(job, png, (2, 1), b"png".to_vec()).await.unwrap();
        let name = crate::artifacts::picture_file(&kept.sha256, png);
        assert_eq!(artifacts.files_of(job).await.unwrap(), std::slice::from_ref(&name));
        let at = Timestamp::from_second(1_700_000_000).unwrap();
        let file = SetAside { at, place: FilePlace::Job(job, name) };
        artifacts.set_aside(&file).await.unwrap();
        assert!(!artifacts.any_files().await.unwrap());
        assert!(artifacts.jobs_with_files().await.unwrap().is_empty());
        let reopened = Artifacts::local(folder.path()).unwrap();
        assert_eq!(reopened.all_set_aside().await.unwrap(), std::slice::from_ref(&file));
        assert!(reopened.put_back(&file).await.unwrap());
        artifacts.picture(job, &kept.sha256, png).await.unwrap();
        assert_eq!(reopened.all_set_aside().await.unwrap(), []);
    }

    #[tokio::test]
    async fn only_what_an_earlier_process_left_half_written_goes() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("jobs/one")).unwrap();
        let (old, new) = (folder.path().join("jobs/one/a#1"), folder.path().join("b#2"));
        std::fs::write(&old, b"half").unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
        let artifacts = Artifacts::local(folder.path()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
        std::fs::write(&new, b"being written").unwrap();
        assert_eq!(artifacts.remove_half_written().await.unwrap(), 1);
        assert!(!old.exists() && new.exists());
    }
}
