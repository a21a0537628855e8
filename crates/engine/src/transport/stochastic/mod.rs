//! Stochastic hemicube iteration (Antal): the device iterates, batches collect, the camera
//! measures the average.

mod settings;

use super::batches::Batches;
use super::checkpoints::{Parts, Past};
use super::job::Job;
use super::known::{Beforehand, known_light};
use super::options::{AnySetting, MESH, MeshSettings, Preset};
use super::patchless;
use super::run::Run;
use super::settled;
use super::solver::{Estimate, Extent, Method, STEP_SECONDS, Solver, TargetChecks, patched_bytes};
use crate::checkpoint::{CheckpointError, Writer};
use crate::device::{
    Device, DeviceError, KnownLight, Shooting, ShootingSettings, VarianceReduction,
};
use crate::image::Picture;
use crate::measurement::{Measurement, Solution, VertexWeights, viewpoint};
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{RenderError, StopReason};
use crate::scene::Warning;
use settings::{ExpectedShots, StochasticSettings};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Most iterations of one call to the device.
const MOST_TOGETHER: u64 = 4096;
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
        3
    }

    fn summary(&self) -> &'static str {
        "stochastic hemicube iteration on patches, diffuse and Phong"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        [settings::SETTINGS, MESH].concat()
    }

    fn presets(&self) -> &'static [Preset] {
        &settings::PRESETS
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        patched_bytes(extent)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        let options = StochasticSettings::new(&job.settings);
        let patches = MeshSettings::new(&job.settings).patches;
        let surrounded = patchless::shines(&job.request.scene, &job.environment);
        let described = device.description().to_string();
        let scene = job.cut(job.request.scene.clone(), patches, described, |scene| {
            strains(scene)
                .into_iter()
                .chain(surrounded.then(|| lost_gloss(scene)).flatten())
                .collect()
        });
        let patchless = match settled::begin(job, &scene)? {
            ControlFlow::Continue(patchless) => patchless,
            ControlFlow::Break(begun) => return Ok(begun),
        };
        let measurement = job.measurement(&scene);
        let expected = job.decide(EXPECTED, job.request.limits.iterations.unwrap_or(0))?;
        let expected = (expected > 0).then_some(expected);
        let mut settings = ShootingSettings {
            seed: job.request.seed,
            variance_reduction: variance_reduction(&options, expected),
            viewpoint: Some(viewpoint(&job.camera)),
            ..options.shooting
        };
        let known = match &mut job.past {
            Some(past) => restored_light(past, scene.patches.len())?,
            None => {
                let StochasticSettings { constant, first_shot, .. } = options;
                let beforehand = Beforehand { constant, first_shot, patchless };
                known_light(device, &scene, &settings, beforehand)?
            }
        };
        settings.known = known.map(Arc::new);
        let known = settings.known.clone();
        let shooting = device.begin(scene.clone(), &settings)?;
        let weights = measurement.vertex_weights();
        let priced = Instant::now();
        measurement.picture(&Solution::dark(scene.patches.len()));
        job.run.standing.picture_seconds = priced.elapsed().as_secs_f64();
        let batches = Batches::new(options.burn_in);
        let mut solver = Iteration {
            scene,
            known,
            shooting,
            batches,
            measurement,
            weights,
            step: 1,
            undrained: 0,
            news: false,
            checks: TargetChecks::after(job.run.standing.tally.iterations),
        };
        if let Some(past) = job.past.take() {
            solver.restore(past)?;
            job.run.standing.estimated_error = solver.estimated_error();
        }
        Ok(Some(Box::new(solver)))
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

/// Warns of lobes that would show light that no patch sends, which only lobes of rays do.
fn lost_gloss(scene: &PatchedScene) -> Option<Warning> {
    let is_glossy = (0..scene.patches.len()).any(|p| scene.patches.is_glossy(p));
    is_glossy.then(|| {
        Warning::new(
            "environment",
            "glossy surfaces lack the highlights and mirror images of the sky, the sun and lights without extent; hemilux, ray-traced and illumination-map have them",
        )
    })
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
        .filter(|p| patches.reflectance(*p).is_sharp())
        .map(|p| scene.facets[patches.facet[p] as usize].source)
        .map(|source| scene.scene.triangle(source).material)
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

/// The iteration at work.
struct Iteration<'a> {
    scene: Arc<PatchedScene>,
    known: Option<Arc<KnownLight>>,
    shooting: Box<dyn Shooting + 'a>,
    batches: Batches,
    measurement: Measurement,
    weights: VertexWeights,
    /// Iterations of the next call to the device.
    step: u64,
    /// Iterations whose sums are still on the device.
    undrained: u64,
    /// Whether a batch was completed since the last estimate.
    news: bool,
    checks: TargetChecks,
}

impl Iteration<'_> {
    /// Goes on from what [`Solver::save`] wrote.
    fn restore(&mut self, mut past: Past<'_>) -> Result<(), DeviceError> {
        self.undrained = past.shared.value()?;
        self.batches.restore(&mut past.shared, self.scene.patches.len())?;
        let summed = self.shooting.restore(&mut past.shared)?;
        past.shared.end()?;
        if summed != self.undrained || self.undrained >= self.batches.room() {
            return Err(CheckpointError::damaged("its last batch is too long").into());
        }
        if past.bound.is_none() {
            let settled = self.shooting.drain()?;
            if settled.glossy.is_empty() {
                self.batches.add(settled);
            } else {
                self.batches.turn(settled);
            }
            self.undrained = 0;
        }
        Ok(())
    }

    fn estimated_error(&self) -> Option<f64> {
        self.batches.relative_error(&self.measurement, &self.weights)
    }
}

impl Solver for Iteration<'_> {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let room = self.batches.room() - self.undrained;
        let count = self.step.min(room).min(run.iterations_left());
        let began = Instant::now();
        run.standing.tally += self.shooting.iterate(count as u32)?;
        let seconds = began.elapsed().as_secs_f64().max(1e-6);
        self.step = ((STEP_SECONDS / seconds * count as f64) as u64).clamp(1, MOST_TOGETHER);
        // Sums leave the device at batch boundaries only, wherever the clock stands, so that the
        // same iterations give the same bits.
        self.undrained += count;
        if self.undrained == self.batches.room() {
            self.news |= self.batches.add(self.shooting.drain()?);
            self.undrained = 0;
        }
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        self.batches.any()
    }

    fn has_news(&self) -> bool {
        self.news
    }

    fn checks_target(&mut self, iterations: u64) -> bool {
        self.news && self.checks.are_due(iterations)
    }

    fn estimate(&mut self) -> Estimate {
        self.news = false;
        Estimate::of_batches(self.estimated_error(), self.batches.enough())
    }

    fn picture(&mut self) -> Picture {
        self.measurement.picture(&self.batches.mean())
    }

    /// All of it is on the surfaces, but for sums of lobes towards the camera; those of another one
    /// are dropped when they are read.
    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        save_light(self.known.as_deref(), &mut parts.shared);
        parts.shared.value(self.undrained);
        self.batches.save(&mut parts.shared);
        self.shooting.save(&mut parts.shared)
    }

    fn settle(&mut self) -> Result<(), DeviceError> {
        if self.undrained > 0 {
            self.batches.add(self.shooting.drain()?);
            self.undrained = 0;
        }
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        Some((self.scene.clone(), self.batches.mean().irradiance))
    }
}
