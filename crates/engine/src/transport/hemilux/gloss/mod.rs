//! Glossy reflection: radiance by the lobes of surfaces that the camera sees or that other rays
//! meet.

mod lobe_rays;
mod lobes;

pub use lobe_rays::reflected_at;
pub use lobes::Gloss;
