//! Whose scenes are, and what each of their holders sees of them. Maps of skies are held, named,
//! counted and let go of in the same way, by the same calls.

use super::error::StoreError;
use crate::api::scenes::Scene;
use async_trait::async_trait;

/// Who looks at scenes.
#[derive(Clone, Copy, Debug)]
pub struct Viewer<'a> {
    /// Under which name they hold scenes, as `Submitter::billed_to`.
    pub holder: &'a str,
    /// Whether they see what others hold, too.
    pub sees_all: bool,
}

/// A place in a list of scenes, which stays where it is when scenes come and go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScenePosition {
    /// When the viewer got the scene there, milliseconds since 1970.
    pub created_ms: i64,
    /// Its id.
    pub id: String,
}

/// Scenes, and maps of skies, and their holders. Those that nobody holds any more are shown to nobody.
#[async_trait]
pub trait Holdings: Send + Sync {
    /// Notes that `holder` sent or used a scene; whether that is new.
    async fn hold_scene(&self, scene: &str, holder: &str) -> Result<bool, StoreError>;
    /// What `holder` calls a scene.
    async fn name_scene(&self, scene: &str, holder: &str, name: &str) -> Result<(), StoreError>;
    /// Whether there is a scene or a map of that id, whoever holds it.
    async fn is_stored(&self, id: &str) -> Result<bool, StoreError>;
    /// Whether `holder` sent or used that scene.
    async fn holds_scene(&self, scene: &str, holder: &str) -> Result<bool, StoreError>;
    /// A scene as `viewer` sees it, with the time and the name that are theirs; nothing where
    /// they may not.
    async fn shown_scene(
        &self,
        scene: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<Scene>, StoreError>;
    /// Scenes that `viewer` sees, newest first; `before` is the place of the last one of the page
    /// before.
    async fn shown_scenes(
        &self,
        viewer: Viewer<'_>,
        before: Option<&ScenePosition>,
        limit: u32,
    ) -> Result<Vec<Scene>, StoreError>;
    /// Bytes of the scenes and maps of `holder`.
    async fn scene_bytes_of(&self, holder: &str) -> Result<u64, StoreError>;
    /// Ends what `holder` has to do with a scene; everyone's part in it without a `holder`.
    async fn let_go_scene(&self, scene: &str, holder: Option<&str>) -> Result<(), StoreError>;
    /// Scenes and maps that all have let go of and that no job names, deleted ones included.
    async fn scenes_let_go(&self, limit: u32) -> Result<Vec<String>, StoreError>;
    /// Forgets such a scene; whether it was one.
    async fn forget_let_go(&self, scene: &str) -> Result<bool, StoreError>;
}
