//! Reading a member: to the size that the directory says, no further, and with its checksum.

use super::directory::Entry;
use super::error::{ArchiveError, refused};
use super::stretch::Stretch;
use flate2::read::DeflateDecoder;
use std::io::{self, Read};

/// How a member's own header begins, and its length without name and extra fields.
const HEADER_MAGIC: [u8; 4] = *b"PK\x03\x04";
const HEADER_BYTES: usize = 30;

/// The contents of a member.
pub struct Contents<'a> {
    archive: Stretch<'a>,
    /// Its name, for messages.
    name: String,
    header: u64,
    packed: u64,
    deflated: bool,
    /// Once it has begun.
    source: Option<Source<'a>>,
    /// Bytes yet to come.
    left: u64,
    expected: u32,
    crc: crc32fast::Hasher,
}

enum Source<'a> {
    Stored(Raw<'a>),
    Deflated(Box<DeflateDecoder<Raw<'a>>>),
}

/// Bytes of the archive, one after the other.
struct Raw<'a> {
    stretch: Stretch<'a>,
    at: u64,
}

impl Read for Raw<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let got = self.stretch.read_at(bytes, self.at)?;
        self.at += got as u64;
        Ok(got)
    }
}

impl<'a> Contents<'a> {
    /// The contents of a member, of which nothing is read yet.
    pub fn of(archive: Stretch<'a>, entry: &Entry) -> Self {
        let Entry { size, packed, header, crc, deflated, ref name } = *entry;
        let name = name.clone();
        let crc32 = crc32fast::Hasher::new();
        Self {
            archive,
            name,
            header,
            packed,
            deflated,
            source: None,
            left: size,
            expected: crc,
            crc: crc32,
        }
    }

    fn refused(&self, what: &str) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidData, refused(&self.name, what))
    }

    /// Finds the contents behind the member's own header.
    fn begin(&self) -> Result<Source<'a>, ArchiveError> {
        let header = self.archive.bytes(self.header, HEADER_BYTES)?;
        if !header.starts_with(&HEADER_MAGIC) {
            return Err(refused(&self.name, "is not where the directory says").into());
        }
        let length = |at: usize| u64::from(u16::from_le_bytes([header[at], header[at + 1]]));
        let begin = self.header + HEADER_BYTES as u64 + length(26) + length(28);
        let start = self.archive.start + begin;
        if begin + self.packed > self.archive.size {
            return Err(refused(&self.name, "ends beyond the archive").into());
        }
        let stretch = Stretch { file: self.archive.file, start, size: self.packed };
        let raw = Raw { stretch, at: 0 };
        Ok(match self.deflated {
            true => Source::Deflated(Box::new(DeflateDecoder::new(raw))),
            false => Source::Stored(raw),
        })
    }

    fn more(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let got = match &mut self.source {
            Some(Source::Stored(raw)) => raw.read(bytes),
            Some(Source::Deflated(decoder)) => decoder.read(bytes),
            None => Ok(0),
        };
        got.map_err(|error| match error.kind() {
            io::ErrorKind::InvalidInput
            | io::ErrorKind::InvalidData
            | io::ErrorKind::UnexpectedEof => self.refused("cannot be unpacked; it is damaged"),
            _ => error,
        })
    }
}

impl Read for Contents<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let wanted = bytes.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        if wanted == 0 {
            return Ok(0);
        }
        if self.source.is_none() {
            self.source = Some(self.begin().map_err(|error| match error {
                ArchiveError::Refused(refusal) => {
                    io::Error::new(io::ErrorKind::InvalidData, refusal)
                }
                ArchiveError::Trouble(error) => error,
            })?);
        }
        let got = self.more(&mut bytes[..wanted])?;
        if got == 0 {
            return Err(self.refused("has fewer bytes than the directory says"));
        }
        self.crc.update(&bytes[..got]);
        self.left -= got as u64;
        if self.left == 0 {
            if self.more(&mut [0])? != 0 {
                return Err(self.refused("has more bytes than the directory says"));
            }
            if self.crc.clone().finalize() != self.expected {
                return Err(self.refused("does not have the checksum that the directory says"));
            }
        }
        Ok(got)
    }
}
