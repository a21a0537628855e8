//! What methods keep in checkpoints, and what they find there: whose it is, how far it was, what
//! was decided.

use super::options::{Scope, Settings};
use crate::checkpoint::{CheckpointError, Header, Reader, SceneDigest, ViewKey, Writer};
use crate::render::{Begin, Progress, RenderError, RenderRequest};
use crate::scene::environment::Environment;
use crate::scene::{Camera, Scene};
use std::collections::BTreeMap;
use std::str::FromStr;
use std::sync::{Arc, OnceLock};

/// A method as it is configured in a job.
pub struct Configured<'a> {
    /// Which, and what it can be set to.
    pub scope: &'a Scope,
    /// The format of its checkpoints.
    pub format: u32,
    /// The settings in force.
    pub settings: &'a Settings,
}

/// A request's scene in its surroundings, as checkpoints name it.
pub struct Surrounded {
    /// What is around it.
    pub environment: Arc<Environment>,
    /// What the hash of the scene begins with, once it was asked for.
    pub digest: Arc<OnceLock<SceneDigest>>,
}

/// What a job begins with, checked to be of the same scene and surroundings, method, settings and seed.
pub struct Past<'a> {
    header: &'a Header,
    /// What any camera can use.
    pub shared: Reader<'a>,
    /// What only its own camera can; `None` for another camera or size.
    pub bound: Option<Reader<'a>>,
}

impl<'a> Past<'a> {
    /// The past of a request that `method` is to render, by that camera.
    ///
    /// # Errors
    /// [`CheckpointError::Foreign`] or [`CheckpointError::Version`].
    pub fn of(
        request: &'a RenderRequest,
        (camera, scene): (&Camera, &Surrounded),
        method: &Configured<'_>,
    ) -> Result<Option<Self>, RenderError> {
        let (name, reads) = (method.scope.method, method.format);
        let (checkpoint, same_view) = match &request.begin {
            Begin::Afresh => return Ok(None),
            Begin::Continue(checkpoint) => (checkpoint, true),
            Begin::View(checkpoint) => (checkpoint, false),
        };
        let header = checkpoint.header();
        let foreign = |what: String| Err(CheckpointError::foreign(what).into());
        if header.method != name {
            return foreign(format!("the method {:?}, not to {name:?}", header.method));
        }
        if header.format != reads {
            let Header { engine, format, .. } = header;
            let found = format!("format {format} of the method {name}, by version {engine}");
            let here = format!("format {reads}");
            return Err(CheckpointError::Version { found, here }.into());
        }
        if header.seed != request.seed {
            return foreign(format!("seed {}, not to {}", header.seed, request.seed));
        }
        if let Some(what) = other_settings(&header.settings, method) {
            return foreign(what);
        }
        if same_view && header.view != view_key(request, camera) {
            return foreign("another camera, size of the picture or background".into());
        }
        let digest = scene.digest.get_or_init(|| SceneDigest::of(&request.scene));
        if header.scene != digest.within(&scene.environment) {
            return foreign("another scene, or other surroundings".into());
        }
        let bound = same_view.then(|| checkpoint.bound());
        Ok(Some(Self { header, shared: checkpoint.shared(), bound }))
    }

    /// What was decided then.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] where there is no such decision.
    pub fn decided<T: FromStr>(&self, name: &str) -> Result<T, CheckpointError> {
        let value = self.header.decided.get(name).and_then(|value| value.parse().ok());
        value.ok_or_else(|| CheckpointError::damaged(format!("it does not say {name}")))
    }
}

/// What a camera's part of a checkpoint is bound to.
fn view_key(request: &RenderRequest, camera: &Camera) -> ViewKey {
    ViewKey::new(camera, [request.width, request.height], request.background)
}

