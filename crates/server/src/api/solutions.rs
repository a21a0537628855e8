//! What is kept of jobs: their solutions, what can be made of them, and the record of a result.

use super::jobs::{CameraRequest, Job, JobRequest, Picture, Plan, SnapshotRequest, Stats, Timings};
use super::scenes::SceneFormat;
use super::{Warning, instant};
use crate::job_state::JobState;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;
use uuid::Uuid;

/// More budget for a job that has ended. At least one limit; each is that of the whole job, what
/// it has already used included, and must be beyond that. Together they replace the job's limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ExtendRequest {
    /// Estimated relative error (rRMSE) at which to stop.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, exclusive_maximum = 1.0, example = 0.01)]
    pub target_error: Option<f64>,
    /// Seconds of solving and measuring after which to stop.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, maximum = 86400.0, example = 20.0)]
    pub time_budget_s: Option<f64>,
    /// Iterations of the method after which to stop.
    #[serde(default)]
    #[schema(nullable = false, minimum = 1, maximum = 1_000_000_000_000_u64, example = 400)]
    pub max_iterations: Option<u64>,
}

/// Another picture of a scene that a job has solved. Scene, method, settings and seed are that
/// job's; limits count from here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ViewRequest {
    /// Which camera; without it that job's.
    #[serde(default)]
    #[schema(nullable = false)]
    pub camera: Option<CameraRequest>,
    /// Picture width, pixels; without it that job's.
    #[serde(default)]
    #[schema(nullable = false, minimum = 1, maximum = 16384, example = 64)]
    pub width: Option<u32>,
    /// Picture height, pixels; without it that job's.
    #[serde(default)]
    #[schema(nullable = false, minimum = 1, maximum = 16384, example = 64)]
    pub height: Option<u32>,
    /// Estimated relative error (rRMSE) at which to stop.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, exclusive_maximum = 1.0, example = 0.05)]
    pub target_error: Option<f64>,
    /// Seconds of solving and measuring after which to stop. Without any limit, 10.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, maximum = 86400.0, example = 1.0)]
    pub time_budget_s: Option<f64>,
    /// Iterations of the method after which to stop.
    #[serde(default)]
    #[schema(nullable = false, minimum = 1, maximum = 1_000_000_000_000_u64, example = 4)]
    pub max_iterations: Option<u64>,
    /// Pictures on the way; without it only the final one.
    #[serde(default)]
    #[schema(nullable = false)]
    pub snapshots: Option<SnapshotRequest>,
    /// Jobs of higher priority start first. With an API key, above 0 needs the scope `priority`.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100, default = 0)]
    pub priority: i32,
    /// The client's own notes.
    #[serde(default)]
    #[schema(schema_with = super::jobs::labels_schema)]
    pub labels: BTreeMap<String, String>,
}

impl ExtendRequest {
    /// The request of the extended job.
    pub fn apply(&self, job: &JobRequest) -> JobRequest {
        JobRequest {
            target_error: self.target_error,
            time_budget_s: self.time_budget_s,
            max_iterations: self.max_iterations,
            ..job.clone()
        }
    }
}

impl ViewRequest {
    /// The request of the new job, of a picture of what `job` has solved.
    pub fn apply(&self, job: &JobRequest) -> JobRequest {
        JobRequest {
            camera: self.camera.clone().or_else(|| job.camera.clone()),
            width: self.width.unwrap_or(job.width),
            height: self.height.unwrap_or(job.height),
            target_error: self.target_error,
            time_budget_s: self.time_budget_s,
            max_iterations: self.max_iterations,
            snapshots: self.snapshots.clone(),
            priority: self.priority,
            labels: self.labels.clone(),
            view_of: None,
            webhook: None,
            ..job.clone()
        }
    }
}

/// What a job begins with where it begins again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Begins {
    /// Where it was itself.
    Continue,
    /// With the solution of another job.
    View,
}

/// What is kept of the light of a job's scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Solution {
    /// Its file, in the job's folder.
    pub file: String,
    /// Bytes of the file.
    pub size: u64,
    /// Whose it is.
    pub begins: Begins,
    /// The method that found it.
    pub method: String,
    /// Whole iterations that are in it.
    pub iterations: u64,
    /// Seconds that they took.
    pub seconds: f64,
    /// Estimated rRMSE of the picture at that moment.
    #[schema(required)]
    pub estimated_error: Option<f64>,
    /// The light baked onto the geometry, for methods with patches, once the job has ended.
    #[schema(required)]
    pub baked: Option<KeptFile>,
}

/// A kept file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct KeptFile {
    /// Its name, in the job's folder.
    pub file: String,
    /// SHA-256, in hex.
    pub sha256: String,
    /// Bytes.
    pub size: u64,
}

impl Solution {
    /// The names of all its files.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        [Some(&self.file), self.baked.as_ref().map(|baked| &baked.file)]
            .into_iter()
            .flatten()
            .map(String::as_str)
    }
}

/// All that it takes to say what a result is and to make it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Manifest {
    /// The job.
    pub job: Uuid,
    /// How it ended.
    pub state: JobState,
    /// Version of the program that answers.
    pub version: String,
    /// The scene.
    pub scene: ManifestScene,
    /// Everything that was asked for, defaults filled in; the seed among it.
    pub request: JobRequest,
    /// The job whose solution it began with.
    #[schema(required)]
    pub view_of: Option<Uuid>,
    /// What the engine decided.
    #[schema(required)]
    pub plan: Option<Plan>,
    /// The device that ran.
    #[schema(required)]
    pub device: Option<String>,
    /// Figures.
    #[schema(required)]
    pub stats: Option<Stats>,
    /// The pictures, with their hashes.
    pub pictures: Vec<Picture>,
    /// What is kept to go on from.
    #[schema(required)]
    pub solution: Option<Solution>,
    /// What the picture does not show as authored.
    pub warnings: Vec<Warning>,
    /// When the job was accepted.
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub created_at: Timestamp,
    /// When it ended.
    #[schema(required, value_type = Option<String>, format = DateTime)]
    #[serde(serialize_with = "instant::serialize_if_any")]
    pub finished_at: Option<Timestamp>,
    /// Where the time went.
    pub timings: Timings,
}

/// The scene of a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ManifestScene {
    /// SHA-256 of its stored bytes, in hex: its id.
    pub sha256: String,
    /// How it was sent.
    #[schema(required)]
    pub format: Option<SceneFormat>,
    /// Stored bytes.
    #[schema(required)]
    pub size: Option<u64>,
}

impl Manifest {
    /// The manifest of an ended job; `scene` is its size and format, where it is still stored.
    pub fn new(job: Job, scene: Option<(SceneFormat, u64)>, solution: Option<Solution>) -> Self {
        let version = env!("CARGO_PKG_VERSION").into();
        let scene = ManifestScene {
            sha256: job.scene,
            format: scene.map(|(format, _)| format),
            size: scene.map(|(_, size)| size),
        };
        Self {
            job: job.id,
            state: job.state,
            version,
            scene,
            view_of: job.request.view_of,
            request: job.request,
            plan: job.plan,
            device: job.device,
            stats: job.stats,
            pictures: job.result.unwrap_or_default(),
            solution,
            warnings: job.warnings,
            created_at: job.created_at,
            finished_at: job.finished_at,
            timings: job.timings,
        }
    }
}
