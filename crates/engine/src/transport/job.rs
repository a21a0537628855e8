//! One job as a method finds it: what is asked, with which settings and camera, what an earlier run
//! knew; and what is told of it: the plan, the warnings, and at the end the figures.

use super::checkpoints::{Configured, Owner, Past, Surrounded};
use super::options::{MeshSettings, Scope, Settings};
use super::prepared::{Beginning, Prepared};
use super::run::Run;
use super::{patchless, unseen};
use crate::checkpoint::CheckpointError;
use crate::image::Picture;
use crate::measurement::Measurement;
use crate::patches::{Cut, Focus, PatchedScene};
use crate::radiometry::Rgb;
use crate::render::{Observer, Plan, RenderError, RenderRequest, Rendered, Stats, StopReason};
use crate::scene::environment::Environment;
use crate::scene::{Camera, Scene, Warning};
use crate::surface::World;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

/// The method of a job, why it was chosen, and what it was set to.
pub struct Chosen {
    /// What it can be set to.
    pub scope: Scope,
    /// The format of its checkpoints.
    pub checkpoint_format: u32,
    /// One sentence a reason.
    pub reasons: Vec<String>,
    /// The settings in force.
    pub settings: Settings,
    /// What of the request the method can do nothing with.
    pub warnings: Vec<Warning>,
}

/// One job.
pub struct Job<'a> {
    /// What is asked.
    pub request: &'a RenderRequest,
    /// What earlier jobs have made of its scene.
    prepared: &'a Prepared,
    /// What surrounds the scene.
    pub environment: Arc<Environment>,
    /// The settings in force.
    pub settings: Settings,
    /// The camera that takes the picture.
    pub camera: Camera,
    /// What the job begins with.
    pub past: Option<Past<'a>>,
    /// The run.
    pub run: Run<'a>,
    /// What computes, in words.
    device: String,
    /// Whether anything emits light.
    shines: bool,
    plan: Plan,
    warnings: Vec<Warning>,
}

/// What a method says of a job before it solves it.
pub struct Announcement {
    /// What computes, in words.
    pub device: String,
    /// Patches of the solution.
    pub patches: usize,
    /// Triangles that the light meets.
    pub triangles: usize,
    /// Whether anything emits light.
    pub shines: bool,
    /// What the method does not show as authored.
    pub warnings: Vec<Warning>,
}

impl<'a> Job<'a> {
    /// Picks the camera, starts the clock and reads what the job begins with.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] where the scene has no such camera;
    /// [`RenderError::Checkpoint`] where the job can't begin with what it names.
    pub fn new(
        chosen: Chosen,
        (request, prepared): (&'a RenderRequest, &'a Prepared),
        observer: &'a mut dyn Observer,
    ) -> Result<Self, RenderError> {
        let Chosen { scope, checkpoint_format, reasons, settings, warnings: unused } = chosen;
        let method = Configured { scope: &scope, format: checkpoint_format, settings: &settings };
        let (camera, made_up) = prepared.camera(request)?;
        let start = Instant::now();
        let (environment, studio) = prepared.surroundings(request);
        let (around, digest) = (environment.clone(), prepared.digest.clone());
        let scene = Surrounded { environment: around, digest };
        let past = Past::of(request, (&camera, &scene), &method)?;
        let owner = Owner::new(request, &method, (&camera, scene));
        let plan = Plan {
            method: scope.method.into(),
            reasons,
            settings: settings.values(),
            ..Plan::default()
        };
        let mut warnings = request.scene.warnings.clone();
        warnings.extend(made_up.into_iter().chain(studio).chain(unused));
        let run = Run::new((request, start), owner, observer);
        Ok(Self {
            request,
            prepared,
            environment,
            settings,
            camera,
            past,
            run,
            device: String::new(),
            shines: false,
            plan,
            warnings,
        })
    }

    /// Adds reasons for how the method goes about the job.
    pub fn explain(&mut self, reasons: impl IntoIterator<Item = String>) {
        self.plan.reasons.extend(reasons);
    }

    /// Tells the observer the plan, with the method's warnings and one where nothing shines.
    pub fn announce(&mut self, told: Announcement) {
        (self.plan.patches, self.plan.triangles) = (told.patches as u64, told.triangles as u64);
        (self.device, self.shines) = (told.device, told.shines);
        if !told.shines {
            self.warnings.push(Warning::new(
                "scene",
                "nothing gives light, so the picture is black; add a sky, a sun, a light or an emissive material",
            ));
        }
        self.warnings.extend(told.warnings);
        self.run.observer().planned(&self.plan, &self.warnings);
    }

