//! Materials: what a surface is made of, by its factors, and what textures make of it at a point.

use super::layers::{Layering, Layers};
use super::texture::{NormalMap, TextureSlot};
use super::translucency::Translucency;
use crate::radiometry::{Reflectance, Rgb};
use glam::Vec2;

/// The law by which what is not diffuse is reflected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Model {
    /// Microfacets with the GGX distribution, as glTF has it.
    #[default]
    Ggx,
    /// A Phong lobe around the mirror direction: the model of the papers that the project's own
    /// scenes are compared with. A file asks for it by `extras.phong: true`.
    Phong,
}

/// What a material's alpha means.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Alpha {
    /// Nothing.
    #[default]
    Opaque,
    /// The surface is there where alpha is at least `cutoff`, and nowhere else.
    Mask {
        /// Least alpha that is there, ≥ 0.
        cutoff: f32,
    },
    /// The share of light that meets the surface; the rest passes straight through.
    Blend,
}

/// What a material is at one point: factors with textures and vertex colours applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Linear base colour.
    pub base_color: Rgb,
    /// Share of metal, in [0, 1].
    pub metallic: f32,
    /// Roughness, in [0, 1]; α = roughness².
    pub roughness: f32,
    /// Strength of the dielectric's reflection, in [0, 1].
    pub specular_factor: f32,
    /// Colour of the dielectric's reflection at normal incidence, ≥ 0.
    pub specular_color: Rgb,
    /// Share of a dielectric that is clear, in [0, 1].
    pub transmission: f32,
    /// Share of what is not reflected by a lobe that goes to the other side, in [0, 1].
    pub translucency: f32,
    /// What lies on top.
    pub layers: Layers,
}

/// A glTF metallic-roughness material with the extensions that change reflection.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in the file, or a made-up one.
    pub name: String,
    /// The law of reflection.
    pub model: Model,
    /// Base colour factor, linear.
    pub base_color: Rgb,
    /// Base colour texture; multiplies the factor, and its alpha [`Material::opacity`].
    pub base_color_texture: Option<TextureSlot>,
    /// Metallic factor.
    pub metallic: f32,
    /// Roughness factor; α = roughness².
    pub roughness: f32,
    /// Green multiplies the roughness, blue the share of metal; linear.
    pub metallic_roughness_texture: Option<TextureSlot>,
    /// Mean over that texture of (metallic, roughness); one without a texture. For judging a
    /// material as a whole, see [`Material::typical`].
    pub metallic_roughness_mean: Vec2,
    /// A texture that tilts the shading normal.
    pub normal_map: Option<NormalMap>,
    /// KHR_materials_ior; 1.5 by default.
    pub ior: f32,
    /// KHR_materials_specular: strength; 1 by default, 0 makes a dielectric Lambertian.
    pub specular_factor: f32,
    /// Its alpha multiplies the strength.
    pub specular_texture: Option<TextureSlot>,
    /// KHR_materials_specular: colour; white by default.
    pub specular_color: Rgb,
    /// Multiplies the specular colour; sRGB.
    pub specular_color_texture: Option<TextureSlot>,
    /// Emitted radiance: factor × KHR_materials_emissive_strength, in the file's unit.
    pub emission: Rgb,
    /// Emission texture; multiplies [`Material::emission`].
    pub emission_texture: Option<TextureSlot>,
    /// Whether the back reflects and emits too. The back of a one-sided material is black and
    /// opaque to light, and invisible to cameras.
    pub double_sided: bool,
    /// KHR_materials_transmission: the share of a dielectric that is clear instead of as
    /// [`Material::reflectance`] says; 0 by default. Rays know it, patches don't.
    pub transmission: f32,
    /// Red multiplies the transmission; linear.
    pub transmission_texture: Option<TextureSlot>,
    /// KHR_materials_volume: what a body bounded by the surface is filled with; without it, the
    /// surface is a sheet that light passes straight through.
    pub volume: Option<Volume>,
    /// KHR_materials_dispersion: 20 over the Abbe number of what the body is filled with; 0 where all
    /// colours are bent alike.
    pub dispersion: f32,
    /// What alpha means. The import says [`Alpha::Opaque`] too where alpha could leave no hole.
    pub alpha: Alpha,
    /// Factor of alpha, in [0, 1].
    pub opacity: f32,
    /// What lies on top of it, and how it is brushed; `None` where there is none of it.
    pub layering: Option<Box<Layering>>,
    /// KHR_materials_diffuse_transmission: what goes through it and is scattered; `None` where there is
    /// none of it. Rays know it, hemicubes don't.
    pub translucency: Option<Box<Translucency>>,
    /// KHR_materials_unlit: shown in its base colour whatever the light; neither reflects nor
    /// emits.
    pub unlit: bool,
}

