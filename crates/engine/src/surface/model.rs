//! The models of reflection that there are, as one type: what a surface reflects
//! ([`Parameters`]), and how it does so where it lies ([`AnyReflection`]).

use super::ggx::{Ggx, Microfacets};
use super::layered::{Layered, LayeredReflection};
use super::phong::Phong;
use super::reflection::{Parts, Reflection};
use super::side::Side;
use super::slopes::{SlopeChanges, Slopes, slope_about};
use crate::radiometry::{Reflectance, Rgb};
use crate::scene::{Appearance, Material, Model};
use glam::Vec3;

/// What a place of a surface reflects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameters {
    /// Diffuse, with a modified Phong lobe or none.
    Phong(Reflectance),
    /// The specification's microfacets.
    Ggx(Microfacets),
    /// The same with layers on top.
    Layered(Layered),
}

impl Parameters {
    /// Nothing.
    pub const BLACK: Self = Self::Phong(Reflectance::lambertian(Rgb::ZERO));

    /// What a material reflects where it looks like this. One without a lobe is diffuse, in either
    /// model alike.
    pub fn new(material: &Material, at: &Appearance) -> Self {
        if material.unlit {
            return Self::BLACK;
        }
        let facets = Microfacets::new(material, at);
        match material.model {
            Model::Ggx if !at.layers.is_none() => Self::layered(facets, at),
            Model::Ggx if facets.is_glossy() => Self::Ggx(facets),
            _ => {
                let mut reflectance = material.reflectance(at);
                // What goes through is not reflected.
                reflectance.diffuse *= 1.0 - at.translucency;
                Self::Phong(reflectance)
            }
        }
    }

