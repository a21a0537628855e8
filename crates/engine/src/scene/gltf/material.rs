//! Materials: metallic-roughness, normal maps, alpha and emission.

use super::document::{Document, name, valid};
use super::factors::{color, factor};
use super::material_extensions;
use super::picture::Images;
use super::textures::{Reference, Textures};
use super::warnings::Warnings;
use crate::radiometry::Rgb;
use crate::scene::{Alpha, Encoding, Material, Model, SceneError};
use glam::Vec2;
use gltf::json;
use gltf::json::material::{AlphaMode, PbrMetallicRoughness};

/// Largest emitted radiance, in the file's unit: far above the sun, well within f32.
const MAX_EMISSION: f32 = 1e12;

/// Reads every material, in file order.
pub(super) fn materials<'a>(
    document: &'a Document,
    images: &mut Images<'a>,
    warnings: &mut Warnings,
) -> Result<Vec<Material>, SceneError> {
    let root = &document.root;
    let mut textures = Textures { root, images };
    let mut materials = Vec::with_capacity(root.materials.len());
    for (index, object) in root.materials.iter().enumerate() {
        let mut material = material(object, index, &mut textures, warnings)?;
        if document.phong.get(index) == Some(&true) {
            material.model = Model::Phong;
            if material.layering.take().is_some() {
                let what = "has layers that are ignored; a Phong lobe knows none";
                warnings.push(format!("materials[{index}].extensions"), what);
            }
        }
        materials.push(material);
    }
    Ok(materials)
}

/// The material of a primitive that names none, by the glTF specification.
pub(super) fn default_material() -> Material {
    Material { metallic: 1.0, ..Material::default() }
}

fn material(
    object: &json::Material,
    index: usize,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<Material, SceneError> {
    let at = format!("materials[{index}]");
    let mut material = default_material();
    material.name = name(&object.name).unwrap_or_else(|| format!("material {index}"));
    material.double_sided = object.double_sided;
    let surface_at = format!("{at}.pbrMetallicRoughness");
    let surface = &object.pbr_metallic_roughness;
    metallic_roughness(surface, &surface_at, &mut material, textures, warnings)?;
    emission(object, &at, &mut material, textures, warnings)?;
    normals(object, &at, &mut material, textures, warnings)?;
    alpha(object, &at, &mut material, warnings)?;
    if object.occlusion_texture.is_some() {
        let what = "is ignored; occlusion is computed";
        warnings.push(format!("{at}.occlusionTexture"), what);
    }
    // Last, since they override what is said without them.
    if let Some(extensions) = &object.extensions {
        let at = format!("{at}.extensions");
        material_extensions::apply(extensions, &at, &mut material, textures, warnings)?;
    }
    Ok(material)
}

fn normals(
    object: &json::Material,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let Some(info) = &object.normal_texture else { return Ok(()) };
    let at = format!("{at}.normalTexture");
    material.normal_map = textures.normal_map(info, &at, warnings)?;
    Ok(())
}

fn alpha(
    object: &json::Material,
    at: &str,
    material: &mut Material,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    material.alpha = match valid(&object.alpha_mode, format!("{at}.alphaMode"))? {
        AlphaMode::Opaque => Alpha::Opaque,
        AlphaMode::Blend => Alpha::Blend,
        AlphaMode::Mask => {
            let cutoff = object.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
            let range = 0.0..=f32::MAX;
            Alpha::Mask { cutoff: factor(cutoff, &format!("{at}.alphaCutoff"), range, warnings) }
        }
    };
    Ok(())
}

fn metallic_roughness(
    surface: &PbrMetallicRoughness,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let of = |member: &str| format!("{at}.{member}");
    let [r, g, b, opacity] = surface.base_color_factor.0;
    material.base_color = color([r, g, b], &of("baseColorFactor"), 0.0..=1.0, warnings);
    material.opacity = factor(opacity, &of("baseColorFactor"), 0.0..=1.0, warnings);
    if let Some(info) = &surface.base_color_texture {
        let reference = Reference::new(info, of("baseColorTexture"));
        material.base_color_texture = textures.slot(&reference, Encoding::Srgb, warnings)?;
    }
    let (metallic, roughness) = (surface.metallic_factor.0, surface.roughness_factor.0);
    material.metallic = factor(metallic, &of("metallicFactor"), 0.0..=1.0, warnings);
    material.roughness = factor(roughness, &of("roughnessFactor"), 0.0..=1.0, warnings);
    if let Some(info) = &surface.metallic_roughness_texture {
        let reference = Reference::new(info, of("metallicRoughnessTexture"));
        material.metallic_roughness_texture =
            textures.slot(&reference, Encoding::Linear, warnings)?;
        if let Some(slot) = material.metallic_roughness_texture {
            let [_, roughness, metallic, _] = textures.images.mean(slot.texture);
            material.metallic_roughness_mean = Vec2::new(metallic, roughness);
        }
    }
    Ok(())
}

fn emission(
    object: &json::Material,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let factor_at = format!("{at}.emissiveFactor");
    let mut emission = color(object.emissive_factor.0, &factor_at, 0.0..=MAX_EMISSION, warnings);
    if emission.max_element() > 1.0 {
        warnings.push(
            factor_at,
            "is above 1 and used as it is; the format keeps it to 1 and has KHR_materials_emissive_strength for more",
        );
    }
    let extensions = object.extensions.as_ref();
    if let Some(strength) = extensions.and_then(|all| all.emissive_strength.as_ref()) {
        let at = format!("{at}.extensions.KHR_materials_emissive_strength.emissiveStrength");
        emission *= factor(strength.emissive_strength.0, &at, 0.0..=MAX_EMISSION, warnings);
        emission = emission.min(Rgb::splat(MAX_EMISSION));
    }
    material.emission = emission;
    if let Some(info) = object.emissive_texture.as_ref().filter(|_| material.emits()) {
        let reference = Reference::new(info, format!("{at}.emissiveTexture"));
        material.emission_texture = textures.slot(&reference, Encoding::Srgb, warnings)?;
        if material.emission_texture.is_none() {
            // The texture says where it shines: without it, a wall with a lamp would shine all over.
            material.emission = Rgb::ZERO;
        }
    }
    Ok(())
}
