//! Tier 3: the emitters' own light on every fragment.

mod shadows;

pub use shadows::Direct;
