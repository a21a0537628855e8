//! Stochastic hemicube iteration (Antal): the device iterates, batches collect, the camera
//! measures the average.

use super::Method;
use super::batches::Batches;
use super::known::known_light;
use super::options::{ExpectedShots, Settings, StochasticSettings};
use super::run::Run;
use super::stage::{Asked, Stage};
use crate::device::{Device, ShootingSettings, VarianceReduction};
use crate::image::Picture;
use crate::measurement::{Measurement, Solution, viewpoint};
use crate::patches::PatchedScene;
use crate::radiometry::{Rgb, SHARP_EXPONENT};
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::scene::Warning;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Aim of one call to the device, seconds: short enough to cancel, long enough not to matter.
const STEP_SECONDS: f64 = 0.04;
/// Pause between error estimates, in times of what the last one took.
const ESTIMATE_PAUSE: f64 = 10.0;
/// A mean albedo that lets light bounce for hundreds of iterations.
const WHITE: f32 = 0.99;

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
        let settings = Settings::new(&request.options)?;
        let options = settings.stochastic()?;
        let stage = Stage::new(
            Asked { method: self.name(), reasons, request, settings: &settings },
            request.scene.clone(),
            device.description(),
            strains,
            observer,
        )?;
        let mut run = stage.run(request, observer);
        if !stage.scene.patches.any_light() {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        }
        let measurement = stage.measurement();
        let mut shooting = ShootingSettings {
            seed: request.seed,
            variance_reduction: variance_reduction(&options, request.limits.iterations),
            viewpoint: Some(viewpoint(&stage.camera)),
            ..options.shooting
        };
        let known =
            known_light(device, &stage.scene, &shooting, options.constant, options.first_shot)?;
        shooting.known = known.map(Arc::new);
        let batches = Batches::new(options.burn_in);
        let scene = stage.scene.clone();
        let result = solve(&mut run, batches, device, scene, &shooting, &measurement)?;
        Ok(stage.rendered(run, result, BTreeMap::new()))
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

/// Warns of lobes that patches can't resolve, and of light that hardly anything absorbs.
fn strains(scene: &PatchedScene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let patches = &scene.patches;
    let area: f32 = patches.area.iter().sum();
    let reflected: Rgb = (0..patches.len())
        .map(|i| patches.area[i] * (patches.diffuse[i] + patches.specular[i]))
        .sum();
    if reflected.max_element() > WHITE * area {
        warnings.push(Warning::new(
            "materials",
            "the surfaces reflect more than 99 % of the light; in a closed scene it takes very long to settle, or never does",
        ));
    }
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
                run.without_estimate = run.estimated_error.is_none() && batches.enough();
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
