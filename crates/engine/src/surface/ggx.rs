//! The reflection that glTF 2.0 prescribes (specification, appendix B): Lambert's diffuse part under
//! a lobe of microfacets with Trowbridge's and Reitz' distribution ("GGX", Walter et al. 2007),
//! Smith's height-correlated masking (Heitz 2014) and Schlick's Fresnel term. Light is scattered
//! once: rough metals are darker than real ones, as the specification has it.
//!
//! With F(h) = F0 + (F90 − F0)(1 − v·h)⁵, dielectrics reflect ρ/π·(1 − max F) + F·D·V, metals
//! F·D·V, and what is between is mixed by `metallic`. As D·V is common to both, a side has one lobe
//! whose F0 and F90 are mixed.

use super::distribution::{density_of_visible, distribution_and_visibility, visible_normal};
use super::ggx_albedo::{LobeShares, diffuse_loss, mean_diffuse_loss};
use super::reflection::{Parts, Reflection, direction_about};
use super::side::Side;
use super::slopes::gain_over;
use crate::radiometry::{Rgb, importance};
use crate::sampling::frame;
use crate::scene::{Appearance, Material};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Smallest α: below it single precision can't tell the lobe from a mirror's.
const LEAST_ALPHA: f32 = 1e-3;

/// What irradiance over π and what the lobe's radiance are multiplied by, so that the diffuse part's loss
/// towards grazing angles goes with the light that it loses: by its albedos without the loss and with it,
/// and that of the lobe.
///
/// The diffuse part loses ρ(F90 − F0) ∫ L (1 − v·h)⁵ cosθ/π dω. The light for which (1 − v·h)⁵
/// is not small comes from low directions opposite to the viewer, as most that the lobe shows
/// does; so L is taken to be the lobe's radiance over its albedo. What is more than the lobe shows is
/// taken from light from all around, so that nothing is less than black. Under light from all around
/// this is exact.
pub fn split([plain, diffuse]: [Rgb; 2], lobe: Rgb) -> [Rgb; 2] {
    let loss = plain - diffuse;
    let covered = loss.min(lobe);
    let factor = Rgb::ONE - covered / lobe.max(Rgb::splat(f32::MIN_POSITIVE));
    [diffuse + covered, factor]
}

/// What a side reflects by the specification's model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Microfacets {
    /// Albedo of the diffuse part before the lobe takes its share: base colour × (1 − metallic).
    pub diffuse: Rgb,
    /// Lobe's reflectance at normal incidence.
    pub f0: Rgb,
    /// Lobe's reflectance at grazing incidence.
    pub f90: f32,
    /// The dielectric part's largest F0 of all channels, and its F90: what they reflect, the diffuse
    /// part can't.
    pub dielectric: [f32; 2],
    /// Width of the distribution of microfacets, roughness².
    pub alpha: f32,
}

impl Microfacets {
    /// Of a material where it looks like this.
    pub fn new(material: &Material, at: &Appearance) -> Self {
        let base = at.base_color.clamp(Rgb::ZERO, Rgb::ONE);
        let metallic = at.metallic.clamp(0.0, 1.0);
        let f90 = at.specular_factor.clamp(0.0, 1.0);
        let normal = ((material.ior - 1.0) / (material.ior + 1.0)).powi(2);
        let f0 = (normal * at.specular_color).clamp(Rgb::ZERO, Rgb::ONE) * f90;
        Self {
            // What goes through is not reflected.
            diffuse: base * ((1.0 - metallic) * (1.0 - at.translucency)),
            f0: f0.lerp(base, metallic),
            f90: f90 + (1.0 - f90) * metallic,
            dielectric: [f0.max_element(), f90],
            alpha: at.roughness.clamp(0.0, 1.0).powi(2).max(LEAST_ALPHA),
        }
    }

