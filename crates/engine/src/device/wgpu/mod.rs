//! The wgpu device.

use super::{Device, DeviceDescription, DeviceError, Shooting, ShootingSettings};
use crate::patches::PatchedScene;
use std::sync::Arc;

/// Adapters.
pub fn list() -> Vec<DeviceDescription> {
    Vec::new()
}

/// A wgpu adapter as a device.
pub struct WgpuDevice {}

impl WgpuDevice {
    /// Opens an adapter.
    pub fn open(index: usize) -> Result<Self, DeviceError> {
        Err(DeviceError::Unknown(index.to_string()))
    }
}

impl Device for WgpuDevice {
    fn description(&self) -> DeviceDescription {
        unreachable!()
    }
    fn begin<'device>(
        &'device mut self,
        _scene: Arc<PatchedScene>,
        _settings: &ShootingSettings,
    ) -> Result<Box<dyn Shooting + 'device>, DeviceError> {
        unreachable!()
    }
}
