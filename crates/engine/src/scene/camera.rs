//! Cameras.

use glam::{Mat4, Vec3};

/// A perspective or orthographic camera looking along −Z of its own frame, +Y up.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Name in the file, or a made-up one.
    pub name: String,
    /// Camera-to-world transform without scale.
    pub to_world: Mat4,
    /// Field of view or extent.
    pub projection: Projection,
}

/// Projection of a camera. The picture's aspect ratio, not the file's, sets the width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians.
    Perspective {
        /// Full vertical angle in radians, in (0, π).
        yfov: f32,
    },
    /// Half the visible height in metres.
    Orthographic {
        /// Half height in metres, > 0.
        ymag: f32,
    },
}

impl Camera {
    /// A perspective camera at `eye` looking at `target`; `yfov` in radians.
    pub fn look_at(name: &str, eye: Vec3, target: Vec3, up: Vec3, yfov: f32) -> Self {
        let backward = (eye - target).normalize();
        let right = up.cross(backward).normalize();
        let up = backward.cross(right);
        Self {
            name: name.into(),
            to_world: Mat4::from_cols(
                right.extend(0.0),
                up.extend(0.0),
                backward.extend(0.0),
                eye.extend(1.0),
            ),
            projection: Projection::Perspective { yfov },
        }
    }
}
