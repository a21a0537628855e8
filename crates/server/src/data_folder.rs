//! The data folder: which process holds it, and whether its database and its files belong
//! together.
//!
//! A database beside files that it does not know would take them all for leftovers. So both bear
//! the id of the store, and a start where the two disagree is refused, with what to do.

use crate::artifacts::{ArtifactError, Artifacts};
use crate::store::sqlite::{SqliteStore, tables};
use crate::store::{Meta, StoreError};
use std::fs::{File, TryLockError};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Name of the database's file.
pub const DATABASE: &str = "hemilux.sqlite";
/// Name of the folder of files.
pub const ARTIFACTS: &str = "artifacts";
/// Name of the fact that the folder of files bears the store's id.
const FILES_BEAR_ID: &str = "files_bear_id";

/// Why a data folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The system refused.
    #[error("cannot use the data folder {}: {source}", path.display())]
    System {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another process uses it.
    #[error("the data folder {} is in use by another hemilux process; stop it, or give another --data-dir", .0.display())]
    InUse(PathBuf),
    /// The database cannot be opened or read.
    #[error("cannot use the database {}: {source}", path.display())]
    Database {
        /// Its file.
        path: PathBuf,
        /// What is wrong.
        source: StoreError,
    },
    /// The files cannot be looked at.
    #[error("cannot use the files in {}: {source}", path.display())]
    Files {
        /// Their folder.
        path: PathBuf,
        /// What is wrong.
        source: ArtifactError,
    },
    /// Database and files do not belong together.
    #[error(
        "the database {} and the files in {} do not belong together: {what}. Put back the {DATABASE} that belongs to these files, with what lies beside it as {DATABASE}-wal (`hemilux restore --database-only` does so from a backup), or restore both from one backup (`hemilux restore`). If this database is to have these files all the same, start once with --adopt-files: what no record names is then not removed at once, but waits in quarantine",
        folder.join(DATABASE).display(),
        folder.join(ARTIFACTS).display()
    )]
    Foreign {
        /// The data folder.
        folder: PathBuf,
        /// What shows it.
        what: String,
    },
}

/// How long a process may take to let go of the folder: one that is about to end, or that only
/// makes the first key.
const LOCK_PATIENCE: Duration = Duration::from_secs(2);

