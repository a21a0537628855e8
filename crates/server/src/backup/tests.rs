use super::*;
use crate::api::jobs::PictureFormat;
use crate::artifacts::Artifacts;
use crate::data_folder;
use crate::hash::sha256_hex;
use crate::job_state::JobState;
use crate::store::solutions::Solutions;
use crate::store::specimens;
use crate::store::sqlite::SqliteStore;
use crate::store::{Accepted, Outcome, Store};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use uuid::Uuid;

/// A data folder with a scene and jobs that have ended, each with a picture and a solution.
struct Used {
    folder: TempDir,
    store: SqliteStore,
    artifacts: Artifacts,
    jobs: Vec<Uuid>,
}

impl Used {
    async fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let data = folder.path().join("data");
        let (store, artifacts) = data_folder::open(&data, false).await.unwrap();
        let mut used = Self { folder, store, artifacts, jobs: Vec::new() };
        for number in 0..3 {
            used.accept(None).await;
            used.work(number).await;
        }
        used
    }

    /// A job that begins with a checkpoint, and perhaps with baked light.
    async fn accept(&mut self, baked: Option<serde_json::Value>) -> Uuid {
        let bytes = bytes::Bytes::from_static(b"scene");
        let scene = specimens::scene(&bytes);
        self.artifacts.put_scene(&scene.id, bytes).await.unwrap();
        self.store.put_scene(&scene).await.unwrap();
        let job = specimens::job(&scene.id);
        let id = job.id;
        let solution = serde_json::json!({
            "file": "a.checkpoint", "size": 5, "begins": "view", "method": "stochastic",
            "iterations": 1, "seconds": 1.0, "estimated_error": null, "baked": baked
        });
        let solution = serde_json::from_value(solution).unwrap();
        self.artifacts.put_kept(id, "a.checkpoint", b"light".to_vec()).await.unwrap();
        let accepted = self.store.accept_view(job, &solution, 100).await.unwrap();
        assert!(matches!(accepted, Accepted::New(_)));
        id
    }

    /// Ends the job that waits longest, with a picture.
    async fn work(&mut self, number: u8) -> Uuid {
        let (claim, _) =
            self.store.claim(&crate::store::conformance::fixture::ASKING).await.unwrap().unwrap();
        let picture =
            self.artifacts.put_picture(claim.job, PictureFormat::Png, (1, 1), vec![number]);
        let pictures = vec![picture.await.unwrap()];
        let outcome = Outcome { pictures, ..Outcome::of(JobState::Succeeded) };
        self.store.finish(claim, outcome).await.unwrap();
        self.jobs.push(claim.job);
        claim.job
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn picture(&self, job: usize) -> String {
        format!("jobs/{}/{}.png", self.jobs[job], sha256_hex(&[job as u8]))
    }
}

