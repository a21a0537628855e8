//! The words that HTTP and the store share: requests, records, events. Plain data, no behaviour
//! beyond checking itself.

mod either;
pub mod environment;
pub mod environments;
pub mod events;
pub mod instant;
pub mod jobs;
pub mod keys;
pub mod limits;
mod part_checks;
pub mod parts;
pub mod request_hash;
pub mod scenes;
pub mod settings;
pub mod shown;
pub mod solutions;
pub mod uploads;
pub mod webhooks;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Something that the picture does not show as authored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// Where: a path into the scene file, or a stage of the job.
    #[schema(example = "materials[3].normalTexture")]
    pub at: String,
    /// What was approximated or ignored.
    #[schema(example = "normal maps are ignored; bake them into the geometry")]
    pub what: String,
}

/// One thing that is wrong with a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FieldError {
    /// The field, as a path into the request.
    #[schema(example = "width")]
    pub field: String,
    /// What is wrong there and what would be right.
    #[schema(example = "must be between 1 and 16384, is 0")]
    pub detail: String,
}

impl FieldError {
    /// An error at `field`.
    pub fn new(field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { field: field.into(), detail: detail.into() }
    }
}

/// A device of the pool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceView {
    /// Short name that selects it.
    #[schema(example = "cpu")]
    pub id: String,
    /// Name in words.
    pub name: String,
    /// `cpu`, `discrete_gpu`, `integrated_gpu`, `virtual_gpu`, `software_gpu` or `other`.
    pub kind: String,
    /// Driver or instruction set.
    pub driver: String,
    /// Whether this server's pool owns it.
    pub in_pool: bool,
    /// What its worker does; `null` outside the pool.
    #[schema(required)]
    pub status: Option<DeviceStatus>,
    /// The job it runs now.
    #[schema(required)]
    pub job: Option<uuid::Uuid>,
    /// Why it cannot be used, if so.
    #[schema(required)]
    pub error: Option<String>,
    /// How often a job broke it, so that it had to be opened again, since the server started.
    pub restarts: u32,
    /// Why the last time; `null` where it never was.
    #[schema(required)]
    pub last_fault: Option<String>,
}

/// What the worker of a device does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeviceStatus {
    /// Being opened.
    Opening,
    /// Waiting for a job.
    Idle,
    /// Running a job.
    Busy,
    /// Could not be opened; tried again from time to time.
    Failed,
}

/// The devices of this machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceList {
    /// All of them, those of the pool marked.
    pub devices: Vec<DeviceView>,
}
