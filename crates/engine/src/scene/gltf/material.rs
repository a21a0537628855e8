//! Materials: metallic-roughness and the extensions that change reflection or emission.

use super::document::{malformed, name, valid};
use super::picture::Images;
use super::warnings::Warnings;
use crate::radiometry::Rgb;
use crate::scene::{Material, SceneError, TextureSlot, Volume, Wrap};
use glam::{Mat2, Vec2};
use gltf::json::material::{AlphaMode, PbrMetallicRoughness};
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{self, Root, Value};

/// Extensions of a material that the reflection model has no term for, and what is lost.
const IGNORED_EXTENSIONS: &[(&str, &str)] = &[
    ("KHR_materials_diffuse_transmission", "transmission is ignored; the surface is opaque"),
    ("KHR_materials_clearcoat", "the clear coat is ignored"),
    ("KHR_materials_sheen", "the sheen is ignored"),
    ("KHR_materials_anisotropy", "anisotropy is ignored; highlights are round"),
    ("KHR_materials_iridescence", "iridescence is ignored"),
    ("KHR_materials_dispersion", "dispersion is ignored"),
    (
        "KHR_materials_pbrSpecularGlossiness",
        "specular-glossiness is ignored; the metallic-roughness values are used",
    ),
];

/// Everything that a material may refer to.
struct Textures<'a, 'i> {
    root: &'a Root,
    images: &'i mut Images<'a>,
}

impl<'a> Textures<'a, '_> {
    /// The texture that a reference leads to, and its image.
    fn image(&self, reference: &Info) -> Result<(&'a json::Texture, usize), SceneError> {
        let texture = &self.root.textures[reference.index.value()];
        let at = || format!("textures[{}]", reference.index);
        let mut image = texture.source.value();
        let extensions = texture.extensions.as_ref();
        if let Some(webp) = extensions.and_then(|all| all.others.get("EXT_texture_webp"))
            && let Some(source) = webp.get("source")
        {
            let index = source.as_u64().and_then(|source| usize::try_from(source).ok());
            image = index.filter(|index| self.images.has(*index)).ok_or_else(|| {
                let at = format!("{}.extensions.EXT_texture_webp.source", at());
                malformed(at, "is not the index of an image")
            })?;
        }
        if !self.images.has(image) {
            return Err(SceneError::malformed(
                at(),
                "has no PNG, JPEG or WebP source",
                "export textures as PNG, JPEG or WebP",
            ));
        }
        Ok((texture, image))
    }

    /// A colour texture as a material uses it.
    fn slot(
        &mut self,
        reference: &Info,
        at: &str,
        warnings: &mut Warnings,
    ) -> Result<TextureSlot, SceneError> {
        let (texture, image) = self.image(reference)?;
        let mut slot = TextureSlot::plain(self.images.texture(image)?);
        let mut set = reference.tex_coord;
        let extensions = reference.extensions.as_ref();
        if let Some(transform) = extensions.and_then(|all| all.texture_transform.as_ref()) {
            set = transform.tex_coord.unwrap_or(set);
            let (offset, scale) = (Vec2::from(transform.offset.0), transform.scale.0);
            let (sin, cos) = transform.rotation.0.sin_cos();
            // Translation · rotation · scale; counter-clockwise as seen on the image, where v
            // points down. The listing in the extension's text turns the other way, its tests and
            // implementations do not.
            let linear =
                Mat2::from_cols(Vec2::new(cos, -sin) * scale[0], Vec2::new(sin, cos) * scale[1]);
            if !(linear.is_finite() && offset.is_finite()) {
                let at = format!("{at}.extensions.KHR_texture_transform");
                return Err(malformed(at, "is not finite"));
            }
            (slot.linear, slot.offset) = (linear, offset);
        }
        if set > 1 {
            warnings.push(
                format!("{at}.texCoord"),
                format!("texture coordinate set {set} is ignored; set 0 is used instead"),
            );
        }
        slot.uv_set = u8::from(set == 1);
        if let Some(index) = texture.sampler {
            let sampler = &self.root.samplers[index.value()];
            let wrap = |mode: &Checked<WrappingMode>| {
                Ok(match valid(mode, format!("samplers[{index}]"))? {
                    WrappingMode::Repeat => Wrap::Repeat,
                    WrappingMode::ClampToEdge => Wrap::ClampToEdge,
                    WrappingMode::MirroredRepeat => Wrap::MirroredRepeat,
                })
            };
            slot.wrap = [wrap(&sampler.wrap_s)?, wrap(&sampler.wrap_t)?];
            slot.nearest = sampler.mag_filter == Some(Checked::Valid(MagFilter::Nearest));
        }
        Ok(slot)
    }
}

