//! Jobs as clients ask for them and as the API shows them.

use super::environment::EnvironmentRequest;
use super::parts::PartRequest;
use super::scenes::CameraName;
use super::shown::{BackgroundRequest, UnitsRequest};
use super::webhooks::WebhookTarget;
use super::{Warning, instant};
use crate::job_state::JobState;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{Object, Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};
use uuid::Uuid;

/// What a job asks for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// Id of a stored scene, or the name of a built-in one. Left out only where the scene
    /// travels in the same multipart request.
    #[serde(default)]
    #[schema(required, nullable = false, value_type = String, min_length = 1, max_length = 64, example = "cornell")]
    pub scene: Option<String>,
    /// How the light is computed; `auto` looks at the scene and picks.
    #[serde(default = "default_method")]
    #[schema(default = "auto", example = "auto")]
    pub method: String,
    /// Which camera: its index, its name, or a camera of the request's own. Without it the
    /// scene's first; without any, one that stands in the room that the scene is, or frames it.
    #[serde(default)]
    #[schema(nullable = false)]
    pub camera: Option<CameraRequest>,
    /// The name of one of the scene's `variants` (KHR_materials_variants), whose materials are shown.
    /// Without it those that the file shows by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false, max_length = 1024)]
    pub variant: Option<String>,
    /// Which of the scenes in the file is shown: the index or the name of one of the scene's
    /// `gltf_scenes`. Without it the file's default one, or else its first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub gltf_scene: Option<PartRequest>,
    /// Which animation moves what is shown: the index or the name of one of the scene's
    /// `animations`. Without it the file is shown at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub animation: Option<PartRequest>,
    /// The moment of the `animation`, seconds; without it the beginning. Before its first key a
    /// property has its first value, after its last key its last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false, minimum = 0, example = 1.5)]
    pub time: Option<f64>,
    /// What surrounds the scene. Without it nothing where the scene has lights of its own that light
    /// it, else a neutral studio, with a warning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub environment: Option<EnvironmentRequest>,
    /// What the camera sees beside the surfaces.
    #[serde(default, skip_serializing_if = "BackgroundRequest::is_default")]
    #[schema(default = "sky")]
    pub background: BackgroundRequest,
    /// What the numbers of the scene, and so of the EXR, are.
    #[serde(default, skip_serializing_if = "UnitsRequest::is_default")]
    #[schema(default = "photometric")]
    pub units: UnitsRequest,
    /// Picture width, pixels. The server may be configured for less.
    #[serde(default = "default_side")]
    #[schema(minimum = 1, maximum = 16384, default = 512, example = 64)]
    pub width: u32,
    /// Picture height, pixels. The server may be configured for less.
    #[serde(default = "default_side")]
    #[schema(minimum = 1, maximum = 16384, default = 512, example = 64)]
    pub height: u32,
    /// Estimated relative error (rRMSE) at which to stop.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, exclusive_maximum = 1.0, example = 0.05)]
    pub target_error: Option<f64>,
    /// Seconds of solving and measuring after which to stop. The server may be configured for
    /// less. Without any limit, 10.
    #[serde(default)]
    #[schema(nullable = false, exclusive_minimum = 0.0, maximum = 86400.0, example = 1.0)]
    pub time_budget_s: Option<f64>,
    /// Iterations of the method after which to stop.
    #[serde(default)]
    #[schema(nullable = false, minimum = 1, maximum = 1_000_000_000_000_u64, example = 200)]
    pub max_iterations: Option<u64>,
    /// Seed of all random numbers: same seed, same device, same `max_iterations`, same bits.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 9_007_199_254_740_991_u64, default = 0)]
    pub seed: u64,
    /// Pictures on the way; without it only the final one.
    #[serde(default)]
    #[schema(nullable = false)]
    pub snapshots: Option<SnapshotRequest>,
    /// Settings of the method by name.
    #[serde(default)]
    pub options: BTreeMap<String, OptionValue>,
    /// Jobs of higher priority start first. With an API key, above 0 needs the scope `priority`.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100, default = 0)]
    pub priority: i32,
    /// Render it even where the result of an identical job could be shared.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[schema(default = false)]
    pub fresh: bool,
    /// The client's own notes; `GET /v1/jobs?label=key:value` finds them.
    #[serde(default)]
    #[schema(schema_with = labels_schema)]
    pub labels: BTreeMap<String, String>,
    /// The job whose solution this one begins with; `POST /v1/jobs/{id}/views` makes such jobs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(read_only, nullable = false)]
    pub view_of: Option<Uuid>,
    /// Who is told when the job ends.
    #[serde(default)]
    #[schema(nullable = false)]
    pub webhook: Option<WebhookTarget>,
}

