//! What a device is to whoever asks it to shoot.

use super::settings::ShootingSettings;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::hemicube::Shot;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// What a device is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DeviceDescription {
    /// Short name that selects it: `cpu`, or the adapter's index.
    pub id: String,
    /// Name in words.
    pub name: String,
    /// `cpu`, `discrete_gpu`, `integrated_gpu`, `virtual_gpu`, `software_gpu` or `other`.
    pub kind: String,
    /// Driver or instruction set.
    pub driver: String,
}

impl fmt::Display for DeviceDescription {
    /// Its name and driver.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{} ({})", self.name, self.driver)
    }
}

/// Why a device failed.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The job needs more memory than the device has or may use.
    #[error(
        "{device}: the job needs {needed_bytes} bytes, {available_bytes} are available; use fewer patches or a lower hemicube resolution"
    )]
    OutOfMemory {
        /// The device.
        device: String,
        /// What the job needs.
        needed_bytes: u64,
        /// What there is.
        available_bytes: u64,
    },
    /// The device is gone and must be opened again.
    #[error("{device} was lost: {reason}")]
    Lost {
        /// The device.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// The device is there but does not do what it should.
    #[error("{device} cannot be used: {reason}")]
    Unfit {
        /// The device.
        device: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// There is no such device here.
    #[error("no device {0:?} here; `hemilux devices` lists them")]
    Unknown(String),
    /// The state that an iteration is to go on from is not one of this device and scene.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
}

/// A device that can shoot.
pub trait Device: Send {
    /// What it is.
    fn description(&self) -> DeviceDescription;

    /// Loads a scene and starts stochastic iteration at L(0) = L^e.
    ///
    /// # Errors
    /// [`DeviceError::OutOfMemory`] before anything is allocated, or [`DeviceError::Lost`].
    fn begin<'device>(
        &'device mut self,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Result<Box<dyn Shooting + 'device>, DeviceError>;
}

/// A stochastic iteration that is under way on a device (Antal eq. 2, 4, 8).
pub trait Shooting {
    /// Runs whole iterations: pick K shooters by power, shoot, update, accumulate.
    fn iterate(&mut self, iterations: u32) -> Result<Tally, DeviceError>;

    /// Per shot and patch, Σ ΔF over the pixels of the shot that see the patch: the form factors of
    /// the point that it is shot from. Leaves the iteration as it is.
    fn form_factors(&mut self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, DeviceError> {
        Ok(self.trace(shots)?.into_iter().map(|trace| trace.form_factor).collect())
    }

    /// The patches that shot in the last iteration.
    fn shooters(&mut self) -> Result<Vec<u32>, DeviceError>;

    /// Sums since the last call, known light included; resets them.
    fn drain(&mut self) -> Result<Sums, DeviceError>;

    /// Writes all that the iteration knows: light on its way, powers, sums since the last
    /// [`Shooting::drain`].
    fn save(&mut self, to: &mut Writer) -> Result<(), DeviceError>;

    /// Goes on from what [`Shooting::save`] wrote, as if it had never stopped; returns the
    /// iterations since the last [`Shooting::drain`].
    ///
    /// # Errors
    /// [`DeviceError::Checkpoint`] for what another kind of device wrote, or for another scene or
    /// other settings; the iteration is then useless.
    fn restore(&mut self, from: &mut Reader<'_>) -> Result<u64, DeviceError>;

    /// Shoots the given shots, leaving the iteration as it is: item buffers and delta-form-factor
    /// sums for comparing devices.
    fn trace(&mut self, shots: &[Shot]) -> Result<Vec<ShotTrace>, DeviceError>;
}

/// Counts of a run of iterations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Whole iterations.
    pub iterations: u64,
    /// Shots.
    pub shots: u64,
    /// Shots whose shooter emits by itself.
    pub light_shots: u64,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.iterations += other.iterations;
        self.shots += other.shots;
        self.light_shots += other.light_shots;
    }
}

/// Sums over iterations of what the measurement averages (Antal eq. 3).
#[derive(Clone, Debug, Default)]
pub struct Sums {
    /// Iterations that were summed.
    pub iterations: u64,
    /// Per patch: Σ E, irradiance in W/m² (times the emission unit of the file).
    pub irradiance: Vec<Rgb>,
    /// Per patch: Σ of the radiance that the Phong lobe sends to the viewpoint; empty where no
    /// patch is glossy or no viewpoint was set.
    pub glossy: Vec<Rgb>,
}

/// What one shot saw.
#[derive(Clone, Debug)]
pub struct ShotTrace {
    /// Item buffer, R × 3R in the layout of [`crate::hemicube::Face`]: see
    /// [`crate::hemicube::item`]. Zero where nothing was seen.
    pub items: Vec<u32>,
    /// Per patch: Σ ΔF over the pixels that see it.
    pub form_factor: Vec<f32>,
    /// Per patch: Σ ΔF·cosⁿα over the same pixels; all zero for a shot without a lobe.
    pub lobe_factor: Vec<f32>,
}
