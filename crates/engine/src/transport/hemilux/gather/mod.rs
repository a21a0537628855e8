//! Tier 2: indirect irradiance at records on what the camera sees, by rays over the hemisphere.

mod by_direction;
mod cache;
mod fitted;
mod record;
mod splat;
mod stored_record;
mod turned;

pub use cache::{Gathering, IndirectLight, IrradianceCache, PilotSampling, Spacing, least_scale};
