//! Names of members: from bytes in one of three encodings to relative paths.

use super::error::refused;
use crate::worker::scenes::SceneRefusal;

/// The upper half of code page 437, which names are in by the format's first version.
const CODE_PAGE_437: &str = "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜ¢£¥₧ƒáíóúñÑªº¿⌐¬½¼¡«»░▒▓│┤╡╢╖╕╣║╗╝╜╛┐└┴┬├─┼╞╟╚╔╩╦╠═╬╧╨╤╥╙╘╒╓╫╪┘┌█▄▌▐▀αßΓπΣσµτΦΘΩδ∞φε∩≡±≥≤⌠⌡÷≈°∙·√ⁿ²■\u{a0}";

/// The extra field with a name in UTF-8: its id, and its bytes before the name (version, checksum).
const UNICODE_PATH: u16 = 0x7075;
const UNICODE_PATH_HEAD: usize = 5;

/// What systems put into archives beside what they were told to.
const LEFT_BEHIND: [&str; 4] = ["__MACOSX", ".DS_Store", "Thumbs.db", "desktop.ini"];

/// A name as text: UTF-8 where the archive or the bytes themselves say so, else code page 437.
pub fn decoded(name: &[u8], extra: &[u8], is_utf8: bool) -> String {
    if let Some(name) = unicode_path(extra).filter(|_| !is_utf8) {
        return name;
    }
    match std::str::from_utf8(name) {
        Ok(name) => name.to_owned(),
        Err(_) if is_utf8 => String::from_utf8_lossy(name).into_owned(),
        Err(_) => {
            let upper = |byte: u8| CODE_PAGE_437.chars().nth(usize::from(byte) - 128);
            let letter = |byte: &u8| match byte {
                0..128 => Some(*byte as char),
                _ => upper(*byte),
            };
            name.iter().filter_map(letter).collect()
        }
    }
}

/// The name in UTF-8 that programs add where the first one is in another encoding.
fn unicode_path(mut extra: &[u8]) -> Option<String> {
    while let Some((&[id_low, id_high, low, high], rest)) = extra.split_first_chunk() {
        let (field, rest) = rest.split_at_checked(usize::from(u16::from_le_bytes([low, high])))?;
        if u16::from_le_bytes([id_low, id_high]) == UNICODE_PATH {
            return String::from_utf8(field.get(UNICODE_PATH_HEAD..)?.to_vec()).ok();
        }
        extra = rest;
    }
    None
}

/// A relative path without `.` segments, with slashes as some programs do not write them.
pub fn normal(name: &str) -> Result<String, SceneRefusal> {
    let path = name.replace('\\', "/");
    if path.starts_with('/') || path.get(1..2) == Some(":") {
        return Err(refused(name, "is an absolute path"));
    }
    if path.chars().any(char::is_control) {
        return Err(refused(name, "has a control character in its name"));
    }
    let mut segments = Vec::new();
    for segment in path.split('/') {
        match segment {
            ".." => return Err(refused(name, "leaves the folder of the archive")),
            "" | "." => {}
            _ => segments.push(segment),
        }
    }
    if segments.is_empty() {
        return Err(refused("archive", "has a member without a name"));
    }
    Ok(segments.join("/"))
}

/// Whether a path is of what systems leave behind.
pub fn is_left_behind(path: &str) -> bool {
    path.split('/').any(|segment| LEFT_BEHIND.contains(&segment))
}
