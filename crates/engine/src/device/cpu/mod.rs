//! The native CPU device: a rasteriser on the cores that are there, nothing to install.
//!
//! The shots of an iteration run side by side, one a thread, each into its own sums, which are
//! then added in a fixed order: the bits do not depend on the number of threads.

mod deposit;
mod iterate;
mod kernel;
mod lobe;
mod raster;
mod select;
mod state_bytes;
mod visible;

pub use visible::visible_share;

use super::{Device, DeviceDescription, DeviceError, Shooting, ShootingSettings};
use crate::patches::PatchedScene;
use std::sync::Arc;

/// The processor as a device.
pub struct CpuDevice {
    pool: Option<rayon::ThreadPool>,
}

impl CpuDevice {
    /// A device on `threads` threads of its own, or else on those of whoever calls it: of the
    /// rayon pool that it is called in, which outside of any has all cores.
    ///
    /// # Errors
    /// [`DeviceError::Lost`] where the system refuses the threads.
    pub fn new(threads: Option<usize>) -> Result<Self, DeviceError> {
        let build = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(|index| format!("hemilux-cpu-{index}"))
                .build()
                .map_err(|error| DeviceError::Lost {
                    device: "cpu".into(),
                    reason: error.to_string(),
                })
        };
        Ok(Self { pool: threads.map(build).transpose()? })
    }

    fn threads(&self) -> usize {
        self.pool
            .as_ref()
            .map_or_else(rayon::current_num_threads, |pool| pool.current_num_threads())
    }

    /// What the device would be, without starting threads.
    pub fn describe() -> DeviceDescription {
        Self::describe_with(std::thread::available_parallelism().map_or(1, usize::from))
    }

    /// The processor as what computes here: with the threads of the rayon pool that this is called
    /// in.
    pub fn describe_here() -> DeviceDescription {
        Self::describe_with(rayon::current_num_threads())
    }

    fn describe_with(threads: usize) -> DeviceDescription {
        DeviceDescription {
            id: "cpu".into(),
            name: format!(
                "native CPU, {threads} {}",
                if threads == 1 { "thread" } else { "threads" }
            ),
            kind: "cpu".into(),
            driver: kernel::name().into(),
        }
    }
}

impl Device for CpuDevice {
    fn description(&self) -> DeviceDescription {
        Self::describe_with(self.threads())
    }

    fn begin<'device>(
        &'device mut self,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Result<Box<dyn Shooting + 'device>, DeviceError> {
        let needed_bytes = iterate::needed_bytes(&scene, settings, self.threads());
        let available_bytes = super::free_memory();
        if needed_bytes > available_bytes {
            let device = "cpu".into();
            return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes });
        }
        Ok(Box::new(iterate::CpuShooting::new(self.pool.as_ref(), scene, settings)))
    }
}
