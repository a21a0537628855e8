//! A point of a surface as a ray meets it.

use super::dielectric::{Clear, Inside};
use super::model::{AnyReflection, Parameters};
use super::side::Side;
use crate::radiometry::Rgb;
use crate::rays::Spot;
use glam::Vec3;

/// A point of a surface, seen from the side that reflects.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// Barycentric (u, v) there.
    pub at: [f32; 2],
    /// Whether the back is seen.
    pub back: bool,
    /// Where.
    pub spot: Spot,
    /// Unit geometric normal of the side that is seen.
    pub normal: Vec3,
    /// Unit shading normal of that side, which it is lit by.
    pub shading_normal: Vec3,
    /// What it reflects; [`Surface::reflection`] says how.
    pub(super) parameters: Parameters,
    /// Radiance that it emits.
    pub emission: Rgb,
    /// How it lets light through, if it does.
    pub clear: Option<Clear>,
}

impl Surface {
    /// How it lies.
    #[inline]
    pub fn side(&self) -> Side {
        Side { normal: self.normal, shading_normal: self.shading_normal, back: self.back }
    }

    /// The body that a ray was in which has met it from inside: that of a clear surface, at its back.
    pub fn body_before(&self) -> Option<Inside> {
        self.clear.and_then(|clear| clear.inside()).filter(|_| self.back)
    }

    /// Where rays that leave start.
    pub fn start(&self) -> Vec3 {
        self.spot.off_surface(self.normal)
    }

    /// Where rays that go on behind it start.
    pub fn start_behind(&self) -> Vec3 {
        self.spot.off_surface(-self.normal)
    }

    /// The same without its diffuse part.
    pub fn lobe_only(mut self) -> Self {
        self.parameters = self.parameters.lobe_only();
        self
    }

    /// The same with lobes of microfacets that are wider by such a difference of slopes; `None` where none of them is
    /// narrower than that by itself.
    pub fn blurred(mut self, slopes: f32) -> Option<Self> {
        self.parameters = self.parameters.blurred(slopes)?;
        Some(self)
    }

    /// What irradiance over π and what the lobe's radiance towards a unit vector are multiplied by, for light
    /// without directions.
    pub fn diffuse_and_lobe_factor(&self, viewer: Vec3) -> [Rgb; 2] {
        self.parameters.diffuse_and_lobe_factor(self.shading_normal, viewer)
    }

    /// The mirror direction of `viewer`.
    pub fn mirrored(&self, viewer: Vec3) -> Vec3 {
        self.side().mirrored(viewer)
    }

    /// How it reflects.
    #[inline]
    pub fn reflection(&self) -> AnyReflection {
        AnyReflection::new(self.parameters, self.side())
    }
}
