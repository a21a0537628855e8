//! Settings of the methods by name, with their defaults and ranges, and those that several methods
//! read.

mod hemicube;
mod mesh;
mod specs;
mod values;

pub use hemicube::hemicubes;
pub use mesh::MeshSettings;
#[cfg(test)]
pub(super) use specs::PRESETS;
pub use specs::{OPTIONS, OptionSpec};
pub use values::Settings;
