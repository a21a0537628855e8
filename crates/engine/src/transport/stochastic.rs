//! Stochastic hemicube iteration (Antal): the device iterates, batches collect, the camera
//! measures the average.

use super::Method;
use super::batches::Batches;
use super::known::known_light;
use super::options::{ExpectedShots, Settings, StochasticSettings};
use crate::device::{Device, ShootingSettings, Tally, VarianceReduction};
use crate::image::Picture;
use crate::measurement::{Measurement, Solution, viewpoint};
use crate::patches::PatchedScene;
use crate::render::{
    Limits, Observer, Plan, Progress, RenderError, RenderRequest, Rendered, Stats, StopReason,
    choose_camera,
};
use crate::scene::Warning;
use std::sync::Arc;
use std::time::Instant;

/// Aim of one call to the device, seconds: short enough to cancel, long enough not to matter.
const STEP_SECONDS: f64 = 0.04;
/// Least time between progress reports, seconds.
const REPORT_SECONDS: f64 = 0.2;
/// Pause between error estimates, in times of what the last one took.
const ESTIMATE_PAUSE: f64 = 10.0;
/// A Phong lobe sharper than this is not resolved by patches of ordinary size.
const SHARP_EXPONENT: f32 = 200.0;

/// Antal's method with power importance sampling, K stratified shots an iteration, and the
/// averaged measurement.
pub struct Stochastic;

impl Method for Stochastic {
    fn name(&self) -> &'static str {
        "stochastic"
    }

    fn summary(&self) -> &'static str {
        "stochastic hemicube iteration on patches, diffuse and Phong"
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
        let options = settings.stochastic()?;
        let (camera, made_up) = choose_camera(&request.scene, &request.camera)?;
        let scene = Arc::new(PatchedScene::new(request.scene.clone(), options.patches));
        let plan = Plan {
            method: self.name().into(),
            reasons,
            settings: settings.values().clone(),
            patches: scene.patches.len() as u64,
            triangles: scene.facets.len() as u64,
        };
        let warnings = collect_warnings(&scene, made_up);
        observer.planned(&plan, &warnings);

        let description = device.description();
        let mut job = Job {
            start,
            limits: request.limits,
            tally: Tally::default(),
            batches: Batches::new(options.burn_in),
            estimated_error: None,
        };
        let (picture, stopped) = if scene.patches.any_light() {
            let measurement = Measurement::new(
                scene.clone(),
                &camera,
                request.width,
                request.height,
                options.pixel_samples,
                options.smoothness,
            );
            let mut shooting = ShootingSettings {
                seed: request.seed,
                variance_reduction: variance_reduction(&options, request.limits.iterations),
                viewpoint: Some(viewpoint(&camera)),
                ..options.shooting
            };
            let (constant, first_shot) = (options.constant, options.first_shot);
            shooting.known =
                known_light(device, &scene, &shooting, constant, first_shot)?.map(Arc::new);
            job.solve(device, scene.clone(), &shooting, &measurement, observer)?
        } else {
            (Picture::black(request.width, request.height), StopReason::NoLight)
        };
        let progress = job.progress();
        let seconds = start.elapsed().as_secs_f64();
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
            triangles: request.scene.triangles.len() as u64,
            device: format!("{} ({})", description.name, description.driver),
            warnings: warnings.iter().map(Into::into).collect(),
            plan,
        };
        Ok(Rendered { picture, stats })
    }
}

fn variance_reduction(
    options: &StochasticSettings,
    iterations: Option<u64>,
) -> Option<VarianceReduction> {
    let shots = match options.substitute_shots {
        ExpectedShots::Given(shots) => Some(shots),
        ExpectedShots::Growing => None,
        ExpectedShots::Auto => {
            let per_iteration = u64::from(options.shooting.shots_per_iteration);
            iterations.map(|iterations| iterations.saturating_mul(per_iteration))
        }
    };
    options.substitute.map(|substitute| VarianceReduction { substitute, shots })
}

fn collect_warnings(scene: &PatchedScene, made_up_camera: Option<Warning>) -> Vec<Warning> {
    let mut warnings = scene.scene.warnings.clone();
    warnings.extend(scene.warnings.iter().cloned());
    warnings.extend(made_up_camera);
    if !scene.patches.any_light() {
        warnings.push(Warning::new(
            "scene",
            "nothing emits light, so the picture is black; give a material an emissive factor",
        ));
    }
    let patches = &scene.patches;
    let sharp = (0..patches.len())
        .filter(|p| patches.is_glossy(*p) && patches.exponent[*p] > SHARP_EXPONENT)
        .map(|p| scene.facets[patches.facet[p] as usize].source as usize)
        .map(|source| scene.scene.triangles[source].material)
        .collect::<std::collections::BTreeSet<_>>();
    for material in sharp {
        let name = &scene.scene.materials[material as usize].name;
        warnings.push(Warning::new(
            format!("materials[{material}]"),
            format!("{name:?} reflects more sharply than the patches resolve; its highlights are blurred to patch size"),
        ));
    }
    warnings
}

