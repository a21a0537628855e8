//! A consistent copy of a database that may be in use, and the files that its records name.

use super::database::SqliteStore;
use super::{retention, rows, solutions, tables};
use crate::api::jobs::Picture;
use crate::api::solutions::Solution;
use crate::artifacts::{FilePlace, picture_file};
use crate::store::StoreError;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteRow};
use sqlx::{ConnectOptions, Connection, Row};
use std::path::Path;
use uuid::Uuid;

/// Records read together.
const PAGE: u32 = 500;

/// A file that a record names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFile {
    /// Where it belongs.
    pub place: FilePlace,
    /// SHA-256 of its content in hex; `None` for checkpoints, whose records know only their size.
    pub sha256: Option<String>,
    /// Its bytes.
    pub size: u64,
    /// What it is.
    pub kind: Kind,
}

/// What a file is that a record names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A scene, a map of a sky or a picture.
    Content,
    /// What a job goes on from; without it, it begins afresh.
    Checkpoint,
    /// Light of surfaces, made when a job ends.
    Baked,
}

/// What a copy holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Facts {
    /// The id of the store.
    pub store_id: Uuid,
    /// Jobs, without those that are deleted.
    pub jobs: u64,
    /// Scenes.
    pub scenes: u64,
}

/// A copy of a database.
pub struct Snapshot {
    connection: SqliteConnection,
}

impl Snapshot {
    /// Copies the database `live` as it is at one moment into the new file `copy`; whoever writes
    /// to `live` meanwhile is not held up.
    ///
    /// # Errors
    /// Where `live` is not of this version, or one of them cannot be read or written.
    pub async fn take(live: &Path, copy: &Path) -> Result<Self, StoreError> {
        let mut connection = SqliteStore::options(live).connect().await?;
        tables::check_version(&mut connection).await?;
        let target = copy.to_string_lossy().into_owned();
        sqlx::query("VACUUM INTO ?").bind(target).execute(&mut connection).await?;
        connection.close().await?;
        Self::open(copy).await
    }

