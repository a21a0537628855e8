//! The full matrix of form factors, row by row from hemicubes, and Gauss–Seidel iteration
//! (Rogers §5-17: the matrix is strictly diagonally dominant, so it converges).

use super::{Point, diffuse_stage, shot_from, solution};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::{Device, DeviceError, Shooting, ShootingSettings, Tally, free_memory};
use crate::hemicube::Shot;
use crate::measurement::Measurement;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::transport::Method;
use crate::transport::kept::Past;
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

    fn checkpoint_format(&self) -> u32 {
        1
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
        let mut past = Past::of(request, self.name(), &settings)?;
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
        if let Some(past) = &mut past {
            matrix.restore(&mut past.shared)?;
        }
        let result = match matrix.fill(&scene, &shooting, points, &mut *shooter, &mut run)? {
            // Without all rows nothing can be solved: the emission is all there is to see.
            Some(reason) => {
                run.keep_solution(|parts| matrix.save(&mut parts.shared))?;
                let dark = vec![Rgb::ZERO; scene.patches.len()];
                (measurement.picture(&solution(&dark)), reason)
            }
            None => {
                let emission = &scene.patches.emission;
                let mut balance = Balance::new(&matrix, emission, &scene.patches.diffuse);
                if let Some(past) = past {
                    balance.restore(past.shared)?;
                }
                sweep(&scene, balance, &measurement, &mut run)?
            }
        };
        let mut diagnostics = matrix.diagnostics(&scene);
        diagnostics.insert("matrix_bytes".into(), (4 * matrix.values.len()) as f64);
        Ok(stage.rendered(run, result, diagnostics))
    }
}

/// Bytes of the form factors between so many patches.
pub fn matrix_bytes(patches: u64) -> u64 {
    patches.saturating_mul(patches).saturating_mul(size_of::<f32>() as u64)
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
        let needed_bytes = matrix_bytes(count as u64);
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

    /// Writes the rows that there are.
    fn save(&self, to: &mut Writer) -> Result<(), DeviceError> {
        to.value(self.rows as u64);
        to.slice(&self.values);
        Ok(())
    }

    /// Takes what [`FormFactors::save`] wrote of the same scene.
    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.rows = from.count(self.count as u64)? as usize;
        self.values.extend(from.exactly::<f32>(self.rows * self.count)?);
        Ok(())
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
            run.keep_if_wanted(|parts| self.save(&mut parts.shared))?;
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

/// Radiance and irradiance while L_i = L^e_i + ρ_i Σ_j F_ij L_j is swept.
struct Balance<'a> {
    matrix: &'a FormFactors,
    emission: Vec<DVec3>,
    albedo: Vec<DVec3>,
    radiance: Vec<DVec3>,
    irradiance: Vec<Rgb>,
}

impl<'a> Balance<'a> {
    fn new(matrix: &'a FormFactors, emission: &[Rgb], albedo: &[Rgb]) -> Self {
        let doubles = |values: &[Rgb]| values.iter().map(|v| v.as_dvec3()).collect::<Vec<_>>();
        let emission = doubles(emission);
        Self {
            matrix,
            radiance: emission.clone(),
            irradiance: vec![Rgb::ZERO; emission.len()],
            albedo: doubles(albedo),
            emission,
        }
    }

    /// Writes the matrix, and where the sweeps are.
    fn save(&self, to: &mut Writer) -> Result<(), DeviceError> {
        self.matrix.save(to)?;
        to.slice(&self.radiance);
        to.slice(&self.irradiance);
        Ok(())
    }

    /// Goes on with sweeps behind a restored matrix, where there were any.
    fn restore(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        if !from.is_empty() {
            from.replace(&mut self.radiance)?;
            from.replace(&mut self.irradiance)?;
        }
        from.end()
    }

    /// One sweep in place; whether nothing changes any more.
    fn sweep(&mut self) -> bool {
        let (mut change, mut largest) = (0f64, 0f64);
        for i in 0..self.emission.len() {
            let mut incident = DVec3::ZERO;
            for (f, radiance) in self.matrix.row(i).iter().zip(&self.radiance) {
                incident += *radiance * f64::from(*f);
            }
            let next = self.emission[i] + self.albedo[i] * incident;
            change = change.max((next - self.radiance[i]).abs().max_element());
            largest = largest.max(next.max_element());
            self.radiance[i] = next;
            self.irradiance[i] = (incident * PI).as_vec3();
        }
        change <= CONVERGED * largest
    }
}

