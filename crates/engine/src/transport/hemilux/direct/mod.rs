//! Direct light on every fragment (tier 3).

mod allocation;
mod by_neighbours;
mod caster;
mod highlights;
mod lit_lobes;
mod lobe_here;
mod polished;
mod shadows;
mod sums;
mod uneven;

pub use caster::Caster;
pub use shadows::DirectLighting;
