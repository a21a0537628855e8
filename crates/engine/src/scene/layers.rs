//! What a material has on its surface beside metallic-roughness: layers that glTF's extensions put on
//! top of it (KHR_materials_clearcoat, KHR_materials_sheen,
//! KHR_materials_iridescence), and how it is brushed (KHR_materials_anisotropy), by their factors, and what textures make of them at a point.

use super::texture::{NormalMap, TextureSlot};
use crate::radiometry::{Reflectance, Rgb};
use glam::{Vec2, Vec4};

/// Reflectance of a clear coat at normal incidence: its index of refraction is 1.5.
pub const COAT_F0: f32 = 0.04;

/// Mean reflectance of a polished coat over the hemisphere: F0 + (1 − F0)/21, by Schlick's formula.
pub const COAT_MEAN: f32 = COAT_F0 + (1.0 - COAT_F0) / 21.0;

/// Less roughness of sheen is taken for this: fibres that stand up straight would send more light
/// than they get.
pub const LEAST_SHEEN_ROUGHNESS: f32 = 0.2;

/// What lies on the surface at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layers {
    /// Strength of the clear coat, in [0, 1].
    pub coat: f32,
    /// Its roughness, in [0, 1]; α = roughness².
    pub coat_roughness: f32,
    /// Colour of the sheen, in [0, 1].
    pub sheen_color: Rgb,
    /// Its roughness, in [0, 1]; α = roughness².
    pub sheen_roughness: f32,
    /// Direction in which the surface is brushed, which makes it rougher, in coordinates of tangent
    /// and bitangent; its length is the strength, in [0, 1].
    pub anisotropy: Vec2,
    /// Strength of the thin film, in [0, 1].
    pub film: f32,
    /// Its index of refraction, ≥ 1.
    pub film_ior: f32,
    /// Its thickness, nanometres.
    pub film_thickness: f32,
}

/// What lies on the surface of a material, by its factors and textures.
#[derive(Clone, Copy, Debug)]
pub struct Layering {
    /// The factors.
    pub factors: Layers,
    /// Red multiplies the strength of the coat; linear.
    pub coat_texture: Option<TextureSlot>,
    /// Green multiplies the roughness of the coat; linear.
    pub coat_roughness_texture: Option<TextureSlot>,
    /// Tilts the coat's normal; without it, the coat is smooth whatever tilts the surface below.
    pub coat_normal_map: Option<NormalMap>,
    /// Multiplies the colour of the sheen; sRGB.
    pub sheen_color_texture: Option<TextureSlot>,
    /// Its alpha multiplies the roughness of the sheen.
    pub sheen_roughness_texture: Option<TextureSlot>,
    /// Red and green are the direction of brushing, from −1 to 1, which turns and scales
    /// [`Layers::anisotropy`]; blue multiplies its strength; linear.
    pub anisotropy_texture: Option<TextureSlot>,
    /// Red multiplies the strength of the film; linear.
    pub film_texture: Option<TextureSlot>,
    /// Green says where between [`Layering::least_thickness`] and the factor the thickness of the film
    /// is; linear.
    pub film_thickness_texture: Option<TextureSlot>,
    /// Thickness of the film where that texture is black, nanometres.
    pub least_thickness: f32,
}

impl Layers {
    /// Nothing.
    pub const NONE: Self = Self {
        coat: 0.0,
        coat_roughness: 0.0,
        sheen_color: Rgb::ZERO,
        sheen_roughness: 0.0,
        anisotropy: Vec2::ZERO,
        film: 0.0,
        film_ior: 1.3,
        film_thickness: 400.0,
    };

    /// Whether nothing lies there.
    pub fn is_none(&self) -> bool {
        self.coat <= 0.0
            && self.sheen_color == Rgb::ZERO
            && self.anisotropy == Vec2::ZERO
            && self.film <= 0.0
    }

    /// Width of the coat's distribution of microfacets, before it is kept from vanishing.
    pub fn coat_alpha(&self) -> f32 {
        self.coat_roughness.clamp(0.0, 1.0).powi(2)
    }

