//! What a store knows of API keys and of the owners of jobs.

use super::error::StoreError;
use crate::api::keys::KeyRecord;
use crate::api::webhooks::WebhookTarget;
use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

/// On whose behalf a job is accepted; the default is a service without keys and quotas.
#[derive(Clone, Debug, Default)]
pub struct Submitter {
    /// Id of the key; empty without one. Idempotency keys are the owner's own.
    pub owner: String,
    /// Under which name quotas are counted.
    pub billed_to: String,
    /// Jobs under that name that may wait.
    pub max_queued: Option<u64>,
    /// Jobs under that name that may run at the same time.
    pub max_running: Option<u64>,
    /// Bytes of pictures and solutions under that name beyond which no snapshots are kept.
    pub max_stored: Option<u64>,
    /// Who is told of the end.
    pub webhook: Option<WebhookTarget>,
    /// W3C `traceparent` of the request.
    pub trace_parent: Option<String>,
}

/// Keys, and whose things are.
#[async_trait]
pub trait Keys: Send + Sync {
    /// Stores a key under the hash of it; false where the name is taken.
    async fn add_key(&self, key: &KeyRecord, hash: &str) -> Result<bool, StoreError>;
    /// All keys, oldest first, ended ones too.
    async fn keys(&self) -> Result<Vec<KeyRecord>, StoreError>;
    /// Ends the key of that id or name; false where there is none that is still good.
    async fn revoke_key(&self, id_or_name: &str) -> Result<bool, StoreError>;
    /// The key of that hash, good or not.
    async fn key(&self, hash: &str) -> Result<Option<KeyRecord>, StoreError>;
    /// Whether there ever was a key.
    async fn any_keys(&self) -> Result<bool, StoreError>;
    /// Notes that a key was used.
    async fn key_used(&self, id: &str, at: Timestamp) -> Result<(), StoreError>;

    /// The owner of a job, unless deleted.
    async fn job_owner(&self, job: Uuid) -> Result<Option<String>, StoreError>;
    /// The `traceparent` that a job was sent with.
    async fn trace_parent(&self, job: Uuid) -> Result<Option<String>, StoreError>;
}
