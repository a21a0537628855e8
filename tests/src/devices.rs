//! The devices that tests run on: the CPU device and the first wgpu adapter.

use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::wgpu::{self, WgpuDevice};
use hemilux_engine::device::{Device, ShootingSettings, Tally};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use std::sync::Arc;

use crate::oracle::statistics::Moments;
use crate::skips::{partly_skipped, without_wgpu};

/// Every kind of device with its name: the CPU device, and the first wgpu adapter unless
/// `HEMILUX_NO_WGPU=1`.
///
/// # Panics
/// Where there is no wgpu adapter.
pub fn all() -> Vec<(&'static str, Box<dyn Device>)> {
    let cpu = CpuDevice::new(None).expect("threads");
    let mut devices: Vec<(&'static str, Box<dyn Device>)> = vec![("cpu", Box::new(cpu))];
    if without_wgpu() {
        partly_skipped("HEMILUX_NO_WGPU=1 leaves the wgpu device out");
    } else {
        let found = wgpu::list();
        let first = found
            .first()
            .expect("no wgpu adapter: install mesa-vulkan-drivers, or set HEMILUX_NO_WGPU=1");
        let adapter = WgpuDevice::open(first.id.parse().expect("an index")).expect("it opens");
        devices.push(("wgpu", Box::new(adapter)));
    }
    devices
}

/// How many iterations an estimate takes.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Iterations that are left out at first.
    pub burn_in: u32,
    /// Batches whose means count as independent.
    pub batches: u32,
    /// Iterations of a batch.
    pub iterations: u32,
}

/// Irradiance of every patch, channel by channel, from batch means.
pub struct Estimate {
    /// Per channel and patch.
    pub channels: [Vec<Moments>; 3],
    /// The channels' sum per patch.
    pub sum: Vec<Moments>,
    /// Power that lands in all per channel, Σ A E, W.
    pub landed: [Moments; 3],
    /// Counts without the burn-in.
    pub tally: Tally,
}

/// Runs a device and collects batch means of the irradiance.
pub fn estimate(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    effort: Effort,
) -> Estimate {
    estimate_until(device, scene, settings, effort, |_| true)
}

/// The same with further batches until `is_enough`.
///
/// # Panics
/// Where a thousand times as many are not enough.
pub fn estimate_until(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    effort: Effort,
    is_enough: impl Fn(&Estimate) -> bool,
) -> Estimate {
    let mut shooting = device.begin(scene.clone(), settings).expect("begins");
    if effort.burn_in > 0 {
        shooting.iterate(effort.burn_in).expect("iterates");
        shooting.drain().expect("drains");
    }
    let dark = || vec![Moments::default(); scene.patches.len()];
    let mut estimate = Estimate {
        channels: [dark(), dark(), dark()],
        sum: dark(),
        landed: [Moments::default(); 3],
        tally: Tally::default(),
    };
    let mut batches = 0;
    while batches < effort.batches || !is_enough(&estimate) {
        assert!(batches < 1000 * effort.batches, "the standard error does not fall");
        batches += 1;
        estimate.tally += shooting.iterate(effort.iterations).expect("iterates");
        let sums = shooting.drain().expect("drains");
        let means: Vec<Rgb> =
            sums.irradiance.iter().map(|sum| *sum / sums.iterations as f32).collect();
        let mut landed = [0.0; 3];
        for (patch, mean) in means.iter().enumerate() {
            for (landed, value) in landed.iter_mut().zip(mean.to_array()) {
                *landed += f64::from(scene.patches.area[patch]) * f64::from(value);
            }
            for (channel, value) in estimate.channels.iter_mut().zip(mean.to_array()) {
                channel[patch].push(f64::from(value));
            }
            estimate.sum[patch].push(f64::from(mean.element_sum()));
        }
        estimate.landed.iter_mut().zip(landed).for_each(|(moments, value)| moments.push(value));
    }
    estimate
}

/// Means of many moments.
pub fn means(moments: &[Moments]) -> Vec<f64> {
    moments.iter().map(Moments::mean).collect()
}
