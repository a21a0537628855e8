//! Content on its way: in memory where it is small, otherwise in a file, so that the server's
//! memory does not grow with scenes, pictures and checkpoints, however large they are.

use crate::hash::hex;
use bytes::Bytes;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek, Write};

/// Bytes that are read and written together.
pub(super) const PIECE: usize = 1 << 20;

/// The bytes of a scene, a picture or a checkpoint.
#[derive(Debug)]
pub enum Content {
    /// In memory.
    Bytes(Bytes),
    /// In a file, from its beginning to its end.
    File(File),
}

impl From<Bytes> for Content {
    fn from(bytes: Bytes) -> Self {
        Self::Bytes(bytes)
    }
}

impl From<Vec<u8>> for Content {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Bytes(bytes.into())
    }
}

impl From<File> for Content {
    fn from(file: File) -> Self {
        Self::File(file)
    }
}

impl Content {
    /// How many bytes there are.
    ///
    /// # Errors
    /// Where the file cannot be asked.
    pub fn size(&self) -> io::Result<u64> {
        match self {
            Self::Bytes(bytes) => Ok(bytes.len() as u64),
            Self::File(file) => Ok(file.metadata()?.len()),
        }
    }

    /// The same content once more. Of a file both have one position, so they are to be read one
    /// after the other.
    ///
    /// # Errors
    /// Where the system opens no more files.
    pub fn try_clone(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Bytes(bytes) => Self::Bytes(bytes.clone()),
            Self::File(file) => Self::File(file.try_clone()?),
        })
    }

    /// Writes all of it.
    ///
    /// # Errors
    /// Where it cannot be read or written.
    pub fn write_to(&self, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Bytes(bytes) => out.write_all(bytes),
            Self::File(file) => for_each_piece(file, |piece| out.write_all(piece)),
        }
    }

    /// All of it in memory.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn into_bytes(self) -> io::Result<Bytes> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            Self::File(mut file) => {
                let mut bytes = Vec::new();
                file.rewind()?;
                file.read_to_end(&mut bytes)?;
                Ok(bytes.into())
            }
        }
    }

    /// Its size and its SHA-256 in hex, computed beside the caller.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub async fn hashed(self) -> io::Result<(Self, u64, String)> {
        let hash = move || {
            let mut hashing = Hashing::new(io::sink());
            self.write_to(&mut hashing)?;
            let (_, size, sha256) = hashing.finish();
            Ok((self, size, sha256))
        };
        tokio::task::spawn_blocking(hash).await.map_err(io::Error::other)?
    }
}

/// Passes on what is written, counted and hashed.
pub struct Hashing<W> {
    inner: W,
    hash: Sha256,
    size: u64,
}

impl<W: Write> Hashing<W> {
    /// Writes to `inner`.
    pub fn new(inner: W) -> Self {
        Self { inner, hash: Sha256::new(), size: 0 }
    }

    /// What was written to, how many bytes, and their SHA-256 in hex.
    pub fn finish(self) -> (W, u64, String) {
        (self.inner, self.size, hex(&self.hash.finalize()))
    }
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = self.inner.write(bytes)?;
        self.hash.update(&bytes[..taken]);
        self.size += taken as u64;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

fn for_each_piece(
    mut file: &File,
    mut each: impl FnMut(&[u8]) -> io::Result<()>,
) -> io::Result<()> {
    file.rewind()?;
    let mut piece = vec![0; PIECE];
    loop {
        match file.read(&mut piece) {
            Ok(0) => return Ok(()),
            Ok(length) => each(&piece[..length])?,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(content: &[u8]) -> File {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(content).unwrap();
        file
    }

    #[tokio::test]
    async fn files_and_memory_say_the_same_however_often_they_are_read() {
        let bytes: Vec<u8> = (0..2 * PIECE + 5).map(|i| (i % 249) as u8).collect();
        for content in [Content::from(bytes.clone()), Content::from(file_of(&bytes))] {
            let (content, size, sha256) = content.hashed().await.unwrap();
            assert_eq!((size, content.size().unwrap()), (bytes.len() as u64, size));
            assert_eq!(sha256, crate::hash::sha256_hex(&bytes));
            let again = content.try_clone().unwrap();
            let mut written = Vec::new();
            content.write_to(&mut written).unwrap();
            assert!(written == bytes);
            assert!(again.into_bytes().unwrap() == bytes);
        }
    }
}
