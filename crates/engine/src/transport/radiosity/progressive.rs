//! Progressive refinement (Southwell iteration; Cohen et al. 1988): always shoot from where most
//! light waits to be shot.

use super::diffuse::{
    Lit, Point, add_irradiance, cut_diffuse, power, shot_from, solution, total_power,
};
use super::settings;
use crate::device::{Device, DeviceError, Shooting, ShootingSettings, Tally};
use crate::image::Picture;
use crate::measurement::Measurement;
use crate::patches::PatchedScene;
use crate::radiometry::{Rgb, importance};
use crate::render::{RenderError, StopReason};
use crate::transport::checkpoints::Parts;
use crate::transport::job::Job;
use crate::transport::options::{AnySetting, MESH};
use crate::transport::run::Run;
use crate::transport::solver::{Estimate, Extent, Method, Solver, patched_bytes};
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Stops when this share of the power that there was at first is left to be shot.
const REST: f64 = 1e-5;

/// Why unshot light is not shown.
const NO_AMBIENT: &str =
    "there is no ambient term, which is for closed scenes: a sky or a sun shines into this one";

/// Shoots from the patches with the most unshot power, at their centroids, until next to nothing
/// is left; what is left is shown as an ambient term.
pub struct Progressive;

impl Method for Progressive {
    fn name(&self) -> &'static str {
        "progressive"
    }

    fn checkpoint_format(&self) -> u32 {
        3
    }

    fn summary(&self) -> &'static str {
        "progressive refinement radiosity with an ambient term, diffuse"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        [settings::PROGRESSIVE, MESH].concat()
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        patched_bytes(extent)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        job.run.standing.without_estimate = true;
        // The term takes the scene to be closed; where a sky shines in, light gets out as well.
        let asked = settings::ambient(&job.settings);
        let ambient = asked && job.environment.is_dark();
        if asked && !ambient {
            job.explain([NO_AMBIENT.into()]);
        }
        let Lit { scene, irradiance, source } = match cut_diffuse(job, device)? {
            ControlFlow::Continue(lit) => lit,
            ControlFlow::Break(begun) => return Ok(begun),
        };
        let settings = settings::shooting(&job.settings, job.request.seed);
        let mut solver = Refinement {
            measurement: job.measurement(&scene),
            shooter: device.begin(scene.clone(), &settings)?,
            emitted: total_power(&scene, &source),
            irradiance,
            unshot: source,
            ambient,
            rest: 1.0,
            scene,
            settings,
        };
        if let Some(mut past) = job.past.take() {
            past.shared.replace(&mut solver.irradiance)?;
            past.shared.replace(&mut solver.unshot)?;
            past.shared.end()?;
        }
        solver.weigh(&mut job.run);
        Ok(Some(Box::new(solver)))
    }
}

/// The refinement at work.
struct Refinement<'a> {
    scene: Arc<PatchedScene>,
    measurement: Measurement,
    settings: ShootingSettings,
    shooter: Box<dyn Shooting + 'a>,
    /// Power of what the patches have to shoot at first.
    emitted: f64,
    irradiance: Vec<Rgb>,
    /// Radiance that waits to be shot.
    unshot: Vec<Rgb>,
    /// Share of that power that waits to be shot.
    rest: f64,
    /// Whether what waits is shown as an ambient term.
    ambient: bool,
}

impl Refinement<'_> {
    /// Finds out how much is left to be shot.
    fn weigh(&mut self, run: &mut Run<'_>) {
        self.rest = total_power(&self.scene, &self.unshot) / self.emitted;
        run.standing.known_fraction = Some((self.rest.max(REST).ln() / REST.ln()).clamp(0.0, 1.0));
    }

    /// The patches with the most unshot power, in the order of their numbers.
    fn brightest(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.unshot.len()).collect();
        let powers: Vec<f32> =
            order.iter().map(|i| power(&self.scene, *i, self.unshot[*i])).collect();
        let count = (self.settings.shots_per_iteration as usize).min(order.len());
        order.select_nth_unstable_by(count - 1, |a, b| {
            powers[*b].total_cmp(&powers[*a]).then(a.cmp(b))
        });
        order.truncate(count);
        order.retain(|i| powers[*i] > 0.0);
        order.sort_unstable();
        order
    }

    /// Irradiance, with the ambient term if that is to be shown.
    fn shown(&self) -> Vec<Rgb> {
        match self.ambient {
            true => with_ambient(&self.scene, &self.irradiance, &self.unshot),
            false => self.irradiance.clone(),
        }
    }
}

impl Solver for Refinement<'_> {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let shoot = |patch| shot_from(&self.scene, &self.settings, patch, &Point::Centroid);
        let shots: Vec<_> = self.brightest().into_iter().map(shoot).collect();
        let patches = &self.scene.patches;
        let mut gained = vec![Rgb::ZERO; patches.len()];
        for (shot, form_factors) in shots.iter().zip(self.shooter.form_factors(&shots)?) {
            let patch = shot.patch as usize;
            let radiance = std::mem::take(&mut self.unshot[patch]);
            add_irradiance(&self.scene, &mut gained, patch, radiance, &form_factors);
        }
        for (i, gained) in gained.into_iter().enumerate() {
            self.irradiance[i] += gained;
            self.unshot[i] += patches.diffuse[i] * gained / PI;
        }
        let lights = shots.iter().filter(|shot| patches.emits(shot.patch as usize)).count();
        let (shots, light_shots) = (shots.len() as u64, lights as u64);
        run.standing.tally += Tally { iterations: 1, shots, light_shots };
        self.weigh(run);
        Ok(None)
    }

    fn finished(&self) -> Option<StopReason> {
        (self.rest <= REST).then_some(StopReason::Converged)
    }

    fn is_visible(&self) -> bool {
        true
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::Never
    }

    fn picture(&mut self) -> Picture {
        self.measurement.picture(&solution(&self.shown()))
    }

    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        parts.shared.slice(&self.irradiance);
        parts.shared.slice(&self.unshot);
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        Some((self.scene.clone(), self.shown()))
    }

    fn diagnostics(&self, _run: &Run<'_>) -> BTreeMap<String, f64> {
        BTreeMap::from([("unshot_power".to_string(), self.rest)])
    }
}

/// Irradiance with the ambient term: what is not yet shot, spread evenly with all its further
/// reflections, π ΔL_mean/(1 − ρ_mean).
fn with_ambient(scene: &PatchedScene, irradiance: &[Rgb], unshot: &[Rgb]) -> Vec<Rgb> {
    let patches = &scene.patches;
    let (mut waiting, mut absorbed) = (Rgb::ZERO, Rgb::ZERO);
    for ((area, diffuse), unshot) in patches.area.iter().zip(&patches.diffuse).zip(unshot) {
        waiting += *area * *unshot;
        absorbed += *area * (Rgb::ONE - *diffuse);
    }
    let everywhere = PI * waiting / absorbed.max(Rgb::splat(f32::MIN_POSITIVE));
    let everywhere = if importance(everywhere).is_finite() { everywhere } else { Rgb::ZERO };
    irradiance.iter().map(|irradiance| *irradiance + everywhere).collect()
}
