//! Surfaces as rays meet them: where, what they reflect and emit, and what they let through.

mod side;

mod reflection;

mod phong;

mod ggx;

mod ggx_albedo;

mod distribution;

mod slopes;

mod layered;

mod model;

mod angle_table;

mod base_lobe;

mod film;

mod coat;

mod sheen;

mod dielectric;

mod point;

mod finish;

mod world;

mod passage;

mod differentials;

mod filtered;

mod far_side;

#[cfg(test)]
mod laws;

pub use dielectric::{Clear, ExitDirection, Inside};
pub use differentials::{Differentials, Turn};
pub use model::Parameters;
pub use passage::{Passage, PassageEnd, mirrored_share};
pub use point::Surface;
pub use reflection::{Parts, Reflection, Scattered};
pub use slopes::{SlopeChanges, Slopes};
pub use world::{World, is_same_normal};