    /// Cuts `scene` (the request's, or what the method makes of it) into about so many patches and
    /// announces that, with what patches can't show and the method's own warnings. `device` is what
    /// computes.
    pub fn cut(
        &mut self,
        scene: Arc<Scene>,
        patches: usize,
        device: String,
        more_warnings: impl FnOnce(&PatchedScene) -> Vec<Warning>,
    ) -> Arc<PatchedScene> {
        let given = self.request.scene.clone();
        let warnings = |scene: &PatchedScene| {
            let mut warnings = unseen::by_patches(&given);
            warnings.extend(more_warnings(scene));
            warnings
        };
        let cut = Arc::new(PatchedScene::new(scene, patches));
        let shines = cut.patches.any_light() || patchless::shines(&cut.scene, &self.environment);
        let warnings = (cut.warnings.iter().cloned()).chain(warnings(&cut));
        self.announce(Announcement {
            device,
            patches: cut.patches.len(),
            triangles: cut.facets.len(),
            shines,
            warnings: warnings.collect(),
        });
        cut
    }

    /// The same, finest about a focus, for a method that shows what is unlit, too, and clear bodies,
    /// whose caustics it maps in scenes of at most so many triangles.
    pub fn cut_with_all(
        &mut self,
        (patches, focus): (usize, Option<Focus>),
        device: String,
        most_triangles: usize,
    ) -> Arc<Cut> {
        let scene = self.request.scene.clone();
        let has_sun = self.environment.sun.is_some();
        let cut = self.prepared.cut(patches, focus);
        let shines =
            cut.any_light() || patchless::shines(&scene, &self.environment) || scene.has_unlit();
        let more = unseen::by_gathering(&scene, has_sun, most_triangles);
        self.announce(Announcement {
            device,
            patches: cut.patches(),
            triangles: cut.facets(),
            shines,
            warnings: cut.warnings().into_iter().chain(more).collect(),
        });
        cut
    }

    /// The scene as rays meet it, in its surroundings and before its background.
    pub fn world(&self) -> World {
        self.prepared.world(self.environment.clone(), self.request.background)
    }

    /// What its method has begun with in an earlier job on the scene.
    pub fn beginning<T: Beginning>(&self) -> Option<Arc<T>> {
        self.prepared.beginning()
    }

    /// Keeps what the method begins with for later jobs on the scene.
    pub fn keep(&self, beginning: impl Beginning) {
        self.prepared.keep(Arc::new(beginning));
    }

    /// What turns solutions on the patches into the picture.
    pub fn measurement(&self, scene: &Arc<PatchedScene>) -> Measurement {
        let mesh = MeshSettings::new(&self.settings);
        let RenderRequest { width, height, .. } = *self.request;
        let (samples, smoothness) = (mesh.pixel_samples, mesh.smoothness);
        Measurement::new(scene.clone(), &self.camera, [width, height], samples, smoothness)
            .before(self.request.background, &self.environment)
    }

    /// What was decided for the job that this one begins with, or else `afresh`, to be found in
    /// its own checkpoints under `name`.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] where the earlier job says nothing of it.
    pub fn decide<T: FromStr + Display>(
        &mut self,
        name: &'static str,
        afresh: T,
    ) -> Result<T, CheckpointError> {
        let value = match &self.past {
            Some(past) => past.decided(name)?,
            None => afresh,
        };
        self.run.owner.decide(name, &value);
        Ok(value)
    }

    /// Warns of a picture that is black although something gives light.
    fn warn_of_black(&mut self, picture: &Picture) {
        if !self.shines || picture.pixels.iter().any(|pixel| *pixel != Rgb::ZERO) {
            return;
        }
        let what = "the picture is black: what gives light in the scene lights nothing that the camera sees; \
                    choose another camera, or add a sky or a sun (on the command line `--sky 1,1,1`)";
        self.warnings.push(Warning::new("camera", what));
        self.run.observer().planned(&self.plan, &self.warnings);
    }

    /// The result, with the method's own figures.
    pub fn rendered(
        mut self,
        (picture, stopped): (Picture, StopReason),
        diagnostics: BTreeMap<String, f64>,
    ) -> Rendered {
        self.warn_of_black(&picture);
        let progress = self.run.finish();
        let seconds = self.run.seconds();
        let stats = Stats {
            method: self.plan.method.clone(),
            stopped,
            figures: progress.figures,
            seconds_total: seconds,
            seconds_solve: seconds,
            patches: self.plan.patches,
            triangles: self.request.scene.triangle_count() as u64,
            device: self.device,
            warnings: self.warnings.iter().map(Into::into).collect(),
            diagnostics,
            plan: self.plan,
        };
        Rendered { picture, stats }
    }
}
