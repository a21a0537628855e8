//! How methods on patches begin where light comes from elsewhere than patches: they know that light,
//! and whether anything of it is left to be shot. Where nothing is, the scene is solved.

use super::checkpoints::Parts;
use super::job::Job;
use super::patchless;
use super::run::Run;
use super::solver::{Estimate, Solver};
use crate::device::DeviceError;
use crate::image::Picture;
use crate::measurement::{Measurement, Solution};
use crate::patches::PatchedScene;
use crate::radiometry::{Rgb, importance};
use crate::render::{RenderError, StopReason};
use std::ops::ControlFlow;
use std::sync::Arc;

/// What [`begin`] comes to: what solves the job, or `None` without any light, as
/// [`crate::transport::Method::begin`] has it; or, where there is light to be shot, the irradiance
/// of every patch by light that no patch sends, if there is such light.
pub type Beginning<'a> = ControlFlow<Option<Box<dyn Solver + 'a>>, Option<Vec<Rgb>>>;

/// Finds the light that no patch sends, and whether that leaves anything to be shot.
///
/// # Errors
/// [`RenderError::Checkpoint`] where the job can't begin with what it names.
pub fn begin<'a>(
    job: &mut Job<'_>,
    scene: &Arc<PatchedScene>,
) -> Result<Beginning<'a>, RenderError> {
    let patches = &scene.patches;
    let Some(irradiance) = patchless::irradiance(scene, &job.environment, job.request.seed) else {
        return Ok(match patches.any_light() {
            true => ControlFlow::Continue(None),
            false => ControlFlow::Break(None),
        });
    };
    let reflects =
        |i: usize| importance(patches.area[i] * patches.diffuse[i] * irradiance[i]) > 0.0;
    if patches.any_light() || (0..patches.len()).any(reflects) {
        return Ok(ControlFlow::Continue(Some(irradiance)));
    }
    if let Some(past) = job.past.take() {
        past.shared.end()?;
    }
    let measurement = job.measurement(scene);
    let settled = Settled { scene: scene.clone(), measurement, irradiance };
    Ok(ControlFlow::Break(Some(Box::new(settled))))
}

/// A scene that is solved before anything is shot: no patch emits light or reflects any.
struct Settled {
    scene: Arc<PatchedScene>,
    measurement: Measurement,
    irradiance: Vec<Rgb>,
}

impl Solver for Settled {
    fn advance(&mut self, _run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        Ok(self.finished())
    }

    fn finished(&self) -> Option<StopReason> {
        Some(StopReason::Converged)
    }

    fn is_visible(&self) -> bool {
        true
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::Never
    }

    fn picture(&mut self) -> Picture {
        let irradiance = self.irradiance.clone();
        self.measurement.picture(&Solution { irradiance, glossy: Vec::new() })
    }

    /// The light is found again from the seed.
    fn save(&mut self, _parts: &mut Parts) -> Result<(), DeviceError> {
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        Some((self.scene.clone(), self.irradiance.clone()))
    }
}
