//! How a point of a surface reflects: the one interface to all models of reflection, with the four
//! operations of a BRDF. Methods that trace rays ask these questions and none about the model, so
//! that a new model is one more implementation.
//!
//! Conventions:
//! - Directions are unit vectors that lead away from the surface: `viewer` to where light goes,
//!   `source` to where it comes from. Both are above the geometric normal of the side that is met.
//! - cosθ is that of the *shading* normal, and the lobe lies about it, too; the lobe is 0 where
//!   either direction is below that normal's horizon, and so is the light of a source that is. Where
//!   the two normals differ, light that is followed from its source has to be weighed by
//!   [`Side::power_factor`] (Veach 1997, §5.3).
//! - Light that is kept without its directions, on patches, in records and in maps, is multiplied by
//!   [`Reflection::diffuse`]/π.
//! - Random numbers are given, never drawn: callers spread them over pixels and rays.
//!
//! Hemicube shooting (`device`) has no part in it. It reflects patch by patch what a patch has
//! gathered, on the processor and in WGSL alike, by the same formulas of [`Reflectance`].
//!
//! [`Reflectance`]: crate::radiometry::Reflectance

use super::side::Side;
use crate::radiometry::{Rgb, SHARP_EXPONENT};
use crate::sampling::frame;
use glam::Vec3;
use std::f32::consts::TAU;

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
    /// f_r·cosθ over the density, dimensionless.
    pub factor: Parts,
    /// Density per solid angle, 1/sr: [`Reflection::pdf`] of the direction.
    pub pdf: f32,
}

/// The reflection of a side of a surface at a point.
///
/// Directions are picked from a mixture of two densities: by the cosine about the shading normal
/// for the diffuse part, and as the model likes for the lobe. Callers say with which probability
/// they take the first, `diffuse_share`, mostly [`Reflection::diffuse_share`].
pub trait Reflection {
    /// How the side lies.
    fn side(&self) -> Side;

    /// Albedo of the diffuse part towards `viewer`, under light from all around.
    fn diffuse(&self, viewer: Vec3) -> Rgb;

    /// The mean of [`Reflection::diffuse`] over the hemisphere, weighed by cosθ/π.
    fn mean_diffuse(&self) -> Rgb;

    /// Albedo of the lobe at normal incidence; 0 without a lobe.
    fn specular(&self) -> Rgb;

    /// How narrow the lobe is: the exponent n of a Phong lobe, cosⁿα about the mirror direction, that
    /// is about as wide. For what needs no more than the width.
    fn exponent(&self) -> f32;

    /// The same of the widest of several lobes, of which [`Reflection::exponent`] tells the narrowest.
    #[inline]
    fn widest_exponent(&self) -> f32 {
        self.exponent()
    }

    /// f_r, 1/sr, without any cosine.
    fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts;

    /// Density per solid angle, 1/sr, with which [`Reflection::sample`] picks `source`. Its integral
    /// over the hemisphere is 1 less the picks that lie below the horizon.
    fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32;

    /// [`Reflection::evaluate`] and [`Reflection::pdf`], for models where both take the same work.
    #[inline]
    fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        (self.evaluate(viewer, source), self.pdf(viewer, source, diffuse_share))
    }

    /// A direction by the lobe alone, for two uniform numbers; it may lie below the horizon.
    fn lobe_direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3;

    /// Picks a direction for light that leaves towards `viewer`, for two uniform numbers: by the
    /// cosine if `diffusely`, which must be so with probability `diffuse_share`, or else by the
    /// lobe. `None` where the pick lies below the horizon of either normal.
    #[inline]
    fn sample(
        &self,
        viewer: Vec3,
        diffuse_share: f32,
        diffusely: bool,
        xi: [f32; 2],
    ) -> Option<Scattered> {
        let side = self.side();
        let direction = if diffusely {
            direction_about(side.shading_normal, (1.0 - xi[0]).sqrt(), xi[1])
        } else {
            self.lobe_direction(viewer, xi)
        };
        let cosine = side.shading_normal.dot(direction);
        if cosine <= 0.0 || side.normal.dot(direction) <= 0.0 {
            return None;
        }
        let (value, pdf) = self.evaluate_with_pdf(viewer, direction, diffuse_share);
        let factor = || value.times(Rgb::splat(cosine / pdf));
        (pdf > 0.0).then(|| Scattered { direction, factor: factor(), pdf })
    }

    /// Directional albedo: the share of the light from all around, of the same radiance everywhere,
    /// that goes on towards `viewer`, ∫ f_r cosθ dω; since f_r is reciprocal, also the share of light
    /// from there that is reflected anywhere. Towards a viewer that the shading normal faces away
    /// from it is that of the diffuse part, and of a coat with a normal of its own.
    fn albedo(&self, viewer: Vec3) -> Rgb;

    /// Mean albedo: the share of the light from all around that is reflected anywhere, which is the
    /// mean of [`Reflection::albedo`] over the hemisphere, weighed by cosθ/π.
    fn mean_albedo(&self) -> Rgb;

    /// The share of rays that are to sample the diffuse part: its share of what is reflected
    /// towards `viewer`.
    fn diffuse_share(&self, viewer: Vec3) -> f32;

    /// Whether the lobe reflects anything at all.
    #[inline]
    fn is_glossy(&self) -> bool {
        self.specular().max_element() > 0.0
    }

    /// Whether the lobe, or each of several, counts as a mirror: light that it gathers makes
    /// caustics.
    #[inline]
    fn is_sharp(&self) -> bool {
        self.is_glossy() && self.widest_exponent() > SHARP_EXPONENT
    }

    /// Whether anything is reflected.
    #[inline]
    fn reflects(&self) -> bool {
        self.mean_diffuse() != Rgb::ZERO || self.is_glossy()
    }
}

/// The unit vector that has a `cosine` with the unit vector `axis`, at an azimuth for a uniform
/// number.
#[inline]
pub fn direction_about(axis: Vec3, cosine: f32, xi: f32) -> Vec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (tangent, bitangent) = frame(axis, 0.0);
    let (sin, cos) = (TAU * xi).sin_cos();
    axis * cosine + (tangent * cos + bitangent * sin) * sine
}