/// Sweeps until nothing changes any more.
fn sweep(
    scene: &PatchedScene,
    mut balance: Balance<'_>,
    measurement: &Measurement,
    run: &mut Run<'_>,
) -> Result<(crate::image::Picture, StopReason), DeviceError> {
    let stopped = loop {
        // At least one, but none beyond the limit of a run that goes on.
        if run.tally.iterations > 0
            && let Some(reason) = run.stop()
        {
            break reason;
        }
        let settled = balance.sweep();
        run.tally.iterations += 1;
        if settled {
            break StopReason::Converged;
        }
        if run.report_is_due() {
            run.report(true, || measurement.picture(&solution(&balance.irradiance)));
        }
        run.keep_if_wanted(|parts| balance.save(&mut parts.shared))?;
    };
    run.known_fraction = Some(1.0);
    run.keep_solution(|parts| balance.save(&mut parts.shared))?;
    let picture = measurement.picture(&solution(&balance.irradiance));
    run.bake(scene, || balance.irradiance);
    Ok((picture, stopped))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solves a dense system by elimination with pivoting.
    fn eliminate(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
        let n = right.len();
        for k in 0..n {
            let largest =
                |a: &usize, b: &usize| matrix[*a][k].abs().total_cmp(&matrix[*b][k].abs());
            let pivot = (k..n).max_by(largest).unwrap();
            matrix.swap(k, pivot);
            right.swap(k, pivot);
            let (above, below) = matrix.split_at_mut(k + 1);
            for (i, row) in (k + 1..n).zip(below) {
                let factor = row[k] / above[k][k];
                for (value, pivot) in row.iter_mut().zip(&above[k]).skip(k) {
                    *value -= factor * pivot;
                }
                right[i] -= factor * right[k];
            }
        }
        for k in (0..n).rev() {
            let known: f64 = (k + 1..n).map(|j| matrix[k][j] * right[j]).sum();
            right[k] = (right[k] - known) / matrix[k][k];
        }
        right
    }

    #[test]
    fn sweeps_settle_on_the_dense_solution() {
        // Random form factors whose rows sum to .95, albedos up to .9.
        let count = 60;
        let draw = |k: usize| crate::random::uniform(3, crate::random::Stream::Face, k as u64);
        let mut values = Vec::new();
        for i in 0..count {
            let row: Vec<f32> =
                (0..count).map(|j| if i == j { 0.0 } else { draw(i * count + j) }).collect();
            let sum: f32 = row.iter().sum();
            values.extend(row.iter().map(|f| 0.95 * f / sum));
        }
        let matrix = FormFactors { count, rows: count, values };
        let colour = |k: usize, scale: f32| {
            Rgb::new(draw(10_000 + k), draw(20_000 + k), draw(30_000 + k)) * scale
        };
        let emission: Vec<Rgb> = (0..count).map(|i| colour(i, 5.0)).collect();
        let albedo: Vec<Rgb> = (0..count).map(|i| colour(count + i, 0.9)).collect();
        let mut balance = Balance::new(&matrix, &emission, &albedo);
        let sweeps = (1..1000).find(|_| balance.sweep()).expect("settles");
        assert!(sweeps < 60, "{sweeps} sweeps");
        for channel in 0..3 {
            let row = |i: usize| {
                let reflected =
                    |j: usize| f64::from(albedo[i][channel]) * f64::from(matrix.row(i)[j]);
                (0..count).map(|j| f64::from(i == j) - reflected(j)).collect()
            };
            let right = emission.iter().map(|e| f64::from(e[channel])).collect();
            let exact = eliminate((0..count).map(row).collect(), right);
            for (ours, exact) in balance.radiance.iter().zip(exact) {
                assert!((ours[channel] / exact - 1.0).abs() < 1e-8, "{ours} {exact}");
            }
        }
    }
}
