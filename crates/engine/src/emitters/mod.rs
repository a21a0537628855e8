//! Emitters, and how they are asked for their light: triangles picked by power, polygons in closed
//! form with a tree for many, and disks that stand for them.

mod disks;
mod light_tree;
mod luminous;
mod polygon;
mod polygons;
mod triangles;
mod unoccluded;

pub use disks::{DiskPoints, Disks};
pub use light_tree::{Glow, LightTree};
pub use polygons::{PolygonLights, ShadowSample, TRIES};
pub use triangles::{Emitted, LightSample, TriangleLights};
pub use unoccluded::{Axis, MOST_LIGHTS};
