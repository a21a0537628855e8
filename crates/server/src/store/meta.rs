//! What a store knows of itself.

use super::error::StoreError;
use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

/// Facts about the store as a whole.
#[async_trait]
pub trait Meta: Send + Sync {
    /// Its id: made once, with its tables, and the same in every copy of it.
    async fn store_id(&self) -> Result<Uuid, StoreError>;
    /// Whether no job and no scene was ever recorded here, or all of them are gone.
    async fn is_blank(&self) -> Result<bool, StoreError>;
    /// When the newest job was made or ended, by the clock of that moment; one of the newest, where
    /// finding the newest would take a look at every record.
    async fn newest_record(&self) -> Result<Option<Timestamp>, StoreError>;
    /// A fact that was kept under a name.
    async fn fact(&self, name: &str) -> Result<Option<String>, StoreError>;
    /// Keeps a fact under a name, in place of the one before.
    async fn keep_fact(&self, name: &str, value: &str) -> Result<(), StoreError>;
}
