//! The full matrix of form factors F_ij, row by row from hemicubes.

use super::diffuse::{Point, shot_from};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::{DeviceError, Shooting, ShootingSettings, Tally, free_memory};
use crate::hemicube::Shot;
use crate::patches::PatchedScene;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Hemicubes that are asked of the device at a time.
const TOGETHER: usize = 64;

/// Bytes of the form factors between so many patches.
pub fn matrix_bytes(patches: u64) -> u64 {
    patches.saturating_mul(patches).saturating_mul(size_of::<f32>() as u64)
}

/// F_ij, row by row.
pub struct FormFactorMatrix {
    count: usize,
    rows: usize,
    values: Vec<f32>,
}

impl FormFactorMatrix {
    /// Room for the matrix, if the machine has it.
    pub fn reserve(scene: &PatchedScene) -> Result<Self, DeviceError> {
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

    /// The matrix of so many patches with these values, row by row.
    #[cfg(test)]
    pub fn of_values(count: usize, values: Vec<f32>) -> Self {
        Self { count, rows: count, values }
    }

    /// Writes the rows that there are.
    pub fn save(&self, to: &mut Writer) -> Result<(), DeviceError> {
        to.value(self.rows as u64);
        to.slice(&self.values);
        Ok(())
    }

    /// Takes what [`FormFactorMatrix::save`] wrote of the same scene.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.rows = from.count(self.count as u64)? as usize;
        self.values.extend(from.exactly::<f32>(self.rows * self.count)?);
        Ok(())
    }

    /// Whether all rows are there.
    pub fn is_full(&self) -> bool {
        self.rows == self.count
    }

    /// Share of the rows that are there.
    pub fn share(&self) -> f64 {
        self.rows as f64 / self.count as f64
    }

    /// Bytes of the rows that are there.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }

    /// Fills some more rows, each the mean of `points` hemicubes on its patch.
    pub fn fill(
        &mut self,
        scene: &PatchedScene,
        settings: &ShootingSettings,
        points: usize,
        shooter: &mut dyn Shooting,
    ) -> Result<Tally, DeviceError> {
        let rows_together = (TOGETHER / points).max(1);
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
        let (shots, light_shots) = (shots.len() as u64, lights.count() as u64);
        Ok(Tally { iterations: 0, shots, light_shots })
    }

    /// Row i: F_ij for all j.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.count..(i + 1) * self.count]
    }

    /// Closure |Σ_j F_ij − 1| (mean and largest over the rows) and the violation of reciprocity,
    /// Σ|A_i F_ij − A_j F_ji|/Σ A_i F_ij.
    pub fn diagnostics(&self, scene: &PatchedScene) -> BTreeMap<String, f64> {
        if !self.is_full() {
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
