//! Scenes in zip archives: a `.glb` or `.gltf` with its resources, in whatever folder. An archive is
//! hostile: its directory is bounded before it is read, a member is read to the size that the
//! directory says and not beyond, and what all members may have together is given by who reads it.
//!
//! Read are members that are stored or deflated, in archives of the first version (no zip64, no
//! encryption), which is what programs write for what may be uploaded.

mod directory;
mod error;
mod member;
mod names;
mod stretch;
#[cfg(test)]
mod tests;

pub use error::ArchiveError;
pub use member::Contents;
pub use stretch::Stretch;

use crate::worker::scenes::SceneRefusal;
use directory::Entry;
use error::refused;
use std::collections::BTreeMap;

/// Most names that a message lists.
const MAX_LISTED: usize = 8;

/// A scene in an archive: its file and what lies beside and below it.
pub struct Packed<'a> {
    archive: Stretch<'a>,
    main: Entry,
    /// By name from the main file's folder on.
    resources: BTreeMap<String, Entry>,
}

impl<'a> Packed<'a> {
    /// Finds the scene in an archive whose members have at most `most` bytes together.
    ///
    /// # Errors
    /// Where the archive cannot be used or read.
    pub fn open(archive: Stretch<'a>, most: u64) -> Result<Self, ArchiveError> {
        let mut members = BTreeMap::new();
        let mut left = most;
        for (name, entry) in directory::read(archive)? {
            let Some(rest) = left.checked_sub(entry.size) else {
                let what = format!("its files have more than {most} bytes once unpacked");
                let fix = "send smaller images and simpler meshes";
                let at = "archive".into();
                return Err(SceneRefusal { at, what, fix: fix.into(), too_large: true }.into());
            };
            left = rest;
            if members.insert(name.clone(), entry).is_some() {
                return Err(refused(&name, "is in the archive twice").into());
            }
        }
        let name = main_file(members.keys())?;
        let folder = name.rfind('/').map_or(0, |slash| slash + 1);
        let (prefix, main) = (name[..folder].to_owned(), members.remove(&name));
        let Some(main) = main else { return Err(refused(&name, "is not in the archive").into()) };
        let resources = members
            .into_iter()
            .filter_map(|(name, entry)| Some((name.strip_prefix(&prefix)?.to_owned(), entry)));
        Ok(Self { archive, main, resources: resources.collect() })
    }

    /// Bytes of all that belongs to the scene, unpacked.
    pub fn size(&self) -> u64 {
        self.main.size + self.resources.values().map(|entry| entry.size).sum::<u64>()
    }

    /// Whether the scene is one file.
    pub fn is_alone(&self) -> bool {
        self.resources.is_empty()
    }

    /// The size of the scene's file and its contents.
    pub fn main(&self) -> (u64, Contents<'a>) {
        (self.main.size, Contents::of(self.archive, &self.main))
    }

    /// Sizes and contents of what came with it, by relative name.
    pub fn resources(&self) -> BTreeMap<String, (u64, Contents<'a>)> {
        let resources = self.resources.iter();
        resources
            .map(|(name, entry)| (name.clone(), (entry.size, Contents::of(self.archive, entry))))
            .collect()
    }
}

/// The scene among the names of an archive or a folder: the only .gltf or .glb, or the only one that
/// lies less deep than all others.
///
/// # Errors
/// Where there is none, or no telling which.
pub fn main_file<'n>(names: impl Iterator<Item = &'n String>) -> Result<String, SceneRefusal> {
    let is_scene = |name: &&String| {
        let ending = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        name.contains('.') && matches!(ending.as_str(), "gltf" | "glb")
    };
    let depth = |name: &String| name.matches('/').count();
    let mut scenes: Vec<&String> = names.filter(is_scene).collect();
    let least = scenes.iter().map(|name| depth(name)).min();
    scenes.retain(|name| Some(depth(name)) == least);
    match scenes[..] {
        [] => Err(refused("archive", "has no .gltf and no .glb in it")),
        [name] => Ok(name.clone()),
        _ => {
            let count = scenes.len();
            let listed: Vec<&str> = scenes.iter().take(MAX_LISTED).map(|name| &name[..]).collect();
            let more = if count > MAX_LISTED { ", …" } else { "" };
            let what = format!("has {count} scenes in it: {}{more}", listed.join(", "));
            let fix = "leave one of them, or put the one that is meant above the others";
            let at = "archive".into();
            Err(SceneRefusal { at, what, fix: fix.into(), too_large: false })
        }
    }
}
