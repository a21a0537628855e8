//! Ray tracing: the techniques that Rogers describes (Lange's importance sampling, jitter, Dippé's
//! adaptive rectangular jitter) and, with the defaults, unbiased path tracing: the engine's own
//! reference.
//!
//! The picture is traced in passes, one estimate of each pixel a pass, and is their mean. Rays
//! run on the processor whatever the device.

mod film;
mod lights;
mod path;
mod pixels;
mod settings;
mod strata;
pub(super) mod surface;

use super::Method;
use super::options::Settings;
use super::run::Run;
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceDescription, DeviceError, free_memory};
use crate::image::Picture;
use crate::measurement::Frame;
use crate::rays::Rays;
use crate::render::{
    Observer, Plan, RenderError, RenderRequest, Rendered, Stats, StopReason, choose_camera,
};
use crate::scene::Warning;
use film::Film;
use lights::Lights;
use path::Tracer;
use pixels::Pixels;
use settings::{LightSampling, PixelSampling};
use std::time::Instant;
use surface::World;

pub use settings::RayTracedSettings;

/// Aim of one step, seconds: short enough to cancel, long enough not to matter.
const STEP_SECONDS: f64 = 0.04;
/// Pause between error estimates, in times of what the last one took.
const ESTIMATE_PAUSE: f64 = 10.0;
/// Most passes of a step.
const MOST_PASSES: u64 = 4096;

/// Path tracing, and the techniques that led to it.
pub struct RayTraced;

impl Method for RayTraced {
    fn name(&self) -> &'static str {
        "ray-traced"
    }

    fn summary(&self) -> &'static str {
        "path tracing from the camera, diffuse and Phong; unbiased unless a setting says otherwise"
    }

    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError> {
        let start = Instant::now();
        let settings = Settings::new(&request.options)?;
        let options = RayTracedSettings::new(&settings)?;
        let (camera, made_up) = choose_camera(&request.scene, &request.camera)?;
        let triangles = request.scene.triangles.len() as u64;
        check_memory(triangles, request)?;
        let world = World::new(request.scene.clone());
        let lights = Lights::new(&world);
        let plan = Plan {
            method: self.name().into(),
            reasons,
            settings: settings.values().clone(),
            patches: 0,
            triangles,
        };
        let device = device.description();
        let mut warnings = request.scene.warnings.clone();
        warnings.extend(made_up);
        warnings.extend(approximations(&options, &device));
        if lights.is_none() {
            warnings.push(Warning::new(
                "scene",
                "nothing emits light, so the picture is black; give a material an emissive factor",
            ));
        }
        if world.rays.is_empty() {
            warnings.push(Warning::new("scene", "there is no surface; the picture is black"));
        }
        observer.planned(&plan, &warnings);

        let mut run = Run::new(start, request.limits, observer);
        let (picture, stopped) = match &lights {
            Some(lights) => {
                let tracer = Tracer {
                    world: &world,
                    lights,
                    light_sampling: options.light_sampling,
                    reflections: options.reflections,
                    rays_per_pixel: options.rays_per_pixel,
                };
                let pixels = Pixels {
                    tracer,
                    frame: Frame::new(&camera, request.width, request.height),
                    size: [request.width, request.height],
                    sampling: options.pixel_sampling,
                    seed: request.seed,
                };
                solve(&mut run, &pixels, options.period())
            }
            None => (Picture::black(request.width, request.height), StopReason::NoLight),
        };
        let progress = run.finish();
        let seconds = start.elapsed().as_secs_f64();
        let rays = progress.shots as f64;
        let diagnostics =
            [("rays".into(), rays), ("rays_per_second".into(), rays / seconds)].into();
        let processor = CpuDevice::describe();
        let stats = Stats {
            method: self.name().into(),
            stopped,
            iterations: progress.iterations,
            shots: progress.shots,
            light_source_selection_ratio: progress.light_source_selection_ratio,
            seconds_total: seconds,
            seconds_solve: seconds,
            estimated_error: progress.estimated_error,
            patches: plan.patches,
            triangles,
            device: format!("{} (rays)", processor.name),
            warnings: warnings.iter().map(Into::into).collect(),
            diagnostics,
            plan,
        };
        Ok(Rendered { picture, stats })
    }
}

/// Refuses what would not fit into memory before anything is allocated.
fn check_memory(triangles: u64, request: &RenderRequest) -> Result<(), DeviceError> {
    let needed_bytes =
        Rays::needed_bytes(triangles) + Film::needed_bytes(request.width, request.height);
    let available_bytes = free_memory();
    if needed_bytes > available_bytes {
        let device = CpuDevice::describe().id;
        return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes });
    }
    Ok(())
}

/// What is not as it should be: bias that was asked for, another device than was asked for.
fn approximations(options: &RayTracedSettings, device: &DeviceDescription) -> Vec<Warning> {
    let mut warnings = Vec::new();
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

/// Traces passes until a limit is reached.
fn solve(run: &mut Run<'_>, pixels: &Pixels<'_>, period: u32) -> (Picture, StopReason) {
    let mut film = Film::new(pixels, period);
    let height = film.height();
    let (mut row, mut step) = (0, height.min(4));
    let mut step_passes = 1;
    let (mut estimated, mut estimate_seconds) = (Instant::now(), 0.0);
    let stopped = loop {
        if let Some(reason) = run.stop() {
            break reason;
        }
        let began = Instant::now();
        let rows = row..(row + step).min(height);
        // Whole passes at once only where a step has all rows.
        let passes = if step == height { step_passes.min(run.iterations_left()) } else { 1 };
        let work = f64::from(rows.end - rows.start) * passes as f64;
        row = rows.end % height;
        film.advance(pixels, rows, passes);
        let per_row = began.elapsed().as_secs_f64().max(1e-9) / work;
        let wanted = STEP_SECONDS / per_row;
        if row == 0 {
            step = (wanted as u32).clamp(1, height);
            step_passes = ((wanted / f64::from(height)) as u64).clamp(1, MOST_PASSES);
        } else {
            step = (wanted as u32).clamp(1, height - row);
        }
        run.tally.iterations = film.passes();
        run.tally.shots = film.rays();
        if run.report_is_due() {
            if estimated.elapsed().as_secs_f64() >= ESTIMATE_PAUSE * estimate_seconds {
                let began = Instant::now();
                run.estimated_error = film.relative_error();
                estimate_seconds = began.elapsed().as_secs_f64();
                estimated = Instant::now();
            }
            run.report(run.tally.iterations > 0, || film.picture());
        }
    };
    run.estimated_error = film.relative_error();
    (film.picture(), stopped)
}
