//! Stochastic hemicube iteration (Antal): the device iterates, batches collect, the camera
//! measures the average.

use super::Method;
use super::batches::Batches;
use super::known::known_light;
use super::options::{ExpectedShots, Settings, StochasticSettings};
use super::run::Run;
use crate::device::{Device, ShootingSettings, VarianceReduction};
use crate::image::Picture;
use crate::measurement::{Measurement, Solution, viewpoint};
use crate::patches::PatchedScene;
use crate::render::{
    Observer, Plan, RenderError, RenderRequest, Rendered, Stats, StopReason, choose_camera,
};
use crate::scene::Warning;
use std::sync::Arc;
use std::time::Instant;

/// Aim of one call to the device, seconds: short enough to cancel, long enough not to matter.
const STEP_SECONDS: f64 = 0.04;
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
        let mut run = Run::new(start, request.limits, observer);
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
            let batches = Batches::new(options.burn_in);
            solve(&mut run, batches, device, scene.clone(), &shooting, &measurement)?
        } else {
            (Picture::black(request.width, request.height), StopReason::NoLight)
        };
        let progress = run.finish();
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

/// Iterates until a limit is reached.
fn solve(
    run: &mut Run<'_>,
    mut batches: Batches,
    device: &mut dyn Device,
    scene: Arc<PatchedScene>,
    settings: &ShootingSettings,
    measurement: &Measurement,
) -> Result<(Picture, StopReason), RenderError> {
    let patches = scene.patches.len();
    let mut shooting = device.begin(scene, settings)?;
    let weights = measurement.vertex_weights();
    let priced = Instant::now();
    measurement.picture(&Solution::dark(patches));
    run.picture_seconds = priced.elapsed().as_secs_f64();

    let (mut step, mut undrained, mut news) = (1u64, 0u64, false);
    let (mut estimated, mut estimate_seconds) = (Instant::now(), 0.0);
    let stopped = loop {
        if let Some(reason) = run.stop() {
            break reason;
        }
        let count = step.min(batches.room() - undrained).min(run.iterations_left());
        let began = Instant::now();
        run.tally += shooting.iterate(count as u32)?;
        let seconds = began.elapsed().as_secs_f64().max(1e-6);
        step = ((STEP_SECONDS / seconds * count as f64) as u64).clamp(1, 4096);

        // Sums leave the device at batch boundaries only, wherever the clock stands, so that the
        // same iterations give the same bits.
        undrained += count;
        if undrained == batches.room() {
            news |= batches.add(shooting.drain()?);
            undrained = 0;
        }
        if run.report_is_due() {
            // With millions of patches an estimate takes longer than a step: keep its share of
            // the time small.
            if news && estimated.elapsed().as_secs_f64() >= ESTIMATE_PAUSE * estimate_seconds {
                let began = Instant::now();
                run.estimated_error = batches.relative_error(measurement, &weights);
                estimate_seconds = began.elapsed().as_secs_f64();
                (estimated, news) = (Instant::now(), false);
            }
            run.report(batches.any(), || measurement.picture(&batches.mean()));
        }
    };
    if undrained > 0 {
        batches.add(shooting.drain()?);
    }
    run.estimated_error = batches.relative_error(measurement, &weights);
    Ok((measurement.picture(&batches.mean()), stopped))
}