/// The inside of a clear body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// What is left of white light after [`Volume::attenuation_distance`], in [0, 1].
    pub attenuation_color: Rgb,
    /// Metres, > 0; infinite without absorption.
    pub attenuation_distance: f32,
}

impl Default for Volume {
    fn default() -> Self {
        Self { attenuation_color: Rgb::ONE, attenuation_distance: f32::INFINITY }
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            model: Model::Ggx,
            base_color: Rgb::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            metallic_roughness_mean: Vec2::ONE,
            normal_map: None,
            ior: 1.5,
            specular_factor: 1.0,
            specular_texture: None,
            specular_color: Rgb::ONE,
            specular_color_texture: None,
            emission: Rgb::ZERO,
            emission_texture: None,
            double_sided: false,
            transmission: 0.0,
            transmission_texture: None,
            volume: None,
            dispersion: 0.0,
            alpha: Alpha::Opaque,
            opacity: 1.0,
            layering: None,
            translucency: None,
            unlit: false,
        }
    }
}

impl Material {
    /// A Lambertian, one-sided material (`specularFactor` 0).
    pub fn lambertian(name: &str, albedo: Rgb) -> Self {
        Self { name: name.into(), base_color: albedo, specular_factor: 0.0, ..Self::default() }
    }

    /// A dielectric whose [`Material::reflectance`] is the given diffuse albedo plus a grey Phong
    /// lobe of albedo `specular` and exponent `exponent`.
    ///
    /// The lobe is authored by index of refraction and roughness alone, as a glTF file can:
    /// α = (2n + 1)^(−½), roughness = √α; F0 = (21 ks − 1)/20, ior = (1 + √F0)/(1 − √F0).
    /// `specular` is clamped to what that can say, [1/21, 0.99]; `exponent` to [0, 10⁵];
    /// `diffuse` to 1 − ks.
    pub fn phong(name: &str, diffuse: Rgb, specular: f32, exponent: f32) -> Self {
        let specular = specular.clamp(1.0 / 21.0, 0.99);
        let alpha = (2.0 * exponent.clamp(0.0, 1e5) + 1.0).sqrt().recip();
        let amplitude = ((21.0 * specular - 1.0) / 20.0).max(0.0).sqrt();
        Self {
            name: name.into(),
            model: Model::Phong,
            base_color: (diffuse / (1.0 - specular)).clamp(Rgb::ZERO, Rgb::ONE),
            roughness: alpha.sqrt(),
            ior: (1.0 + amplitude) / (1.0 - amplitude),
            ..Self::default()
        }
    }

    /// A clear body of glass, its surface polished, without absorption.
    pub fn glass(name: &str, ior: f32) -> Self {
        Self {
            name: name.into(),
            roughness: 0.0,
            ior,
            transmission: 1.0,
            volume: Some(Volume::default()),
            ..Self::default()
        }
    }

    /// A mirror of polished metal: all that it reflects is in a Phong lobe of the given exponent.
    pub fn metal(name: &str, color: Rgb, exponent: f32) -> Self {
        let alpha = (2.0 * exponent.clamp(0.0, 1e5) + 1.0).sqrt().recip();
        Self {
            name: name.into(),
            model: Model::Phong,
            base_color: color,
            metallic: 1.0,
            roughness: alpha.sqrt(),
            ..Self::default()
        }
    }

    /// The largest share of light that meets the material anywhere as a clear surface: transmission
    /// of what is not metal, by the factors. A texture that says where it is metal can leave any
    /// point without.
    pub fn clear_share(&self) -> f32 {
        let textured = self.metallic_roughness_texture.is_some();
        let metallic = if textured { 0.0 } else { self.metallic.clamp(0.0, 1.0) };
        self.transmission.clamp(0.0, 1.0) * (1.0 - metallic)
    }

    /// Whether light that it reflects or lets through makes caustics, which patches can't show: it
    /// is clear, or its lobe is sharp.
    pub fn casts_caustics(&self) -> bool {
        self.clear_share() > 0.0 || self.reflectance(&self.typical(self.base_color)).is_sharp()
    }

    /// Whether backs are there for light and cameras: they reflect, or let light out.
    pub fn is_there_from_behind(&self) -> bool {
        self.double_sided || self.clear_share() > 0.0
    }

    /// Whether light may go through it diffusely.
    pub fn is_translucent(&self) -> bool {
        !self.unlit && self.translucency.is_some()
    }

