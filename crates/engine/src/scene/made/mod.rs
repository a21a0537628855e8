//! Scenes made by code: the project's own test and example scenes, as GLB files. The same bytes
//! every time.

mod caustics;
mod cornell;
mod glb;
mod gloss;
mod hidden_light;
mod mesh;
mod office;
mod patterns;
pub mod real;
#[cfg(test)]
pub mod revolved;
mod rooms;
#[cfg(test)]
mod tests;
mod texture;

pub use caustics::{glass, ring};
pub use cornell::{cornell, phong_cornell};
pub use glb::assemble;
pub use gloss::{gallery, kitchen};
pub use hidden_light::{blinds, hall, shade};
pub use office::office;
pub use patterns::{checker, screens};
pub use rooms::{
    CeilingLamps, DIVIDED_AT, ceiling_lamps, corridor, divided_room, furnace, tessellated_room,
};

use crate::radiometry::Rgb;

/// The scenes that are shipped in `scenes/`: file name and contents.
pub fn shipped() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("cornell.glb", cornell()),
        ("cornell_phong.glb", phong_cornell()),
        ("corridor.glb", corridor()),
        ("furnace.glb", furnace(Rgb::splat(0.5), Rgb::ONE)),
        ("glass.glb", glass()),
        ("office.glb", office()),
        ("ring.glb", ring()),
    ]
}