fn default_method() -> String {
    "auto".into()
}

fn default_side() -> u32 {
    512
}

pub(super) fn labels_schema() -> Object {
    let text = |least| {
        ObjectBuilder::new()
            .schema_type(Type::String)
            .min_length(least)
            .max_length(Some(64))
            .pattern(Some(if least.is_some() { "^[^:\\x00]*$" } else { "^[^\\x00]*$" }))
    };
    ObjectBuilder::new()
        .description(Some("The client's own notes; `GET /v1/jobs?label=key:value` finds them."))
        .property_names(Some(text(Some(1)).build()))
        .additional_properties(Some(text(None)))
        .max_properties(Some(16))
        .build()
}

/// Which camera takes the picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum CameraRequest {
    /// By position in the file.
    Index(u32),
    /// By name.
    Name(String),
    /// A camera of the request's own.
    Explicit(ExplicitCamera),
}

impl PartialSchema for CameraRequest {
    fn schema() -> RefOr<Schema> {
        let index = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .minimum(Some(0))
            .maximum(Some(u32::MAX));
        let name = ObjectBuilder::new().schema_type(Type::String).max_length(Some(1024));
        OneOfBuilder::new()
            .description(Some("Index of a camera, name of one, or a camera of the request's own."))
            .item(index)
            .item(name)
            .item(Ref::from_schema_name("ExplicitCamera"))
            .into()
    }
}

impl ToSchema for CameraRequest {}

/// A perspective camera given in the request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ExplicitCamera {
    /// World position, metres.
    #[schema(example = json!([0.5, 0.5, 2.0]))]
    pub eye: [f32; 3],
    /// World point that the optical axis goes through.
    #[schema(example = json!([0.5, 0.5, 0.0]))]
    pub target: [f32; 3],
    /// Which way is up; not along the view.
    #[serde(default = "default_up")]
    pub up: [f32; 3],
    /// Full vertical field of view, degrees.
    #[schema(minimum = 0.001, exclusive_maximum = 180.0, example = 40.0)]
    pub yfov_degrees: f32,
}

fn default_up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

/// Pictures on the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SnapshotRequest {
    /// Seconds between them; the interval doubles after every hundred, and whenever they reach the
    /// bytes that a job's snapshots may have, where every second one is removed.
    #[schema(minimum = 0.1, maximum = 3600.0, example = 1.0)]
    pub every_s: f64,
    /// File formats of each.
    #[serde(default = "default_formats")]
    #[schema(min_items = 1, max_items = 2)]
    pub formats: Vec<PictureFormat>,
}

fn default_formats() -> Vec<PictureFormat> {
    vec![PictureFormat::Png]
}

/// A picture file's format.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum PictureFormat {
    /// 8-bit sRGB, automatic exposure.
    Png,
    /// 32-bit float linear radiance.
    Exr,
}

impl PictureFormat {
    /// File name ending without the dot; also the name in the API.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
        }
    }

    /// Media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Exr => "image/x-exr",
        }
    }

    /// The format of that [`PictureFormat::suffix`].
    pub fn parse(suffix: &str) -> Option<Self> {
        [Self::Png, Self::Exr].into_iter().find(|format| format.suffix() == suffix)
    }
}

/// A setting's value; numbers and booleans are taken as written.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum OptionValue {
    /// A switch.
    Switch(bool),
    /// A number.
    Number(serde_json::Number),
    /// A word.
    Word(String),
}

impl PartialSchema for OptionValue {
    fn schema() -> RefOr<Schema> {
        let of = |kind| ObjectBuilder::new().schema_type(kind);
        OneOfBuilder::new()
            .description(Some("A setting's value; numbers and booleans are taken as written."))
            .item(of(Type::Boolean))
            .item(of(Type::Number))
            .item(of(Type::String).max_length(Some(256)))
            .into()
    }
}

impl ToSchema for OptionValue {}

impl std::fmt::Display for OptionValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Switch(value) => value.fmt(f),
            // 1e3 counts as 1000.
            Self::Number(value) => match value.as_f64() {
                Some(x) if x.fract() == 0.0 && x.abs() < 1e15 => (x as i64).fmt(f),
                _ => value.fmt(f),
            },
            Self::Word(value) => value.fmt(f),
        }
    }
}