    /// Whether any point of the material can emit.
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }

    /// Whether any texture changes the [`Appearance`].
    pub fn has_textured_reflection(&self) -> bool {
        self.base_color_texture.is_some() || self.has_textured_shape()
    }

    /// Whether nothing but the base colour varies over a surface of it.
    pub fn varies_in_colour_alone(&self) -> bool {
        self.emission_texture.is_none() && !self.has_textured_shape()
    }

    /// Whether anything of how it reflects has a texture, but for the base colour.
    fn has_textured_shape(&self) -> bool {
        self.metallic_roughness_texture.is_some()
            || self.specular_texture.is_some()
            || self.specular_color_texture.is_some()
            || self.transmission_texture.is_some()
            || self.layering.as_ref().is_some_and(|layering| layering.slots().next().is_some())
            || self.translucency.as_ref().is_some_and(|own| own.slots().next().is_some())
    }

    /// What the factors say of what lies on top.
    fn layers(&self) -> Layers {
        self.layering.as_ref().map_or(Layers::NONE, |layering| layering.factors)
    }

    /// The coat's normal map.
    fn coat_normal_map(&self) -> Option<NormalMap> {
        self.layering.as_ref().and_then(|layering| layering.coat_normal_map)
    }

    /// Whether a texture tilts the shading normal or the coat's.
    pub fn has_normal_map(&self) -> bool {
        self.normal_map.is_some() || self.coat_normal_map().is_some()
    }

    /// Whether a texture says how it is brushed.
    pub fn is_brushed_by_texture(&self) -> bool {
        self.layering.as_ref().is_some_and(|layering| layering.anisotropy_texture.is_some())
    }

    /// The texture along whose coordinates tangents are needed, if they are: that of the normal map,
    /// or else that of the coat's, or else that of the brushing.
    pub fn tangent_slot(&self) -> Option<TextureSlot> {
        let maps = self.normal_map.or(self.coat_normal_map()).map(|map| map.slot);
        let layering = self.layering.as_ref();
        maps.or_else(|| layering.and_then(|layering| layering.brushing_slot()))
    }

    /// Whether light may pass the surface because it is not everywhere, or not wholly, there.
    pub fn has_holes(&self) -> bool {
        self.alpha != Alpha::Opaque
    }

    /// What the factors alone say of a point of the given (textured) base colour.
    pub fn appearance(&self, base_color: Rgb) -> Appearance {
        Appearance {
            base_color,
            metallic: self.metallic,
            roughness: self.roughness,
            specular_factor: self.specular_factor,
            specular_color: self.specular_color,
            transmission: self.transmission,
            translucency: self.translucency.as_ref().map_or(0.0, |own| own.share),
            layers: self.layers(),
        }
    }

    /// The same with the mean of what textures say of metal and roughness: what the material is on
    /// the whole.
    pub fn typical(&self, base_color: Rgb) -> Appearance {
        let mean = self.metallic_roughness_mean;
        let (metallic, roughness) = (self.metallic * mean.x, self.roughness * mean.y);
        Appearance { metallic, roughness, ..self.appearance(base_color) }
    }

    /// Diffuse + modified-Phong reflectance of a point.
    ///
    /// α = roughness², n = (1/α² − 1)/2 clamped to [0, 10⁵];
    /// F0 = lerp(((ior−1)/(ior+1))²·specularColor·specularFactor, baseColor, metallic),
    /// F90 = lerp(specularFactor, 1, metallic), ks = F0 + (F90 − F0)/21 (the cosine-weighted
    /// mean of Schlick's term), kd = baseColor·(1 − metallic)·(1 − ks).
    ///
    /// For [`Model::Phong`] this is the law itself. For [`Model::Ggx`] it is a cosine lobe fitted to
    /// the microfacets, of their mean albedo and about their width, for hemicube shots and patches,
    /// which know no other law; layers on top are in the same lobe. What is unlit reflects nothing.
    pub fn reflectance(&self, at: &Appearance) -> Reflectance {
        if self.unlit {
            return Reflectance::lambertian(Rgb::ZERO);
        }
        let base_color = at.base_color.clamp(Rgb::ZERO, Rgb::ONE);
        let metallic = at.metallic.clamp(0.0, 1.0);
        let alpha = at.roughness.clamp(0.0, 1.0).powi(2).max(1e-3);
        let exponent = (0.5 * (1.0 / (alpha * alpha) - 1.0)).clamp(0.0, 1e5);
        let normal_incidence = ((self.ior - 1.0) / (self.ior + 1.0)).powi(2);
        let dielectric =
            (normal_incidence * at.specular_color * at.specular_factor).clamp(Rgb::ZERO, Rgb::ONE);
        let f0 = dielectric.lerp(base_color, metallic);
        let f90 = Rgb::splat(at.specular_factor.clamp(0.0, 1.0)).lerp(Rgb::ONE, metallic);
        let specular = (f0 + (f90 - f0) / 21.0).clamp(Rgb::ZERO, Rgb::ONE);
        let diffuse = base_color * (1.0 - metallic) * (Rgb::ONE - specular);
        at.layers.over(Reflectance { diffuse, specular, exponent })
    }
}