fn change(path: &Path) {
    let mut bytes = std::fs::read(path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(path, bytes).unwrap();
}

#[tokio::test]
async fn what_is_restored_is_what_was_there() {
    let used = Used::new().await;
    let deleted = used.jobs[0];
    used.store.delete(deleted).await.unwrap();
    // What no record names, and what is in quarantine, is no part of a backup.
    used.artifacts.put_scene(&sha256_hex(b"orphan"), bytes::Bytes::from("orphan")).await.unwrap();
    let taken = take(&used.data(), &used.path("backup")).await.unwrap();
    assert_eq!((taken.jobs, taken.scenes, taken.files), (2, 1, 5));
    assert!(taken.lost.is_empty() && taken.begin_afresh.is_empty());
    let restored = restore(&used.path("backup"), &used.path("new")).unwrap();
    assert_eq!(restored, taken);
    let (store, artifacts) = data_folder::open(&used.path("new"), false).await.unwrap();
    assert!(store.job(deleted).await.unwrap().is_none());
    for (number, job) in [(1, used.jobs[1]), (2, used.jobs[2])] {
        let record = store.job(job).await.unwrap().unwrap();
        assert_eq!(record.result, used.store.job(job).await.unwrap().unwrap().result);
        let sha256 = sha256_hex(&[number]);
        artifacts.picture(job, &sha256, PictureFormat::Png).await.unwrap();
        assert_eq!(
            artifacts.kept_file(job, "a.checkpoint").await.unwrap().into_bytes().unwrap(),
            "light"
        );
        artifacts.scene(&record.scene).await.unwrap();
    }
}

#[tokio::test]
async fn a_backup_is_not_restored_over_anything_nor_taken_over_anything() {
    let used = Used::new().await;
    let backup = used.path("backup");
    take(&used.data(), &backup).await.unwrap();
    let again = take(&used.data(), &backup).await.unwrap_err().to_string();
    assert!(again.contains("is not empty"), "{again}");
    let over = restore(&backup, &used.data()).unwrap_err().to_string();
    assert!(over.contains("is not empty"), "{over}");
    let new = used.path("new");
    let lock = data_folder::lock(&new).unwrap();
    let in_use = restore(&backup, &new).unwrap_err().to_string();
    assert!(in_use.contains("in use"), "{in_use}");
    drop(lock);
    restore(&backup, &new).unwrap();
    let none = restore(&used.path("nothing"), &used.path("other")).unwrap_err().to_string();
    assert!(none.contains("no backup"), "{none}");
    let none = take(&used.path("nothing"), &used.path("other")).await.unwrap_err().to_string();
    assert!(none.contains("no data folder"), "{none}");
    let left: Vec<_> = std::fs::read_dir(used.folder.path()).unwrap().collect();
    assert_eq!(left.len(), 3, "{left:?}");
}

/// A changed byte anywhere is found before anything is written.
#[tokio::test]
async fn a_damaged_backup_is_refused_whole() {
    let used = Used::new().await;
    let backup = used.path("backup");
    take(&used.data(), &backup).await.unwrap();
    let checkpoint = format!("{}/jobs/{}/a.checkpoint", data_folder::ARTIFACTS, used.jobs[1]);
    let picture = format!("{}/{}", data_folder::ARTIFACTS, used.picture(2));
    let refused = |what: &str| {
        let error = restore(&backup, &used.path("new")).unwrap_err();
        assert!(matches!(&error, BackupError::Damaged { .. }), "{what}: {error}");
        assert!(!used.path("new").join(data_folder::DATABASE).exists(), "{what}");
        assert!(!used.path("new").join(data_folder::ARTIFACTS).exists(), "{what}");
    };
    for name in [data_folder::DATABASE, FILES, &checkpoint, &picture] {
        let path = backup.join(name);
        let whole = std::fs::read(&path).unwrap();
        change(&path);
        refused(name);
        std::fs::remove_file(&path).unwrap();
        refused(name);
        std::fs::write(&path, whole).unwrap();
    }
    // A list that leads out of the folder, with a manifest that vouches for it.
    let (list, manifest) = (backup.join(FILES), backup.join(MANIFEST));
    let text = std::fs::read_to_string(&list).unwrap();
    let evil = text.replacen("artifacts/scenes/", "artifacts/scenes/../../", 1);
    let hash = |text: &str| sha256_hex(text.as_bytes());
    let vouched = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&list, &evil).unwrap();
    std::fs::write(&manifest, vouched.replace(&hash(&text), &hash(&evil))).unwrap();
    refused("a path that leads out");
    std::fs::write(&list, &text).unwrap();
    std::fs::write(&manifest, &vouched).unwrap();
    restore(&backup, &used.path("new")).unwrap();
}

/// What the data folder has lost is told, whatever it is, and what is left of it is kept.
#[tokio::test]
async fn what_the_data_folder_has_lost_is_told() {
    let used = Used::new().await;
    let files = used.data().join(data_folder::ARTIFACTS);
    let checkpoint = |job: usize| format!("jobs/{}/a.checkpoint", used.jobs[job]);
    std::fs::remove_file(files.join(used.picture(0))).unwrap();
    change(&files.join(used.picture(1)));
    std::fs::remove_file(files.join(checkpoint(2))).unwrap();
    let taken = take(&used.data(), &used.path("backup")).await.unwrap();
    let mut told = [
        format!("{}: is missing", used.picture(0)),
        format!("{}: is damaged", used.picture(1)),
        format!("{}: is missing, so it cannot be extended", checkpoint(2)),
    ];
    told.sort_unstable();
    assert_eq!(taken.lost, told);
    assert!(taken.begin_afresh.is_empty(), "these jobs have ended");
    restore(&used.path("backup"), &used.path("new")).unwrap();
    let (store, _) = data_folder::open(&used.path("new"), false).await.unwrap();
    assert_eq!(store.solution(used.jobs[2]).await.unwrap(), None);
    assert!(store.solution(used.jobs[1]).await.unwrap().is_some());
}

