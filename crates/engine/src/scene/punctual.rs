//! Lights without extent, as KHR_lights_punctual has them.

use crate::radiometry::Rgb;
use glam::Vec3;

/// How a light without extent spreads its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Evenly in all directions.
    Point,
    /// In a cone around [`PunctualLight::direction`].
    Spot {
        /// Angle from the axis up to which the light is full, radians, in [0, outer).
        inner_cone: f32,
        /// Angle from the axis beyond which there is none, radians, in (inner, π/2].
        outer_cone: f32,
    },
    /// In one direction, from infinitely far away.
    Directional,
}

/// A light without extent: no ray ever meets it, so only its irradiance is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Name in the file, or a made-up one.
    pub name: String,
    /// How it spreads its light.
    pub kind: LightKind,
    /// World position, metres; without meaning where the light is directional.
    pub position: Vec3,
    /// Unit vector along which the light goes, −Z of the light's node; without meaning of a point.
    pub direction: Vec3,
    /// Colour × intensity, linear, ≥ 0: candela (lm/sr) of a point and a spot, lux (lm/m²) of a
    /// directional light, as in the file. The scale of nodes does not change it.
    pub intensity: Rgb,
    /// Distance in metres, > 0, at which the file lets the light end; `None` where it never does.
    pub range: Option<f32>,
}

impl PunctualLight {
    /// Whether any light comes from it.
    pub fn shines(&self) -> bool {
        self.intensity.max_element() > 0.0
    }
}