    /// Of the boundary of something clear and colourless, of which nothing below is to be seen.
    pub fn coat(f0: f32, alpha: f32) -> Self {
        Self {
            diffuse: Rgb::ZERO,
            f0: Rgb::splat(f0),
            f90: 1.0,
            dielectric: [f0, 1.0],
            alpha: alpha.max(LEAST_ALPHA),
        }
    }

    /// The same with a distribution that is wider by such a difference of slopes; `None` where it is that wide by
    /// itself.
    pub fn blurred(self, slopes: f32) -> Option<Self> {
        let alpha = self.alpha.hypot(slopes);
        (self.is_glossy() && self.alpha < slopes).then_some(Self { alpha, ..self })
    }

    /// Whether its lobe reflects anything at all.
    #[inline]
    pub fn is_glossy(&self) -> bool {
        self.f90 > 0.0 || self.f0 != Rgb::ZERO
    }

    /// Albedo of the diffuse part towards a viewer at an angle of that cosine: what the lobe leaves
    /// of it, ∫ (1 − max F) cosθ/π dω.
    #[inline]
    pub fn diffuse_albedo(&self, cosine: f32) -> Rgb {
        self.faded(diffuse_loss(cosine))
    }

    /// Albedo of the diffuse part before Fresnel's loss towards grazing angles.
    pub fn plain_diffuse_albedo(&self) -> Rgb {
        self.faded(0.0)
    }

    /// Diffuse albedo and factor of the lobe, towards a viewer at an angle of that cosine, for light
    /// without directions: see [`split`].
    pub fn diffuse_and_lobe_factor(&self, cosine: f32) -> [Rgb; 2] {
        let lobe = if cosine > 0.0 { self.lobe_albedo(cosine) } else { Rgb::ZERO };
        split([self.plain_diffuse_albedo(), self.diffuse_albedo(cosine)], lobe)
    }

    /// The mean of [`Microfacets::diffuse_albedo`] over the hemisphere.
    pub fn mean_diffuse_albedo(&self) -> Rgb {
        self.faded(mean_diffuse_loss())
    }

    /// The diffuse albedo where (1 − v·h)⁵ is `grazing` on average.
    fn faded(&self, grazing: f32) -> Rgb {
        let [f0, f90] = self.dielectric;
        self.diffuse * (1.0 - f0 - (f90 - f0) * grazing)
    }

    /// Albedo of the lobe towards a viewer at an angle of that cosine.
    pub fn lobe_albedo(&self, cosine: f32) -> Rgb {
        self.lobe_of(LobeShares::at(self.alpha, cosine))
    }

    /// The mean of [`Microfacets::lobe_albedo`] over the hemisphere.
    pub fn mean_lobe_albedo(&self) -> Rgb {
        self.lobe_of(LobeShares::mean(self.alpha))
    }

    fn lobe_of(&self, shares: LobeShares) -> Rgb {
        self.f0 * shares.normal + Rgb::splat(self.f90 * shares.grazing)
    }

    /// Exponent of a Phong lobe that is about as wide.
    #[inline]
    pub fn exponent(&self) -> f32 {
        (0.5 * (1.0 / (self.alpha * self.alpha) - 1.0)).clamp(0.0, 1e5)
    }
}

/// The reflection of a side by the specification's model.
#[derive(Clone, Copy, Debug)]
pub struct Ggx {
    facets: Microfacets,
    side: Side,
}

impl Ggx {
    /// Of a side that lies like this.
    #[inline]
    pub fn new(facets: Microfacets, side: Side) -> Self {
        Self { facets, side }
    }

    fn cosine(&self, direction: Vec3) -> f32 {
        self.side.shading_normal.dot(direction)
    }

    /// Width of its distribution of microfacets.
    pub fn width(&self) -> f32 {
        self.facets.alpha
    }

