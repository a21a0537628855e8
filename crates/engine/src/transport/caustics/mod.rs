//! Maps of caustics (Arvo 1986, as Rogers prints them): light that comes to diffuse surfaces by way
//! of sharp mirrors and of clear bodies is carried there from the lights, and kept on grids.
//!
//! What is in a map is light of emitters, the sun and points that was mirrored by a sharp lobe
//! ([`crate::surface::Reflection::is_sharp`]), or mirrored or bent by a clear surface, at least once,
//! and met nothing else on its way. Light of the sky is not in it: rays find that by themselves.

mod charts;
mod light_rays;
mod maker;
mod map;

pub use charts::Charts;
pub use light_rays::{Casters, Lit};
pub use maker::{BLOCK, Maker};
pub use map::{Map, PowerDeposit};