/// Settings of other methods that earlier releases wrote into every checkpoint, though the method
/// did not read them.
const OF_ALL_METHODS: [&str; 40] = [
    "adaptive",
    "adaptive_contrast",
    "ambient",
    "burn_in",
    "coarse_patches",
    "coarse_rays",
    "constant_radiance",
    "first_shot",
    "form_factor_points",
    "gather",
    "gather_direct",
    "gather_fit",
    "gather_rays",
    "hemicube_faces",
    "hemicube_resolution",
    "light",
    "light_rays",
    "light_sampling",
    "lobe_filter",
    "map_texels",
    "near_field",
    "patches",
    "path_strata",
    "pixel_samples",
    "pixel_sampling",
    "preset",
    "random_azimuth",
    "ray_depth",
    "ray_preset",
    "rays_per_pixel",
    "reconstruction",
    "shadow_filter",
    "shooter_point",
    "shooter_selection",
    "shots_per_iteration",
    "stratified",
    "subpixel_jitter",
    "variance_reduction",
    "variance_reduction_shots",
    "well_spread",
];

/// What differs between the settings of a checkpoint and those of a job, if anything. A setting
/// that there was not when the checkpoint was written had its default: whoever adds one whose
/// default does something else than before raises the method's format.
fn other_settings(then: &BTreeMap<String, String>, method: &Configured<'_>) -> Option<String> {
    let known = |name: &str| {
        OF_ALL_METHODS.contains(&name)
            || method.scope.settings.iter().any(|s| s.entry().name == name)
    };
    if let Some(unknown) = then.keys().find(|name| !known(name)) {
        return Some(format!("the setting {unknown:?}, which there is no more"));
    }
    let now = method.settings.values();
    method.scope.settings.iter().find_map(|setting| {
        let entry = setting.entry();
        let now = now[entry.name].as_str();
        let formerly = entry.former_name.and_then(|name| then.get(name));
        let then = formerly.or_else(|| then.get(entry.name)).map_or(entry.default, String::as_str);
        let same = then == now || (now == entry.default && Some(then) == entry.former_default);
        (!same).then(|| format!("{name}={then}, not to {name}={now}", name = entry.name))
    })
}

/// The two parts of a checkpoint in the making.
pub struct Parts {
    /// What any camera can use.
    pub shared: Writer,
    /// What only this one can.
    pub bound: Writer,
}

/// Whose checkpoints a run makes.
pub struct Owner {
    scene: Arc<Scene>,
    surrounded: Surrounded,
    seed: u64,
    method: String,
    format: u32,
    settings: BTreeMap<String, String>,
    view: ViewKey,
    /// Decisions by the limits or the picture.
    decided: BTreeMap<String, String>,
    /// The hash of scene and surroundings, once it was asked for.
    hash: Option<String>,
}

impl Owner {
    /// The owner of a request's checkpoints.
    pub fn new(
        request: &RenderRequest,
        method: &Configured<'_>,
        (camera, surrounded): (&Camera, Surrounded),
    ) -> Self {
        Self {
            scene: request.scene.clone(),
            surrounded,
            seed: request.seed,
            method: method.scope.method.into(),
            format: method.format,
            settings: method.settings.values(),
            view: view_key(request, camera),
            decided: BTreeMap::new(),
            // It was found to be the same.
            hash: match &request.begin {
                Begin::Afresh => None,
                Begin::Continue(past) | Begin::View(past) => Some(past.header().scene.clone()),
            },
        }
    }

    /// Remembers a decision by the limits or the picture.
    pub fn decide(&mut self, name: &str, value: &impl ToString) {
        self.decided.insert(name.into(), value.to_string());
    }

    /// The header of a checkpoint at this moment.
    pub fn header(&mut self, progress: &Progress, light_shots: u64) -> Header {
        let scene = self.hash.get_or_insert_with(|| {
            let digest = self.surrounded.digest.get_or_init(|| SceneDigest::of(&self.scene));
            digest.within(&self.surrounded.environment)
        });
        Header {
            engine: env!("CARGO_PKG_VERSION").into(),
            method: self.method.clone(),
            format: self.format,
            scene: scene.clone(),
            settings: self.settings.clone(),
            seed: self.seed,
            decided: self.decided.clone(),
            view: self.view.clone(),
            iterations: progress.figures.iterations,
            shots: progress.figures.shots,
            light_shots,
            seconds: progress.seconds,
            estimated_error: progress.figures.estimated_error,
        }
    }
}

#[cfg(test)]
mod tests;
