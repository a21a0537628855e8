//! Extensions of a material that change what it reflects and lets through.

use super::extensions::{EXTENSIONS, Support, loss};
use super::factors::{color, factor};
use super::material_layers::{self, object};
use super::textures::{Reference, Textures};
use super::warnings::Warnings;
use crate::radiometry::Rgb;
use crate::scene::{Encoding, Material, SceneError, Translucency, Volume};
use glam::Vec2;
use gltf::json::Value;
use gltf::json::extensions::material::{Material as Extensions, PbrSpecularGlossiness, Specular};
use gltf::json::texture::Info;
use serde::Deserialize;

const SPECULAR_GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

const DIFFUSE_TRANSMISSION: &str = "KHR_materials_diffuse_transmission";

const DISPERSION: &str = "KHR_materials_dispersion";

/// Largest dispersion, 20 over the Abbe number: far above any material's.
const MAX_DISPERSION: f32 = 1e3;

/// Least attenuation distance, metres.
const MIN_ATTENUATION: f32 = 1e-9;

/// Applies them, and warns of those that are ignored.
pub(super) fn apply(
    extensions: &Extensions,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    if let Some(extension) = &extensions.ior {
        let at = format!("{at}.KHR_materials_ior.ior");
        material.ior = match extension.ior.0 {
            // The extension's way to say F0 = 1.
            0.0 => 0.0,
            ior => factor(ior, &at, 1.0..=1e4, warnings),
        };
    }
    if let Some(extension) = &extensions.specular {
        let at = format!("{at}.KHR_materials_specular");
        specular(extension, &at, material, textures, warnings)?;
    }
    if let Some(extension) = &extensions.pbr_specular_glossiness {
        let at = format!("{at}.{SPECULAR_GLOSSINESS}");
        specular_glossiness(extension, &at, material, textures, warnings)?;
    }
    clear(extensions, at, material, textures, warnings)?;
    diffuse_transmission(extensions, at, material, textures, warnings)?;
    material_layers::apply(extensions, at, material, textures, warnings)?;
    if extensions.unlit.is_some() {
        material.unlit = true;
        material.emission = Rgb::ZERO;
        material.emission_texture = None;
        material.transmission = 0.0;
        material.translucency = None;
    }
    for extension in EXTENSIONS {
        let Support::Ignored(loss) = extension.support else { continue };
        if extensions.others.get(extension.name).is_some_and(Value::is_object) {
            warnings.push(format!("{at}.{}", extension.name), loss);
        }
    }
    Ok(())
}

fn specular(
    extension: &Specular,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let of = |member: &str| format!("{at}.{member}");
    let (strength, tint) = (extension.specular_factor.0, extension.specular_color_factor.0);
    material.specular_factor = factor(strength, &of("specularFactor"), 0.0..=1.0, warnings);
    material.specular_color = color(tint, &of("specularColorFactor"), 0.0..=1e4, warnings);
    if let Some(info) = &extension.specular_texture {
        let reference = Reference::new(info, of("specularTexture"));
        material.specular_texture = textures.slot(&reference, Encoding::Linear, warnings)?;
    }
    if let Some(info) = &extension.specular_color_texture {
        let reference = Reference::new(info, of("specularColorTexture"));
        material.specular_color_texture = textures.slot(&reference, Encoding::Srgb, warnings)?;
    }
    Ok(())
}

/// A dielectric that reflects as the extension says.
///
/// With the index of refraction 0, which stands for F0 = 1, the specular colour is F0 itself; the
/// diffuse colour is the base colour of something that is no metal; roughness = 1 − glossiness.
fn specular_glossiness(
    extension: &PbrSpecularGlossiness,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let of = |member: &str| format!("{at}.{member}");
    warnings.push(at, loss(SPECULAR_GLOSSINESS));
    let [r, g, b, opacity] = extension.diffuse_factor.0;
    material.base_color = color([r, g, b], &of("diffuseFactor"), 0.0..=1.0, warnings);
    material.opacity = factor(opacity, &of("diffuseFactor"), 0.0..=1.0, warnings);
    let tint = extension.specular_factor.0;
    material.specular_color = color(tint, &of("specularFactor"), 0.0..=1.0, warnings);
    let glossiness = extension.glossiness_factor.0;
    let glossiness = factor(glossiness, &of("glossinessFactor"), 0.0..=1.0, warnings);
    (material.metallic, material.roughness) = (0.0, 1.0 - glossiness);
    (material.ior, material.specular_factor) = (0.0, 1.0);
    material.base_color_texture = None;
    material.metallic_roughness_texture = None;
    material.metallic_roughness_mean = Vec2::ONE;
    (material.specular_texture, material.specular_color_texture) = (None, None);
    if let Some(info) = &extension.diffuse_texture {
        let reference = Reference::new(info, of("diffuseTexture"));
        material.base_color_texture = textures.slot(&reference, Encoding::Srgb, warnings)?;
    }
    if let Some(info) = &extension.specular_glossiness_texture {
        let reference = Reference::new(info, of("specularGlossinessTexture"));
        material.specular_color_texture = textures.slot(&reference, Encoding::Srgb, warnings)?;
        let rough = textures.roughness_slot(&reference, glossiness, warnings)?;
        material.metallic_roughness_texture = rough;
        if let Some(slot) = rough {
            material.roughness = 1.0;
            let [_, roughness, ..] = textures.images.mean(slot.texture);
            material.metallic_roughness_mean = Vec2::new(1.0, roughness);
        }
    }
    Ok(())
}

