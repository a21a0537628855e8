//! What neighbours say together.

mod plane;

pub use plane::Plane;
