//! The directory at the end of an archive: what members it has, where and how.

use super::error::{ArchiveError, refused};
use super::names;
use super::stretch::Stretch;
use crate::worker::scenes::SceneRefusal;

/// Most members of an archive.
const MAX_MEMBERS: u16 = 4096;
/// Most bytes of a directory: names, comments and what else programs put there.
const MAX_DIRECTORY_BYTES: u32 = 4 << 20;

/// How the end of the directory begins, and its least length.
const END_MAGIC: [u8; 4] = *b"PK\x05\x06";
const END_BYTES: usize = 22;
/// How an entry begins, and its length without what follows its fields.
const ENTRY_MAGIC: [u8; 4] = *b"PK\x01\x02";
const ENTRY_BYTES: usize = 46;

/// Flags of an entry.
const ENCRYPTED: u16 = 1 << 0 | 1 << 6 | 1 << 13;
const IS_UTF8: u16 = 1 << 11;
/// Methods of compression.
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// Systems whose attributes have a mode of Unix: Unix itself and macOS.
const UNIX: [u8; 2] = [3, 19];
/// The part of a mode that is the kind of file.
const KIND: u32 = 0o170_000;
const LINK: u32 = 0o120_000;
const FOLDER: u32 = 0o040_000;
const PLAIN: u32 = 0o100_000;

/// A member that is a file.
pub struct Entry {
    /// Bytes once unpacked.
    pub size: u64,
    /// Bytes in the archive.
    pub packed: u64,
    /// Where its own header is.
    pub header: u64,
    /// Its checksum.
    pub crc: u32,
    /// Whether it is deflated.
    pub deflated: bool,
    /// Its name, for messages.
    pub name: String,
}

fn short(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..at + 2).map_or(0, |pair| u16::from_le_bytes([pair[0], pair[1]]))
}

fn long(bytes: &[u8], at: usize) -> u32 {
    u32::from(short(bytes, at)) | u32::from(short(bytes, at + 2)) << 16
}

/// The files of an archive by their names from its top; folders and what systems leave behind are
/// passed over.
pub fn read(archive: Stretch<'_>) -> Result<Vec<(String, Entry)>, ArchiveError> {
    let (count, directory) = directory(archive)?;
    let mut rest = &directory[..];
    let mut members = Vec::new();
    for _ in 0..count {
        let damaged = || refused("archive", "its directory is damaged");
        let (fields, behind) = rest.split_at_checked(ENTRY_BYTES).ok_or_else(damaged)?;
        if !fields.starts_with(&ENTRY_MAGIC) {
            return Err(damaged().into());
        }
        let lengths = [28, 30, 32].map(|at| usize::from(short(fields, at)));
        let (name, behind) = behind.split_at_checked(lengths[0]).ok_or_else(damaged)?;
        let (extra, behind) = behind.split_at_checked(lengths[1]).ok_or_else(damaged)?;
        rest = behind.get(lengths[2]..).ok_or_else(damaged)?;
        let name = names::decoded(name, extra, short(fields, 8) & IS_UTF8 != 0);
        if let Some(member) = member(fields, &name)? {
            members.push(member);
        }
    }
    Ok(members)
}

/// The number of entries of the directory and its bytes.
fn directory(archive: Stretch<'_>) -> Result<(u16, Vec<u8>), ArchiveError> {
    let length = archive.size.min((END_BYTES + usize::from(u16::MAX)) as u64) as usize;
    let tail = archive.bytes(archive.size - length as u64, length)?;
    // The last place whose comment reaches to the end.
    let is_end = |at: usize| {
        tail[at..].starts_with(&END_MAGIC)
            && usize::from(short(&tail, at + 20)) == tail.len() - at - END_BYTES
    };
    let end =
        (0..=length.saturating_sub(END_BYTES)).rev().find(|at| length >= END_BYTES && is_end(*at));
    let Some(end) = end else {
        let what = "has no directory at its end; it is no zip archive, or not all of one";
        return Err(refused("archive", what).into());
    };
    let fields = &tail[end..];
    let (count, size, begin) = (short(fields, 10), long(fields, 12), long(fields, 16));
    if count == u16::MAX || size == u32::MAX || begin == u32::MAX {
        return Err(refused("archive", "is in the zip64 format, which is not read").into());
    }
    if short(fields, 4) != 0 || short(fields, 8) != count {
        return Err(refused("archive", "is one part of several").into());
    }
    if count > MAX_MEMBERS || size > MAX_DIRECTORY_BYTES {
        let at = "archive".into();
        let what = format!(
            "has {count} members in a directory of {size} bytes; {MAX_MEMBERS} and {MAX_DIRECTORY_BYTES} are allowed"
        );
        let fix = "leave out what the scene does not name, or pack the scene into one .glb".into();
        return Err(SceneRefusal { at, what, fix, too_large: true }.into());
    }
    Ok((count, archive.bytes(begin.into(), size as usize)?))
}

/// A member that is a file; `None` for what is passed over.
fn member(fields: &[u8], name: &str) -> Result<Option<(String, Entry)>, SceneRefusal> {
    let path = names::normal(name)?;
    let (flags, method) = (short(fields, 8), short(fields, 10));
    let made_by_unix = UNIX.contains(&fields[5]);
    let mode = if made_by_unix { long(fields, 38) >> 16 } else { 0 };
    match mode & KIND {
        LINK => return Err(refused(name, "is a link to another file; links are not followed")),
        FOLDER | PLAIN | 0 => {}
        _ => return Err(refused(name, "is no file")),
    }
    if name.ends_with(['/', '\\']) || mode & KIND == FOLDER || names::is_left_behind(&path) {
        return Ok(None);
    }
    if flags & ENCRYPTED != 0 {
        return Err(refused(name, "is encrypted"));
    }
    if method != STORED && method != DEFLATED {
        let what = format!("is compressed by method {method}; stored and deflated files are read");
        return Err(refused(name, what));
    }
    let [packed, size, header] = [20, 24, 42].map(|at| long(fields, at));
    if [packed, size, header].contains(&u32::MAX) {
        return Err(refused(name, "is in the zip64 format, which is not read"));
    }
    if method == STORED && packed != size {
        return Err(refused(name, "is stored, but has two sizes"));
    }
    let entry = Entry {
        size: size.into(),
        packed: packed.into(),
        header: header.into(),
        crc: long(fields, 16),
        deflated: method == DEFLATED,
        name: name.to_owned(),
    };
    Ok(Some((path, entry)))
}
