//! Devices: who runs shots. [`cpu`] needs nothing installed; [`wgpu`] runs the same iteration in
//! WGSL kernels. Both take the same [`Shot`](crate::hemicube::Shot)s and are compared shot by shot in the tests.
//!
//! Shots do not ask `surface`'s interface to reflection. A patch reflects what it has gathered, pixel
//! by pixel and in vectors, by the diffuse part and the modified Phong lobe of a
//! [`Reflectance`](crate::radiometry::Reflectance), written once for each device; patches of any
//! other model would come here as the Phong lobe that is most like it.

pub mod cpu;
mod interface;
mod memory;
mod settings;
mod viewpoint;
#[cfg(feature = "wgpu")]
pub mod wgpu;

pub use interface::{Device, DeviceDescription, DeviceError, Shooting, ShotTrace, Sums, Tally};
pub use memory::free_memory;
pub use settings::{
    Faces, KnownLight, MIRROR_FACE_PROBABILITY, OTHER_FACE_PROBABILITY, Selection,
    ShootingSettings, Substitute, VarianceReduction,
};
use settings::{known_power, sources};
pub use viewpoint::Viewpoint;

/// Devices of this machine: the processor first, then wgpu adapters.
pub fn list() -> Vec<DeviceDescription> {
    let mut devices = vec![cpu::CpuDevice::describe()];
    #[cfg(feature = "wgpu")]
    devices.extend(wgpu::list());
    devices
}

/// Opens a device: `cpu`, `auto` (a real GPU if there is one that can be opened, else the
/// processor) or the index of a wgpu adapter.
///
/// # Errors
/// [`DeviceError::Unknown`] where there is no such device, and what opening it says.
pub fn open(id: &str) -> Result<Box<dyn Device>, DeviceError> {
    match id {
        "cpu" => Ok(Box::new(cpu::CpuDevice::new(None)?)),
        "auto" => {
            #[cfg(feature = "wgpu")]
            for gpu in
                list().iter().filter(|d| d.kind.ends_with("_gpu") && d.kind != "software_gpu")
            {
                match open(&gpu.id) {
                    Ok(device) => return Ok(device),
                    Err(error) => tracing::warn!(%error, "this GPU is left out"),
                }
            }
            open("cpu")
        }
        #[cfg(feature = "wgpu")]
        index => match index.parse() {
            Ok(index) => Ok(Box::new(wgpu::WgpuDevice::open(index)?)),
            Err(_) => Err(DeviceError::Unknown(id.into())),
        },
        #[cfg(not(feature = "wgpu"))]
        _ => Err(DeviceError::Unknown(id.into())),
    }
}
