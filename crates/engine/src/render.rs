//! One job from scene to picture: what is asked, what is reported on the way, what comes out.

mod framing;

use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::device::DeviceError;
use crate::image::Picture;
use crate::scene::environment::Environment;
use crate::scene::gltf::BakedMesh;
use crate::scene::{Background, Camera, Scene, SceneError, Warning};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What a job asks for.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// The scene; shared, never changed.
    pub scene: Arc<Scene>,
    /// What surrounds it; `None` leaves the choice to [`crate::transport::surroundings`].
    pub environment: Option<Arc<Environment>>,
    /// What the camera sees beside the surfaces; the light is the same with any.
    pub background: Background,
    /// Which camera.
    pub camera: CameraChoice,
    /// Picture width in pixels, 1 … [`MAX_PICTURE_SIDE`].
    pub width: u32,
    /// Picture height in pixels, 1 … [`MAX_PICTURE_SIDE`].
    pub height: u32,
    /// Name of the method: `auto` or the name of one.
    pub method: String,
    /// When to stop; the first limit reached ends the job.
    pub limits: Limits,
    /// Same seed, same device, same limits by iterations: same bits.
    pub seed: u64,
    /// Settings of the method by `NAME` or `METHOD.NAME`, see [`crate::transport::listed`]; others
    /// are refused.
    pub options: BTreeMap<String, String>,
    /// What it begins with.
    pub begin: Begin,
}

/// What a job begins with.
#[derive(Clone, Debug, Default)]
pub enum Begin {
    /// Nothing.
    #[default]
    Afresh,
    /// All that the same job knew at an earlier moment: it goes on as if it had never stopped, on
    /// the processor bit for bit. Iterations and seconds of before count towards the limits.
    Continue(Arc<Checkpoint>),
    /// What a job with another camera or another size of the picture, but else the same, found out
    /// about the scene. Limits count from here.
    View(Arc<Checkpoint>),
}

/// Longest side of a picture, pixels.
pub const MAX_PICTURE_SIDE: u32 = 16_384;
/// Narrowest vertical field of view of a request's camera, degrees.
pub const MIN_YFOV_DEGREES: f32 = 1e-3;
/// Sine of the smallest angle between a request's camera's view and what it calls up.
const MIN_UP_SINE: f32 = 1e-4;
/// Most pixels of a picture.
pub const MAX_PICTURE_PIXELS: u64 = 64 << 20;

/// Which camera takes the picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum CameraChoice {
    /// The first of the scene; without one, a camera in the room that the scene is, or one that
    /// frames the scene, with a warning.
    #[default]
    First,
    /// By position in the file.
    Index(u32),
    /// By name.
    Name(String),
    /// A camera of the request's own.
    Explicit(ExplicitCamera),
}

/// A perspective camera given in the request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplicitCamera {
    /// World position, metres.
    pub eye: [f32; 3],
    /// World point that the optical axis goes through.
    pub target: [f32; 3],
    /// Which way is up; +Y by default.
    #[serde(default = "default_up")]
    pub up: [f32; 3],
    /// Full vertical field of view, degrees, from [`MIN_YFOV_DEGREES`] to below 180.
    pub yfov_degrees: f32,
}

fn default_up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

/// When a job stops: what was asked for, and what is allowed. Without any limit that was asked for,
/// [`Limits::DEFAULT_SECONDS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Wall-clock seconds of solving and measuring, > 0.
    pub seconds: Option<f64>,
    /// Iterations of the method, ≥ 1.
    pub iterations: Option<u64>,
    /// Estimated relative error (rRMSE) to reach, in (0, 1).
    pub target_error: Option<f64>,
    /// Wall-clock seconds, > 0, after which whoever runs the job ends it, whatever was asked for.
    /// It stops the job and decides nothing else, so that the same request has the same plan
    /// wherever it runs.
    pub cap_seconds: Option<f64>,
}

impl Limits {
    /// Time budget of a job that names no limit, seconds.
    pub const DEFAULT_SECONDS: f64 = 10.0;

    /// So many iterations, and no other limit.
    pub fn iterations(iterations: u64) -> Self {
        Self { iterations: Some(iterations), ..Self::default() }
    }

    /// So many seconds, and no other limit.
    pub fn seconds(seconds: f64) -> Self {
        Self { seconds: Some(seconds), ..Self::default() }
    }

    /// What was asked for, the default of a job that names no limit filled in, and without the
    /// cap: what a job is planned by.
    pub fn to_plan_by(self) -> Self {
        let Self { seconds, iterations, target_error, .. } = self;
        let asked = Self { seconds, iterations, target_error, cap_seconds: None };
        match asked == Self::default() {
            true => Self { seconds: Some(Self::DEFAULT_SECONDS), ..asked },
            false => asked,
        }
    }
}

