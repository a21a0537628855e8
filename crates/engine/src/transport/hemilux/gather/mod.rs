//! Tier 2: indirect irradiance at records on what the camera sees, by rays over the hemisphere.

mod cache;
mod kept_record;
mod record;
mod splat;

pub use cache::{Bounced, Cache, FirstLook, Gathering, Spacing, least_scale};
