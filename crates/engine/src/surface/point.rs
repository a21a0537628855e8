//! A point of a surface as a ray meets it: diffuse plus modified Phong, evaluated and importance
//! sampled.

use super::dielectric::{Clear, Side};
use crate::radiometry::{LobeAlbedo, Reflectance, Rgb, importance};
use crate::rays::Spot;
use crate::sampling::frame;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// A point of a surface, seen from the side that reflects.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Barycentric (u, v) there.
    pub at: [f32; 2],
    /// Whether the back is seen.
    pub back: bool,
    /// Where.
    pub spot: Spot,
    /// Unit geometric normal of the side that is seen.
    pub normal: Vec3,
    /// Unit shading normal of that side: the lobe is about its mirror direction.
    pub shading_normal: Vec3,
    /// What it reflects.
    pub reflectance: Reflectance,
    /// Radiance that it emits.
    pub emission: Rgb,
    /// How it lets light through, if it does.
    pub clear: Option<Clear>,
}

/// What f_r does, the diffuse part and the lobe by themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// By the diffuse part.
    pub diffuse: Rgb,
    /// By the lobe.
    pub lobe: Rgb,
}

impl Parts {
    /// Both together.
    pub fn both(&self) -> Rgb {
        self.diffuse + self.lobe
    }

    /// Both, weighed.
    pub fn times(&self, weight: Rgb) -> Self {
        Self { diffuse: self.diffuse * weight, lobe: self.lobe * weight }
    }
}

/// A direction that was picked for light to come from.
pub struct Scattered {
    /// Unit direction away from the surface.
    pub direction: Vec3,
    /// f_r·cosθ over the density.
    pub factor: Parts,
    /// Density per solid angle.
    pub density: f32,
}

impl Surface {
    /// How it lies.
    pub fn side(&self) -> Side {
        Side { normal: self.normal, shading_normal: self.shading_normal, back: self.back }
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
        self.reflectance.diffuse = Rgb::ZERO;
        self
    }

    /// Share of the light from all around that it reflects.
    pub fn albedo(&self) -> Rgb {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        if !self.reflectance.is_glossy() {
            return diffuse;
        }
        diffuse + specular * LobeAlbedo::shared().mean(exponent)
    }

    /// The mirror direction of `viewer`.
    pub fn mirrored(&self, viewer: Vec3) -> Vec3 {
        2.0 * self.shading_normal.dot(viewer) * self.shading_normal - viewer
    }

    /// Whether it reflects anything.
    pub fn reflects(&self) -> bool {
        self.reflectance.diffuse != Rgb::ZERO || self.reflectance.is_glossy()
    }

    /// The share of rays that are to sample the diffuse part: its share of what is reflected
    /// towards `viewer`.
    pub fn diffuse_share(&self, viewer: Vec3) -> f32 {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.shading_normal.dot(viewer);
        if !self.reflectance.is_glossy() || cosine <= 0.0 {
            return 1.0;
        }
        let diffuse = importance(diffuse);
        let lobe = importance(specular) * LobeAlbedo::shared().at(exponent, cosine).max(1e-3);
        let both = diffuse + lobe;
        // Reflectances that are almost nothing may vanish in the products.
        if both > 0.0 { diffuse / both } else { 1.0 }
    }

    /// f_r and, for directions picked diffusely with probability `diffuse_share`, their density.
    pub fn evaluate(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.normal.dot(source).max(0.0);
        let mut value = Parts { diffuse: diffuse / PI, lobe: Rgb::ZERO };
        let mut density = diffuse_share * cosine / PI;
        if self.reflectance.is_glossy() {
            let power = self.lobe(viewer, source);
            value.lobe = specular * ((exponent + 2.0) / TAU * power);
            density += (1.0 - diffuse_share) * ((exponent + 1.0) / TAU * power);
        }
        (value, density)
    }

    /// Picks a direction for light that leaves towards `viewer`: by the cosine if `diffusely`,
    /// which must be so with probability `diffuse_share`, or else by the lobe. `None` where the
    /// pick lies below the horizon, of the shading normal, too, where the lobe was sampled: there the
    /// lobe reflects nothing.
    pub fn scatter(
        &self,
        viewer: Vec3,
        diffuse_share: f32,
        diffusely: bool,
        xi: [f32; 2],
    ) -> Option<Scattered> {
        let (cosine, axis) = if diffusely {
            ((1.0 - xi[0]).sqrt(), self.normal)
        } else {
            let mirror = self.mirrored(viewer);
            let power = 1.0 / (self.reflectance.exponent + 1.0);
            ((1.0 - xi[0]).powf(power), mirror.normalize_or(self.shading_normal))
        };
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (tangent, bitangent) = frame(axis, 0.0);
        let (sin, cos) = (TAU * xi[1]).sin_cos();
        let direction = axis * cosine + (tangent * cos + bitangent * sin) * sine;
        let cosine = self.normal.dot(direction);
        if cosine <= 0.0 || !(diffusely || self.shading_normal.dot(direction) > 0.0) {
            return None;
        }
        let (value, density) = self.evaluate(viewer, direction, diffuse_share);
        (density > 0.0).then(|| Scattered {
            direction,
            factor: value.times(Rgb::splat(cosine / density)),
            density,
        })
    }

    /// cosⁿα between the mirror of `viewer` and `source`; 0 where either is below the horizon.
    fn lobe(&self, viewer: Vec3, source: Vec3) -> f32 {
        let (to_viewer, to_source) =
            (self.shading_normal.dot(viewer), self.shading_normal.dot(source));
        if to_viewer <= 0.0 || to_source <= 0.0 {
            return 0.0;
        }
        let cosine = 2.0 * to_viewer * to_source - viewer.dot(source);
        if cosine <= 0.0 { 0.0 } else { cosine.min(1.0).powf(self.reflectance.exponent) }
    }
}