/// Holds the data folder for this process; the system lets go of it when the process ends,
/// however it ends. Waits a moment for another one to do so.
///
/// # Errors
/// Where another process holds it, or it cannot be made.
pub fn lock(folder: &Path) -> Result<File, FolderError> {
    let trouble = |source| FolderError::System { path: folder.to_owned(), source };
    std::fs::create_dir_all(folder).map_err(trouble)?;
    warn_of_open_folder(folder).map_err(trouble)?;
    let lock = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(folder.join("lock"))
        .map_err(trouble)?;
    let deadline = Instant::now() + LOCK_PATIENCE;
    loop {
        match lock.try_lock() {
            Ok(()) => return Ok(lock),
            Err(TryLockError::WouldBlock) if Instant::now() < deadline => {
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(TryLockError::WouldBlock) => return Err(FolderError::InUse(folder.to_owned())),
            Err(TryLockError::Error(error)) => return Err(trouble(error)),
        }
    }
}

/// Says so where others can look into a folder that was there before: what is made in it is for its
/// own user alone, but older files may not be.
fn warn_of_open_folder(folder: &Path) -> std::io::Result<()> {
    let mode = std::fs::metadata(folder)?.permissions().mode();
    if mode & 0o077 != 0 {
        let (folder, mode) = (folder.display(), format!("{:o}", mode & 0o777));
        tracing::warn!(%folder, mode, "other users of this machine can look into the data folder; chmod -R go= makes it private");
    }
    Ok(())
}

/// Opens the files and the database of a data folder, each made where it is missing, and checks
/// that they belong together before anything is changed; `adopt` makes them.
///
/// # Errors
/// Where one cannot be used, or they do not belong together.
pub async fn open(folder: &Path, adopt: bool) -> Result<(SqliteStore, Artifacts), FolderError> {
    let path = folder.join(ARTIFACTS);
    let artifacts = Artifacts::local(&path)
        .map_err(|source| FolderError::System { path: folder.to_owned(), source })?;
    if !adopt {
        check_not_orphaned(folder, &artifacts).await?;
        check_ids(folder, &artifacts).await?;
    }
    let database = folder.join(DATABASE);
    let trouble = |source| FolderError::Database { path: database.clone(), source };
    let store = SqliteStore::open(&database).await.map_err(trouble)?;
    unite(folder, &store, &artifacts, adopt).await?;
    Ok((store, artifacts))
}

/// Refuses a folder whose database is gone while its files are there: a new database would take
/// them all for leftovers.
///
/// # Errors
/// Where that is so.
pub async fn check_not_orphaned(folder: &Path, artifacts: &Artifacts) -> Result<(), FolderError> {
    if folder.join(DATABASE).exists() {
        return Ok(());
    }
    let id = artifacts.store_id().await.map_err(|source| files_trouble(folder, source))?;
    let any = artifacts.any_files().await.map_err(|source| files_trouble(folder, source))?;
    let what = match id {
        Some(id) => format!("there is no database, and the files belong to store {id}"),
        None if any => "there is no database, and there are files".to_owned(),
        None => return Ok(()),
    };
    Err(FolderError::Foreign { folder: folder.to_owned(), what })
}

/// Refuses a database that is not that of the files before it is brought up to date: it may be
/// wanted with an older program.
async fn check_ids(folder: &Path, artifacts: &Artifacts) -> Result<(), FolderError> {
    let database = folder.join(DATABASE);
    let borne = artifacts.store_id().await.map_err(|source| files_trouble(folder, source))?;
    let Some(borne) = borne.filter(|_| database.exists()) else { return Ok(()) };
    // What is no database, or damaged, is named when it is opened.
    let Ok(own) = tables::peek_id(&database).await else { return Ok(()) };
    let what = match own {
        Some(own) if own == borne => return Ok(()),
        Some(own) => format!("the database is that of store {own}"),
        None => "the database is of an early release".to_owned(),
    };
    let what = format!("{what}, the files are of store {borne}");
    Err(FolderError::Foreign { folder: folder.to_owned(), what })
}

fn files_trouble(folder: &Path, source: ArtifactError) -> FolderError {
    FolderError::Files { path: folder.join(ARTIFACTS), source }
}

/// Checks that both bear the same id, and makes the files bear it where they are new or of an
/// earlier release.
async fn unite(
    folder: &Path,
    store: &SqliteStore,
    artifacts: &Artifacts,
    adopt: bool,
) -> Result<(), FolderError> {
    let database = |source| FolderError::Database { path: folder.join(DATABASE), source };
    let files = |source| files_trouble(folder, source);
    let own = store.store_id().await.map_err(database)?;
    let borne = artifacts.store_id().await.map_err(files)?;
    let was_united = store.fact(FILES_BEAR_ID).await.map_err(database)?.is_some();
    let is_blank = store.is_blank().await.map_err(database)?;
    let any_files = artifacts.any_files().await.map_err(files)?;
    let is_own = borne.as_ref().is_some_and(|id| *id == own.to_string());
    let foreign = match borne {
        _ if is_own => None,
        Some(id) => {
            Some(format!("the database is that of store {own}, the files are of store {id}"))
        }
        None if was_united && (any_files || !is_blank) => {
            let hint = "is a disk missing?";
            Some(format!("the folder of files does not bear the id {own} that it had; {hint}"))
        }
        // The folder of an earlier release has no id, and a database that knows things.
        None if is_blank && any_files => {
            Some("the database is new, and there are files".to_owned())
        }
        None => None,
    };
    match foreign {
        Some(what) if !adopt => {
            return Err(FolderError::Foreign { folder: folder.to_owned(), what });
        }
        Some(what) => tracing::warn!(what, "the database takes the files over (--adopt-files)"),
        None if was_united && is_own => return Ok(()),
        None => {}
    }
    artifacts.put_store_id(own).await.map_err(files)?;
    store.keep_fact(FILES_BEAR_ID, "yes").await.map_err(database)
}

#[cfg(test)]
mod tests;
