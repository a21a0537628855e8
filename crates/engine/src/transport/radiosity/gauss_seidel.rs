//! The full matrix of form factors and Gauss–Seidel iteration (Rogers §5-17: the matrix is strictly
//! diagonally dominant, so it converges).

use super::diffuse::{Lit, cut_diffuse, solution};
use super::form_factor_matrix::{FormFactorMatrix, matrix_bytes};
use super::settings;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::{Device, DeviceError, Shooting, ShootingSettings};
use crate::image::Picture;
use crate::measurement::Measurement;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{RenderError, StopReason};
use crate::transport::checkpoints::Parts;
use crate::transport::job::Job;
use crate::transport::options::{AnySetting, MESH, MeshSettings};
use crate::transport::run::Run;
use crate::transport::solver::{Estimate, Extent, Method, Solver, patched_bytes};
use glam::DVec3;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

/// A sweep that changes no radiance by more than this share of the largest ends the iteration.
const CONVERGED: f64 = 1e-9;
/// Share of the work that is done once the matrix is there.
const MATRIX_SHARE: f64 = 0.98;

/// Solves the whole system: memory and hemicubes grow with the square of the patches.
pub struct GaussSeidel;

impl Method for GaussSeidel {
    fn name(&self) -> &'static str {
        "gauss-seidel"
    }

    fn checkpoint_format(&self) -> u32 {
        3
    }

    fn summary(&self) -> &'static str {
        "full-matrix radiosity by Gauss–Seidel iteration, diffuse"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        [settings::GAUSS_SEIDEL, MESH].concat()
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        let patches = MeshSettings::new(extent.settings).patches as u64;
        let matrix = matrix_bytes(patches.max(extent.triangles.all));
        patched_bytes(extent).saturating_add(matrix)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        job.run.standing.without_estimate = true;
        let Lit { scene, irradiance, source } = match cut_diffuse(job, device)? {
            ControlFlow::Continue(lit) => lit,
            ControlFlow::Break(begun) => return Ok(begun),
        };
        let measurement = job.measurement(&scene);
        let settings = settings::looking(&job.settings, job.request.seed);
        let mut matrix = FormFactorMatrix::reserve(&scene)?;
        let shooter = device.begin(scene.clone(), &settings)?;
        let mut balance = Balance::new(&source, irradiance, &scene.patches.diffuse);
        if let Some(mut past) = job.past.take() {
            matrix.restore(&mut past.shared)?;
            match matrix.is_full() {
                true => balance.restore(past.shared)?,
                false => past.shared.end()?,
            }
        }
        let points = settings::form_factor_points(&job.settings);
        Ok(Some(Box::new(Full { scene, measurement, settings, points, shooter, matrix, balance })))
    }
}

/// The system at work: the matrix in the making, and its balance once it is there.
struct Full<'a> {
    scene: Arc<PatchedScene>,
    measurement: Measurement,
    settings: ShootingSettings,
    /// Hemicubes whose mean is a row.
    points: usize,
    shooter: Box<dyn Shooting + 'a>,
    matrix: FormFactorMatrix,
    balance: Balance,
}

impl Solver for Full<'_> {
    /// Some rows of the matrix, or a sweep; one follows the last row at once. Without all rows
    /// nothing can be solved: the emission is all there is to see, and light that no patch sends.
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        if !self.matrix.is_full() {
            if let Some(reason) = run.stop_early() {
                return Ok(Some(reason));
            }
            let (scene, settings) = (&self.scene, &self.settings);
            run.standing.tally +=
                self.matrix.fill(scene, settings, self.points, &mut *self.shooter)?;
            run.standing.known_fraction = Some(MATRIX_SHARE * self.matrix.share());
            if !self.matrix.is_full() {
                return Ok(None);
            }
        }
        self.balance.sweep(&self.matrix);
        run.standing.tally.iterations += 1;
        Ok(None)
    }

    fn finished(&self) -> Option<StopReason> {
        self.balance.settled.then_some(StopReason::Converged)
    }

    fn is_visible(&self) -> bool {
        self.matrix.is_full()
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::Never
    }

    fn picture(&mut self) -> Picture {
        self.measurement.picture(&solution(&self.balance.irradiance))
    }

    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        self.matrix.save(&mut parts.shared)?;
        if self.matrix.is_full() {
            self.balance.save(&mut parts.shared);
        }
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        self.matrix.is_full().then(|| (self.scene.clone(), self.balance.irradiance.clone()))
    }

    fn diagnostics(&self, _run: &Run<'_>) -> BTreeMap<String, f64> {
        let mut figures = self.matrix.diagnostics(&self.scene);
        figures.insert("matrix_bytes".into(), self.matrix.bytes() as f64);
        figures
    }
}

/// Radiance and irradiance while L_i = S_i + ρ_i Σ_j F_ij L_j is swept, with the source
/// S_i = L^e_i + ρ_i E⁰_i/π.
struct Balance {
    source: Vec<DVec3>,
    /// E⁰, irradiance by light that no patch sends.
    found: Vec<Rgb>,
    albedo: Vec<DVec3>,
    radiance: Vec<DVec3>,
    irradiance: Vec<Rgb>,
    /// Whether the last sweep changed next to nothing.
    settled: bool,
}

impl Balance {
    fn new(source: &[Rgb], found: Vec<Rgb>, albedo: &[Rgb]) -> Self {
        let doubles = |values: &[Rgb]| values.iter().map(|v| v.as_dvec3()).collect::<Vec<_>>();
        let source = doubles(source);
        Self {
            radiance: source.clone(),
            irradiance: found.clone(),
            albedo: doubles(albedo),
            source,
            found,
            settled: false,
        }
    }

    /// Writes where the sweeps are.
    fn save(&self, to: &mut Writer) {
        to.slice(&self.radiance);
        to.slice(&self.irradiance);
    }

    /// Goes on with sweeps behind a restored matrix, where there were any.
    fn restore(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        if !from.is_empty() {
            from.replace(&mut self.radiance)?;
            from.replace(&mut self.irradiance)?;
        }
        from.end()
    }

    /// One sweep in place.
    fn sweep(&mut self, matrix: &FormFactorMatrix) {
        let (mut change, mut largest) = (0f64, 0f64);
        for i in 0..self.source.len() {
            let mut incident = DVec3::ZERO;
            for (f, radiance) in matrix.row(i).iter().zip(&self.radiance) {
                incident += *radiance * f64::from(*f);
            }
            let next = self.source[i] + self.albedo[i] * incident;
            change = change.max((next - self.radiance[i]).abs().max_element());
            largest = largest.max(next.max_element());
            self.radiance[i] = next;
            self.irradiance[i] = (incident * PI).as_vec3() + self.found[i];
        }
        self.settled = change <= CONVERGED * largest;
    }
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
        let matrix = FormFactorMatrix::of_values(count, values);
        let colour = |k: usize, scale: f32| {
            Rgb::new(draw(10_000 + k), draw(20_000 + k), draw(30_000 + k)) * scale
        };
        let emission: Vec<Rgb> = (0..count).map(|i| colour(i, 5.0)).collect();
        let albedo: Vec<Rgb> = (0..count).map(|i| colour(count + i, 0.9)).collect();
        let mut balance = Balance::new(&emission, vec![Rgb::ZERO; count], &albedo);
        let mut settles = |_: &u32| {
            balance.sweep(&matrix);
            balance.settled
        };
        let sweeps = (1..1000).find(&mut settles).expect("settles");
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