/// A number within a range; clamped with a warning where it lies outside.
fn factor(
    value: f32,
    at: &str,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> f32 {
    if range.contains(&value) {
        return value;
    }
    let (low, high) = range.into_inner();
    warnings.push(at, format!("{value:e} is outside {low}…{high}; it is clamped"));
    value.clamp(low, high)
}

/// Colour factors within a range; clamped with a warning where one lies outside.
fn color(
    values: [f32; 3],
    at: &str,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> Rgb {
    Rgb::from_array(values.map(|value| factor(value, at, range.clone(), warnings)))
}

/// Up to this roughness a clear surface counts as polished without a warning.
const POLISHED: f32 = 0.05;

/// Least attenuation distance, metres.
const MIN_ATTENUATION: f32 = 1e-9;

/// Largest emitted radiance, in the file's unit: far above the sun, well within f32.
const MAX_EMISSION: f32 = 1e12;

/// Reads every material, in file order.
pub(super) fn materials<'a>(
    root: &'a Root,
    images: &mut Images<'a>,
    warnings: &mut Warnings,
) -> Result<Vec<Material>, SceneError> {
    let mut textures = Textures { root, images };
    root.materials
        .iter()
        .enumerate()
        .map(|(index, object)| material(object, index, &mut textures, warnings))
        .collect()
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
    if let Some(extensions) = &object.extensions {
        let at = format!("{at}.extensions");
        extended(extensions, &at, &mut material, warnings);
        clear(extensions, &at, &mut material, textures, warnings)?;
    }
    if object.normal_texture.is_some() {
        let what = "is ignored; the mesh's normals are used";
        warnings.push(format!("{at}.normalTexture"), what);
    }
    if object.occlusion_texture.is_some() {
        let what = "is ignored; occlusion is computed";
        warnings.push(format!("{at}.occlusionTexture"), what);
    }
    let alpha_at = format!("{at}.alphaMode");
    let mode = match valid(&object.alpha_mode, &alpha_at)? {
        AlphaMode::Opaque => return Ok(material),
        AlphaMode::Mask => "MASK",
        AlphaMode::Blend => "BLEND",
    };
    warnings.push(alpha_at, format!("{mode} is ignored; the surface is opaque"));
    Ok(material)
}

fn metallic_roughness(
    surface: &PbrMetallicRoughness,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let of = |member: &str| format!("{at}.{member}");
    let [r, g, b, _] = surface.base_color_factor.0;
    material.base_color = color([r, g, b], &of("baseColorFactor"), 0.0..=1.0, warnings);
    if let Some(reference) = &surface.base_color_texture {
        let slot = textures.slot(reference, &of("baseColorTexture"), warnings)?;
        material.base_color_texture = Some(slot);
    }
    let (metallic, roughness) = (surface.metallic_factor.0, surface.roughness_factor.0);
    material.metallic = factor(metallic, &of("metallicFactor"), 0.0..=1.0, warnings);
    material.roughness = factor(roughness, &of("roughnessFactor"), 0.0..=1.0, warnings);
    if let Some(reference) = &surface.metallic_roughness_texture {
        let (_, image) = textures.image(reference)?;
        let [_, roughness, metallic] = textures.images.mean(image)?;
        material.metallic *= metallic;
        material.roughness *= roughness;
        warnings.push(
            of("metallicRoughnessTexture"),
            format!(
                "enters by its mean: metallic {:.3}, roughness {:.3} all over",
                material.metallic, material.roughness
            ),
        );
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
    if let Some(reference) = object.emissive_texture.as_ref().filter(|_| material.emits()) {
        let slot = textures.slot(reference, &format!("{at}.emissiveTexture"), warnings)?;
        material.emission_texture = Some(slot);
    }
    Ok(())
}

/// Applies the extensions that change reflection, and warns of those that are ignored.
fn extended(
    extensions: &json::extensions::material::Material,
    at: &str,
    material: &mut Material,
    warnings: &mut Warnings,
) {
    if let Some(extension) = &extensions.ior {
        let at = format!("{at}.KHR_materials_ior.ior");
        material.ior = match extension.ior.0 {
            // The extension's way to say F0 = 1.
            0.0 => 0.0,
            ior => factor(ior, &at, 1.0..=1e4, warnings),
        };
    }
    if let Some(extension) = &extensions.specular {
        let of = |member: &str| format!("{at}.KHR_materials_specular.{member}");
        let (strength, tint) = (extension.specular_factor.0, extension.specular_color_factor.0);
        material.specular_factor = factor(strength, &of("specularFactor"), 0.0..=1.0, warnings);
        material.specular_color = color(tint, &of("specularColorFactor"), 0.0..=1e4, warnings);
        for (member, texture) in [
            ("specularTexture", &extension.specular_texture),
            ("specularColorTexture", &extension.specular_color_texture),
        ] {
            if texture.is_some() {
                warnings.push(of(member), "is ignored; the factor alone is used");
            }
        }
    }
    if extensions.unlit.is_some() {
        material.specular_factor = 0.0;
        material.metallic = 0.0;
        material.emission = Rgb::ZERO;
        material.emission_texture = None;
        warnings.push(
            format!("{at}.KHR_materials_unlit"),
            "an unlit surface has no physical meaning; it is lit, as diffuse with its base colour",
        );
    }
    for (name, what) in IGNORED_EXTENSIONS {
        if extensions.others.get(*name).is_some_and(Value::is_object) {
            warnings.push(format!("{at}.{name}"), *what);
        }
    }
}

/// Reads how light passes through: a clear surface, and what is behind it.
fn clear(
    extensions: &json::extensions::material::Material,
    at: &str,
    material: &mut Material,
    textures: &mut Textures<'_, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let Some(extension) = &extensions.transmission else {
        if extensions.volume.is_some() {
            let what = "is ignored; nothing gets into it without KHR_materials_transmission";
            warnings.push(format!("{at}.KHR_materials_volume"), what);
        }
        return Ok(());
    };
    let of = |member: &str| format!("{at}.KHR_materials_transmission.{member}");
    let share = extension.transmission_factor.0;
    material.transmission = factor(share, &of("transmissionFactor"), 0.0..=1.0, warnings);
    if let Some(reference) = &extension.transmission_texture {
        let (_, image) = textures.image(reference)?;
        let [red, _, _] = textures.images.mean(image)?;
        material.transmission *= red;
        let what = format!("enters by its mean: {:.3} all over", material.transmission);
        warnings.push(of("transmissionTexture"), what);
    }
    if material.transmission > 0.0 && material.roughness > POLISHED {
        let what = "the rough surface lets light through as a polished one, without scattering it";
        warnings.push(format!("{at}.KHR_materials_transmission"), what);
    }
    if let Some(extension) = &extensions.volume {
        let of = |member: &str| format!("{at}.KHR_materials_volume.{member}");
        let range = 0.0..=f32::MAX;
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
    Ok(())
}
