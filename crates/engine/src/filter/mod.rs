//! Local linear regression: weighted least-squares planes through neighbouring values.

mod moments;

mod plane;

pub use moments::middle_coefficients;
pub use plane::{Center, Plane};
