//! Monte-Carlo radiosity (Neumann et al. 1995; Antal §1): bounce by bounce, random patches shoot
//! what they hold over the probability of being picked, in place of all the others.

use super::diffuse::{Lit, Point, add_irradiance, cut_diffuse, power, shot_from, total_power};
use super::settings;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::{Device, DeviceError, Shooting, ShootingSettings, Sums, Tally};
use crate::image::Picture;
use crate::measurement::{Measurement, VertexWeights};
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::random::{Stream, uniform};
use crate::render::{RenderError, StopReason};
use crate::transport::batches::Batches;
use crate::transport::checkpoints::{Parts, Past};
use crate::transport::job::Job;
use crate::transport::options::{AnySetting, MESH};
use crate::transport::run::Run;
use crate::transport::solver::{Estimate, Extent, Method, Solver, TargetChecks, patched_bytes};
use std::f32::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

/// A pass ends when a bounce holds less than this share of the first one's power; with probability
/// proportional to the rest it goes on, so that nothing is lost on average.
const SMALL_BOUNCE: f64 = 0.02;
/// Bounces of a pass, whatever is left.
const MOST_BOUNCES: u32 = 10_000;

/// Independent passes of bounces, averaged.
pub struct MonteCarlo;

impl Method for MonteCarlo {
    fn name(&self) -> &'static str {
        "monte-carlo"
    }

    fn checkpoint_format(&self) -> u32 {
        3
    }

    fn summary(&self) -> &'static str {
        "Monte-Carlo radiosity, bounce by bounce, diffuse"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        [settings::MONTE_CARLO, MESH].concat()
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        patched_bytes(extent)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        let lit = match cut_diffuse(job, device)? {
            ControlFlow::Continue(lit) => lit,
            ControlFlow::Break(begun) => return Ok(begun),
        };
        let measurement = job.measurement(&lit.scene);
        let settings = settings::shooting(&job.settings, job.request.seed);
        let mut solver = Passes {
            weights: measurement.vertex_weights(),
            measurement,
            shooter: device.begin(lit.scene.clone(), &settings)?,
            batches: Batches::new(0),
            pass: Pass { lit, settings, tally: Tally::default() },
            earlier: Tally::default(),
            whole: Tally::default(),
            checks: TargetChecks::after(job.run.standing.tally.iterations),
        };
        if let Some(past) = job.past.take() {
            solver.restore(past)?;
            job.run.standing.estimated_error = solver.estimated_error();
        }
        Ok(Some(Box::new(solver)))
    }
}

/// The passes at work.
struct Passes<'a> {
    measurement: Measurement,
    weights: VertexWeights,
    shooter: Box<dyn Shooting + 'a>,
    batches: Batches,
    pass: Pass,
    /// What was done for another camera's picture: it is in the mean, but it is not this run's.
    earlier: Tally,
    /// What the whole passes took. One that is given up leaves its shots in the count of
    /// [`Pass`], and is begun again from here.
    whole: Tally,
    checks: TargetChecks,
}

impl Passes<'_> {
    /// Goes on from what [`Solver::save`] wrote.
    fn restore(&mut self, mut past: Past<'_>) -> Result<(), CheckpointError> {
        self.pass.tally = restored_tally(&mut past.shared)?;
        self.earlier = restored_tally(&mut past.shared)?;
        self.whole = self.pass.tally;
        if past.bound.is_none() {
            self.earlier = self.whole;
        }
        if self.earlier.iterations > self.whole.iterations {
            return Err(CheckpointError::damaged("it has fewer passes than it began with"));
        }
        self.batches.restore(&mut past.shared, self.pass.lit.scene.patches.len())?;
        past.shared.end()
    }

    fn estimated_error(&self) -> Option<f64> {
        self.batches.relative_error(&self.measurement, &self.weights)
    }
}

fn save_tally(tally: Tally, to: &mut Writer) {
    to.value([tally.iterations, tally.shots, tally.light_shots]);
}

fn restored_tally(from: &mut Reader<'_>) -> Result<Tally, CheckpointError> {
    let [iterations, shots, light_shots] = from.value()?;
    Ok(Tally { iterations, shots, light_shots })
}

