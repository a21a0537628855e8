//! What shines, and how its direct light is found: triangles sampled by power, polygons in closed
//! form with a tree for very many, and disks in place of them; the sky, the sun, and lights without
//! extent, or of a small one.

mod all_unoccluded;
mod cells;
mod direct_lights;
mod disks;
mod from_triangles;
mod glow;
mod light_tree;
mod merging;
mod narrow;
mod of_triangles;
mod openings;
mod polygon;
mod polygons;
mod punctual;
mod scene_lights;
mod sky;
mod sun;
mod triangles;
mod unoccluded;

pub use all_unoccluded::AllUnoccluded;
pub use direct_lights::DirectLights;
pub use disks::{DiskPoints, Disks};
pub use light_tree::{LightBounds, LightTree};
pub use narrow::NarrowLimits;
pub use polygons::{LightPoint, ShadowSample, TRIES};
pub use scene_lights::SceneLights;
pub use sky::SkyLight;
pub use triangles::{EmissionSample, LightSample, TriangleLights};
pub use unoccluded::{LobeAxis, MOST_LIGHTS};