    /// What a surface reflects, below these layers and by them, as one Phong lobe on a diffuse
    /// surface: the lobe is as wide as the widest that it stands for. It knows no film.
    pub fn over(&self, below: Reflectance) -> Reflectance {
        if self.is_none() {
            return below;
        }
        let mut exponent = if below.is_glossy() { below.exponent } else { f32::MAX };
        let (mut diffuse, mut specular) = (below.diffuse, below.specular);
        let strength = self.anisotropy.length_squared().min(1.0);
        if strength > 0.0 && below.is_glossy() {
            let alpha = (2.0 * below.exponent + 1.0).sqrt().recip();
            exponent = exponent_of(alpha + (1.0 - alpha) * strength);
        }
        if self.sheen_color != Rgb::ZERO {
            let sheen = self.sheen_color.clamp(Rgb::ZERO, Rgb::ONE) * self.mean_sheen();
            let left = 1.0 - sheen.max_element();
            (diffuse, specular) = (diffuse * left, specular * left + sheen);
            exponent = exponent.min(1.0);
        }
        if self.coat > 0.0 {
            let coat = self.coat.clamp(0.0, 1.0) * COAT_MEAN;
            (diffuse, specular) = (diffuse * (1.0 - coat), specular * (1.0 - coat) + coat);
            exponent = exponent.min(exponent_of(self.coat_alpha().max(1e-3)));
        }
        Reflectance { diffuse, specular, exponent }
    }

    /// Mean albedo of white sheen: a cubic that is fitted to the integral.
    fn mean_sheen(&self) -> f32 {
        let roughness = self.sheen_roughness.clamp(LEAST_SHEEN_ROUGHNESS, 1.0);
        roughness * (0.0778 + roughness * (0.6279 - 0.4059 * roughness))
    }
}

/// Exponent of a Phong lobe about as wide as one of microfacets.
fn exponent_of(alpha: f32) -> f32 {
    (0.5 * (1.0 / (alpha * alpha) - 1.0)).clamp(0.0, 1e5)
}

impl Default for Layering {
    fn default() -> Self {
        Self {
            factors: Layers::NONE,
            coat_texture: None,
            coat_roughness_texture: None,
            coat_normal_map: None,
            sheen_color_texture: None,
            sheen_roughness_texture: None,
            anisotropy_texture: None,
            film_texture: None,
            film_thickness_texture: None,
            least_thickness: 0.0,
        }
    }
}

impl Layering {
    /// The textures that say what lies at a point; normal maps are none of them.
    pub fn slots(&self) -> impl Iterator<Item = &TextureSlot> {
        let all = [
            &self.coat_texture,
            &self.coat_roughness_texture,
            &self.sheen_color_texture,
            &self.sheen_roughness_texture,
            &self.anisotropy_texture,
            &self.film_texture,
            &self.film_thickness_texture,
        ];
        all.into_iter().flatten()
    }

    /// The texture along whose coordinates the surface is brushed, if it is; the first coordinates
    /// where no texture says it.
    pub fn brushing_slot(&self) -> Option<TextureSlot> {
        let is_brushed = self.factors.anisotropy != Vec2::ZERO;
        is_brushed.then(|| self.anisotropy_texture.unwrap_or(TextureSlot::data(0)))
    }

    /// What lies at a point where `sample` says what a texture is there.
    pub fn at(&self, sample: impl Fn(&TextureSlot) -> Vec4) -> Layers {
        let mut layers = self.factors;
        if let Some(slot) = &self.coat_texture {
            layers.coat *= sample(slot).x;
        }
        if let Some(slot) = &self.coat_roughness_texture {
            layers.coat_roughness *= sample(slot).y;
        }
        if let Some(slot) = &self.sheen_color_texture {
            layers.sheen_color *= sample(slot).truncate();
        }
        if let Some(slot) = &self.sheen_roughness_texture {
            layers.sheen_roughness *= sample(slot).w;
        }
        if let Some(slot) = &self.anisotropy_texture {
            let texel = sample(slot);
            let direction = (2.0 * texel.truncate().truncate() - 1.0).normalize_or(Vec2::X);
            layers.anisotropy = layers.anisotropy.rotate(direction) * texel.z;
        }
        if let Some(slot) = &self.film_texture {
            layers.film *= sample(slot).x;
        }
        if let Some(slot) = &self.film_thickness_texture {
            let [least, most] = [self.least_thickness, layers.film_thickness];
            layers.film_thickness = least + (most - least) * sample(slot).y;
        }
        layers
    }
}
