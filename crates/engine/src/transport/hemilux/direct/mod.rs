//! Direct light on every fragment (tier 3).

mod shadows;
mod sums;

pub use shadows::{Caster, DirectLighting};