    /// By how much more its lobe reflects on the mean over a part of the surface than at its middle.
    pub fn gain_over(&self, viewer: Vec3, source: Vec3, sides: [Vec3; 2]) -> f32 {
        let normal = self.side.shading_normal;
        let (tangent, bitangent) = frame(normal, 0.0);
        let axes = [tangent, bitangent, normal];
        gain_over(([self.facets.alpha; 2], axes), (viewer, source), sides)
    }
}

impl Reflection for Ggx {
    #[inline]
    fn side(&self) -> Side {
        self.side
    }

    #[inline]
    fn diffuse(&self, viewer: Vec3) -> Rgb {
        self.facets.diffuse_albedo(self.cosine(viewer))
    }

    fn mean_diffuse(&self) -> Rgb {
        self.facets.mean_diffuse_albedo()
    }

    #[inline]
    fn specular(&self) -> Rgb {
        self.facets.lobe_albedo(1.0)
    }

    #[inline]
    fn exponent(&self) -> f32 {
        self.facets.exponent()
    }

    #[inline]
    fn is_glossy(&self) -> bool {
        self.facets.is_glossy()
    }

    #[inline]
    fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts {
        self.evaluate_with_pdf(viewer, source, 1.0).0
    }

    #[inline]
    fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32 {
        self.evaluate_with_pdf(viewer, source, diffuse_share).1
    }

    fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        let Microfacets { diffuse, f0, f90, dielectric, alpha } = self.facets;
        let (to_viewer, to_source) = (self.cosine(viewer), self.cosine(source));
        let half = (viewer + source).normalize_or(self.side.shading_normal);
        let grazing = (1.0 - viewer.dot(half).clamp(0.0, 1.0)).powi(5);
        let loss = dielectric[0] + (dielectric[1] - dielectric[0]) * grazing;
        let mut value = Parts { diffuse: diffuse * ((1.0 - loss) * FRAC_1_PI), lobe: Rgb::ZERO };
        let mut pdf = diffuse_share * to_source.max(0.0) * FRAC_1_PI;
        if to_viewer > 0.0 && to_source > 0.0 && self.facets.is_glossy() {
            let sine_square = self.side.shading_normal.cross(half).length_squared().min(1.0);
            let [distribution, visibility] =
                distribution_and_visibility(alpha, [to_viewer, to_source], sine_square);
            let fresnel = f0 + (Rgb::splat(f90) - f0) * grazing;
            value.lobe = fresnel * (distribution * visibility);
            pdf += (1.0 - diffuse_share) * density_of_visible(alpha, to_viewer, distribution);
        }
        (value, pdf)
    }

    /// By the microfacets that the viewer sees.
    fn lobe_direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
        let normal = self.side.shading_normal;
        let (tangent, bitangent) = frame(normal, 0.0);
        let local = Vec3::new(tangent.dot(viewer), bitangent.dot(viewer), normal.dot(viewer));
        if local.z <= 0.0 {
            return direction_about(normal, (1.0 - xi[0]).sqrt(), xi[1]);
        }
        let half = visible_normal(self.facets.alpha, local, xi);
        let to = 2.0 * local.dot(half) * half - local;
        (tangent * to.x + bitangent * to.y + normal * to.z).normalize_or(normal)
    }

    fn albedo(&self, viewer: Vec3) -> Rgb {
        let cosine = self.cosine(viewer);
        let diffuse = self.facets.diffuse_albedo(cosine);
        if cosine > 0.0 { diffuse + self.facets.lobe_albedo(cosine) } else { diffuse }
    }

    fn mean_albedo(&self) -> Rgb {
        self.facets.mean_diffuse_albedo() + self.facets.mean_lobe_albedo()
    }

    fn diffuse_share(&self, viewer: Vec3) -> f32 {
        let cosine = self.cosine(viewer);
        if !self.facets.is_glossy() || cosine <= 0.0 {
            return 1.0;
        }
        let diffuse = importance(self.facets.diffuse_albedo(cosine));
        let both = diffuse + importance(self.facets.lobe_albedo(cosine)).max(1e-6);
        if diffuse > 0.0 { diffuse / both } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::laws::broken;

    /// A metal of that roughness that reflects everything at every angle, before masking.
    fn white_metal(roughness: f32) -> Microfacets {
        let material = Material { metallic: 1.0, roughness, ..Material::default() };
        Microfacets::new(&material, &material.appearance(Rgb::ONE))
    }

    fn side(shading_normal: Vec3) -> Side {
        Side { normal: Vec3::Z, shading_normal, back: false }
    }

    #[test]
    fn the_laws_of_reflection_are_kept() {
        let mut materials = Vec::new();
        for roughness in [0.15, 0.4, 1.0] {
            for (metallic, ior) in [(0.0, 1.5), (0.5, 1.8), (1.0, 1.5)] {
                materials.push(Material { metallic, roughness, ior, ..Material::default() });
            }
        }
        for shading_normal in [Vec3::Z, Vec3::new(0.1, 0.2, 1.0).normalize()] {
            for material in &materials {
                let at = material.appearance(Rgb::new(0.8, 0.5, 0.2));
                let ggx = Ggx::new(Microfacets::new(material, &at), side(shading_normal));
                let found = broken(&ggx);
                assert!(found.is_empty(), "{ggx:?}: {found:?}");
            }
        }
    }

    /// The specification's own formulas at one place, in double precision.
    #[test]
    fn values_are_those_of_the_specification() {
        let material = Material { metallic: 0.3, roughness: 0.5, ..Material::default() };
        let base = Rgb::new(0.8, 0.5, 0.2);
        let ggx = Ggx::new(Microfacets::new(&material, &material.appearance(base)), side(Vec3::Z));
        let (viewer, source) =
            (Vec3::new(0.3, 0.1, 0.8).normalize(), Vec3::new(-0.5, 0.4, 0.6).normalize());
        let [v, l] = [viewer, source].map(|direction| direction.as_dvec3());
        let h = (v + l).normalize();
        let alpha_square = 0.0625f64;
        let d = alpha_square
            / (std::f64::consts::PI * (h.z * h.z * (alpha_square - 1.0) + 1.0).powi(2));
        let lambda = |z: f64| (alpha_square + (1.0 - alpha_square) * z * z).sqrt();
        let visible = 0.5 / (l.z * lambda(v.z) + v.z * lambda(l.z));
        let schlick = |f0: f64| f0 + (1.0 - f0) * (1.0 - v.dot(h)).powi(5);
        for (channel, base) in base.to_array().into_iter().map(f64::from).enumerate() {
            let dielectric =
                base / std::f64::consts::PI * (1.0 - schlick(0.04)) + schlick(0.04) * d * visible;
            let expected = 0.7 * dielectric + 0.3 * schlick(base) * d * visible;
            let found = f64::from(ggx.evaluate(viewer, source).both()[channel]);
            assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
        }
    }

    #[test]
    fn smooth_metal_loses_nothing_and_rough_metal_what_is_masked() {
        assert!((white_metal(0.1).lobe_albedo(0.8).x - 1.0).abs() < 0.005);
        // With α = 1 at normal incidence D = 1/π and V = ½/(1 + cosθ): what is left is 1 − ln 2.
        let rough = white_metal(1.0).lobe_albedo(1.0).x;
        assert!((rough - 0.306_85).abs() < 0.002, "{rough}");
    }

    #[test]
    fn polished_metal_reflects_into_the_mirror_direction() {
        let ggx = Ggx::new(white_metal(0.0), side(Vec3::Z));
        let viewer = Vec3::new(0.6, 0.0, 0.8);
        let picked = ggx.sample(viewer, 0.0, false, [0.4, 0.7]).expect("it is above the horizon");
        assert!(picked.direction.distance(Vec3::new(-0.6, 0.0, 0.8)) < 0.01);
        assert!((picked.factor.lobe.x - 1.0).abs() < 0.01, "{}", picked.factor.lobe);
    }
}