/// What a picture took so far, and how far it may be off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Whole iterations done.
    pub iterations: u64,
    /// Hemicube shots done, or rays traced.
    pub shots: u64,
    /// Share of shots whose shooter emits (Antal §3); of rays, the share cast at or from a light. 0
    /// before the first.
    pub light_source_selection_ratio: f64,
    /// Estimated rRMSE of the picture; `None` until there is enough to tell, or where the method
    /// can't.
    pub estimated_error: Option<f64>,
    /// What the true error most likely lies between; `None` where the method holds no audit, or that
    /// can't tell yet.
    #[serde(default)]
    pub error_bounds: Option<ErrorBounds>,
}

/// What a picture's true error most likely lies between.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorBounds {
    /// Lower bound of the rRMSE.
    pub low: f64,
    /// Upper bound of it: where an audit could have missed more than scatter shows, that counts.
    pub high: f64,
    /// What says so.
    pub by: ErrorSource,
}

/// What an error is estimated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorSource {
    /// By the scatter within the picture's own samples; unbiased paths find nothing beyond it.
    Scatter,
    /// By unbiased paths, from which wide areas of the picture differ by more than scatter explains.
    Audit,
}

/// Where a job stands.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Its present picture.
    #[serde(flatten)]
    pub figures: Figures,
    /// Seconds since solving began.
    pub seconds: f64,
    /// Expected seconds to the nearest limit.
    pub seconds_remaining: Option<f64>,
    /// Share of the work done, in [0, 1].
    pub fraction: f64,
}

/// What the engine decided to do and why.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// The method that runs.
    pub method: String,
    /// One sentence a decision.
    pub reasons: Vec<String>,
    /// Every setting in force, defaults included.
    pub settings: BTreeMap<String, String>,
    /// Surface patches of the solution.
    pub patches: u64,
    /// Triangles that are rasterised.
    pub triangles: u64,
}

/// Why a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// The time budget was used.
    TimeBudget,
    /// The longest time that is allowed, [`Limits::cap_seconds`], was used before what was asked
    /// for was reached.
    ServerLimit,
    /// The asked iterations were done.
    Iterations,
    /// The estimated error fell to the target.
    TargetError,
    /// The observer asked to stop.
    Cancelled,
    /// The method has nothing more to do.
    Converged,
    /// There is no light in the scene: the picture is exactly black.
    NoLight,
}

/// Figures of a finished job; the `--stats` file and the job's record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stats {
    /// The method that ran.
    pub method: String,
    /// What was decided and why.
    pub plan: Plan,
    /// Why it stopped.
    pub stopped: StopReason,
    /// Its picture.
    #[serde(flatten)]
    pub figures: Figures,
    /// Seconds with start-up and file reading.
    pub seconds_total: f64,
    /// Seconds of preparing patches, solving and measuring.
    pub seconds_solve: f64,
    /// Surface patches.
    pub patches: u64,
    /// Triangles of the scene.
    pub triangles: u64,
    /// What computed, in words: the processor where the method does not use the device that the job
    /// was given.
    pub device: String,
    /// What the picture does not show as authored.
    pub warnings: Vec<WarningText>,
    /// Figures of the method's own by name, such as the closure of its form factors.
    #[serde(default)]
    pub diagnostics: BTreeMap<String, f64>,
}

/// A [`Warning`] in a record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WarningText {
    /// Where.
    pub at: String,
    /// What.
    pub what: String,
}

impl From<&Warning> for WarningText {
    fn from(warning: &Warning) -> Self {
        Self { at: warning.at.clone(), what: warning.what.clone() }
    }
}

