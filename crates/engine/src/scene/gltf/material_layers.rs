//! Extensions of a material that put layers on its surface or say how it is brushed:
//! KHR_materials_clearcoat, KHR_materials_sheen, KHR_materials_iridescence, KHR_materials_anisotropy.

use super::document::typed;
use super::extensions::loss;
use super::factors::{color, factor};
use super::textures::{Reference, Textures};
use super::warnings::Warnings;
use crate::scene::{
    COAT_MEAN, Encoding, LEAST_SHEEN_ROUGHNESS, Layering, Material, SceneError, TextureSlot,
};
use glam::Vec2;
use gltf::json::extensions::material::Material as Extensions;
use gltf::json::material::NormalTexture;
use gltf::json::texture::Info;
use serde::Deserialize;
use serde::de::DeserializeOwned;

const CLEARCOAT: &str = "KHR_materials_clearcoat";
const SHEEN: &str = "KHR_materials_sheen";
const ANISOTROPY: &str = "KHR_materials_anisotropy";
const IRIDESCENCE: &str = "KHR_materials_iridescence";

/// Thickest film, nanometres, and largest index of refraction: far above where colours are to be seen.
const MAX_THICKNESS: f32 = 1e6;
const MAX_FILM_IOR: f32 = 10.0;
/// Largest angle, radians, that single precision still tells from others.
const MAX_ROTATION: f32 = 1e4;

/// KHR_materials_clearcoat.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_texture: Option<Info>,
    clearcoat_roughness_factor: f32,
    clearcoat_roughness_texture: Option<Info>,
    clearcoat_normal_texture: Option<NormalTexture>,
}

/// KHR_materials_sheen.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Sheen {
    sheen_color_factor: [f32; 3],
    sheen_color_texture: Option<Info>,
    sheen_roughness_factor: f32,
    sheen_roughness_texture: Option<Info>,
}

/// KHR_materials_anisotropy.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Anisotropy {
    anisotropy_strength: f32,
    anisotropy_rotation: f32,
    anisotropy_texture: Option<Info>,
}

/// KHR_materials_iridescence.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Iridescence {
    iridescence_factor: f32,
    iridescence_texture: Option<Info>,
    iridescence_ior: f32,
    iridescence_thickness_minimum: f32,
    iridescence_thickness_maximum: f32,
    iridescence_thickness_texture: Option<Info>,
}

impl Default for Iridescence {
    fn default() -> Self {
        Self {
            iridescence_factor: 0.0,
            iridescence_texture: None,
            iridescence_ior: 1.3,
            iridescence_thickness_minimum: 100.0,
            iridescence_thickness_maximum: 400.0,
            iridescence_thickness_texture: None,
        }
    }
}

/// What is read, and what may be said of it.
struct Reading<'a, 't, 'i> {
    textures: &'a mut Textures<'t, 'i>,
    warnings: &'a mut Warnings,
}

/// Reads all of them; what shines and what is clear have to be known before.
pub(super) fn apply(
    extensions: &Extensions,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let mut layering = Layering::default();
    let mut reading = Reading { textures, warnings };
    if let Some((coat, at)) = object(extensions, CLEARCOAT, at)? {
        reading.clearcoat(&coat, &at, material, &mut layering)?;
    }
    if let Some((sheen, at)) = object(extensions, SHEEN, at)? {
        reading.sheen(&sheen, &at, &mut layering)?;
    }
    if let Some((anisotropy, at)) = object(extensions, ANISOTROPY, at)? {
        reading.anisotropy(&anisotropy, &at, &mut layering)?;
    }
    if let Some((film, at)) = object(extensions, IRIDESCENCE, at)? {
        reading.iridescence(&film, &at, &mut layering)?;
        if layering.factors.film > 0.0 && material.transmission > 0.0 {
            reading.warnings.push(at, loss(IRIDESCENCE));
        }
    }
    if !layering.factors.is_none() {
        material.layering = Some(Box::new(layering));
    }
    Ok(())
}

/// An extension's object and its place, where there is one.
pub(super) fn object<T: DeserializeOwned>(
    extensions: &Extensions,
    name: &str,
    at: &str,
) -> Result<Option<(T, String)>, SceneError> {
    let Some(value) = extensions.others.get(name) else { return Ok(None) };
    let at = format!("{at}.{name}");
    Ok(Some((typed(value, &at)?, at)))
}

