//! What neighbours say together.

mod moments;

mod plane;

pub use moments::middle_coefficients;
pub use plane::Plane;
