//! Tier 2: indirect irradiance at records on what the camera sees, by rays over the hemisphere.

mod by_direction;
mod cache;
mod fitted;
mod in_time;
mod pilot;
mod record;
mod splat;
mod stored_record;
mod turned;

pub use cache::{Gathering, IndirectLight, IrradianceCache, Spacing, least_scale};
pub use pilot::PilotSampling;
