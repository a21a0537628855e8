//! Direct light on every fragment (tier 3).

mod shadows;

pub use shadows::DirectLighting;
