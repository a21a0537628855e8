//! Where samples are drawn: random and well-spread points, cells, discrete picks, directions about
//! a normal, and how samples of several ways are weighed against each other.

mod discrete;
mod frame;
mod mis;
mod sequence;
mod sparse;
mod strata;

pub use discrete::Discrete;
pub use frame::frame;
pub use mis::power_heuristic;
pub use sequence::*;
pub use sparse::SparsePixels;
pub use strata::*;
