//! Iterating on two devices: runs from the same random numbers, averages, and comparators for
//! both.

use crate::skips::{skipped, without_wgpu};
use crate::twins::{Batches, distance};
use glam::Vec3;
use hemilux_engine::device::wgpu::{self, WgpuDevice};
use hemilux_engine::device::{Device, ShootingSettings, Sums, Viewpoint};
use hemilux_engine::patches::PatchedScene;
use std::sync::Arc;

/// The first wgpu adapter; `None` where the environment says to do without.
pub fn adapter() -> Option<WgpuDevice> {
    if without_wgpu() {
        skipped("HEMILUX_NO_WGPU=1");
        return None;
    }
    let found = wgpu::list();
    let first = found
        .first()
        .expect("no wgpu adapter: install mesa-vulkan-drivers, or set HEMILUX_NO_WGPU=1 to skip");
    Some(WgpuDevice::open(first.id.parse().expect("an index")).expect("the adapter opens"))
}

/// Settings with a viewer in a corner of the made rooms.
pub fn settings(resolution: u32, shots_per_iteration: u32, seed: u64) -> ShootingSettings {
    ShootingSettings {
        resolution,
        shots_per_iteration,
        seed,
        viewpoint: Some(Viewpoint::Eye(Vec3::new(0.9, 0.9, 0.9))),
        ..ShootingSettings::default()
    }
}

/// A few iterations on one device.
#[derive(Clone)]
pub struct Run {
    /// Iteration by iteration, the patches that shot.
    pub shooters: Vec<Vec<u32>>,
    /// Sums over all of them.
    pub sums: Sums,
}

impl Run {
    /// Iterates from the start.
    pub fn new(
        device: &mut dyn Device,
        scene: &Arc<PatchedScene>,
        settings: &ShootingSettings,
        iterations: u32,
    ) -> Self {
        let mut shooting = device.begin(scene.clone(), settings).expect("begins");
        let shooters = (0..iterations).map(|_| {
            let tally = shooting.iterate(1).expect("iterates");
            assert_eq!(tally.shots, u64::from(settings.shots_per_iteration));
            let shooters = shooting.shooters().expect("lists shooters");
            let emits = |patch: &&u32| scene.patches.emits(**patch as usize);
            assert_eq!(tally.light_shots, shooters.iter().filter(emits).count() as u64);
            shooters
        });
        Self { shooters: shooters.collect(), sums: shooting.drain().expect("drains") }
    }
}

/// Runs from the same random numbers on two devices, compared seed by seed.
#[derive(Debug, Default)]
pub struct SameNumbers {
    /// Runs.
    pub runs: usize,
    /// Relative distances of the irradiance, and of the glossy radiance where there is any, in
    /// the runs in which the same patches shot. Where rounding moves a pick over the border
    /// between two patches, the rest is another random walk.
    pub distances: Vec<f64>,
}

impl SameNumbers {
    /// Adds two runs that should be the same.
    pub fn push(&mut self, areas: &[f32], a: &Run, b: &Run) {
        self.runs += 1;
        if a.shooters == b.shooters {
            let irradiance = distance(areas, &a.sums.irradiance, &b.sums.irradiance);
            let lit = a.sums.glossy.iter().any(|radiance| radiance.element_sum() != 0.0);
            let glossy = if lit { distance(areas, &a.sums.glossy, &b.sums.glossy) } else { 0.0 };
            assert!(irradiance >= 0.0 && glossy >= 0.0, "no light to compare");
            self.distances.push(irradiance.max(glossy));
        }
    }

    /// Whether the devices do the same: nearly the same shooters, and light that differs by no
    /// more than pixels at edges and, rarely, a choice among lobes or a form factor at a limit.
    pub fn agree(&self) -> bool {
        let mut sorted = self.distances.clone();
        sorted.sort_by(f64::total_cmp);
        4 * sorted.len() >= 3 * self.runs
            && sorted[sorted.len() / 2] < 0.005
            && sorted[sorted.len() - 1] < 0.05
    }
}

/// Averages of many iterations, in batches.
pub struct Averages {
    /// Of the irradiance.
    pub irradiance: Batches,
    /// Of the radiance that lobes send to the viewer.
    pub glossy: Batches,
    /// Share of shots from patches that emit.
    pub light_ratio: f64,
}

impl Averages {
    /// 24 batches of 60 iterations.
    pub fn new(
        device: &mut dyn Device,
        scene: &Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Self {
        let mut shooting = device.begin(scene.clone(), settings).expect("begins");
        let (mut irradiance, mut glossy) = (Batches::default(), Batches::default());
        // What the start at L^e leaves behind.
        shooting.iterate(60).expect("iterates");
        shooting.drain().expect("drains");
        let (mut shots, mut light_shots) = (0, 0);
        for _ in 0..24 {
            let tally = shooting.iterate(60).expect("iterates");
            (shots, light_shots) = (shots + tally.shots, light_shots + tally.light_shots);
            let sums = shooting.drain().expect("drains");
            irradiance.push(&sums.irradiance, sums.iterations);
            glossy.push(&sums.glossy, sums.iterations);
        }
        Self { irradiance, glossy, light_ratio: light_shots as f64 / shots as f64 }
    }
}