    /// Opens a copy that was taken before.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn open(copy: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(copy)
            // One file, with nothing beside it.
            .journal_mode(SqliteJournalMode::Delete)
            .foreign_keys(true);
        Ok(Self { connection: options.connect().await? })
    }

    /// What it holds.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn facts(&mut self) -> Result<Facts, StoreError> {
        let row = sqlx::query(
            "SELECT (SELECT count(*) FROM jobs WHERE deleted_ms IS NULL) AS jobs,
                    (SELECT count(*) FROM scenes WHERE kind = 'scene') AS scenes",
        )
        .fetch_one(&mut self.connection)
        .await?;
        Ok(Facts {
            store_id: tables::store_id(&mut self.connection).await?,
            jobs: row.get::<i64, _>("jobs").unsigned_abs(),
            scenes: row.get::<i64, _>("scenes").unsigned_abs(),
        })
    }

    /// Jobs that ran at that moment: their checkpoints are replaced as they go on.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn running(&mut self) -> Result<Vec<Uuid>, StoreError> {
        let query = "SELECT id FROM jobs WHERE state = 'running' AND deleted_ms IS NULL";
        let found = sqlx::query(query).fetch_all(&mut self.connection).await?;
        found.iter().map(id).collect()
    }

    /// Some jobs that are not deleted, in order, beginning after one.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn jobs(&mut self, after: Option<Uuid>) -> Result<Vec<Uuid>, StoreError> {
        let found = sqlx::query(
            "SELECT id FROM jobs WHERE deleted_ms IS NULL AND id > ? ORDER BY id LIMIT ?",
        )
        .bind(after.map(|id| id.to_string()).unwrap_or_default())
        .bind(PAGE)
        .fetch_all(&mut self.connection)
        .await?;
        found.iter().map(id).collect()
    }

    /// The files that the records of a job name.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn files_of(&mut self, job: Uuid) -> Result<Vec<NamedFile>, StoreError> {
        let query = "SELECT record FROM pictures WHERE job_id = ? GROUP BY sha256, format";
        let found =
            sqlx::query(query).bind(job.to_string()).fetch_all(&mut self.connection).await?;
        let mut files = Vec::new();
        for row in found {
            let picture: Picture = rows::from_json("picture", row.get("record"))?;
            let name = picture_file(&picture.sha256, picture.format);
            files.push(NamedFile {
                place: FilePlace::Job(job, name),
                sha256: Some(picture.sha256),
                size: picture.size,
                kind: Kind::Content,
            });
        }
        let solution = solutions::find(&mut self.connection, job).await?;
        files.extend(solution.into_iter().flat_map(|solution| files_of_solution(job, solution)));
        Ok(files)
    }

    /// The files of some scenes, and maps of skies, in order, beginning after one.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn scenes(&mut self, after: &str) -> Result<Vec<NamedFile>, StoreError> {
        let query = "SELECT id, json_extract(record, '$.size') AS size FROM scenes
             WHERE id > ? ORDER BY id LIMIT ?";
        let found =
            sqlx::query(query).bind(after).bind(PAGE).fetch_all(&mut self.connection).await?;
        let file = |row: &SqliteRow| {
            let id: String = row.get("id");
            NamedFile {
                place: FilePlace::Scene(id.clone()),
                sha256: Some(id),
                size: row.get::<i64, _>("size").unsigned_abs(),
                kind: Kind::Content,
            }
        };
        Ok(found.iter().map(file).collect())
    }

    /// Whether that file is one that a record names.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn names(&mut self, place: &FilePlace) -> Result<bool, StoreError> {
        match place {
            FilePlace::Scene(scene) => {
                let query = sqlx::query("SELECT 1 FROM scenes WHERE id = ?").bind(scene);
                Ok(query.fetch_optional(&mut self.connection).await?.is_some())
            }
            FilePlace::Job(job, name) => {
                let query = sqlx::query("SELECT 1 FROM jobs WHERE id = ? AND deleted_ms IS NULL");
                let query = query.bind(job.to_string());
                if query.fetch_optional(&mut self.connection).await?.is_none() {
                    return Ok(false);
                }
                let names = retention::file_names(&mut self.connection, *job).await?;
                Ok(names.contains(name))
            }
        }
    }

    /// Whether a job has ended.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn has_ended(&mut self, job: Uuid) -> Result<bool, StoreError> {
        let query = sqlx::query("SELECT state FROM jobs WHERE id = ?").bind(job.to_string());
        let row = query.fetch_optional(&mut self.connection).await?;
        row.map_or(Ok(false), |row| Ok(rows::state(row.get("state"))?.is_terminal()))
    }

    /// Forgets what the copy knows of a job's solution: the job begins afresh, and one that has
    /// ended cannot be extended.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub async fn forget_solution(&mut self, job: Uuid) -> Result<(), StoreError> {
        self.change("DELETE FROM solutions WHERE job_id = ?", job).await
    }

    /// Forgets the baked light of a job's solution, and nothing else of it.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub async fn forget_baked(&mut self, job: Uuid) -> Result<(), StoreError> {
        let change =
            "UPDATE solutions SET record = json_set(record, '$.baked', NULL) WHERE job_id = ?";
        self.change(change, job).await
    }

    async fn change(&mut self, query: &'static str, job: Uuid) -> Result<(), StoreError> {
        sqlx::query(query).bind(job.to_string()).execute(&mut self.connection).await?;
        Ok(())
    }

    /// Closes the file.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub async fn close(self) -> Result<(), StoreError> {
        Ok(self.connection.close().await?)
    }
}

fn id(row: &SqliteRow) -> Result<Uuid, StoreError> {
    rows::parse_id(row.get("id"))
}

fn files_of_solution(job: Uuid, solution: Solution) -> Vec<NamedFile> {
    let baked = solution.baked.map(|baked| NamedFile {
        place: FilePlace::Job(job, baked.file),
        sha256: Some(baked.sha256),
        size: baked.size,
        kind: Kind::Baked,
    });
    let checkpoint = NamedFile {
        place: FilePlace::Job(job, solution.file),
        sha256: None,
        size: solution.size,
        kind: Kind::Checkpoint,
    };
    [checkpoint].into_iter().chain(baked).collect()
}