/// A solve under way.
struct Job {
    start: Instant,
    limits: Limits,
    tally: Tally,
    batches: Batches,
    estimated_error: Option<f64>,
}

impl Job {
    fn solve(
        &mut self,
        device: &mut dyn Device,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
        measurement: &Measurement,
        observer: &mut dyn Observer,
    ) -> Result<(Picture, StopReason), RenderError> {
        let patches = scene.patches.len();
        let mut shooting = device.begin(scene, settings)?;
        let weights = measurement.vertex_weights();
        // The last picture is part of the time budget: know its price before the end.
        let priced = Instant::now();
        measurement.picture(&Solution::dark(patches));
        let picture_seconds = priced.elapsed().as_secs_f64();

        let (mut step, mut undrained, mut news) = (1u64, 0u64, false);
        let (mut reported, mut estimated) = (Instant::now(), Instant::now());
        let mut estimate_seconds = 0.0;
        let stopped = loop {
            if observer.cancelled() {
                break StopReason::Cancelled;
            }
            if let Some(reason) = self.limit_reached(picture_seconds) {
                break reason;
            }
            let wanted = self.limits.iterations.map_or(u64::MAX, |n| n - self.tally.iterations);
            let count = step.min(self.batches.room() - undrained).min(wanted);
            let began = Instant::now();
            self.tally += shooting.iterate(count as u32)?;
            let seconds = began.elapsed().as_secs_f64().max(1e-6);
            step = ((STEP_SECONDS / seconds * count as f64) as u64).clamp(1, 4096);

            // Sums leave the device at batch boundaries only, wherever the clock stands, so that
            // the same iterations give the same bits.
            undrained += count;
            if undrained == self.batches.room() {
                news |= self.batches.add(shooting.drain()?);
                undrained = 0;
            }
            if reported.elapsed().as_secs_f64() >= REPORT_SECONDS {
                // With millions of patches an estimate takes longer than a step: keep its share
                // of the time small.
                if news && estimated.elapsed().as_secs_f64() >= ESTIMATE_PAUSE * estimate_seconds {
                    let began = Instant::now();
                    self.estimated_error = self.batches.relative_error(measurement, &weights);
                    estimate_seconds = began.elapsed().as_secs_f64();
                    (estimated, news) = (Instant::now(), false);
                }
                let progress = self.progress();
                observer.progress(&progress);
                if self.batches.any() && observer.wants_snapshot(&progress) {
                    let picture = measurement.picture(&self.batches.mean());
                    observer.snapshot(&picture, &progress);
                }
                reported = Instant::now();
            }
        };
        if undrained > 0 {
            self.batches.add(shooting.drain()?);
        }
        self.estimated_error = self.batches.relative_error(measurement, &weights);
        let picture = measurement.picture(&self.batches.mean());
        let last = Progress { fraction: 1.0, seconds_remaining: Some(0.0), ..self.progress() };
        observer.progress(&last);
        Ok((picture, stopped))
    }

    /// The time budget: the asked one, or the default where nothing else would end the job.
    fn seconds_limit(&self) -> Option<f64> {
        let Limits { seconds, iterations, target_error } = self.limits;
        let unlimited = iterations.is_none() && target_error.is_none();
        seconds.or(unlimited.then_some(Limits::DEFAULT_SECONDS))
    }

    fn limit_reached(&self, picture_seconds: f64) -> Option<StopReason> {
        let elapsed = self.start.elapsed().as_secs_f64();
        let Limits { iterations, target_error, .. } = self.limits;
        if iterations.is_some_and(|limit| self.tally.iterations >= limit) {
            return Some(StopReason::Iterations);
        }
        // At least one iteration, however little time there is.
        let begun = self.tally.iterations > 0;
        if begun && self.seconds_limit().is_some_and(|limit| elapsed + picture_seconds >= limit) {
            return Some(StopReason::TimeBudget);
        }
        let error = self.estimated_error?;
        target_error.is_some_and(|target| error <= target).then_some(StopReason::TargetError)
    }

    fn progress(&self) -> Progress {
        let seconds = self.start.elapsed().as_secs_f64();
        let Limits { iterations, target_error, .. } = self.limits;
        let Tally { iterations: done, shots, light_shots } = self.tally;
        let by_time = self.seconds_limit().map(|limit| (limit - seconds).max(0.0));
        let by_iterations = iterations
            .filter(|_| done > 0)
            .map(|limit| seconds / done as f64 * (limit - done) as f64);
        // Noise falls with the square root of time.
        let by_error = target_error
            .zip(self.estimated_error)
            .map(|(target, error)| seconds * ((error / target).powi(2) - 1.0).max(0.0));
        let seconds_remaining =
            [by_time, by_iterations, by_error].into_iter().flatten().reduce(f64::min);
        Progress {
            iterations: done,
            shots,
            light_source_selection_ratio: light_shots as f64 / shots.max(1) as f64,
            estimated_error: self.estimated_error,
            seconds,
            seconds_remaining,
            fraction: seconds_remaining.map_or(0.0, |rest| seconds / (seconds + rest).max(1e-9)),
        }
    }
}
