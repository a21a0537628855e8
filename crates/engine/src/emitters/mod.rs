//! Emitters, and how their direct light is found: triangles sampled by power, polygons in closed
//! form with a tree for very many, and disks in place of them.

mod disks;
mod from_triangles;
mod light_tree;
mod polygon;
mod polygons;
mod triangles;
mod unoccluded;

pub use disks::{DiskPoints, Disks};
pub use light_tree::{LightBounds, LightTree};
pub use polygons::{PolygonLights, ShadowSample, TRIES};
pub use triangles::{EmissionSample, LightSample, TriangleLights};
pub use unoccluded::{LobeAxis, MOST_LIGHTS};