/// Who watches a job. Called on the rendering thread, between submissions to the device.
pub trait Observer {
    /// Called before the first iteration, and again at the end where there is one more warning then.
    fn planned(&mut self, _plan: &Plan, _warnings: &[Warning]) {}
    /// Called several times a second.
    fn progress(&mut self, _progress: &Progress) {}
    /// Whether a picture of the present state is wanted now.
    fn wants_snapshot(&mut self, _progress: &Progress) -> bool {
        false
    }
    /// The picture that [`Observer::wants_snapshot`] asked for.
    fn snapshot(&mut self, _picture: &Picture, _progress: &Progress) {}
    /// Whether a checkpoint of the present state is wanted now. Asked many times a second, between
    /// iterations.
    fn wants_checkpoint(&mut self, _progress: &Progress) -> bool {
        false
    }
    /// Whether what the job knows at its end is wanted, to go on from there some day or to take
    /// other pictures of it. Asked once, before the last report.
    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        false
    }
    /// Most bytes of a checkpoint: larger ones are not made.
    fn most_checkpoint_bytes(&self) -> u64 {
        u64::MAX
    }
    /// What [`Observer::wants_checkpoint`] or [`Observer::wants_solution`] asked for, unless it
    /// would be too large.
    fn checkpoint(&mut self, _checkpoint: Checkpoint) {}
    /// Whether the light of the surfaces is wanted at the end, as a mesh.
    fn wants_baked(&self) -> bool {
        false
    }
    /// The mesh that [`Observer::wants_baked`] asked for; none comes of methods without patches,
    /// and none whose file would be larger than [`Observer::most_checkpoint_bytes`].
    fn baked(&mut self, _mesh: BakedMesh) {}
    /// Whether to stop now.
    fn cancelled(&self) -> bool {
        false
    }
}

/// An observer that watches nothing.
pub struct Unobserved;

impl Observer for Unobserved {}

/// What a job gives.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The picture.
    pub picture: Picture,
    /// Its figures.
    pub stats: Stats,
}

/// Why a job could not be done.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The request does not fit the scene or the limits; the sender can mend it.
    #[error("{parameter}: {what}")]
    Parameter {
        /// Which parameter.
        parameter: String,
        /// What is wrong and what would be right.
        what: String,
    },
    /// The device failed; another attempt or another device may succeed.
    #[error(transparent)]
    Device(DeviceError),
    /// The job can't begin with that checkpoint; it can begin afresh.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
}

impl From<DeviceError> for RenderError {
    fn from(error: DeviceError) -> Self {
        match error {
            DeviceError::Checkpoint(error) => Self::Checkpoint(error),
            error => Self::Device(error),
        }
    }
}

impl RenderError {
    /// A refusal of `parameter`.
    pub fn parameter(parameter: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Parameter { parameter: parameter.into(), what: what.into() }
    }
}

/// The camera that `choice` means in `scene` for a picture of that width and height, with a warning
/// where one had to be made up.
pub fn choose_camera(
    scene: &Scene,
    choice: &CameraChoice,
    [width, height]: [u32; 2],
) -> Result<(Camera, Option<Warning>), RenderError> {
    match choice {
        CameraChoice::First => match scene.cameras.first() {
            Some(camera) => Ok((camera.clone(), None)),
            None => {
                let (camera, made_up) = framing::camera(scene, width as f32 / height as f32);
                let what = format!("the scene has no camera; {made_up} was made up");
                Ok((camera, Some(Warning::new("camera", what))))
            }
        },
        CameraChoice::Index(index) => {
            scene.cameras.get(*index as usize).map(|camera| (camera.clone(), None)).ok_or_else(
                || {
                    let count = scene.cameras.len();
                    RenderError::parameter(
                        "camera",
                        format!("index {index}, but the scene has {count} cameras"),
                    )
                },
            )
        }
        CameraChoice::Name(name) => scene
            .cameras
            .iter()
            .find(|camera| camera.name == *name)
            .map(|camera| (camera.clone(), None))
            .ok_or_else(|| {
                let names: Vec<_> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
                RenderError::parameter(
                    "camera",
                    format!("no camera named {name:?}; there are {names:?}"),
                )
            }),
        CameraChoice::Explicit(camera) => explicit_camera(camera).map(|camera| (camera, None)),
    }
}

fn explicit_camera(camera: &ExplicitCamera) -> Result<Camera, RenderError> {
    let named = |field: &str| format!("camera.{field}");
    let vectors = [("eye", camera.eye), ("target", camera.target), ("up", camera.up)];
    for (field, vector) in vectors {
        if !Vec3::from_array(vector).is_finite() {
            return Err(RenderError::parameter(named(field), "must be three finite numbers"));
        }
    }
    if !(camera.yfov_degrees >= MIN_YFOV_DEGREES && camera.yfov_degrees < 180.0) {
        let what = format!("must be from {MIN_YFOV_DEGREES} to below 180");
        return Err(RenderError::parameter(named("yfov_degrees"), what));
    }
    let [eye, target, up] = vectors.map(|(_, vector)| Vec3::from_array(vector));
    let forward = (target - eye).normalize_or_zero();
    if forward == Vec3::ZERO {
        let what = "must differ from camera.eye, by more than single precision can lose";
        return Err(RenderError::parameter(named("target"), what));
    }
    let up_direction = up.normalize_or_zero();
    if up_direction == Vec3::ZERO {
        return Err(RenderError::parameter(named("up"), "must not be zero"));
    }
    if forward.cross(up_direction).length() < MIN_UP_SINE {
        let what = "must not be parallel to the view, the line from camera.eye to camera.target";
        return Err(RenderError::parameter(named("up"), what));
    }
    Ok(Camera::look_at("request", eye, target, up_direction, camera.yfov_degrees.to_radians()))
}

