//! Surfaces as rays meet them: where, what they reflect and emit, and what they let through.

mod dielectric;
mod point;
mod world;

pub use dielectric::Inside;
pub use point::{Parts, Surface};
pub use world::World;