    /// What light that goes through diffusely is left of by the diffuse part alone, where the
    /// surface lets through that share of what its lobes leave; towards a viewer at an angle of that
    /// cosine, or on the mean over all.
    #[cold]
    #[inline(never)]
    pub(super) fn passing(&self, share: Rgb, cosine: Option<f32>) -> Self {
        let without_lobe = |facets: Microfacets, diffuse| Microfacets {
            diffuse,
            f0: Rgb::ZERO,
            f90: 0.0,
            ..facets
        };
        match self {
            Self::Phong(own) => Self::Phong(Reflectance::lambertian(share * (1.0 - own.specular))),
            Self::Ggx(facets) => Self::Ggx(without_lobe(*facets, share)),
            Self::Layered(layered) => {
                let (facets, left) = layered.below(cosine);
                Self::Ggx(without_lobe(facets, share * left))
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn layered(facets: Microfacets, at: &Appearance) -> Self {
        Self::Layered(Layered::new(facets, &at.layers))
    }

    /// Whether there is a lobe.
    pub fn is_glossy(&self) -> bool {
        match self {
            Self::Phong(reflectance) => reflectance.is_glossy(),
            Self::Ggx(facets) => facets.is_glossy(),
            Self::Layered(_) => true,
        }
    }

    /// What radiance of light without directions is multiplied by to be seen by a viewer in a unit
    /// direction, and what the lobe's is: diffuse albedo and factor; `normal` is the shading normal.
    /// Loss of the diffuse part towards grazing angles is in the factor ([`super::ggx::split`]).
    pub fn diffuse_and_lobe_factor(&self, normal: Vec3, viewer: Vec3) -> [Rgb; 2] {
        match self {
            Self::Phong(reflectance) => [reflectance.diffuse, Rgb::ONE],
            Self::Ggx(facets) => facets.diffuse_and_lobe_factor(normal.dot(viewer)),
            Self::Layered(layered) => layered.diffuse_and_lobe_factor(normal, viewer),
        }
    }

    /// Albedo of the lobes towards a viewer in a unit direction, where the geometric and the shading
    /// normal are those.
    pub fn lobe_albedo(&self, [normal, shading_normal]: [Vec3; 2], viewer: Vec3) -> Rgb {
        let side = Side { normal, shading_normal, back: false };
        AnyReflection::new(self.lobe_only(), side).albedo(viewer)
    }

    /// Mean albedo of diffuse part and lobe together, over the hemisphere.
    pub fn mean_albedo(&self) -> Rgb {
        match self {
            Self::Phong(reflectance) => reflectance.mean_albedo(),
            Self::Ggx(facets) => facets.mean_diffuse_albedo() + facets.mean_lobe_albedo(),
            Self::Layered(layered) => layered.mean_albedo(),
        }
    }

    /// Albedo of both for light that comes at an angle of that cosine; of a Phong lobe the mean.
    pub fn albedo(&self, cosine: f32) -> Rgb {
        match self {
            Self::Phong(reflectance) => reflectance.mean_albedo(),
            Self::Ggx(facets) => facets.diffuse_albedo(cosine) + facets.lobe_albedo(cosine),
            Self::Layered(layered) => layered.albedo(cosine),
        }
    }

    /// The same with lobes of microfacets that are wider by such a difference of slopes; `None` where all of them are
    /// that wide by themselves.
    pub fn blurred(self, slopes: f32) -> Option<Self> {
        match self {
            Self::Phong(_) => None,
            Self::Ggx(facets) => facets.blurred(slopes).map(Self::Ggx),
            Self::Layered(layered) => layered.blurred(slopes).map(Self::Layered),
        }
    }

    /// The same without the diffuse part.
    pub fn lobe_only(mut self) -> Self {
        match &mut self {
            Self::Phong(reflectance) => reflectance.diffuse = Rgb::ZERO,
            Self::Ggx(facets) => facets.diffuse = Rgb::ZERO,
            Self::Layered(layered) => *layered = layered.lobe_only(),
        }
        self
    }
}

/// The reflection of a side by either model.
#[derive(Clone, Copy, Debug)]
pub enum AnyReflection {
    /// Diffuse and modified Phong.
    Phong(Phong),
    /// The specification's.
    Ggx(Ggx),
    /// The same with layers on top.
    Layered(LayeredReflection),
}

impl AnyReflection {
    /// Of a side that lies like this.
    #[inline]
    pub fn new(parameters: Parameters, side: Side) -> Self {
        match parameters {
            Parameters::Phong(reflectance) => Self::Phong(Phong::new(reflectance, side)),
            Parameters::Ggx(facets) => Self::Ggx(Ggx::new(facets, side)),
            Parameters::Layered(layered) => Self::Layered(LayeredReflection::new(layered, side)),
        }
    }
}

impl AnyReflection {
    /// Whether all its lobes are of microfacets.
    pub fn has_slopes(&self) -> bool {
        !matches!(self, Self::Phong(_))
    }

    /// Unit normals of the lobes of base and coat.
    pub fn normals(&self) -> [Vec3; 2] {
        let normal = self.side().shading_normal;
        match self {
            Self::Layered(layered) => [normal, layered.coat_normal()],
            _ => [normal; 2],
        }
    }

    /// Slopes of the half vector of two unit vectors.
    pub fn slopes(&self, viewer: Vec3, source: Vec3) -> Slopes {
        self.normals().map(|normal| slope_about(normal, viewer, source))
    }

    /// Least width of the distribution of microfacets of each lobe; infinite where there is none.
    pub fn widths(&self) -> [f32; 2] {
        match self {
            Self::Phong(_) => [f32::INFINITY; 2],
            Self::Ggx(ggx) => [ggx.width(), f32::INFINITY],
            Self::Layered(layered) => layered.widths(),
        }
    }

    /// f_r on the mean over a part of the surface, as far as the microfacets' distribution goes; a lobe of Phong's is
    /// what it is in the middle.
    pub fn evaluate_over(&self, viewer: Vec3, source: Vec3, changes: &SlopeChanges) -> Parts {
        match self {
            Self::Phong(phong) => phong.evaluate(viewer, source),
            Self::Ggx(ggx) => {
                let mut value = ggx.evaluate(viewer, source);
                value.lobe *= ggx.gain_over(viewer, source, changes[0]);
                value
            }
            Self::Layered(layered) => layered.evaluate_over(viewer, source, changes),
        }
    }
}

/// Asks whichever model it is.
macro_rules! ask {
    ($self:ident, $model:ident => $answer:expr) => {
        match $self {
            AnyReflection::Phong($model) => $answer,
            AnyReflection::Ggx($model) => $answer,
            AnyReflection::Layered($model) => $answer,
        }
    };
}

impl Reflection for AnyReflection {
    #[inline]
    fn side(&self) -> Side {
        ask!(self, model => model.side())
    }

    #[inline]
    fn diffuse(&self, viewer: Vec3) -> Rgb {
        ask!(self, model => model.diffuse(viewer))
    }

    #[inline]
    fn mean_diffuse(&self) -> Rgb {
        ask!(self, model => model.mean_diffuse())
    }

    #[inline]
    fn specular(&self) -> Rgb {
        ask!(self, model => model.specular())
    }

    #[inline]
    fn exponent(&self) -> f32 {
        ask!(self, model => model.exponent())
    }

    #[inline]
    fn widest_exponent(&self) -> f32 {
        ask!(self, model => model.widest_exponent())
    }

    #[inline]
    fn is_glossy(&self) -> bool {
        ask!(self, model => model.is_glossy())
    }

    #[inline]
    fn evaluate(&self, viewer: Vec3, source: Vec3) -> Parts {
        ask!(self, model => model.evaluate(viewer, source))
    }

    #[inline]
    fn pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> f32 {
        ask!(self, model => model.pdf(viewer, source, diffuse_share))
    }

    #[inline]
    fn evaluate_with_pdf(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        ask!(self, model => model.evaluate_with_pdf(viewer, source, diffuse_share))
    }

    #[inline]
    fn lobe_direction(&self, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
        ask!(self, model => model.lobe_direction(viewer, xi))
    }

    #[inline]
    fn albedo(&self, viewer: Vec3) -> Rgb {
        ask!(self, model => model.albedo(viewer))
    }

    #[inline]
    fn mean_albedo(&self) -> Rgb {
        ask!(self, model => model.mean_albedo())
    }

    #[inline]
    fn diffuse_share(&self, viewer: Vec3) -> f32 {
        ask!(self, model => model.diffuse_share(viewer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean albedo is that of light from all around; less is reflected of light that comes straight.
    #[test]
    fn albedos_for_directions_have_the_mean_albedo_as_their_mean() {
        for (roughness, metallic) in [(0.2, 0.0), (0.5, 0.0), (0.4, 1.0)] {
            let material = Material { roughness, metallic, ..Material::default() };
            let at = material.appearance(Rgb::new(0.8, 0.5, 0.2));
            let parameters = Parameters::new(&material, &at);
            const STEPS: u32 = 200;
            let step = |k: u32| {
                let cosine = (k as f32 + 0.5) / STEPS as f32;
                parameters.albedo(cosine) * (2.0 * cosine / STEPS as f32)
            };
            let mean: Rgb = (0..STEPS).map(step).sum();
            let off = (mean / parameters.mean_albedo() - Rgb::ONE).abs().max_element();
            assert!(off < 0.01, "{roughness} {metallic}: {mean} {}", parameters.mean_albedo());
            let straight = parameters.albedo(1.0);
            let less = straight.cmplt(parameters.mean_albedo()).all();
            assert!(less || roughness > 0.3, "{straight} {}", parameters.mean_albedo());
        }
    }
}