/// What a job's picture took so far, and how far it may be off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Figures {
    /// Whole iterations done.
    pub iterations: u64,
    /// Hemicube shots done, or rays traced.
    pub shots: u64,
    /// Share of shots whose shooter emits; of rays, the share cast at or from a light.
    pub light_source_selection_ratio: f64,
    /// Estimated rRMSE of the present picture; `null` until there is enough to tell.
    #[schema(required)]
    pub estimated_error: Option<f64>,
    /// What the true error most likely lies between; `null` where the method holds no audit,
    /// or that can't tell yet.
    #[schema(required)]
    #[serde(default)]
    pub error_bounds: Option<ErrorBounds>,
}

/// What a picture's true error most likely lies between.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorBounds {
    /// Lower bound of the rRMSE.
    pub low: f64,
    /// Upper bound of the rRMSE: it covers what an audit by unbiased paths may have missed so far.
    pub high: f64,
    /// What says so.
    pub by: ErrorSource,
}

/// What an error is estimated by: `scatter` within the picture's own samples, beyond which unbiased
/// paths find nothing; or an `audit` by such paths, from which wide areas of the picture differ by more
/// than scatter explains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ErrorSource {
    /// The scatter within the picture's own samples.
    Scatter,
    /// Unbiased paths.
    Audit,
}

/// Where a running job stands.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// Its present picture.
    #[serde(flatten)]
    pub figures: Figures,
    /// Seconds since solving began.
    pub seconds: f64,
    /// Expected seconds to the nearest limit.
    #[schema(required)]
    pub seconds_remaining: Option<f64>,
    /// Share of the work done, in [0, 1].
    pub fraction: f64,
}

/// What the engine decided to do and why.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Plan {
    /// The method that runs.
    pub method: String,
    /// One sentence a decision.
    pub reasons: Vec<String>,
    /// Every setting in force.
    pub settings: BTreeMap<String, String>,
    /// Surface patches of the solution.
    pub patches: u64,
    /// Triangles that are rasterised.
    pub triangles: u64,
}

/// Figures of a finished job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Stats {
    /// The method that ran.
    pub method: String,
    /// Why it stopped: `time_budget`, `iterations`, `target_error`, `converged`, `cancelled`,
    /// `no_light`, or `server_limit` where the longest time of this server was used before what was
    /// asked for was reached.
    pub stopped: String,
    /// Its picture.
    #[serde(flatten)]
    pub figures: Figures,
    /// Seconds of preparing patches, solving and measuring.
    pub seconds_solve: f64,
    /// Seconds with scene reading and picture writing.
    pub seconds_total: f64,
    /// Surface patches.
    pub patches: u64,
    /// Triangles of the scene.
    pub triangles: u64,
    /// What computed, in words: the processor where the method does not use the device that the job
    /// ran on, which is the job's `device`. Empty in records of earlier versions.
    #[serde(default)]
    pub device: String,
    /// Figures of the method's own by name, such as the closure of its form factors.
    #[serde(default)]
    pub diagnostics: BTreeMap<String, f64>,
}

impl Stats {
    /// The progress of a job that has these figures at its end.
    pub fn last_progress(&self) -> Progress {
        Progress {
            figures: self.figures,
            seconds: self.seconds_solve,
            seconds_remaining: Some(0.0),
            fraction: 1.0,
        }
    }
}

/// Why a job failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobError {
    /// A short name for programs: `parameter`, `scene`, `environment`, `device`, `panic`,
    /// `picture`, `poisoned`.
    #[schema(example = "device")]
    pub code: String,
    /// What happened, in words.
    pub detail: String,
}

/// A picture file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Picture {
    /// Its format.
    pub format: PictureFormat,
    /// Where it lies; never changes its content.
    #[schema(
        example = "/v1/jobs/01936f3e-8a51-7c3e-b1a4-6f2d7a7b6c01/snapshots/9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08.png"
    )]
    pub url: String,
    /// SHA-256 of the file, in hex.
    pub sha256: String,
    /// Bytes of the file.
    pub size: u64,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The file itself in base64, where the stream was asked for it and it is small enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base64: Option<String>,
}

/// Where the time of a job went, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Timings {
    /// From acceptance to the last start, or until now.
    pub queued_s: f64,
    /// From the last start to the end, or until now.
    pub running_s: f64,
    /// From acceptance to the end, or until now.
    pub total_s: f64,
}

