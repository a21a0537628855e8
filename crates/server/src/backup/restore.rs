//! Restoring a backup into an empty data folder.

use super::copy;
use super::error::{BackupError, at, refuse_filled};
use super::manifest::{FILES, FORMAT, MANIFEST, Manifest};
use crate::artifacts::FilePlace;
use crate::clock;
use crate::data_folder::{self, ARTIFACTS, DATABASE};
use crate::store::sqlite::tables;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// What an empty data folder may hold.
const ALLOWED: [&str; 2] = ["lock", "lost+found"];

/// Name of the database's file while it is being copied.
const UNFINISHED: &str = "hemilux.sqlite.restoring";

/// How the moment is written in the name of a database that was replaced.
const MOMENT: &str = "%Y%m%dT%H%M%SZ";

/// Checks a backup and copies it into a new or empty data folder; what is in it. The database comes
/// last, so a server does not start on a half of it.
///
/// # Errors
/// Where the backup is not as it was taken, or the folder is in use or not empty. Then nothing
/// of the backup is left there.
pub fn restore(from: &Path, data_dir: &Path) -> Result<Manifest, BackupError> {
    refuse_filled(data_dir, &ALLOWED)?;
    let manifest = manifest(from)?;
    check(from, &manifest)?;
    let _lock = data_folder::lock(data_dir)?;
    refuse_filled(data_dir, &ALLOWED)?;
    let done = fill(from, data_dir, &manifest);
    if done.is_err() {
        let _ = std::fs::remove_dir_all(data_dir.join(ARTIFACTS));
        for name in [DATABASE, UNFINISHED] {
            let _ = std::fs::remove_file(data_dir.join(name));
        }
    }
    done.map(|()| manifest)
}

/// Puts the database of a backup beside the files of the same store that are in a data folder; where
/// the one is now that was there. It moves with the files that SQLite keeps beside it: without them
/// it is not whole, and with another database they would spoil that.
///
/// # Errors
/// Where the backup is not as it was taken, the folder is in use, or its files are not of the same
/// store. Then the database is as it was.
pub fn restore_database(from: &Path, data_dir: &Path) -> Result<Option<PathBuf>, BackupError> {
    let manifest = manifest(from)?;
    let borne = data_dir.join(ARTIFACTS).join("store-id");
    let id = std::fs::read_to_string(&borne).map_err(at(&borne))?;
    if id.trim() != manifest.store_id.to_string() {
        return Err(BackupError::Refused(format!(
            "the files in {} are of store {}, the backup is of store {}; restore it into an empty folder",
            data_dir.display(),
            id.trim(),
            manifest.store_id
        )));
    }
    let _lock = data_folder::lock(data_dir)?;
    let unfinished = data_dir.join(UNFINISHED);
    let _ = std::fs::remove_file(&unfinished);
    let copied = copy::copy(&from.join(DATABASE), &unfinished).and_then(|copied| match copied {
        Some(content) if content.sha256 == manifest.database_sha256 => Ok(()),
        _ => Err(damaged(from, format!("{DATABASE} has another content than it had"))),
    });
    if let Err(error) = copied {
        let _ = std::fs::remove_file(&unfinished);
        return Err(error);
    }
    let former = data_dir.join(format!("{DATABASE}.replaced-{}", clock::wall().strftime(MOMENT)));
    let database = data_dir.join(DATABASE);
    let was_there = database.exists();
    for beside in ["-wal", "-shm", ""] {
        let name = |path: &Path| PathBuf::from(format!("{}{beside}", path.display()));
        if name(&database).exists() {
            std::fs::rename(name(&database), name(&former)).map_err(at(&database))?;
        }
    }
    std::fs::rename(&unfinished, &database).map_err(at(&database))?;
    copy::sync_folder(data_dir)?;
    Ok(was_there.then_some(former))
}

