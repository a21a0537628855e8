//! Glossy reflection: radiance by the lobes of surfaces that the camera sees or that other rays
//! meet.

mod allocation;
mod lobe_at;
mod lobe_rays;
mod lobes;
mod open_sky;
mod placed_lobe;
mod seen_through;
mod sharing;
mod sums;
#[cfg(test)]
mod suns;

pub use lobe_rays::{Arriving, AtTheEnd, arriving, lacking};
pub use lobes::Gloss;
pub use seen_through::{PixelRay, of_camera};
