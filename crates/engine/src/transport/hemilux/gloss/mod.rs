//! Gloss: what lobes reflect, seen by the camera or met by other rays.

mod lobe_rays;
mod lobes;

pub use lobe_rays::reflected_at;
pub use lobes::Gloss;