/// KHR_materials_dispersion.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Dispersion {
    dispersion: f32,
}

/// Reads by how much a clear body bends colours by different angles.
fn dispersion(
    extensions: &Extensions,
    at: &str,
    material: &mut Material,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let found = object::<Dispersion>(extensions, DISPERSION, at)?;
    let Some((extension, at)) = found else { return Ok(()) };
    let range = 0.0..=MAX_DISPERSION;
    let value = factor(extension.dispersion, &format!("{at}.dispersion"), range, warnings);
    if value > 0.0 && material.volume.is_none() {
        warnings.push(at, "is ignored; nothing is bent without KHR_materials_volume");
        return Ok(());
    }
    material.dispersion = value;
    Ok(())
}

/// KHR_materials_diffuse_transmission.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct DiffuseTransmission {
    diffuse_transmission_factor: f32,
    diffuse_transmission_texture: Option<Info>,
    diffuse_transmission_color_factor: [f32; 3],
    diffuse_transmission_color_texture: Option<Info>,
}

impl Default for DiffuseTransmission {
    fn default() -> Self {
        Self {
            diffuse_transmission_factor: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color_factor: [1.0; 3],
            diffuse_transmission_color_texture: None,
        }
    }
}

/// Reads what goes through and is scattered. Such a surface has two sides for light, so its back is
/// there for cameras, too.
fn diffuse_transmission(
    extensions: &Extensions,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let found = object::<DiffuseTransmission>(extensions, DIFFUSE_TRANSMISSION, at)?;
    let Some((extension, at)) = found else { return Ok(()) };
    let of = |member: &str| format!("{at}.{member}");
    let share = extension.diffuse_transmission_factor;
    let share = factor(share, &of("diffuseTransmissionFactor"), 0.0..=1.0, warnings);
    let tint = extension.diffuse_transmission_color_factor;
    let tint = color(tint, &of("diffuseTransmissionColorFactor"), 0.0..=1.0, warnings);
    if share == 0.0 {
        return Ok(());
    }
    let mut slot = |info: &Option<Info>, member: &str, encoding| {
        let reference = info.as_ref().map(|info| Reference::new(info, of(member)));
        let slot = reference.map(|reference| textures.slot(&reference, encoding, warnings));
        slot.transpose().map(Option::flatten)
    };
    let (shares, tints) =
        (&extension.diffuse_transmission_texture, &extension.diffuse_transmission_color_texture);
    let share_texture = slot(shares, "diffuseTransmissionTexture", Encoding::Linear)?;
    let color_texture = slot(tints, "diffuseTransmissionColorTexture", Encoding::Srgb)?;
    let translucency = Translucency { share, share_texture, color: tint, color_texture };
    material.translucency = Some(Box::new(translucency));
    material.double_sided = true;
    let has_film = extensions.others.contains_key("KHR_materials_iridescence");
    if extensions.volume.is_some() || has_film {
        warnings.push(at, loss(DIFFUSE_TRANSMISSION));
    }
    Ok(())
}

/// Reads how light passes through: a clear surface, and what is behind it.
fn clear(
    extensions: &Extensions,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let Some(extension) = &extensions.transmission else {
        if extensions.volume.is_some() && !extensions.others.contains_key(DIFFUSE_TRANSMISSION) {
            let what = "is ignored; nothing gets into it without KHR_materials_transmission";
            warnings.push(format!("{at}.KHR_materials_volume"), what);
        }
        return Ok(());
    };
    let of = |member: &str| format!("{at}.KHR_materials_transmission.{member}");
    let share = extension.transmission_factor.0;
    material.transmission = factor(share, &of("transmissionFactor"), 0.0..=1.0, warnings);
    if let Some(info) = &extension.transmission_texture {
        let reference = Reference::new(info, of("transmissionTexture"));
        material.transmission_texture = textures.slot(&reference, Encoding::Linear, warnings)?;
    }
    if let Some(extension) = &extensions.volume {
        let of = |member: &str| format!("{at}.KHR_materials_volume.{member}");
        let range = 0.0..=f32::MAX;
        if extension.thickness_texture.is_some() {
            warnings.push(of("thicknessTexture"), loss("KHR_materials_volume"));
        }
        let thickness =
            factor(extension.thickness_factor.0, &of("thicknessFactor"), range, warnings);
        let tint =
            color(extension.attenuation_color.0, &of("attenuationColor"), 0.0..=1.0, warnings);
        // Absent means infinite, which JSON can't say.
        let distance = match extension.attenuation_distance.0 {
            distance if distance.is_infinite() => distance,
            distance => {
                let range = MIN_ATTENUATION..=f32::MAX;
                factor(distance, &of("attenuationDistance"), range, warnings)
            }
        };
        let volume = Volume { attenuation_color: tint, attenuation_distance: distance };
        material.volume = (thickness > 0.0).then_some(volume);
    }
    dispersion(extensions, at, material, warnings)
}