/// A job that waits begins afresh; light that cannot be had takes no checkpoint along.
#[tokio::test]
async fn a_waiting_job_begins_afresh_and_a_checkpoint_outlives_its_light() {
    let mut used = Used::new().await;
    let files = used.data().join(data_folder::ARTIFACTS);
    let baked = serde_json::json!({"file": "b.glb", "sha256": sha256_hex(b"b"), "size": 1});
    used.accept(Some(baked)).await;
    let waits = used.accept(None).await;
    std::fs::remove_file(files.join(format!("jobs/{waits}/a.checkpoint"))).unwrap();
    let with_light = used.work(9).await;
    let taken = take(&used.data(), &used.path("backup")).await.unwrap();
    assert_eq!(taken.lost, [format!("jobs/{with_light}/b.glb: is missing")]);
    assert_eq!(taken.begin_afresh, [waits]);
    restore(&used.path("backup"), &used.path("new")).unwrap();
    let (store, artifacts) = data_folder::open(&used.path("new"), false).await.unwrap();
    assert_eq!(store.solution(waits).await.unwrap(), None);
    let solution = store.solution(with_light).await.unwrap().unwrap();
    assert_eq!((solution.baked, solution.file.as_str()), (None, "a.checkpoint"));
    artifacts.kept_file(with_light, "a.checkpoint").await.unwrap();
}

/// The folder may be there, and the root of a disk: nothing is made outside it.
#[tokio::test]
async fn a_backup_into_an_empty_folder_is_made_in_there() {
    let used = Used::new().await;
    let to = used.path("disk");
    std::fs::create_dir(&to).unwrap();
    let around = || std::fs::read_dir(used.folder.path()).unwrap().count();
    let before = around();
    let taken = take(&used.data(), &to).await.unwrap();
    assert_eq!(around(), before);
    let mut names: Vec<_> =
        std::fs::read_dir(&to).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort_unstable();
    assert_eq!(names, [data_folder::ARTIFACTS, FILES, data_folder::DATABASE, MANIFEST]);
    assert_eq!(restore(&to, &used.path("new")).unwrap(), taken);
    // One that fails leaves the folder as it was.
    let other = used.path("other disk");
    std::fs::create_dir(&other).unwrap();
    used.artifacts.put_store_id(Uuid::new_v4()).await.unwrap();
    take(&used.data(), &other).await.unwrap_err();
    assert_eq!(std::fs::read_dir(&other).unwrap().count(), 0);
}

#[tokio::test]
async fn files_of_another_store_are_no_part_of_a_backup() {
    let used = Used::new().await;
    used.artifacts.put_store_id(Uuid::new_v4()).await.unwrap();
    let error = take(&used.data(), &used.path("backup")).await.unwrap_err().to_string();
    assert!(error.contains("do not belong together"), "{error}");
    assert!(!used.path("backup").exists());
}

/// Only the database is put back; the one of before stays whole beside it.
#[tokio::test]
async fn a_database_alone_comes_back_beside_its_files() {
    let mut used = Used::new().await;
    take(&used.data(), &used.path("backup")).await.unwrap();
    used.accept(None).await;
    let later = used.work(7).await;
    let database = used.data().join(data_folder::DATABASE);
    let beside = |path: &Path| PathBuf::from(format!("{}-wal", path.display()));
    assert!(beside(&database).exists(), "what is not in the file yet is beside it");
    // Those are the files of a server that was killed: nothing was merged.
    let former = restore_database(&used.path("backup"), &used.data()).unwrap().unwrap();
    assert!(beside(&former).exists() && !beside(&database).exists());
    let (store, _) = data_folder::open(&used.data(), false).await.unwrap();
    assert!(store.job(later).await.unwrap().is_none());
    assert!(store.job(used.jobs[0]).await.unwrap().is_some());
    assert!(SqliteStore::open(&former).await.unwrap().job(later).await.unwrap().is_some());
    // A changed backup, and files of another store, leave everything as it is.
    change(&used.path("backup").join(data_folder::DATABASE));
    restore_database(&used.path("backup"), &used.data()).unwrap_err();
    let other = Used::new().await;
    let error = restore_database(&used.path("backup"), &other.data()).unwrap_err().to_string();
    assert!(error.contains("are of store"), "{error}");
    assert!(other.store.job(other.jobs[0]).await.unwrap().is_some());
}
