//! Direct light on every fragment (tier 3).

mod allocation;
mod by_neighbours;
mod highlights;
mod shadows;
mod sums;

pub use shadows::{Caster, DirectLighting};
