//! Scenes that commands read: a file with what it names beside it, a folder, a zip archive, or one
//! that comes with the program.

use super::files::{MAX_FILE_BYTES, read_file};
use super::process::Failure;
use crate::archive::{ArchiveError, Contents, Packed, Stretch, main_file};
use crate::worker::scenes::resource_names;
use crate::{builtin, bundle};
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Most entries of a folder, with all below it, that are looked at for a scene.
const MAX_ENTRIES: usize = 100_000;
/// Deepest folder that is looked into.
const MAX_DEPTH: usize = 16;

/// A scene's file and its resources by the relative URIs that it names them with.
pub type SceneFiles = (Cow<'static, [u8]>, bundle::Resources);

/// Reads the files of the scene that `name` stands for.
///
/// # Errors
/// Where there is none, or it cannot be read.
pub fn read(name: &str) -> Result<SceneFiles, Failure> {
    let path = Path::new(name);
    if let Some(bytes) = builtin::scene(name).filter(|_| !path.exists()) {
        return Ok((bytes.into(), bundle::Resources::new()));
    }
    let failed = |error: &dyn std::fmt::Display| Failure::failed(format!("{name}: {error}"));
    if path.is_dir() {
        let inside = in_folder(path).map_err(|error| match error {
            ArchiveError::Refused(refusal) => {
                failed(&format!("the folder {}; {}", refusal.what, refusal.fix))
            }
            ArchiveError::Trouble(error) => failed(&error),
        })?;
        return with_resources(&inside).map_err(|error| failed(&error));
    }
    if let Some(files) = in_archive(path).map_err(|error| match error {
        ArchiveError::Refused(refusal) => failed(&refusal),
        ArchiveError::Trouble(error) => failed(&error),
    })? {
        return Ok(files);
    }
    with_resources(path).map_err(|error| {
        let known = builtin::names();
        let hint = match path.extension() {
            None => format!("; built-in scenes are {known:?}"),
            Some(_) => String::new(),
        };
        Failure::failed(format!("cannot read {name}: {error}{hint}"))
    })
}

/// A file and those beside or below it that it names; the importer names those that are missing.
fn with_resources(path: &Path) -> io::Result<SceneFiles> {
    let bytes = read_file(path)?;
    let folder = path.parent().unwrap_or(Path::new(".")).join(".");
    let resources = resource_names(&bytes).into_iter().filter_map(|uri| {
        let name = percent_decode_str(&uri).decode_utf8().ok()?;
        let inside = folder.join(&*name).canonicalize().ok()?;
        let folder = folder.canonicalize().ok()?;
        let bytes = inside.starts_with(folder).then(|| read_file(&inside).ok())??;
        Some((uri, bytes))
    });
    let resources = resources.collect();
    Ok((bytes.into(), resources))
}

/// The scene of a folder.
fn in_folder(folder: &Path) -> Result<PathBuf, ArchiveError> {
    let mut names = Vec::new();
    let mut left = MAX_ENTRIES;
    let mut level = vec![String::new()];
    for _ in 0..MAX_DEPTH {
        let mut below = Vec::new();
        for inner in level {
            for entry in std::fs::read_dir(folder.join(&inner))? {
                left = left.checked_sub(1).ok_or_else(|| {
                    io::Error::other(format!("more than {MAX_ENTRIES} files are in the folder"))
                })?;
                let entry = entry?;
                // Names that are no text can be named by no scene.
                let Ok(name) = entry.file_name().into_string() else { continue };
                let kind = entry.file_type()?;
                if kind.is_dir() {
                    below.push(format!("{inner}{name}/"));
                } else {
                    names.push(format!("{inner}{name}"));
                }
            }
        }
        // What lies deeper is not looked for once there is a scene.
        let is_scene = |name: &String| main_file(std::iter::once(name)).is_ok();
        if below.is_empty() || names.iter().any(is_scene) {
            break;
        }
        level = below;
    }
    Ok(folder.join(main_file(names.iter())?))
}

/// The scene of an archive; `None` where the file is none.
fn in_archive(path: &Path) -> Result<Option<SceneFiles>, ArchiveError> {
    let Ok(file) = File::open(path) else { return Ok(None) };
    let archive = Stretch { file: &file, start: 0, size: file.metadata()?.len() };
    if !archive.is_archive()? {
        return Ok(None);
    }
    let packed = Packed::open(archive, MAX_FILE_BYTES)?;
    let all = |(_, mut contents): (u64, Contents<'_>)| {
        let mut bytes = Vec::new();
        contents.read_to_end(&mut bytes).map(|_| bytes)
    };
    let resources = packed.resources().into_iter();
    let resources = resources.map(|(name, contents)| Ok((name, all(contents)?)));
    let resources = resources.collect::<io::Result<_>>()?;
    Ok(Some((all(packed.main())?.into(), resources)))
}
