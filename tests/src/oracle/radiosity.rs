//! The radiosity system of a scene of diffuse patches, solved densely in f64.
//!
//! E_i = Σ_j F_ij (π L^e_j + kd_j E_j), with F_ij leaving i and reaching j.

use super::rays::World;
use super::statistics::Moments;
use hemilux_engine::patches::PatchedScene;
use std::f64::consts::PI;

/// A dense system for one scene.
pub struct Radiosity {
    /// F_ij: row i leaves patch i.
    pub form_factors: Vec<Vec<f64>>,
    /// Per patch: share of its hemisphere that sees no patch.
    pub lost: Vec<f64>,
    /// Area of each patch, m².
    pub area: Vec<f64>,
    /// kd per patch and channel.
    pub albedo: Vec<[f64; 3]>,
    /// π L^e per patch and channel, W/m².
    pub emitted: Vec<[f64; 3]>,
}

impl Radiosity {
    /// The system of a scene, form factors by `rays` rays a patch.
    pub fn by_rays(scene: &PatchedScene, rays: u64, seed: u64) -> Self {
        let world = World::new(scene);
        let (form_factors, lost) =
            (0..world.len()).map(|patch| world.form_factors(patch, rays, seed)).unzip();
        Self::new(scene, form_factors, lost)
    }

    /// The system of a scene with given form factors.
    pub fn new(scene: &PatchedScene, form_factors: Vec<Vec<f64>>, lost: Vec<f64>) -> Self {
        let world = World::new(scene);
        let patches = &scene.patches;
        let channels = |rgb: &glam::Vec3| rgb.to_array().map(f64::from);
        Self {
            form_factors,
            lost,
            area: (0..world.len()).map(|patch| world.area(patch)).collect(),
            albedo: patches.diffuse.iter().map(channels).collect(),
            emitted: patches.emission.iter().map(|e| channels(e).map(|e| PI * e)).collect(),
        }
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// Irradiance from radiosities: E_i = Σ_j F_ij B_j. One application of the transport
    /// operator T.
    pub fn transport(&self, radiosity: &[f64]) -> Vec<f64> {
        let dot = |row: &Vec<f64>| row.iter().zip(radiosity).map(|(f, b)| f * b).sum();
        self.form_factors.iter().map(dot).collect()
    }

    /// B = π L^e + kd E of one channel.
    pub fn radiosity(&self, channel: usize, irradiance: &[f64]) -> Vec<f64> {
        let b = |i: usize| self.emitted[i][channel] + self.albedo[i][channel] * irradiance[i];
        (0..self.len()).map(b).collect()
    }

    /// Irradiance after `count` iterations from L = L^e, of one channel.
    pub fn iterated(&self, channel: usize, count: usize) -> Vec<f64> {
        (0..count).fold(vec![0.0; self.len()], |irradiance, _| {
            self.transport(&self.radiosity(channel, &irradiance))
        })
    }

    /// The irradiance of every patch, of one channel.
    pub fn solve(&self, channel: usize) -> Vec<f64> {
        let n = self.len();
        let matrix = (0..n)
            .map(|i| {
                let own = |j: usize| f64::from(u8::from(i == j));
                (0..n).map(|j| own(j) - self.form_factors[i][j] * self.albedo[j][channel]).collect()
            })
            .collect();
        let emitted: Vec<f64> = self.emitted.iter().map(|e| e[channel]).collect();
        solve(matrix, self.transport(&emitted))
    }

    /// Irradiance of every patch summed over the channels.
    pub fn solve_sum(&self) -> Vec<f64> {
        let channels = [0, 1, 2].map(|channel| self.solve(channel));
        (0..self.len()).map(|i| channels.iter().map(|e| e[i]).sum()).collect()
    }

    /// [`Self::solve_sum`] over independent draws of rays: what the rays leave uncertain is known.
    pub fn solve_by_rays(scene: &PatchedScene, rays: u64, draws: u64) -> Vec<Moments> {
        let mut moments = vec![Moments::default(); scene.patches.len()];
        for seed in 0..draws {
            let solution = Self::by_rays(scene, rays, seed).solve_sum();
            moments.iter_mut().zip(solution).for_each(|(moments, e)| moments.push(e));
        }
        moments
    }

    /// Area-weighted mean.
    pub fn mean(&self, values: &[f64]) -> f64 {
        let total: f64 = self.area.iter().sum();
        self.area.iter().zip(values).map(|(area, value)| area * value).sum::<f64>() / total
    }
}

/// Solves a·x = b by Gaussian elimination with row pivoting.
pub fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for column in 0..n {
        let pivot = (column..n)
            .max_by(|&i, &j| a[i][column].abs().total_cmp(&a[j][column].abs()))
            .expect("a row is left");
        a.swap(column, pivot);
        b.swap(column, pivot);
        let (upper, lower) = a.split_at_mut(column + 1);
        let row = &upper[column];
        for (below, values) in lower.iter_mut().enumerate() {
            let factor = values[column] / row[column];
            if factor != 0.0 {
                for k in column..n {
                    values[k] -= factor * row[k];
                }
                b[column + 1 + below] -= factor * b[column];
            }
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| a[i][j] * b[j]).sum();
        b[i] = (b[i] - known) / a[i][i];
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elimination_needs_its_pivots() {
        // Zero in the first pivot; solution (1, −2, 3).
        let a = vec![vec![0.0, 2.0, 1.0], vec![1.0, 1.0, 0.0], vec![4.0, 0.0, -1.0]];
        let x = solve(a, vec![-1.0, -1.0, 1.0]);
        for (x, exact) in x.iter().zip([1.0, -2.0, 3.0]) {
            assert!((x - exact).abs() < 1e-12, "{x} {exact}");
        }
    }
}
