//! Ray tracing: the techniques that Rogers describes (Lange's importance sampling, jitter, Dippé's
//! adaptive rectangular jitter) and, with the defaults, unbiased path tracing: the engine's own
//! reference.
//!
//! The picture is traced in passes, one estimate of each pixel a pass, and is their mean. Rays
//! run on the processor whatever the device.

mod clear;
mod disks;
mod film;
mod lights;
mod path;
mod pixels;
mod settings;
mod strata;
pub(super) mod surface;

use super::Method;
use super::kept::{Parts, Past};
use super::options::Settings;
use super::run::Run;
use super::stage::{Asked, Record};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceDescription, DeviceError, free_memory};
use crate::image::Picture;
use crate::measurement::Frame;
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::scene::Warning;
use settings::{LightSampling, PixelSampling};
use std::time::Instant;

pub use settings::RayTracedSettings;
// What illumination maps share.
pub(super) use disks::{DiskPoints, Disks};
pub(super) use film::Film;
pub(super) use lights::{Choice, Emitted, Lights};
pub(super) use path::{Caustics, Mapped, Tracer};
pub(super) use pixels::Pixels;
pub(super) use surface::{Surface, World};

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

    fn checkpoint_format(&self) -> u32 {
        1
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
        let settings = Settings::new(&request.options)?;
        let options = RayTracedSettings::new(&settings)?;
        let past = Past::of(request, self.name(), &settings)?;
        check_memory(request)?;
        let asked = Asked { method: self.name(), reasons, request, settings: &settings };
        let mut record = Record::new(asked, format!("{} (rays)", CpuDevice::describe_here().name))?;
        let world = World::new(request.scene.clone());
        let lights = Lights::new(&world);
        let warnings = warnings(&world, &options, &device.description());
        let triangles = request.scene.triangles.len();
        record.announce((0, triangles), lights.is_some(), warnings, observer);

        let mut run = record.run(request, observer);
        let result = match &lights {
            Some(lights) => {
                let disks = options.disks(&world, lights);
                let tracer = Tracer {
                    world: &world,
                    lights,
                    disks: disks.as_ref().map(|(disks, points)| (disks, *points)),
                    reflections: options.reflections,
                    rays_per_pixel: options.rays_per_pixel,
                    caustics: None,
                };
                let pixels = Pixels {
                    tracer,
                    frame: Frame::new(&record.camera, request.width, request.height),
                    size: [request.width, request.height],
                    sampling: options.pixel_sampling,
                    path_strata: options.spreads_paths(),
                    seed: request.seed,
                };
                let mut film = Film::new(pixels.size, options.period());
                // What another camera saw is of no use to this one.
                if let Some(mut bound) = past.and_then(|past| past.bound) {
                    film.restore(&mut bound)?;
                    bound.end()?;
                }
                solve(&mut run, &pixels, film)?
            }
            None => (record.black(), StopReason::NoLight),
        };
        let rays = run.tally.shots as f64;
        let diagnostics =
            [("rays".into(), rays), ("rays_per_second".into(), rays / run.seconds())].into();
        Ok(record.rendered(run, result, diagnostics))
    }
}

/// Memory of the scene, as rays see it, and of the film, bytes.
pub fn needed_bytes(triangles: u64, width: u32, height: u32) -> u64 {
    World::needed_bytes(triangles) + Film::needed_bytes(width, height)
}

/// Refuses what would not fit into memory before anything is allocated.
fn check_memory(request: &RenderRequest) -> Result<(), DeviceError> {
    let triangles = request.scene.triangles.len() as u64;
    let needed_bytes = needed_bytes(triangles, request.width, request.height);
    let available_bytes = free_memory();
    if needed_bytes > available_bytes {
        let device = CpuDevice::describe().id;
        return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes });
    }
    Ok(())
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
        warnings.push(Warning::new("scene", "there is no surface; the picture is black"));
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

/// Traces passes until a limit is reached.
fn solve(
    run: &mut Run<'_>,
    pixels: &Pixels<'_>,
    mut film: Film,
) -> Result<(Picture, StopReason), DeviceError> {
    let save = |parts: &mut Parts, film: &Film| {
        film.save(&mut parts.bound);
        Ok(())
    };
    let height = film.height();
    let (mut row, mut step) = (film.next_row(), height.min(4));
    let mut step_passes = 1;
    let (mut estimated, mut estimate_seconds) = (Instant::now(), 0.0);
    let stopped = loop {
        if let Some(reason) = run.stop() {
            break reason;
        }
        let began = Instant::now();
        let rows = row..(row + step).min(height);
        // Whole passes at once only where a step has all rows.
        let passes =
            if step == height && row == 0 { step_passes.min(run.iterations_left()) } else { 1 };
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
        run.tally.light_shots = film.light_rays();
        if run.report_is_due() {
            if estimated.elapsed().as_secs_f64() >= ESTIMATE_PAUSE * estimate_seconds {
                let began = Instant::now();
                run.estimated_error = film.relative_error();
                run.without_estimate = run.estimated_error.is_none() && film.enough();
                estimate_seconds = began.elapsed().as_secs_f64();
                estimated = Instant::now();
            }
            run.report(run.tally.iterations > 0, || film.picture());
        }
        run.keep_if_wanted(|parts| save(parts, &film))?;
    };
    run.keep_solution(|parts| save(parts, &film))?;
    run.estimated_error = film.relative_error();
    Ok((film.picture(), stopped))
}