impl Solver for Passes<'_> {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let irradiance = self.pass.shoot(&mut *self.shooter, || run.stop_early().is_some())?;
        let Some(irradiance) = irradiance else {
            return Ok(Some(run.stop_early().unwrap_or(StopReason::TimeBudget)));
        };
        self.batches.add(Sums { iterations: 1, irradiance, glossy: Vec::new() });
        self.whole = self.pass.tally;
        run.standing.tally = Tally {
            iterations: self.whole.iterations.saturating_sub(self.earlier.iterations),
            shots: self.whole.shots.saturating_sub(self.earlier.shots),
            light_shots: self.whole.light_shots.saturating_sub(self.earlier.light_shots),
        };
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        self.batches.any()
    }

    fn checks_target(&mut self, passes: u64) -> bool {
        self.checks.are_due(passes)
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::of_batches(self.estimated_error(), self.batches.enough())
    }

    fn picture(&mut self) -> Picture {
        self.measurement.picture(&self.batches.mean())
    }

    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        save_tally(self.whole, &mut parts.shared);
        save_tally(self.earlier, &mut parts.shared);
        self.batches.save(&mut parts.shared);
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        let any = self.batches.any();
        any.then(|| (self.pass.lit.scene.clone(), self.batches.mean().irradiance))
    }
}

/// One pass after the other.
struct Pass {
    lit: Lit,
    settings: ShootingSettings,
    tally: Tally,
}

impl Pass {
    /// All bounces of one pass: an unbiased estimate of the irradiance. `None` where it had to
    /// stop before the end of any but the first pass.
    fn shoot(
        &mut self,
        shooter: &mut dyn Shooting,
        stop: impl Fn() -> bool,
    ) -> Result<Option<Vec<Rgb>>, DeviceError> {
        let scene = self.lit.scene.clone();
        let patches = &scene.patches;
        let mut irradiance = self.lit.irradiance.clone();
        let mut held = self.lit.source.clone();
        let emitted = total_power(&scene, &held);
        for bounce in 0..MOST_BOUNCES {
            let left = total_power(&scene, &held) / emitted;
            // Russian roulette over the whole bounce.
            if left < SMALL_BOUNCE {
                let xi = f64::from(uniform(self.settings.seed, Stream::Roulette, self.tally.shots));
                let survival = left / SMALL_BOUNCE;
                if xi >= survival {
                    break;
                }
                held.iter_mut().for_each(|radiance| *radiance /= survival as f32);
            }
            if self.tally.iterations > 0 && stop() {
                return Ok(None);
            }
            // As many shots as the bounce holds power, at least one.
            let most = f64::from(self.settings.shots_per_iteration) * 4.0;
            let count = (most * left.min(1.0)).ceil().max(1.0) as u32;
            let mut gained = vec![Rgb::ZERO; patches.len()];
            self.bounce(shooter, &held, count, &mut gained)?;
            for i in 0..patches.len() {
                irradiance[i] += gained[i];
                held[i] = patches.diffuse[i] * gained[i] / PI;
            }
            if bounce + 1 == MOST_BOUNCES {
                break;
            }
        }
        self.tally.iterations += 1;
        Ok(Some(irradiance))
    }

    /// Shoots `held` by `count` shooters, picked systematically by power.
    fn bounce(
        &mut self,
        shooter: &mut dyn Shooting,
        held: &[Rgb],
        count: u32,
        gained: &mut [Rgb],
    ) -> Result<(), DeviceError> {
        let scene = &*self.lit.scene;
        let total = total_power(scene, held);
        if total <= 0.0 || !total.is_finite() {
            return Ok(());
        }
        let offset = f64::from(uniform(self.settings.seed, Stream::Shooter, self.tally.shots));
        let (mut at, mut before) = (0, 0.0);
        let mut shots = Vec::new();
        for k in 0..count {
            let sought = (f64::from(k) + offset) / f64::from(count) * total;
            let holds = |i: usize| f64::from(power(scene, i, held[i]));
            while before + holds(at) <= sought && at + 1 < held.len() {
                before += holds(at);
                at += 1;
            }
            let probability = holds(at) / total;
            if probability > 0.0 {
                let number = self.tally.shots + u64::from(k);
                let shot = shot_from(scene, &self.settings, at, &Point::Random(number));
                shots.push((shot, (1.0 / (probability * f64::from(count))) as f32));
            }
        }
        let bare: Vec<_> = shots.iter().map(|(shot, _)| *shot).collect();
        for ((shot, scale), form_factors) in shots.iter().zip(shooter.form_factors(&bare)?) {
            let patch = shot.patch as usize;
            add_irradiance(scene, gained, patch, held[patch] * *scale, &form_factors);
            self.tally.light_shots += u64::from(scene.patches.emits(patch));
        }
        self.tally.shots += u64::from(count);
        Ok(())
    }
}
