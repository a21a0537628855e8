//! Scenes as large as the disk allows, kept and checked a piece at a time: the server's memory does
//! not grow with their size.

use super::{ArtifactError, Artifacts, failpoint, hex, scene_key};
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::{MultipartUpload, ObjectStoreExt};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Seek};

/// Bytes that are read and written together.
const PIECE: usize = 1 << 20;

/// The bytes of a scene on their way into the storage.
pub enum SceneContent {
    /// In memory.
    Bytes(Bytes),
    /// In a file, from its beginning to its end.
    File(File),
}

impl From<Bytes> for SceneContent {
    fn from(bytes: Bytes) -> Self {
        Self::Bytes(bytes)
    }
}

impl From<File> for SceneContent {
    fn from(file: File) -> Self {
        Self::File(file)
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
        content: impl Into<SceneContent>,
    ) -> Result<(), ArtifactError> {
        let key = scene_key(id);
        let mut file = match content.into() {
            SceneContent::Bytes(bytes) => return self.put(&key, bytes).await,
            SceneContent::File(file) => file,
        };
        failpoint("artifact", &key)?;
        file.rewind().map_err(unreadable)?;
        let mut upload = self.store.put_multipart(&key).await?;
        let done = match send(file, &mut *upload).await {
            Ok(()) => upload.complete().await.map(drop).map_err(ArtifactError::from),
            Err(error) => Err(error),
        };
        if let Err(error) = done {
            // What it had written is under no name that anyone reads.
            let _ = upload.abort().await;
            return Err(error);
        }
        failpoint("artifact-kept", &key)
    }

    /// Whether a scene's file is there with the content that its id stands for.
    ///
    /// # Errors
    /// Where the storage does not answer.
    pub async fn scene_is_sound(&self, id: &str) -> Result<bool, ArtifactError> {
        let found = match self.store.get(&scene_key(id)).await {
            Err(object_store::Error::NotFound { .. }) => return Ok(false),
            found => found?,
        };
        let mut pieces = found.into_stream();
        let mut hash = Sha256::new();
        while let Some(piece) = pieces.try_next().await? {
            hash = tokio::task::spawn_blocking(move || hash.chain_update(piece))
                .await
                .map_err(unreadable)?;
        }
        Ok(hex(&hash.finalize()) == id)
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
        let (rest, piece) = read.await.map_err(unreadable)?.map_err(unreadable)?;
        if piece.is_empty() {
            return Ok(());
        }
        file = rest;
        upload.put_part(piece.into()).await?;
    }
}

fn unreadable(error: impl std::error::Error + Send + Sync + 'static) -> ArtifactError {
    object_store::Error::Generic { store: "upload", source: Box::new(error) }.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[tokio::test]
    async fn a_file_comes_back_whole_and_damage_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::local(folder.path()).unwrap();
        let content: Vec<u8> = (0..3 * PIECE + 17).map(|i| (i % 251) as u8).collect();
        let id = super::super::sha256_hex(&content);
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&content).unwrap();
        artifacts.put_scene(&id, file).await.unwrap();
        assert!(artifacts.scene(&id).await.unwrap() == content);
        assert!(artifacts.scene_is_sound(&id).await.unwrap());
        std::fs::write(folder.path().join("scenes").join(&id), &content[1..]).unwrap();
        assert!(!artifacts.scene_is_sound(&id).await.unwrap());
        assert!(!artifacts.scene_is_sound(&"0".repeat(64)).await.unwrap());
        let names = std::fs::read_dir(folder.path().join("scenes")).unwrap().count();
        assert_eq!(names, 1, "a half-written file is left");
    }
}
