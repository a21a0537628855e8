//! Between the API's words and the engine's, each way in one place: a job's request goes to the
//! engine, its plan, its figures and what its checkpoints are of come back.

use crate::api::jobs::{self as api, CameraRequest, JobRequest, OptionValue};
use crate::api::solutions::{Begins, Solution};
use hemilux_engine::checkpoint::Header;
use hemilux_engine::render::{
    Begin, CameraChoice, ExplicitCamera, Figures, Limits, Plan, Progress, RenderRequest, Stats,
};
use hemilux_engine::scene::Scene;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A job in the engine's words: its limits as it named them, as on the command line, and beside them
/// the longest time of the server, which ends jobs that name only iterations or an accuracy which
/// they may never reach.
pub fn render_request(
    job: &JobRequest,
    scene: Arc<Scene>,
    cap_seconds: Option<f64>,
    begin: Begin,
) -> RenderRequest {
    RenderRequest {
        scene,
        camera: camera(job.camera.as_ref()),
        width: job.width,
        height: job.height,
        method: job.method.clone(),
        limits: Limits {
            seconds: job.time_budget_s,
            iterations: job.max_iterations,
            target_error: job.target_error,
            cap_seconds,
        },
        seed: job.seed,
        options: settings(&job.options),
        begin,
    }
}

/// A job's settings in the engine's words.
pub fn settings(given: &BTreeMap<String, OptionValue>) -> BTreeMap<String, String> {
    given.iter().map(|(name, value)| (name.clone(), value.to_string())).collect()
}

/// A job's camera in the engine's words.
fn camera(request: Option<&CameraRequest>) -> CameraChoice {
    match request {
        None => CameraChoice::First,
        Some(CameraRequest::Index(index)) => CameraChoice::Index(*index),
        Some(CameraRequest::Name(name)) => CameraChoice::Name(name.clone()),
        Some(CameraRequest::Explicit(camera)) => {
            let api::ExplicitCamera { eye, target, up, yfov_degrees } = *camera;
            CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
        }
    }
}

/// JSON has no NaN; a figure that is none reads 0.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// What a picture took, in the API's words.
fn to_figures(figures: &Figures) -> api::Figures {
    api::Figures {
        iterations: figures.iterations,
        shots: figures.shots,
        light_source_selection_ratio: finite(figures.light_source_selection_ratio),
        estimated_error: figures.estimated_error.filter(|error| error.is_finite()),
    }
}

/// Where a job stands, in the API's words.
pub fn to_progress(progress: &Progress) -> api::Progress {
    api::Progress {
        figures: to_figures(&progress.figures),
        seconds: finite(progress.seconds),
        seconds_remaining: progress.seconds_remaining.filter(|seconds| seconds.is_finite()),
        fraction: finite(progress.fraction),
    }
}

/// What the engine decided, in the API's words.
pub fn to_plan(plan: &Plan) -> api::Plan {
    api::Plan {
        method: plan.method.clone(),
        reasons: plan.reasons.clone(),
        settings: plan.settings.clone(),
        patches: plan.patches,
        triangles: plan.triangles,
    }
}

/// The engine's figures in the API's words; the server adds the time that it saw itself.
pub fn to_stats(stats: &Stats) -> api::Stats {
    let stopped = serde_json::to_value(stats.stopped).ok();
    api::Stats {
        method: stats.method.clone(),
        stopped: stopped.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default(),
        figures: to_figures(&stats.figures),
        seconds_solve: finite(stats.seconds_solve),
        seconds_total: finite(stats.seconds_total),
        patches: stats.patches,
        triangles: stats.triangles,
        device: stats.device.clone(),
        diagnostics: stats.diagnostics.iter().map(|(k, v)| (k.clone(), finite(*v))).collect(),
    }
}

/// What a checkpoint is of, with figures that JSON can say.
pub fn finite_header(checkpoint: &Header) -> Header {
    Header {
        seconds: finite(checkpoint.seconds),
        estimated_error: checkpoint.estimated_error.filter(|error| error.is_finite()),
        ..checkpoint.clone()
    }
}

/// The record of a checkpoint that is kept as that file of so many bytes.
pub fn to_solution(checkpoint: Header, file: String, size: u64) -> Solution {
    Solution {
        file,
        size,
        begins: Begins::Continue,
        method: checkpoint.method,
        iterations: checkpoint.iterations,
        seconds: checkpoint.seconds,
        estimated_error: checkpoint.estimated_error,
        baked: None,
    }
}
