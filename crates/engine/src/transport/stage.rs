//! What every method on patches sets up and leaves behind: the cut scene, the camera, the plan,
//! the warnings, and at the end the figures.

use super::options::{MeshSettings, Settings};
use super::run::Run;
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

/// The set-up of one job.
pub struct Stage {
    start: Instant,
    device: DeviceDescription,
    plan: Plan,
    warnings: Vec<Warning>,
    scene_triangles: u64,
    width: u32,
    height: u32,
    mesh: MeshSettings,
    /// The camera that takes the picture.
    pub camera: Camera,
    /// The scene in patches.
    pub scene: Arc<PatchedScene>,
}

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

impl Stage {
    /// Cuts `scene` (the request's, or what the method makes of it) and tells the observer the
    /// plan.
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
        let start = Instant::now();
        let Asked { method, reasons, request, settings } = asked;
        let mesh = settings.mesh()?;
        let (camera, made_up) = choose_camera(&request.scene, &request.camera)?;
        let scene = Arc::new(PatchedScene::new(scene, patches));
        let plan = Plan {
            method: method.into(),
            reasons,
            settings: settings.values().clone(),
            patches: scene.patches.len() as u64,
            triangles: scene.facets.len() as u64,
        };
        let mut warnings = request.scene.warnings.clone();
        warnings.extend(scene.warnings.iter().cloned());
        warnings.extend(made_up);
        if !scene.patches.any_light() {
            warnings.push(Warning::new(
                "scene",
                "nothing emits light, so the picture is black; give a material an emissive factor",
            ));
        }
        warnings.extend(more_warnings(&scene));
        observer.planned(&plan, &warnings);
        let scene_triangles = request.scene.triangles.len() as u64;
        let (width, height) = (request.width, request.height);
        Ok(Self {
            start,
            device,
            plan,
            warnings,
            scene_triangles,
            width,
            height,
            mesh,
            camera,
            scene,
        })
    }

    /// The run of this job.
    pub fn run<'a>(&self, request: &RenderRequest, observer: &'a mut dyn Observer) -> Run<'a> {
        Run::new(self.start, request.limits, observer)
    }

    /// What turns solutions into the picture.
    pub fn measurement(&self) -> Measurement {
        Measurement::new(
            self.scene.clone(),
            &self.camera,
            self.width,
            self.height,
            self.mesh.pixel_samples,
            self.mesh.smoothness,
        )
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
        let seconds = self.start.elapsed().as_secs_f64();
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
            device: format!("{} ({})", self.device.name, self.device.driver),
            warnings: self.warnings.iter().map(Into::into).collect(),
            diagnostics,
            plan: self.plan,
        };
        Rendered { picture, stats }
    }
}
