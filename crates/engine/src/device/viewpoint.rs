//! From where light is looked at.

use glam::Vec3;

/// Where the picture is taken from, for reflections that depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// A perspective camera's eye.
    Eye(Vec3),
    /// An orthographic camera: the unit direction towards it.
    Direction(Vec3),
}

impl Viewpoint {
    /// Unit direction from `point` towards the viewer.
    pub fn direction_from(&self, point: Vec3) -> Vec3 {
        match self {
            Viewpoint::Eye(eye) => (*eye - point).normalize_or_zero(),
            Viewpoint::Direction(direction) => *direction,
        }
    }
}
