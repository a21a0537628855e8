//! What every method sets up and leaves behind: camera, plan, warnings, and at the end the figures
//! ([`Record`]); for methods on patches the cut scene, too ([`Stage`]).

use super::kept::Owner;
use super::options::{MeshSettings, Settings};
use super::run::Run;
use super::unseen;
use crate::device::DeviceDescription;
use crate::image::Picture;
use crate::measurement::Measurement;
use crate::patches::PatchedScene;
use crate::render::{
    Observer, Plan, RenderError, RenderRequest, Rendered, Stats, StopReason, choose_camera,
};
use crate::scene::{Camera, Scene, Warning};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// What a job asks of a method.
pub struct Asked<'a> {
    /// The method's name.
    pub method: &'static str,
    /// Why it was chosen.
    pub reasons: Vec<String>,
    /// The request.
    pub request: &'a RenderRequest,
    /// Its settings.
    pub settings: &'a Settings,
}

/// The record of one job, whatever its method.
pub struct Record {
    start: Instant,
    device: String,
    plan: Plan,
    warnings: Vec<Warning>,
    scene_triangles: u64,
    width: u32,
    height: u32,
    /// The camera that takes the picture.
    pub camera: Camera,
}

impl Record {
    /// Starts the clock and picks the camera. `device` is what computes, in words.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] where the scene has no such camera.
    pub fn new(asked: Asked<'_>, device: String) -> Result<Self, RenderError> {
        let start = Instant::now();
        let Asked { method, reasons, request, settings } = asked;
        let (camera, made_up) = choose_camera(&request.scene, &request.camera)?;
        let settings = settings.values().clone();
        let plan = Plan { method: method.into(), reasons, settings, ..Plan::default() };
        let mut warnings = request.scene.warnings.clone();
        warnings.extend(made_up);
        Ok(Self {
            start,
            device,
            plan,
            warnings,
            scene_triangles: request.scene.triangles.len() as u64,
            width: request.width,
            height: request.height,
            camera,
        })
    }

    /// Tells the observer the plan, with the method's own warnings and one where nothing shines.
    pub fn announce(
        &mut self,
        (patches, triangles): (usize, usize),
        shines: bool,
        warnings: impl IntoIterator<Item = Warning>,
        observer: &mut dyn Observer,
    ) {
        (self.plan.patches, self.plan.triangles) = (patches as u64, triangles as u64);
        if !shines {
            self.warnings.push(Warning::new(
                "scene",
                "nothing emits light, so the picture is black; give a material an emissive factor",
            ));
        }
        self.warnings.extend(warnings);
        observer.planned(&self.plan, &self.warnings);
    }

    /// The run of this job.
    pub fn run<'a>(&self, request: &RenderRequest, observer: &'a mut dyn Observer) -> Run<'a> {
        let owner = Owner::new(request, &self.plan.method, &self.plan.settings, &self.camera);
        Run::new(self.start, request, owner, observer)
    }

    /// The picture of a scene without light.
    pub fn black(&self) -> Picture {
        Picture::black(self.width, self.height)
    }

    /// The result, with the method's own figures.
    pub fn rendered(
        self,
        mut run: Run<'_>,
        (picture, stopped): (Picture, StopReason),
        diagnostics: BTreeMap<String, f64>,
    ) -> Rendered {
        let progress = run.finish();
        let seconds = run.seconds();
        let stats = Stats {
            method: self.plan.method.clone(),
            stopped,
            iterations: progress.iterations,
            shots: progress.shots,
            light_source_selection_ratio: progress.light_source_selection_ratio,
            seconds_total: seconds,
            seconds_solve: seconds,
            estimated_error: progress.estimated_error,
            patches: self.plan.patches,
            triangles: self.scene_triangles,
            device: self.device,
            warnings: self.warnings.iter().map(Into::into).collect(),
            diagnostics,
            plan: self.plan,
        };
        Rendered { picture, stats }
    }
}

/// Bytes that a method on patches takes at its peak for a scene of so many triangles and a picture
/// of that size, as measured: what scene, mesh, sums of the device and weights of the pixels hold,
/// and the program itself. There is at least a patch a triangle.
pub fn needed_bytes(triangles: u64, patches: u64, width: u32, height: u32) -> u64 {
    const PROGRAM: u64 = 16 << 20;
    const PER_TRIANGLE: u64 = 300;
    const PER_PATCH: u64 = 450;
    const PER_PIXEL: u64 = 32;
    let pixels = u64::from(width) * u64::from(height);
    let mesh = triangles.saturating_mul(PER_TRIANGLE);
    let light = patches.max(triangles).saturating_mul(PER_PATCH);
    mesh.saturating_add(light).saturating_add(PROGRAM + pixels * PER_PIXEL)
}

/// The set-up of one job on patches.
pub struct Stage {
    record: Record,
    mesh: MeshSettings,
    /// The camera that takes the picture.
    pub camera: Camera,
    /// The scene in patches.
    pub scene: Arc<PatchedScene>,
}

impl Stage {
    /// Cuts `scene` (the request's, or what the method makes of it) and tells the observer the
    /// plan. `device` is what computes.
    pub fn new(
        asked: Asked<'_>,
        scene: Arc<Scene>,
        device: DeviceDescription,
        more_warnings: impl FnOnce(&PatchedScene) -> Vec<Warning>,
        observer: &mut dyn Observer,
    ) -> Result<Self, RenderError> {
        let patches = asked.settings.mesh()?.patches;
        Self::with_patches(asked, scene, device, more_warnings, patches, observer)
    }

    /// The same with another wanted number of patches than the settings'.
    pub fn with_patches(
        asked: Asked<'_>,
        scene: Arc<Scene>,
        device: DeviceDescription,
        more_warnings: impl FnOnce(&PatchedScene) -> Vec<Warning>,
        patches: usize,
        observer: &mut dyn Observer,
    ) -> Result<Self, RenderError> {
        let mesh = asked.settings.mesh()?;
        let asked_scene = &asked.request.scene;
        let mut record = Record::new(asked, format!("{} ({})", device.name, device.driver))?;
        let scene = Arc::new(PatchedScene::new(scene, patches));
        let shines = scene.patches.any_light();
        let warnings = (scene.warnings.iter().cloned())
            .chain(unseen::by_patches(asked_scene))
            .chain(more_warnings(&scene));
        let sizes = (scene.patches.len(), scene.facets.len());
        record.announce(sizes, shines, warnings, observer);
        Ok(Self { camera: record.camera.clone(), record, mesh, scene })
    }

    /// The run of this job.
    pub fn run<'a>(&self, request: &RenderRequest, observer: &'a mut dyn Observer) -> Run<'a> {
        self.record.run(request, observer)
    }

    /// What turns solutions into the picture.
    pub fn measurement(&self) -> Measurement {
        Measurement::new(
            self.scene.clone(),
            &self.camera,
            self.record.width,
            self.record.height,
            self.mesh.pixel_samples,
            self.mesh.smoothness,
        )
    }

    /// The picture of a scene without light.
    pub fn black(&self) -> Picture {
        self.record.black()
    }

    /// The result, with the method's own figures.
    pub fn rendered(
        self,
        run: Run<'_>,
        result: (Picture, StopReason),
        diagnostics: BTreeMap<String, f64>,
    ) -> Rendered {
        self.record.rendered(run, result, diagnostics)
    }
}
