//! Stochastic hemicube iteration (Antal): the device iterates, batches collect, the camera
//! measures the average.

use super::Method;
use super::batches::Batches;
use super::kept::{Parts, Past};
use super::known::known_light;
use super::options::{ExpectedShots, Settings, StochasticSettings};
use super::run::Run;
use super::stage::{Asked, Stage};
use crate::checkpoint::{CheckpointError, Writer};
use crate::device::{
    Device, DeviceError, KnownLight, Shooting, ShootingSettings, VarianceReduction,
};
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
/// Iterations that the limits let expect, in checkpoints; 0 for none.
const EXPECTED: &str = "expected_iterations";
/// A mean albedo that lets light bounce for hundreds of iterations.
const WHITE: f32 = 0.99;

/// Antal's method with power importance sampling, K stratified shots an iteration, and the
/// averaged measurement.
pub struct Stochastic;

impl Method for Stochastic {
    fn name(&self) -> &'static str {
        "stochastic"
    }

    fn checkpoint_format(&self) -> u32 {
        1
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
        let mut past = Past::of(request, self.name(), &settings)?;
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
        let expected = match &past {
            Some(past) => past.decided::<u64>(EXPECTED)?,
            None => request.limits.iterations.unwrap_or(0),
        };
        run.owner.decided.insert(EXPECTED.into(), expected.to_string());
        let expected = (expected > 0).then_some(expected);
        let mut shooting = ShootingSettings {
            seed: request.seed,
            variance_reduction: variance_reduction(&options, expected),
            viewpoint: Some(viewpoint(&stage.camera)),
            ..options.shooting
        };
        let known = match &mut past {
            Some(past) => restored_light(past, stage.scene.patches.len())?,
            None => {
                known_light(device, &stage.scene, &shooting, options.constant, options.first_shot)?
            }
        };
        shooting.known = known.map(Arc::new);
        let batches = Batches::new(options.burn_in);
        let scene = stage.scene.clone();
        let (result, irradiance) =
            solve(&mut run, batches, device, scene, &shooting, &measurement, past)?;
        run.bake(&stage.scene, || irradiance);
        Ok(stage.rendered(run, result, BTreeMap::new()))
    }
}

/// Writes what was known before the first iteration.
fn save_light(known: Option<&KnownLight>, to: &mut Writer) {
    let none = KnownLight { radiance: Vec::new(), irradiance: Vec::new() };
    let known = known.unwrap_or(&none);
    to.slice(&known.radiance);
    to.slice(&known.irradiance);
}

fn restored_light(
    past: &mut Past<'_>,
    patches: usize,
) -> Result<Option<KnownLight>, CheckpointError> {
    let radiance: Vec<Rgb> = past.shared.slice()?;
    if radiance.is_empty() {
        past.shared.exactly::<Rgb>(0)?;
        return Ok(None);
    }
    let irradiance = past.shared.exactly(patches)?;
    if radiance.len() != patches {
        return Err(CheckpointError::damaged("its light is not of these patches"));
    }
    Ok(Some(KnownLight { radiance, irradiance }))
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
    past: Option<Past<'_>>,
) -> Result<((Picture, StopReason), Vec<Rgb>), RenderError> {
    let patches = scene.patches.len();
    let known = settings.known.clone();
    let mut shooting = device.begin(scene, settings)?;
    let weights = measurement.vertex_weights();
    let priced = Instant::now();
    measurement.picture(&Solution::dark(patches));
    run.picture_seconds = priced.elapsed().as_secs_f64();

    let (mut step, mut undrained, mut news) = (1u64, 0u64, false);
    if let Some(mut past) = past {
        undrained = past.shared.value()?;
        batches.restore(&mut past.shared, patches)?;
        let summed = shooting.restore(&mut past.shared)?;
        past.shared.end()?;
        if summed != undrained || undrained >= batches.room() {
            return Err(CheckpointError::damaged("its last batch is too long").into());
        }
        if past.bound.is_none() {
            let settled = shooting.drain()?;
            if settled.glossy.is_empty() {
                batches.add(settled);
            } else {
                batches.turn(settled);
            }
            undrained = 0;
        }
        run.estimated_error = batches.relative_error(measurement, &weights);
    }
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
        run.keep_if_wanted(|parts| {
            save(parts, known.as_deref(), undrained, &batches, &mut *shooting)
        })?;
    };
    // Before the open batch leaves the device: it goes on there.
    run.keep_solution(|parts| save(parts, known.as_deref(), undrained, &batches, &mut *shooting))?;
    if undrained > 0 {
        batches.add(shooting.drain()?);
    }
    run.estimated_error = batches.relative_error(measurement, &weights);
    let mean = batches.mean();
    Ok(((measurement.picture(&mean), stopped), mean.irradiance))
}

/// All of it is on the surfaces, but for sums of lobes towards the camera; those of another one
/// are dropped when they are read.
fn save(
    parts: &mut Parts,
    known: Option<&KnownLight>,
    undrained: u64,
    batches: &Batches,
    shooting: &mut dyn Shooting,
) -> Result<(), DeviceError> {
    save_light(known, &mut parts.shared);
    parts.shared.value(undrained);
    batches.save(&mut parts.shared);
    shooting.save(&mut parts.shared)
}
