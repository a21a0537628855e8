//! Monte-Carlo radiosity (Neumann et al. 1995; Antal §1): bounce by bounce, random patches shoot
//! what they hold over the probability of being picked, in place of all the others.

use super::{Point, add_irradiance, diffuse_stage, power, shot_from};
use crate::checkpoint::CheckpointError;
use crate::device::{Device, DeviceError, Shooting, ShootingSettings, Sums, Tally};
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::random::{Stream, uniform};
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::transport::Method;
use crate::transport::batches::Batches;
use crate::transport::kept::{Parts, Past};
use crate::transport::options::Settings;
use crate::transport::stage::Asked;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::sync::Arc;

/// A pass ends when a bounce holds less than this share of the emitted power; with probability
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
        1
    }

    fn summary(&self) -> &'static str {
        "Monte-Carlo radiosity, bounce by bounce, diffuse"
    }

    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError> {
        let settings = Settings::new(&request.options)?;
        let options = settings.radiosity()?;
        let past = Past::of(request, self.name(), &settings)?;
        let asked = Asked { method: self.name(), reasons, request, settings: &settings };
        let stage = diffuse_stage(asked, device, observer)?;
        let mut run = stage.run(request, observer);
        let scene = stage.scene.clone();
        if !scene.patches.any_light() {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        }
        let measurement = stage.measurement();
        let weights = measurement.vertex_weights();
        let shooting = ShootingSettings { seed: request.seed, ..options.shooting };
        let mut shooter = device.begin(scene.clone(), &shooting)?;
        let mut batches = Batches::new(0);
        let mut pass = Pass { scene: scene.clone(), settings: shooting, tally: Tally::default() };
        // Another camera's passes are in the mean, but they are not this run's.
        let mut earlier = Tally::default();
        if let Some(mut past) = past {
            let tally = |[iterations, shots, light_shots]: [u64; 3]| Tally {
                iterations,
                shots,
                light_shots,
            };
            pass.tally = tally(past.shared.value()?);
            earlier = tally(past.shared.value()?);
            if past.bound.is_none() {
                earlier = pass.tally;
            }
            if earlier.iterations > pass.tally.iterations {
                return Err(
                    CheckpointError::damaged("it has fewer passes than it began with").into()
                );
            }
            batches.restore(&mut past.shared, scene.patches.len())?;
            past.shared.end()?;
        }
        let save = |parts: &mut Parts, tally: Tally, batches: &Batches| {
            for Tally { iterations, shots, light_shots } in [tally, earlier] {
                parts.shared.value([iterations, shots, light_shots]);
            }
            batches.save(&mut parts.shared);
            Ok(())
        };
        // A pass that is given up leaves its shots in the count: it is begun again from here.
        let mut kept = pass.tally;
        run.estimated_error = batches.relative_error(&measurement, &weights);
        let stopped = loop {
            if let Some(reason) = run.stop() {
                break reason;
            }
            let irradiance = pass.shoot(&mut *shooter, || run.stop_early().is_some())?;
            let Some(irradiance) = irradiance else {
                break run.stop_early().unwrap_or(StopReason::TimeBudget);
            };
            run.tally = Tally {
                iterations: pass.tally.iterations.saturating_sub(earlier.iterations),
                shots: pass.tally.shots.saturating_sub(earlier.shots),
                light_shots: pass.tally.light_shots.saturating_sub(earlier.light_shots),
            };
            batches.add(Sums { iterations: 1, irradiance, glossy: Vec::new() });
            kept = pass.tally;
            if run.report_is_due() {
                run.estimated_error = batches.relative_error(&measurement, &weights);
                run.without_estimate = run.estimated_error.is_none() && batches.enough();
                run.report(true, || measurement.picture(&batches.mean()));
            }
            run.keep_if_wanted(|parts| save(parts, kept, &batches))?;
        };
        run.keep_solution(|parts| save(parts, kept, &batches))?;
        run.estimated_error = batches.relative_error(&measurement, &weights);
        let mean = batches.mean();
        let picture = measurement.picture(&mean);
        if batches.any() {
            run.bake(&scene, || mean.irradiance);
        }
        Ok(stage.rendered(run, (picture, stopped), BTreeMap::new()))
    }
}

/// One pass after the other.
struct Pass {
    scene: Arc<PatchedScene>,
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
        let scene = self.scene.clone();
        let patches = &scene.patches;
        let mut irradiance = vec![Rgb::ZERO; patches.len()];
        let mut held = patches.emission.clone();
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
        let scene = &*self.scene;
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

fn total_power(scene: &PatchedScene, radiance: &[Rgb]) -> f64 {
    radiance.iter().enumerate().map(|(i, l)| f64::from(power(scene, i, *l))).sum()
}
