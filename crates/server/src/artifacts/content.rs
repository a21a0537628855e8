//! Content on its way: in memory where it is small, otherwise in a file, so that the server's
//! memory does not grow with scenes, pictures and checkpoints, however large they are.

use super::{ArtifactError, Artifacts, failpoint, hex, scene_key};
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::path::Path as Key;
use object_store::{GetResultPayload, MultipartUpload, ObjectStoreExt};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek, Write};

/// Bytes that are read and written together.
const PIECE: usize = 1 << 20;

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

impl Artifacts {
    /// Keeps a scene under its id.
    ///
    /// # Errors
    /// Where it cannot be read or stored; then nothing of it is left under its name.
    pub async fn put_scene(
        &self,
        id: &str,
        content: impl Into<Content>,
    ) -> Result<(), ArtifactError> {
        self.put(&scene_key(id), content.into()).await
    }

    /// A scene, checked against its id.
    ///
    /// # Errors
    /// Where it is not there, is damaged, or cannot be read.
    pub async fn scene(&self, id: &str) -> Result<Content, ArtifactError> {
        let key = scene_key(id);
        let (content, _, sha256) = self.content(&key).await?.hashed().await?;
        if sha256 == id { Ok(content) } else { Err(super::damaged(&key)) }
    }

    /// Whether a scene's file is there with the content that its id stands for.
    ///
    /// # Errors
    /// Where the storage does not answer.
    pub async fn scene_is_sound(&self, id: &str) -> Result<bool, ArtifactError> {
        match self.scene(id).await {
            Ok(_) => Ok(true),
            Err(error) if error.is_lasting() => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Keeps content, all or nothing; durable on return.
    pub(super) async fn put(&self, key: &Key, content: Content) -> Result<(), ArtifactError> {
        failpoint("artifact", key)?;
        match content {
            Content::Bytes(bytes) => drop(self.store.put(key, bytes.into()).await?),
            Content::File(file) => self.put_file(key, file).await?,
        }
        failpoint("artifact-kept", key)
    }

    async fn put_file(&self, key: &Key, mut file: File) -> Result<(), ArtifactError> {
        file.rewind()?;
        let mut upload = self.store.put_multipart(key).await?;
        let done = match send(file, &mut *upload).await {
            Ok(()) => upload.complete().await.map(drop).map_err(ArtifactError::from),
            Err(error) => Err(error),
        };
        if done.is_err() {
            // What it had written is under no name that anyone reads.
            let _ = upload.abort().await;
        }
        done
    }

    /// Content as it is stored, which may be damaged; that of a local folder is its file, which can
    /// be read even where it is removed meanwhile.
    pub(super) async fn content(&self, key: &Key) -> Result<Content, ArtifactError> {
        let got = self.store.get(key).await?;
        Ok(match got.payload {
            GetResultPayload::File(file, _) => Content::File(file),
            GetResultPayload::Stream(pieces) => {
                let pieces: Vec<Bytes> = pieces.try_collect().await?;
                pieces.concat().into()
            }
        })
    }
}

/// Hands a file over piece by piece, each stored before the next is read.
async fn send(mut file: File, upload: &mut dyn MultipartUpload) -> Result<(), ArtifactError> {
    loop {
        let read = tokio::task::spawn_blocking(move || {
            let mut piece = Vec::with_capacity(PIECE);
            let got = (&mut file).take(PIECE as u64).read_to_end(&mut piece);
            got.map(|_| (file, piece))
        });
        let (rest, piece) = read.await.map_err(io::Error::other)??;
        if piece.is_empty() {
            return Ok(());
        }
        file = rest;
        upload.put_part(piece.into()).await?;
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
    async fn a_file_comes_back_whole_and_damage_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::local(folder.path()).unwrap();
        let content: Vec<u8> = (0..3 * PIECE + 17).map(|i| (i % 251) as u8).collect();
        let id = super::super::sha256_hex(&content);
        artifacts.put_scene(&id, file_of(&content)).await.unwrap();
        assert!(artifacts.scene(&id).await.unwrap().into_bytes().unwrap() == content);
        assert!(artifacts.scene_is_sound(&id).await.unwrap());
        std::fs::write(folder.path().join("scenes").join(&id), &content[1..]).unwrap();
        assert!(!artifacts.scene_is_sound(&id).await.unwrap());
        let damaged = artifacts.scene(&id).await.unwrap_err();
        assert!(damaged.is_lasting() && !damaged.is_not_found(), "{damaged}");
        assert!(!artifacts.scene_is_sound(&"0".repeat(64)).await.unwrap());
        let names = std::fs::read_dir(folder.path().join("scenes")).unwrap().count();
        assert_eq!(names, 1, "a half-written file is left");
    }

    #[tokio::test]
    async fn files_and_memory_say_the_same_however_often_they_are_read() {
        let bytes: Vec<u8> = (0..2 * PIECE + 5).map(|i| (i % 249) as u8).collect();
        for content in [Content::from(bytes.clone()), Content::from(file_of(&bytes))] {
            let (content, size, sha256) = content.hashed().await.unwrap();
            assert_eq!((size, content.size().unwrap()), (bytes.len() as u64, size));
            assert_eq!(sha256, super::super::sha256_hex(&bytes));
            let again = content.try_clone().unwrap();
            let mut written = Vec::new();
            content.write_to(&mut written).unwrap();
            assert!(written == bytes);
            assert!(again.into_bytes().unwrap() == bytes);
        }
    }
}
