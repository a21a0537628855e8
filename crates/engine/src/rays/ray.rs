//! Rays as values, so that many can be asked about together.

use glam::Vec3;

/// A ray without an end.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts, ray units.
    pub origin: Vec3,
    /// Unit vector.
    pub direction: Vec3,
}

/// What lies between two points.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// Where it starts, ray units.
    pub from: Vec3,
    /// Where it ends, ray units.
    pub to: Vec3,
}
