//! The full matrix of form factors, row by row from hemicubes, and Gauss–Seidel iteration
//! (Rogers §5-17: the matrix is strictly diagonally dominant, so it converges).

use super::{Point, diffuse_stage, shot_from, solution};
use crate::device::{Device, DeviceError, Shooting, ShootingSettings, Tally, free_memory};
use crate::hemicube::Shot;
use crate::measurement::Measurement;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::transport::Method;
use crate::transport::options::Settings;
use crate::transport::run::Run;
use crate::transport::stage::Asked;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A sweep that changes no radiance by more than this share of the largest ends the iteration.
const CONVERGED: f64 = 1e-9;
/// Hemicubes that are asked of the device at a time.
const TOGETHER: usize = 64;

/// Solves the whole system: memory and hemicubes grow with the square of the patches.
pub struct GaussSeidel;

impl Method for GaussSeidel {
    fn name(&self) -> &'static str {
        "gauss-seidel"
    }

    fn summary(&self) -> &'static str {
        "full-matrix radiosity by Gauss–Seidel iteration, diffuse"
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
        let asked = Asked { method: self.name(), reasons, request, settings: &settings };
        let stage = diffuse_stage(asked, device, observer)?;
        let mut run = stage.run(request, observer);
        run.without_estimate = true;
        let scene = stage.scene.clone();
        if !scene.patches.any_light() {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        }
        let measurement = stage.measurement();
        let shooting = ShootingSettings { seed: request.seed, ..options.shooting };
        let mut matrix = FormFactors::reserve(&scene)?;
        let mut shooter = device.begin(scene.clone(), &shooting)?;
        let points = options.points;
        let result = match matrix.fill(&scene, &shooting, points, &mut *shooter, &mut run)? {
            // Without all rows nothing can be solved: the emission is all there is to see.
            Some(reason) => {
                let dark = vec![Rgb::ZERO; scene.patches.len()];
                (measurement.picture(&solution(&dark)), reason)
            }
            None => sweep(&scene, &matrix, &measurement, &mut run),
        };
        let mut diagnostics = matrix.diagnostics(&scene);
        diagnostics.insert("matrix_bytes".into(), (4 * matrix.values.len()) as f64);
        Ok(stage.rendered(run, result, diagnostics))
    }
}

/// F_ij, row by row.
pub struct FormFactors {
    count: usize,
    rows: usize,
    values: Vec<f32>,
}