/// A job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Job {
    /// Its id.
    pub id: Uuid,
    /// Where it stands.
    pub state: JobState,
    /// Id of its scene.
    pub scene: String,
    /// What whoever sent the job called the scene then; `null` where it had no name.
    #[schema(required)]
    pub scene_name: Option<String>,
    /// What was asked for, defaults filled in.
    pub request: JobRequest,
    /// When it was accepted.
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub created_at: Timestamp,
    /// When it last started.
    #[schema(required, value_type = Option<String>, format = DateTime)]
    #[serde(serialize_with = "instant::serialize_if_any")]
    pub started_at: Option<Timestamp>,
    /// When it ended.
    #[schema(required, value_type = Option<String>, format = DateTime)]
    #[serde(serialize_with = "instant::serialize_if_any")]
    pub finished_at: Option<Timestamp>,
    /// Whether it stays until it is deleted, however old it gets.
    pub pinned: bool,
    /// Bytes that are stored of it: pictures, snapshots among them, and its solution.
    #[serde(default)]
    pub bytes: u64,
    /// Counted attempts. A failure makes another one necessary, up to five; where jobs run within
    /// the server, so does its death, up to twenty.
    pub attempts: u32,
    /// Attempts that do not count: the server died, or the job's process was killed for want of
    /// memory while other jobs ran.
    pub interruptions: u32,
    /// Whether a cancel is on its way to the worker.
    pub cancel_requested: bool,
    /// Id of the device that runs or ran it; `stats.device` says what computed.
    #[schema(required)]
    pub device: Option<String>,
    /// Latest figures.
    #[schema(required)]
    pub progress: Option<Progress>,
    /// Its present picture.
    #[serde(flatten)]
    pub figures: Figures,
    /// What the engine decided.
    #[schema(required)]
    pub plan: Option<Plan>,
    /// What the picture does not show as authored.
    pub warnings: Vec<Warning>,
    /// Figures of the finished job.
    #[schema(required)]
    pub stats: Option<Stats>,
    /// Why it failed.
    #[schema(required)]
    pub error: Option<JobError>,
    /// The final picture, one file a format; of a cancelled job the picture so far. An extended job
    /// shows that of before, with its `stats`, until there is a better one, also where the
    /// extension failed.
    #[schema(required)]
    pub result: Option<Vec<Picture>>,
    /// The identical job whose result this is; `null` where it was rendered for this job.
    #[schema(required)]
    pub result_of: Option<Uuid>,
    /// Where the time went.
    pub timings: Timings,
}

/// One page of jobs, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobPage {
    /// The jobs.
    pub jobs: Vec<Job>,
    /// Give this as `cursor` for the next page; `null` on the last one.
    #[schema(required)]
    pub next_cursor: Option<String>,
}

/// One point of a trace.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TracePoint {
    /// Seconds since solving began.
    pub seconds: f64,
    /// The picture then.
    #[serde(flatten)]
    pub figures: Figures,
}

/// How the figures of a job moved, oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Trace {
    /// The job.
    pub job: Uuid,
    /// Points of the latest attempt; the older half is thinned out in long jobs.
    pub points: Vec<TracePoint>,
}

impl JobRequest {
    /// The id of the stored map that the sky is, if it is one.
    pub fn environment_map(&self) -> Option<&str> {
        self.environment.as_ref()?.map()
    }

    /// Whether `cameras` has what [`JobRequest::camera`] asks for; the message if not. They are
    /// those of the file's default scene: of another one the import says.
    pub fn camera_problem(&self, cameras: &[CameraName]) -> Option<String> {
        if self.gltf_scene.is_some() {
            return None;
        }
        match self.camera.as_ref()? {
            CameraRequest::Index(index) if *index as usize >= cameras.len() => {
                Some(format!("index {index}, but the scene has {} cameras", cameras.len()))
            }
            CameraRequest::Name(name) if cameras.iter().all(|camera| camera.name != *name) => {
                let names: Vec<_> = cameras.iter().take(32).map(|c| c.name.as_str()).collect();
                Some(format!("no camera named {name:?}; the scene has {names:?}"))
            }
            _ => None,
        }
    }

    /// Whether a scene has the variant that [`JobRequest::variant`] asks for; the message if not.
    /// Of scenes that an earlier release stored it is not known: then the import says.
    pub fn variant_problem(&self, variants: Option<&[String]>) -> Option<String> {
        let (name, variants) = self.variant.as_ref().zip(variants)?;
        if variants.contains(name) {
            return None;
        }
        let names: Vec<_> = variants.iter().take(32).collect();
        Some(format!("no variant named {name:?}; the scene has {names:?}"))
    }
}
