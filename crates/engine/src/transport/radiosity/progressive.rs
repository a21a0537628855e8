//! Progressive refinement (Southwell iteration; Cohen et al. 1988): always shoot from where most
//! light waits to be shot.

use super::{Point, add_irradiance, diffuse_stage, power, shot_from, solution};
use crate::device::{Device, ShootingSettings, Tally};
use crate::radiometry::{Rgb, importance};
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::transport::Method;
use crate::transport::kept::{Parts, Past};
use crate::transport::options::Settings;
use crate::transport::stage::Asked;
use std::collections::BTreeMap;
use std::f32::consts::PI;

/// Stops when this share of the emitted power is left to be shot.
const REST: f64 = 1e-5;

/// Shoots from the patches with the most unshot power, at their centroids, until next to nothing
/// is left; what is left is shown as an ambient term.
pub struct Progressive;

impl Method for Progressive {
    fn name(&self) -> &'static str {
        "progressive"
    }

    fn checkpoint_format(&self) -> u32 {
        1
    }

    fn summary(&self) -> &'static str {
        "progressive refinement radiosity with an ambient term, diffuse"
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
        run.without_estimate = true;
        let scene = stage.scene.clone();
        let patches = &scene.patches;
        if !patches.any_light() {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        }
        let measurement = stage.measurement();
        let shooting = ShootingSettings { seed: request.seed, ..options.shooting };
        let together = shooting.shots_per_iteration as usize;
        let mut shooter = device.begin(scene.clone(), &shooting)?;

        let mut irradiance = vec![Rgb::ZERO; patches.len()];
        let mut unshot = patches.emission.clone();
        let emitted: f64 = (0..patches.len()).map(|i| f64::from(power(&scene, i, unshot[i]))).sum();
        let mut gained = vec![Rgb::ZERO; patches.len()];
        if let Some(mut past) = past {
            past.shared.replace(&mut irradiance)?;
            past.shared.replace(&mut unshot)?;
            past.shared.end()?;
        }
        let save = |parts: &mut Parts, irradiance: &[Rgb], unshot: &[Rgb]| {
            parts.shared.slice(irradiance);
            parts.shared.slice(unshot);
            Ok(())
        };
        let (stopped, rest) = loop {
            let mut order: Vec<usize> = (0..patches.len()).collect();
            let powers: Vec<f32> = order.iter().map(|i| power(&scene, *i, unshot[*i])).collect();
            let rest = powers.iter().map(|power| f64::from(*power)).sum::<f64>() / emitted;
            run.known_fraction = Some((rest.max(REST).ln() / REST.ln()).clamp(0.0, 1.0));
            if rest <= REST {
                break (StopReason::Converged, rest);
            }
            if let Some(reason) = run.stop() {
                break (reason, rest);
            }
            // The patches with the most unshot power.
            let count = together.min(order.len());
            order.select_nth_unstable_by(count - 1, |a, b| {
                powers[*b].total_cmp(&powers[*a]).then(a.cmp(b))
            });
            order.truncate(count);
            order.retain(|i| powers[*i] > 0.0);
            order.sort_unstable();
            let shots: Vec<_> =
                order.iter().map(|i| shot_from(&scene, &shooting, *i, &Point::Centroid)).collect();
            gained.fill(Rgb::ZERO);
            for (shot, form_factors) in shots.iter().zip(shooter.form_factors(&shots)?) {
                let patch = shot.patch as usize;
                let radiance = std::mem::take(&mut unshot[patch]);
                add_irradiance(&scene, &mut gained, patch, radiance, &form_factors);
            }
            for i in 0..patches.len() {
                irradiance[i] += gained[i];
                unshot[i] += patches.diffuse[i] * gained[i] / PI;
            }
            let lights = shots.iter().filter(|shot| patches.emits(shot.patch as usize)).count();
            run.tally +=
                Tally { iterations: 1, shots: shots.len() as u64, light_shots: lights as u64 };
            if run.report_is_due() {
                let shown = || with_ambient(&scene, &irradiance, &unshot, options.ambient);
                run.report(true, || measurement.picture(&solution(&shown())));
            }
            run.keep_if_wanted(|parts| save(parts, &irradiance, &unshot))?;
        };
        run.keep_solution(|parts| save(parts, &irradiance, &unshot))?;
        let shown = with_ambient(&scene, &irradiance, &unshot, options.ambient);
        let picture = measurement.picture(&solution(&shown));
        run.bake(&scene, || shown);
        let diagnostics = BTreeMap::from([("unshot_power".to_string(), rest)]);
        Ok(stage.rendered(run, (picture, stopped), diagnostics))
    }
}

/// Irradiance with the ambient term: what is not yet shot, spread evenly with all its further
/// reflections, π ΔL_mean/(1 − ρ_mean).
fn with_ambient(
    scene: &crate::patches::PatchedScene,
    irradiance: &[Rgb],
    unshot: &[Rgb],
    ambient: bool,
) -> Vec<Rgb> {
    if !ambient {
        return irradiance.to_vec();
    }
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
