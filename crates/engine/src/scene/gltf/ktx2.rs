//! Pictures in KTX 2 files (KHR_texture_basisu): Basis Universal, as ETC1S under BasisLZ or as UASTC,
//! plain or under Zstandard. The first level is all that is read.

use basisu::{DecodeFlags, Error, TargetFormat, Transcoder};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// How the files begin.
pub(super) const MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Offsets of what is read of a file, bytes.
mod offset {
    pub const FORMAT: usize = 12;
    pub const WIDTH: usize = 20;
    pub const HEIGHT: usize = 24;
    pub const DEPTH: usize = 28;
    pub const LAYERS: usize = 32;
    pub const FACES: usize = 36;
    pub const LEVELS: usize = 40;
    pub const SCHEME: usize = 44;
    pub const DESCRIPTOR: usize = 48;
    pub const KEYS: usize = 56;
    pub const GLOBAL: usize = 64;
    pub const FIRST_LEVEL: usize = 80;
    /// Of the colour model, within the descriptor.
    pub const MODEL: usize = 12;
}

/// Colour models of the descriptor.
const ETC1S: u8 = 163;
const UASTC: u8 = 166;
/// Schemes of supercompression.
const PLAIN: u32 = 0;
const BASIS_LZ: u32 = 1;
const ZSTANDARD: u32 = 2;

/// Most levels that a picture can have.
const MAX_LEVELS: u32 = 32;
/// Texels along a side of a block, and bytes of a block of UASTC.
const BLOCK_SIDE: u64 = 4;
const UASTC_BLOCK_BYTES: u64 = 16;
/// Bytes of the header of BasisLZ's tables, and of what it says of a picture.
const BASIS_LZ_BYTES: u64 = 20;

/// Why a file is refused.
type Why = String;

/// The size of a file's picture, once everything is checked that its decoder allocates by.
pub(super) fn size(file: &[u8]) -> Result<(u32, u32), Why> {
    let (width, height) = (number(file, offset::WIDTH)?, number(file, offset::HEIGHT)?);
    if number(file, offset::FORMAT)? != 0 {
        return Err("is a KTX2 file, but not one of Basis Universal".into());
    }
    let other = [offset::DEPTH, offset::LAYERS, offset::FACES].map(|at| number(file, at));
    let [depth, layers, faces] = other;
    if height == 0 || depth? != 0 || layers? > 1 || faces? != 1 {
        return Err("is a KTX2 file, but not of a single picture".into());
    }
    let levels = number(file, offset::LEVELS)?;
    if !(1..=MAX_LEVELS).contains(&levels) {
        return Err(format!("has {levels} levels"));
    }
    let (level, uncompressed) = first_level(file)?;
    check_keys(file)?;
    let descriptor = number(file, offset::DESCRIPTOR)? as usize;
    let model = descriptor.checked_add(offset::MODEL).and_then(|at| file.get(at));
    let blocks = u64::from(width).div_ceil(BLOCK_SIDE) * u64::from(height).div_ceil(BLOCK_SIDE);
    let bytes = blocks.saturating_mul(UASTC_BLOCK_BYTES);
    match (model, number(file, offset::SCHEME)?) {
        (Some(&ETC1S), BASIS_LZ) => check_tables(file, levels)?,
        (Some(&UASTC), PLAIN) if level == bytes => {}
        (Some(&UASTC), ZSTANDARD) if uncompressed == bytes => {}
        (Some(&UASTC), PLAIN | ZSTANDARD) => {
            return Err(format!("has not the {bytes} bytes that {width} × {height} texels take"));
        }
        (model, scheme) => {
            let model = model.copied().unwrap_or_default();
            return Err(format!(
                "has colour model {model} under supercompression {scheme}; ETC1S and UASTC are read"
            ));
        }
    }
    Ok((width, height))
}

/// The length of the first level, which the file has, and the one that it says for what comes out.
fn first_level(file: &[u8]) -> Result<(u64, u64), Why> {
    let at = offset::FIRST_LEVEL;
    let (begin, length) = (long(file, at)?, long(file, at + 8)?);
    check_inside(file, begin, length, "its first level")?;
    Ok((length, long(file, at + 16)?))
}

/// Checks that keys and values end where the file says that they do, with what fills them up to four
/// bytes: the decoder looks through them and counts on it.
fn check_keys(file: &[u8]) -> Result<(), Why> {
    let begin = u64::from(number(file, offset::KEYS)?);
    let length = u64::from(number(file, offset::KEYS + 4)?);
    let end = begin + length;
    if length == 0 || end > file.len() as u64 {
        return Ok(());
    }
    let mut at = begin;
    while end.saturating_sub(at) > 4 {
        let own = u64::from(number(file, at as usize)?);
        at += 4;
        // Here the decoder stops looking.
        if own < 2 || own > end - at {
            return Ok(());
        }
        at = (at + own).next_multiple_of(4);
    }
    if at > end {
        return Err("has keys and values that are longer than it says".into());
    }
    Ok(())
}

/// Checks that the tables of BasisLZ are there.
fn check_tables(file: &[u8], levels: u32) -> Result<(), Why> {
    let (begin, length) = (long(file, offset::GLOBAL)?, long(file, offset::GLOBAL + 8)?);
    check_inside(file, begin, length, "its tables")?;
    let begin = begin as usize;
    let mut needed = BASIS_LZ_BYTES * (1 + u64::from(levels));
    for table in [4, 8, 12] {
        needed += u64::from(number(file, begin.saturating_add(table))?);
    }
    if needed > length {
        return Err(format!("has tables of {length} bytes that say they have {needed}"));
    }
    Ok(())
}

fn check_inside(file: &[u8], begin: u64, length: u64, what: &str) -> Result<(), Why> {
    match begin.checked_add(length) {
        Some(end) if end <= file.len() as u64 => Ok(()),
        _ => Err(format!("ends within {what}")),
    }
}

fn number(file: &[u8], at: usize) -> Result<u32, Why> {
    let bytes = at.checked_add(4).and_then(|end| file.get(at..end));
    let bytes = bytes.and_then(|bytes| bytes.try_into().ok());
    bytes.map(u32::from_le_bytes).ok_or_else(|| "ends too early for a KTX2 file".into())
}

fn long(file: &[u8], at: usize) -> Result<u64, Why> {
    Ok(u64::from(number(file, at)?) | u64::from(number(file, at + 4)?) << 32)
}

/// The texels of a file whose [`size`] is allowed.
pub(super) fn decode(file: &[u8]) -> Result<Vec<[u8; 4]>, Why> {
    // The decoder reads what may be anything: a panic there costs the upload, not the process.
    let decoded = catch_unwind(AssertUnwindSafe(|| {
        Transcoder::new(file)?.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
    }));
    match decoded {
        Ok(Ok(bytes)) => Ok(bytes.as_chunks().0.to_vec()),
        Ok(Err(Error::VideoRequiresState)) => Err("is a video".into()),
        Ok(Err(_)) => Err("cannot be decoded: its data is damaged".into()),
        Err(_) => Err("cannot be decoded: the decoder gave up".into()),
    }
}
