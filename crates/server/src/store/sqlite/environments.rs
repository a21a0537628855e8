//! Maps of skies in SQLite.

use super::database::SqliteStore;
use super::uploads;
use crate::api::environments::EnvironmentMap;
use crate::store::StoreError;
use crate::store::environments::Environments;
use crate::store::scenes::{ScenePosition, Viewer};
use async_trait::async_trait;

#[async_trait]
impl Environments for SqliteStore {
    async fn put_environment(&self, map: &EnvironmentMap) -> Result<bool, StoreError> {
        uploads::put(self, map).await
    }

    async fn environment(&self, id: &str) -> Result<Option<EnvironmentMap>, StoreError> {
        uploads::get(self, id).await
    }

    async fn shown_environment(
        &self,
        id: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<EnvironmentMap>, StoreError> {
        uploads::shown(self, id, viewer).await
    }

    async fn shown_environments(
        &self,
        viewer: Viewer<'_>,
        before: Option<&ScenePosition>,
        limit: u32,
    ) -> Result<Vec<EnvironmentMap>, StoreError> {
        uploads::list(self, viewer, before, limit).await
    }
}
