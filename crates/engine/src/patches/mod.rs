//! Patches.
use crate::scene::Scene;
use std::sync::Arc;
/// placeholder
pub struct PatchedScene {
    /// s
    pub scene: Arc<Scene>,
}
