//! The wgpu device: the CPU device's iteration as WGSL kernels, all of it on the adapter.
//!
//! One iteration is `select.wgsl` (pick K shooters, make [`Shot`](crate::hemicube::Shot)s), then
//! per group of shots that share a render pass `cull.wgsl` (which facets does each face draw),
//! `raster.wgsl` (item buffers, side by side in one texture), `deposit.wgsl` (sums per patch) and
//! `update.wgsl` (incoming light, next powers). The host only submits and, now and then, reads
//! counts and sums back.

mod buffers;
mod check;
mod formats;
mod gpu;
mod layout;
mod pipelines;
mod shooting;

use super::{Device, DeviceDescription, DeviceError, Shooting, ShootingSettings};
use crate::patches::PatchedScene;
use gpu::Gpu;
use pipelines::Pipelines;
use std::sync::Arc;

/// Adapters of this machine that can shoot; empty where there is no driver. The id of each is
/// its index, for [`WgpuDevice::open`].
pub fn list() -> Vec<DeviceDescription> {
    gpu::adapters()
        .iter()
        .enumerate()
        .filter(|(_, adapter)| gpu::missing(adapter).is_none())
        .map(|(index, adapter)| gpu::describe(index, adapter))
        .collect()
}

/// A wgpu adapter as a device.
pub struct WgpuDevice {
    gpu: Gpu,
    pipelines: Pipelines,
}

impl WgpuDevice {
    /// Opens the adapter that [`list`] names by this index, compiles the kernels for it and
    /// shoots into a closed room to see whether they do there what they should.
    ///
    /// # Errors
    /// [`DeviceError::Unknown`] where there is no such adapter or it lacks what the kernels need,
    /// [`DeviceError::Lost`] where the driver refuses, [`DeviceError::Unfit`] where light is lost in
    /// the room.
    pub fn open(index: usize) -> Result<Self, DeviceError> {
        let gpu = Gpu::open(index)?;
        let pipelines = gpu.guarded(|| Pipelines::new(&gpu))?;
        let mut device = Self { gpu, pipelines };
        let traces = device.begin(check::room(), &check::settings())?.trace(&check::shots())?;
        check::judge(&traces)
            .map_err(|reason| DeviceError::Unfit { device: device.description().name, reason })?;
        Ok(device)
    }
}

impl Device for WgpuDevice {
    fn description(&self) -> DeviceDescription {
        self.gpu.description.clone()
    }

    fn begin<'device>(
        &'device mut self,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Result<Box<dyn Shooting + 'device>, DeviceError> {
        Ok(Box::new(shooting::WgpuShooting::new(&self.gpu, &self.pipelines, scene, settings)?))
    }
}