impl RenderRequest {
    /// A scene by a method in a picture of `[width, height]` pixels, and whatever a job has that
    /// asks for no more: the scene's first camera, seed 1, no limits, no settings.
    pub fn new(scene: Arc<Scene>, method: impl Into<String>, [width, height]: [u32; 2]) -> Self {
        Self {
            scene,
            environment: None,
            background: Background::default(),
            camera: CameraChoice::First,
            width,
            height,
            method: method.into(),
            limits: Limits::default(),
            seed: 1,
            options: BTreeMap::new(),
            begin: Begin::Afresh,
        }
    }

    /// The camera that takes the picture, with a warning where it had to be made up.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] where the scene has no such camera.
    pub fn camera(&self) -> Result<(Camera, Option<Warning>), RenderError> {
        choose_camera(&self.scene, &self.camera, [self.width, self.height])
    }

    /// Checks the size of the picture, the limits, a camera of the request's own and surroundings; for method and
    /// settings, too, see [`crate::transport::check`].
    ///
    /// # Errors
    /// [`RenderError::Parameter`] names the first parameter that is out of range.
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=MAX_PICTURE_SIDE).contains(&side) {
                let what = format!("must be 1 to {MAX_PICTURE_SIDE} pixels, not {side}");
                return Err(RenderError::parameter(name, what));
            }
        }
        if u64::from(self.width) * u64::from(self.height) > MAX_PICTURE_PIXELS {
            let what = format!("width times height must be at most {MAX_PICTURE_PIXELS} pixels");
            return Err(RenderError::parameter("width", what));
        }
        let Limits { seconds, iterations, target_error, cap_seconds } = self.limits;
        for (name, limit) in [("seconds", seconds), ("cap_seconds", cap_seconds)] {
            if limit.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
                return Err(RenderError::parameter(name, "must be a positive number"));
            }
        }
        if iterations == Some(0) {
            return Err(RenderError::parameter("iterations", "must be at least 1"));
        }
        if target_error.is_some_and(|e| !(e > 0.0 && e < 1.0)) {
            return Err(RenderError::parameter("target_error", "must be between 0 and 1"));
        }
        if let CameraChoice::Explicit(camera) = &self.camera {
            explicit_camera(camera)?;
        }
        let refuse = |error: SceneError| {
            RenderError::parameter(error.at, format!("{}; {}", error.what, error.fix))
        };
        self.background.check().map_err(refuse)?;
        if let Some(environment) = &self.environment {
            environment.check().map_err(refuse)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(camera: ExplicitCamera) -> Option<String> {
        let request = RenderRequest {
            camera: CameraChoice::Explicit(camera),
            seed: 0,
            ..RenderRequest::new(Arc::default(), "auto", [8, 8])
        };
        match request.check() {
            Ok(()) => None,
            Err(RenderError::Parameter { parameter, .. }) => Some(parameter),
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn cameras_that_cannot_look_are_refused_by_field() {
        let good = ExplicitCamera {
            eye: [0.5, 0.5, 2.0],
            target: [0.5, 0.5, 0.0],
            up: [0.0, 1.0, 0.0],
            yfov_degrees: 40.0,
        };
        assert_eq!(refused(good), None);
        assert_eq!(refused(ExplicitCamera { up: [0.0, 1e-15, 0.0], ..good }), None);
        for (camera, field) in [
            (ExplicitCamera { eye: [f32::NAN; 3], ..good }, "camera.eye"),
            (ExplicitCamera { target: good.eye, ..good }, "camera.target"),
            (ExplicitCamera { target: [0.5, 0.5, 2.0 + 1e-9], ..good }, "camera.target"),
            (ExplicitCamera { target: [f32::INFINITY; 3], ..good }, "camera.target"),
            (ExplicitCamera { up: [0.0; 3], ..good }, "camera.up"),
            (ExplicitCamera { up: [0.0, 0.0, -3.0], ..good }, "camera.up"),
            (ExplicitCamera { up: [0.0, 1e-5, 1.0], ..good }, "camera.up"),
            (ExplicitCamera { yfov_degrees: 0.9e-3, ..good }, "camera.yfov_degrees"),
            (ExplicitCamera { yfov_degrees: 180.0, ..good }, "camera.yfov_degrees"),
        ] {
            assert_eq!(refused(camera).as_deref(), Some(field), "{camera:?}");
        }
    }
}
