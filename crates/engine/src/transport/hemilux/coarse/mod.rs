//! Tier 1: the light of the whole scene on a coarse mesh.

mod aimed;
mod by_lobes;
mod caustic_light;
mod crevices;
mod direct;
mod elements;
mod far_sides;
mod glow;
mod groups;
mod guide;
mod inside;
mod links;
mod mesh;
mod outlook;
mod reflected;
mod solution;

pub use caustic_light::MOST_TRIANGLES;
pub use direct::SampledLight;
pub use elements::Elements;
pub use guide::{Met, aims_of, balanced};
pub use mesh::CoarseMesh;
pub use outlook::Outlook;
pub use reflected::FoundAfresh;
pub use solution::{CoarseSolution, Drawing, PATCH_POINTS};
