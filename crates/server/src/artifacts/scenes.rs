//! The files of scenes, and of maps of skies, which are kept as scenes are: each is named by the SHA-256 of its content.

use super::content::Content;
use super::error::{ArtifactError, damaged};
use super::files::Artifacts;
use super::keys::scene_key;

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
        if sha256 == id { Ok(content) } else { Err(damaged(&key)) }
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

    /// Whether a scene's file is there with that many bytes; says nothing about their content.
    pub async fn has_scene(&self, id: &str, size: u64) -> Result<bool, ArtifactError> {
        Ok(self.head(&scene_key(id)).await?.is_some_and(|file| file.size == size))
    }

    /// Removes a scene's file; its not being there is fine.
    pub async fn remove_scene(&self, id: &str) -> Result<(), ArtifactError> {
        self.remove(&scene_key(id)).await
    }
}

#[cfg(test)]
mod tests {
    use super::super::content::PIECE;
    use super::*;
    use std::io::Write;

    #[tokio::test]
    async fn a_file_comes_back_whole_and_damage_is_seen() {
        let (folder, artifacts) = Artifacts::of_test();
        let content: Vec<u8> = (0..3 * PIECE + 17).map(|i| (i % 251) as u8).collect();
        let id = crate::hash::sha256_hex(&content);
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&content).unwrap();
        artifacts.put_scene(&id, file).await.unwrap();
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
}