impl FormFactors {
    /// Room for the matrix, if the machine has it.
    fn reserve(scene: &PatchedScene) -> Result<Self, DeviceError> {
        let count = scene.patches.len();
        let needed_bytes = 4 * (count as u64).pow(2);
        let available_bytes = free_memory();
        let mut values = Vec::new();
        let fits =
            needed_bytes <= available_bytes && values.try_reserve_exact(count * count).is_ok();
        if !fits {
            let device = "gauss-seidel".into();
            return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes });
        }
        Ok(Self { count, rows: 0, values })
    }

    /// Fills all rows, each the mean of `points` hemicubes on its patch. Why not, if it had to
    /// stop.
    fn fill(
        &mut self,
        scene: &PatchedScene,
        settings: &ShootingSettings,
        points: u32,
        shooter: &mut dyn Shooting,
        run: &mut Run<'_>,
    ) -> Result<Option<StopReason>, DeviceError> {
        let points = points as usize;
        let rows_together = (TOGETHER / points).max(1);
        while self.rows < self.count {
            if let Some(reason) = run.stop_early() {
                return Ok(Some(reason));
            }
            let rows = self.rows..(self.rows + rows_together).min(self.count);
            let point = |k: usize| match points {
                1 => Point::Centroid,
                _ => Point::Spread(k as u64),
            };
            let shots: Vec<Shot> = rows
                .clone()
                .flat_map(|i| (0..points).map(move |k| (i, k)))
                .map(|(i, k)| shot_from(scene, settings, i, &point(k)))
                .collect();
            for row in shooter.form_factors(&shots)?.chunks(points) {
                let start = self.values.len();
                self.values.extend_from_slice(&row[0]);
                for more in &row[1..] {
                    self.values[start..].iter_mut().zip(more).for_each(|(sum, f)| *sum += f);
                }
                self.values[start..].iter_mut().for_each(|f| *f /= points as f32);
            }
            self.rows = rows.end;
            let lights = shots.iter().filter(|shot| scene.patches.emits(shot.patch as usize));
            run.tally += Tally {
                iterations: 0,
                shots: shots.len() as u64,
                light_shots: lights.count() as u64,
            };
            run.known_fraction = Some(0.98 * self.rows as f64 / self.count as f64);
            if run.report_is_due() {
                run.report_progress();
            }
        }
        Ok(None)
    }

    /// Row i: F_ij for all j.
    fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.count..(i + 1) * self.count]
    }

    /// Closure |Σ_j F_ij − 1| (mean and largest over the rows) and the violation of reciprocity,
    /// Σ|A_i F_ij − A_j F_ji|/Σ A_i F_ij.
    fn diagnostics(&self, scene: &PatchedScene) -> BTreeMap<String, f64> {
        if self.rows < self.count {
            return BTreeMap::new();
        }
        let areas = &scene.patches.area;
        let area = |i: usize| f64::from(areas[i]);
        let (open, widest, asymmetry, exchanged) = (0..self.count)
            .into_par_iter()
            .map(|i| {
                let sum: f64 = self.row(i).iter().map(|f| f64::from(*f)).sum();
                let (mut asymmetry, mut exchanged) = (0.0, 0.0);
                for (j, f) in self.row(i).iter().enumerate() {
                    let there = area(i) * f64::from(*f);
                    let back = area(j) * f64::from(self.values[j * self.count + i]);
                    asymmetry += (there - back).abs();
                    exchanged += there;
                }
                ((sum - 1.0).abs(), (sum - 1.0).abs(), asymmetry, exchanged)
            })
            .reduce(
                || (0.0, 0.0, 0.0, 0.0),
                |a, b| (a.0 + b.0, f64::max(a.1, b.1), a.2 + b.2, a.3 + b.3),
            );
        BTreeMap::from([
            ("closure_mean".into(), open / self.count as f64),
            ("closure_largest".into(), widest),
            ("reciprocity".into(), asymmetry / exchanged.max(f64::MIN_POSITIVE)),
        ])
    }
}

/// Sweeps L_i = L^e_i + ρ_i Σ_j F_ij L_j in place until nothing changes any more.
fn sweep(
    scene: &PatchedScene,
    matrix: &FormFactors,
    measurement: &Measurement,
    run: &mut Run<'_>,
) -> (crate::image::Picture, StopReason) {
    let patches = &scene.patches;
    let emission: Vec<DVec3> = patches.emission.iter().map(|l| l.as_dvec3()).collect();
    let mut radiance = emission.clone();
    let mut irradiance = vec![Rgb::ZERO; patches.len()];
    let stopped = loop {
        let (mut change, mut largest) = (0f64, 0f64);
        for i in 0..patches.len() {
            let mut incident = DVec3::ZERO;
            for (f, radiance) in matrix.row(i).iter().zip(&radiance) {
                incident += *radiance * f64::from(*f);
            }
            let next = emission[i] + patches.diffuse[i].as_dvec3() * incident;
            change = change.max((next - radiance[i]).abs().max_element());
            largest = largest.max(next.max_element());
            radiance[i] = next;
            irradiance[i] = (incident * PI).as_vec3();
        }
        run.tally.iterations += 1;
        if change <= CONVERGED * largest {
            break StopReason::Converged;
        }
        if let Some(reason) = run.stop() {
            break reason;
        }
        if run.report_is_due() {
            run.report(true, || measurement.picture(&solution(&irradiance)));
        }
    };
    run.known_fraction = Some(1.0);
    (measurement.picture(&solution(&irradiance)), stopped)
}
