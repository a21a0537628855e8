//! Maps of skies. They are held, named, let go of and expired as scenes are, by the calls for
//! scenes; here is what differs: their records, and lists of nothing but them.

use super::error::StoreError;
use super::scenes::{ScenePosition, Viewer};
use crate::api::environments::EnvironmentMap;
use async_trait::async_trait;

/// Maps of skies.
#[async_trait]
pub trait Environments: Send + Sync {
    /// Stores a map; false where it was there already.
    async fn put_environment(&self, map: &EnvironmentMap) -> Result<bool, StoreError>;
    /// The map of that id, whoever holds it.
    async fn environment(&self, id: &str) -> Result<Option<EnvironmentMap>, StoreError>;
    /// A map as `viewer` sees it; nothing where they may not.
    async fn shown_environment(
        &self,
        id: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<EnvironmentMap>, StoreError>;
    /// Maps that `viewer` sees, newest first; `before` is the place of the last one of the page
    /// before.
    async fn shown_environments(
        &self,
        viewer: Viewer<'_>,
        before: Option<&ScenePosition>,
        limit: u32,
    ) -> Result<Vec<EnvironmentMap>, StoreError>;
}
