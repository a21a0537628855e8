//! Which side of a surface light meets, and how it lies.

use glam::Vec3;

/// How the side of a surface lies that light meets.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Unit geometric normal of that side.
    pub normal: Vec3,
    /// Unit shading normal of that side.
    pub shading_normal: Vec3,
    /// Whether it is the back.
    pub back: bool,
}

impl Side {
    /// The mirror direction of the unit vector `viewer` about the shading normal.
    #[inline]
    pub fn mirrored(&self, viewer: Vec3) -> Vec3 {
        2.0 * self.shading_normal.dot(viewer) * self.shading_normal - viewer
    }
}
