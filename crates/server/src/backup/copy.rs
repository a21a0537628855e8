//! Copying and hashing files, durably and in bounded memory.

use super::error::{BackupError, at};
use crate::artifacts::{FilePlace, Hashing};
use std::fs::File;
use std::io::{BufReader, Write};
use std::path::Path;

/// Bytes read at once.
const CHUNK: usize = 1 << 20;

/// A file's content in short.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Content {
    /// SHA-256, in hex.
    pub sha256: String,
    /// Bytes.
    pub size: u64,
}

fn pass(from: File, to: impl Write) -> std::io::Result<Content> {
    let mut hashing = Hashing::new(to);
    std::io::copy(&mut BufReader::with_capacity(CHUNK, from), &mut hashing)?;
    let (_, size, sha256) = hashing.finish();
    Ok(Content { sha256, size })
}

/// Reads a file.
pub fn content(path: &Path) -> Result<Content, BackupError> {
    let file = File::open(path).map_err(at(path))?;
    pass(file, std::io::sink()).map_err(at(path))
}

/// Copies a file into one that is not there yet; it is on disk on return, its name not yet. `None`
/// where there is nothing to copy.
pub fn copy(from: &Path, to: &Path) -> Result<Option<Content>, BackupError> {
    let source = match File::open(from) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(at(from)(error)),
    };
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(at(folder))?;
    }
    let target = File::create_new(to).map_err(at(to))?;
    let copied = pass(source, &target).map_err(at(to))?;
    target.sync_all().map_err(at(to))?;
    Ok(Some(copied))
}

/// Writes a new file; it is on disk on return, its name not yet.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), BackupError> {
    let mut file = File::create_new(path).map_err(at(path))?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(at(path))
}

/// Puts the names of all files below a folder on disk.
pub fn sync_names(folder: &Path) -> Result<(), BackupError> {
    for entry in std::fs::read_dir(folder).map_err(at(folder))? {
        let entry = entry.map_err(at(folder))?;
        if entry.file_type().map_err(at(folder))?.is_dir() {
            sync_names(&entry.path())?;
        }
    }
    sync_folder(folder)
}

/// Puts the names in a folder on disk.
pub fn sync_folder(folder: &Path) -> Result<(), BackupError> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    File::open(here).and_then(|file| file.sync_all()).map_err(at(here))
}

/// Calls `then` with every file of a scene or a job in a folder of files. What is gone meanwhile is
/// passed over, and so is what another program put there.
pub fn each_file(
    folder: &Path,
    then: &mut dyn FnMut(FilePlace) -> Result<(), BackupError>,
) -> Result<(), BackupError> {
    for top in ["scenes", "jobs"] {
        walk(&folder.join(top), top, then)?;
    }
    Ok(())
}

fn walk(
    folder: &Path,
    path: &str,
    then: &mut dyn FnMut(FilePlace) -> Result<(), BackupError>,
) -> Result<(), BackupError> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(at(folder)(error)),
    };
    for entry in entries {
        let entry = entry.map_err(at(folder))?;
        let name = entry.file_name();
        // What is being written is called `name#1` until it is whole.
        let Some(name) = name.to_str().filter(|name| is_plain(name)) else { continue };
        let below = format!("{path}/{name}");
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() && path == "jobs" {
            walk(&entry.path(), &below, then)?;
        } else if kind.is_file()
            && let Some(place) = FilePlace::of(&below)
        {
            then(place)?;
        }
    }
    Ok(())
}

fn is_plain(name: &str) -> bool {
    name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c)) && !name.starts_with('.')
}
