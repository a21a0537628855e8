//! What a fragment's lobe reflects of a light where it is looked at.

use crate::radiometry::Rgb;
use crate::surface::{Parts, Reflection, SlopeChanges, Surface};
use crate::transport::hemilux::fragments::VisibleSurfaces;
use glam::Vec3;
use std::f32::consts::PI;

/// A lobe where it is looked at.
pub struct LobeHere {
    pub surface: Surface,
    /// Unit vector towards the eye.
    pub viewer: Vec3,
    /// What the fragment reflects of irradiance, 1/sr.
    even: Rgb,
}

impl LobeHere {
    /// Of the surface that a pixel sees.
    pub fn of(visible: &VisibleSurfaces, surface: Surface) -> Self {
        let viewer = visible.frame.towards_eye(surface.spot.point);
        let [diffuse, _] = surface.diffuse_and_lobe_factor(viewer);
        Self { surface, viewer, even: diffuse / PI }
    }

    /// Radiance that the surface reflects of a light in that unit direction, which shines so much on a plane
    /// that faces it, beside what it would if it reflected all light alike.
    pub fn reflects(&self, light: (Vec3, Rgb)) -> Rgb {
        self.reflects_by(light, |direction| {
            self.surface.reflection().evaluate(self.viewer, direction)
        })
    }

    /// The same on the mean over a part of the surface over which slopes change like this.
    pub fn reflects_over(&self, light: (Vec3, Rgb), changes: &SlopeChanges) -> Rgb {
        let reflection = self.surface.reflection();
        self.reflects_by(light, |direction| {
            reflection.evaluate_over(self.viewer, direction, changes)
        })
    }

    fn reflects_by(
        &self,
        (direction, irradiance): (Vec3, Rgb),
        parts: impl Fn(Vec3) -> Parts,
    ) -> Rgb {
        let cosine = self.surface.shading_normal.dot(direction);
        if cosine <= 0.0 || self.surface.normal.dot(direction) <= 0.0 {
            return Rgb::ZERO;
        }
        (parts(direction).both() - self.even) * irradiance * cosine
    }
}
