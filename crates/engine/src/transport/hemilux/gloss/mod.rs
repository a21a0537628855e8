//! Glossy reflection: radiance by the lobes of surfaces that the camera sees or that other rays
//! meet.

mod lobe_rays;
mod lobes;
mod seen_through;

pub use lobe_rays::arriving;
pub use lobes::Gloss;