fn damaged(folder: &Path, what: impl Into<String>) -> BackupError {
    BackupError::Damaged { folder: folder.to_owned(), what: what.into() }
}

fn manifest(from: &Path) -> Result<Manifest, BackupError> {
    let path = from.join(MANIFEST);
    let text = std::fs::read_to_string(&path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => BackupError::Refused(format!(
            "{} is no backup of hemilux: there is no {MANIFEST}",
            from.display()
        )),
        _ => at(&path)(error),
    })?;
    let manifest: Manifest = serde_json::from_str(&text)
        .map_err(|error| damaged(from, format!("{MANIFEST} does not read back: {error}")))?;
    let own = tables::newest_version();
    if manifest.format != FORMAT || manifest.tables > own {
        return Err(BackupError::Refused(format!(
            "the backup was taken by version {} of hemilux (format {}, tables {}), this program reads format {FORMAT} with tables up to {own}; restore it with that version",
            manifest.program, manifest.format, manifest.tables
        )));
    }
    Ok(manifest)
}

/// Checks every byte before anything is written.
fn check(from: &Path, manifest: &Manifest) -> Result<(), BackupError> {
    let of = |name: &str, hoped: &str| {
        let path = from.join(name);
        if !path.is_file() {
            return Err(damaged(from, format!("{name} is missing")));
        }
        if copy::content(&path)?.sha256 != hoped {
            return Err(damaged(from, format!("{name} has another content than it had")));
        }
        Ok(())
    };
    of(DATABASE, &manifest.database_sha256)?;
    of(FILES, &manifest.files_sha256)?;
    let mut files = 0;
    each_listed(from, &mut |sha256, path| {
        files += 1;
        of(path, sha256)
    })?;
    if files != manifest.files {
        return Err(damaged(from, format!("{} files are listed of {}", files, manifest.files)));
    }
    Ok(())
}

/// Calls `then` with the hash and the path of every file in the list.
fn each_listed(
    from: &Path,
    then: &mut dyn FnMut(&str, &str) -> Result<(), BackupError>,
) -> Result<(), BackupError> {
    let path = from.join(FILES);
    let list = std::fs::File::open(&path).map_err(at(&path))?;
    for line in BufReader::new(list).lines() {
        let line = line.map_err(at(&path))?;
        let entry = line.split_once("  ").filter(|(_, path)| {
            // Whatever the list says, no file is written outside the folder of files.
            let place = path.strip_prefix(ARTIFACTS).and_then(|path| path.strip_prefix('/'));
            let is_plain = |part: &str| !part.is_empty() && part != "." && part != "..";
            place.is_some_and(|place| {
                FilePlace::of(place).is_some() && place.split('/').all(is_plain)
            })
        });
        let (sha256, path) =
            entry.ok_or_else(|| damaged(from, format!("{FILES} has the line {line:?}")))?;
        then(sha256, path)?;
    }
    Ok(())
}

fn fill(from: &Path, data_dir: &Path, manifest: &Manifest) -> Result<(), BackupError> {
    let put = |name: &str, sha256: &str, to: &Path| match copy::copy(&from.join(name), to)? {
        Some(content) if content.sha256 == sha256 => Ok(()),
        _ => Err(damaged(from, format!("{name} has just changed"))),
    };
    let files = data_dir.join(ARTIFACTS);
    std::fs::create_dir_all(&files).map_err(at(&files))?;
    copy::write(&files.join("store-id"), format!("{}\n", manifest.store_id).as_bytes())?;
    each_listed(from, &mut |sha256, path| put(path, sha256, &data_dir.join(path)))?;
    copy::sync_names(&files)?;
    let unfinished = data_dir.join(UNFINISHED);
    put(DATABASE, &manifest.database_sha256, &unfinished)?;
    let database = data_dir.join(DATABASE);
    std::fs::rename(&unfinished, &database).map_err(at(&database))?;
    copy::sync_folder(data_dir)
}
