//! Ray tracing: the techniques that Rogers describes (Lange's importance sampling, jitter, Dippé's
//! adaptive rectangular jitter) and, with the defaults, unbiased path tracing: the engine's own
//! reference.
//!
//! The picture is traced in passes, one estimate of each pixel a pass, and is their mean. Rays
//! run on the processor whatever the device.

mod film;
mod path;
mod pixels;
mod settings;
mod steps;
mod view;

use super::checkpoints::Parts;
use super::job::{Announcement, Job};
use super::options::{AnySetting, Preset};
use super::run::Run;
use super::solver::{Estimate, Extent, Method, Solver, TargetChecks};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceDescription, DeviceError, Tally};
use crate::emitters::SceneLights;
use crate::image::Picture;
use crate::render::{RenderError, StopReason};
use crate::scene::Warning;
use crate::surface::World;
use settings::{LightSampling, PixelSampling};
use std::collections::BTreeMap;

// What illumination maps share.
pub(super) use film::Film;
pub(super) use path::{Caustics, Mapped, Tracer, Walk};
pub(super) use settings::{PRESETS, RayTracedSettings, SETTINGS};
pub(super) use steps::Steps;
pub(super) use view::View;

/// Path tracing, and the techniques that led to it.
pub struct RayTraced;

impl Method for RayTraced {
    fn name(&self) -> &'static str {
        "ray-traced"
    }

    fn checkpoint_format(&self) -> u32 {
        2
    }

    fn summary(&self) -> &'static str {
        "path tracing from the camera; unbiased unless a setting says otherwise"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        SETTINGS.to_vec()
    }

    fn presets(&self) -> &'static [Preset] {
        &PRESETS
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        needed_bytes(extent)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        let options = RayTracedSettings::new(&job.settings);
        let world = job.world();
        let lights = SceneLights::new(&world);
        job.announce(Announcement {
            device: format!("{} (rays)", CpuDevice::describe_here().name),
            patches: 0,
            triangles: job.request.scene.triangle_count(),
            shines: lights.is_some(),
            warnings: warnings(&world, &options, &device.description()),
        });
        let Some(lights) = lights else { return Ok(None) };
        let view = View::new(job, world, lights, options);
        let mut film = view.film();
        // What another camera saw is of no use to this one.
        if let Some(mut bound) = job.past.take().and_then(|past| past.bound) {
            film.restore(&mut bound)?;
            bound.end()?;
        }
        let steps = Steps::new(film.height());
        let checks = TargetChecks::after(film.passes());
        Ok(Some(Box::new(Passes { view, film, steps, checks })))
    }
}

/// Memory of the scene, as rays see it, and of the film, bytes.
pub fn needed_bytes(extent: &Extent<'_>) -> u64 {
    World::needed_bytes(extent.triangles.kept) + Film::needed_bytes(extent.size[0], extent.size[1])
}

/// What is not as it should be: an empty scene, bias that was asked for, another device than was
/// asked for.
pub(super) fn warnings(
    world: &World,
    options: &RayTracedSettings,
    device: &DeviceDescription,
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if world.rays.is_empty() {
        warnings.push(Warning::new("scene", "there is no surface to be seen"));
    }
    if device.kind != "cpu" {
        let what = format!("rays are traced by the processor, not by {}", device.name);
        warnings.push(Warning::new("device", what));
    }
    if options.light_sampling != LightSampling::Area {
        warnings.push(Warning::new(
            "options.light_sampling",
            "lights are sampled as disks with a weighted centre ray, so direct light is biased; area is not",
        ));
    }
    if matches!(options.pixel_sampling, PixelSampling::Adaptive { fresh: false, .. }) {
        warnings.push(Warning::new(
            "options.pixel_sampling",
            "samples decide about splits and are kept, which is biased: what few samples see counts less; adaptive_fresh and jittered are not",
        ));
    }
    warnings
}

/// The passes at work.
struct Passes {
    view: View,
    film: Film,
    steps: Steps,
    checks: TargetChecks,
}

impl Solver for Passes {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let pixels = self.view.pixels(None);
        let to_check = self.checks.iterations_to_next(self.film.passes());
        self.steps.advance(&mut self.film, &pixels, run.iterations_left().min(to_check));
        run.standing.tally = Tally {
            iterations: self.film.passes(),
            shots: self.film.rays(),
            light_shots: self.film.light_rays(),
        };
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        self.film.passes() > 0
    }

    fn checks_target(&mut self, passes: u64) -> bool {
        self.checks.are_due(passes)
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::of_batches(self.film.relative_error(), self.film.enough())
    }

    fn picture(&mut self) -> Picture {
        self.film.picture()
    }

    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        self.film.save(&mut parts.bound);
        Ok(())
    }

    fn diagnostics(&self, run: &Run<'_>) -> BTreeMap<String, f64> {
        ray_figures(run)
    }
}

/// Rays, and how many a second.
pub fn ray_figures(run: &Run<'_>) -> BTreeMap<String, f64> {
    let rays = run.standing.tally.shots as f64;
    BTreeMap::from([("rays".into(), rays), ("rays_per_second".into(), rays / run.seconds())])
}