impl Reading<'_, '_, '_> {
    /// A texture of an extension.
    fn slot(
        &mut self,
        info: Option<&Info>,
        at: String,
        encoding: Encoding,
    ) -> Result<Option<TextureSlot>, SceneError> {
        let Some(info) = info else { return Ok(None) };
        let reference = Reference::new(info, at);
        self.textures.slot(&reference, encoding, self.warnings)
    }

    fn clearcoat(
        &mut self,
        coat: &Clearcoat,
        at: &str,
        material: &mut Material,
        layering: &mut Layering,
    ) -> Result<(), SceneError> {
        let of = |member: &str| format!("{at}.{member}");
        let factors = &mut layering.factors;
        factors.coat =
            factor(coat.clearcoat_factor, &of("clearcoatFactor"), 0.0..=1.0, self.warnings);
        let roughness = coat.clearcoat_roughness_factor;
        factors.coat_roughness =
            factor(roughness, &of("clearcoatRoughnessFactor"), 0.0..=1.0, self.warnings);
        if factors.coat == 0.0 {
            return Ok(());
        }
        let (strength, roughness) = (&coat.clearcoat_texture, &coat.clearcoat_roughness_texture);
        layering.coat_texture =
            self.slot(strength.as_ref(), of("clearcoatTexture"), Encoding::Linear)?;
        layering.coat_roughness_texture =
            self.slot(roughness.as_ref(), of("clearcoatRoughnessTexture"), Encoding::Linear)?;
        if let Some(info) = &coat.clearcoat_normal_texture {
            let at = of("clearcoatNormalTexture");
            layering.coat_normal_map = self.textures.normal_map(info, &at, self.warnings)?;
        }
        if material.emits() {
            // What gets through a coat, on the mean over all directions.
            let texture = layering.coat_texture.map(|slot| self.textures.images.mean(slot.texture));
            let strength = layering.factors.coat * texture.map_or(1.0, |[red, ..]| red);
            material.emission *= 1.0 - COAT_MEAN * strength;
        }
        if material.emits() || material.transmission > 0.0 {
            self.warnings.push(at, loss(CLEARCOAT));
        }
        Ok(())
    }

    fn sheen(
        &mut self,
        sheen: &Sheen,
        at: &str,
        layering: &mut Layering,
    ) -> Result<(), SceneError> {
        let of = |member: &str| format!("{at}.{member}");
        let factors = &mut layering.factors;
        let (tint, roughness) = (sheen.sheen_color_factor, sheen.sheen_roughness_factor);
        factors.sheen_color = color(tint, &of("sheenColorFactor"), 0.0..=1.0, self.warnings);
        factors.sheen_roughness =
            factor(roughness, &of("sheenRoughnessFactor"), 0.0..=1.0, self.warnings);
        if factors.sheen_color.max_element() == 0.0 {
            return Ok(());
        }
        if factors.sheen_roughness < LEAST_SHEEN_ROUGHNESS {
            self.warnings.push(at, loss(SHEEN));
        }
        let (tint, roughness) = (&sheen.sheen_color_texture, &sheen.sheen_roughness_texture);
        layering.sheen_color_texture =
            self.slot(tint.as_ref(), of("sheenColorTexture"), Encoding::Srgb)?;
        layering.sheen_roughness_texture =
            self.slot(roughness.as_ref(), of("sheenRoughnessTexture"), Encoding::Linear)?;
        Ok(())
    }

    fn anisotropy(
        &mut self,
        anisotropy: &Anisotropy,
        at: &str,
        layering: &mut Layering,
    ) -> Result<(), SceneError> {
        let of = |member: &str| format!("{at}.{member}");
        let strength = anisotropy.anisotropy_strength;
        let strength = factor(strength, &of("anisotropyStrength"), 0.0..=1.0, self.warnings);
        let range = -MAX_ROTATION..=MAX_ROTATION;
        let rotation = anisotropy.anisotropy_rotation;
        let rotation = factor(rotation, &of("anisotropyRotation"), range, self.warnings);
        layering.factors.anisotropy = strength * Vec2::from_angle(rotation);
        if strength > 0.0 {
            let info = anisotropy.anisotropy_texture.as_ref();
            layering.anisotropy_texture =
                self.slot(info, of("anisotropyTexture"), Encoding::Linear)?;
        }
        Ok(())
    }

    fn iridescence(
        &mut self,
        film: &Iridescence,
        at: &str,
        layering: &mut Layering,
    ) -> Result<(), SceneError> {
        let of = |member: &str| format!("{at}.{member}");
        let range = 0.0..=MAX_THICKNESS;
        let factors = &mut layering.factors;
        factors.film =
            factor(film.iridescence_factor, &of("iridescenceFactor"), 0.0..=1.0, self.warnings);
        if factors.film == 0.0 {
            return Ok(());
        }
        let ior = film.iridescence_ior;
        factors.film_ior = factor(ior, &of("iridescenceIor"), 1.0..=MAX_FILM_IOR, self.warnings);
        let [least, most] =
            [film.iridescence_thickness_minimum, film.iridescence_thickness_maximum];
        let at_least = of("iridescenceThicknessMinimum");
        layering.least_thickness = factor(least, &at_least, range.clone(), self.warnings);
        let at_most = of("iridescenceThicknessMaximum");
        layering.factors.film_thickness = factor(most, &at_most, range, self.warnings);
        let (strength, thickness) =
            (film.iridescence_texture.as_ref(), film.iridescence_thickness_texture.as_ref());
        layering.film_texture = self.slot(strength, of("iridescenceTexture"), Encoding::Linear)?;
        layering.film_thickness_texture =
            self.slot(thickness, of("iridescenceThicknessTexture"), Encoding::Linear)?;
        Ok(())
    }
}
