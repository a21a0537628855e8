//! Materials: metallic-roughness and the extensions that change reflection or emission.

use super::Warnings;
use super::json::{Object, malformed};
use super::picture::Images;
use crate::radiometry::Rgb;
use crate::scene::{Material, SceneError, TextureSlot, Wrap};
use glam::{Mat2, Vec2};

/// Extensions of a material that the reflection model has no term for, and what is lost.
const IGNORED_EXTENSIONS: &[(&str, &str)] = &[
    ("KHR_materials_transmission", "transmission is ignored; the surface is opaque"),
    ("KHR_materials_volume", "the volume is ignored; the surface is opaque"),
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
pub(super) struct Textures<'a, 'i> {
    textures: Vec<Object<'a>>,
    samplers: Vec<Object<'a>>,
    images: &'i mut Images<'a>,
}

impl<'a, 'i> Textures<'a, 'i> {
    /// The textures of a file.
    pub fn new(root: &Object<'a>, images: &'i mut Images<'a>) -> Result<Self, SceneError> {
        Ok(Self {
            textures: root.objects("textures")?,
            samplers: root.objects("samplers")?,
            images,
        })
    }

    /// The texture object and the image that a texture reference leads to.
    fn image(&self, reference: &Object<'a>) -> Result<(Object<'a>, usize), SceneError> {
        let index = reference
            .index("index", self.textures.len(), "textures")?
            .ok_or_else(|| reference.missing("index"))?;
        let texture = &self.textures[index];
        let images = self.images.count();
        let mut image = texture.index("source", images, "images")?;
        if let Some(webp) = texture.extension("EXT_texture_webp")? {
            image = webp.index("source", images, "images")?.or(image);
        }
        match image {
            Some(image) => Ok((texture.clone(), image)),
            None => Err(SceneError::malformed(
                &texture.at,
                "has no PNG, JPEG or WebP source",
                "export textures as PNG, JPEG or WebP",
            )),
        }
    }

    /// A colour texture as a material uses it; `None` without a reference.
    fn slot(
        &mut self,
        owner: &Object<'a>,
        key: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureSlot>, SceneError> {
        let Some(reference) = owner.object(key)? else { return Ok(None) };
        let (texture, image) = self.image(&reference)?;
        let mut slot = TextureSlot::plain(self.images.texture(image)?);
        let mut set = reference.integer("texCoord")?.unwrap_or(0);
        if let Some(transform) = reference.extension("KHR_texture_transform")? {
            set = transform.integer("texCoord")?.unwrap_or(set);
            let pair = |key: &str, default: f64| -> Result<Vec2, SceneError> {
                let [x, y] = transform.numbers::<2>(key)?.unwrap_or([default; 2]);
                Ok(Vec2::new(x as f32, y as f32))
            };
            let (offset, scale) = (pair("offset", 0.0)?, pair("scale", 1.0)?);
            let (sin, cos) = (transform.number("rotation")?.unwrap_or(0.0) as f32).sin_cos();
            // Translation · rotation · scale; counter-clockwise as seen on the image, where v
            // points down. The listing in the extension's text turns the other way, its tests and
            // implementations do not.
            let linear =
                Mat2::from_cols(Vec2::new(cos, -sin) * scale.x, Vec2::new(sin, cos) * scale.y);
            if !(linear.is_finite() && offset.is_finite()) {
                return Err(malformed(&transform.at, "is not finite"));
            }
            (slot.linear, slot.offset) = (linear, offset);
        }
        if set > 1 {
            warnings.push(
                reference.path("texCoord"),
                format!("texture coordinate set {set} is ignored; set 0 is used instead"),
            );
        }
        slot.uv_set = u8::from(set == 1);
        if let Some(index) = texture.index("sampler", self.samplers.len(), "samplers")? {
            let sampler = &self.samplers[index];
            slot.wrap = [wrap(sampler, "wrapS")?, wrap(sampler, "wrapT")?];
            slot.nearest = sampler.integer("magFilter")? == Some(9728);
        }
        Ok(Some(slot))
    }
}

fn wrap(sampler: &Object<'_>, key: &str) -> Result<Wrap, SceneError> {
    match sampler.integer(key)? {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33071) => Ok(Wrap::ClampToEdge),
        Some(33648) => Ok(Wrap::MirroredRepeat),
        Some(code) => Err(malformed(sampler.path(key), format!("{code} is not a wrap mode"))),
    }
}

/// A number within a range; clamped with a warning where it lies outside.
fn factor(
    object: &Object<'_>,
    key: &str,
    default: f32,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> Result<f32, SceneError> {
    let Some(value) = object.number(key)? else { return Ok(default) };
    Ok(clamped(value, &object.path(key), &range, warnings))
}

/// Colour factors within a range; clamped with a warning where one lies outside.
fn color(
    values: [f64; 3],
    at: &str,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> Rgb {
    Rgb::from_array(values.map(|value| clamped(value, at, &range, warnings)))
}

fn clamped(
    value: f64,
    at: &str,
    range: &std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> f32 {
    let (low, high) = (*range.start(), *range.end());
    let narrow = value as f32;
    if range.contains(&narrow) {
        return narrow;
    }
    warnings.push(at, format!("{value:e} is outside {low}…{high}; it is clamped"));
    narrow.clamp(low, high)
}

/// Largest emitted radiance, in the file's unit: far above the sun, well within f32.
const MAX_EMISSION: f32 = 1e12;

/// Reads every material, in file order.
pub(super) fn materials<'a>(
    root: &Object<'a>,
    textures: &mut Textures<'a, '_>,
    warnings: &mut Warnings,
) -> Result<Vec<Material>, SceneError> {
    root.objects("materials")?
        .iter()
        .enumerate()
        .map(|(index, object)| material(object, index, textures, warnings))
        .collect()
}

/// The material of a primitive that names none, by the glTF specification.
pub(super) fn default_material() -> Material {
    Material { metallic: 1.0, ..Material::default() }
}

fn material<'a>(
    object: &Object<'a>,
    index: usize,
    textures: &mut Textures<'a, '_>,
    warnings: &mut Warnings,
) -> Result<Material, SceneError> {
    let mut material = default_material();
    material.name = object.name()?.unwrap_or_else(|| format!("material {index}"));
    material.double_sided = object.flag("doubleSided")?;
    if let Some(surface) = object.object("pbrMetallicRoughness")? {
        metallic_roughness(&surface, &mut material, textures, warnings)?;
    }
    emission(object, &mut material, textures, warnings)?;
    if let Some(extension) = object.extension("KHR_materials_ior")? {
        // 0 is the extension's way to say F0 = 1.
        if extension.number("ior")? == Some(0.0) {
            material.ior = 0.0;
        } else {
            material.ior = factor(&extension, "ior", 1.5, 1.0..=1e4, warnings)?;
        }
    }
    if let Some(extension) = object.extension("KHR_materials_specular")? {
        material.specular_factor = factor(&extension, "specularFactor", 1.0, 0.0..=1.0, warnings)?;
        if let Some(values) = extension.numbers::<3>("specularColorFactor")? {
            let at = extension.path("specularColorFactor");
            material.specular_color = color(values, &at, 0.0..=1e4, warnings);
        }
        for key in ["specularTexture", "specularColorTexture"] {
            if extension.has(key) {
                warnings.push(extension.path(key), "is ignored; the factor alone is used");
            }
        }
    }
    if object.extension("KHR_materials_unlit")?.is_some() {
        material.specular_factor = 0.0;
        material.metallic = 0.0;
        material.emission = Rgb::ZERO;
        material.emission_texture = None;
        warnings.push(
            object.path("extensions.KHR_materials_unlit"),
            "an unlit surface has no physical meaning; it is lit, as diffuse with its base colour",
        );
    }
    for (name, what) in IGNORED_EXTENSIONS {
        if object.extension(name)?.is_some() {
            warnings.push(format!("{}.extensions.{name}", object.at), *what);
        }
    }
    ignored_members(object, warnings)?;
    Ok(material)
}

fn ignored_members(object: &Object<'_>, warnings: &mut Warnings) -> Result<(), SceneError> {
    if object.object("normalTexture")?.is_some() {
        warnings.push(object.path("normalTexture"), "is ignored; the mesh's normals are used");
    }
    if object.object("occlusionTexture")?.is_some() {
        warnings.push(object.path("occlusionTexture"), "is ignored; occlusion is computed");
    }
    match object.string("alphaMode")? {
        None | Some("OPAQUE") => {}
        Some(mode @ ("MASK" | "BLEND")) => warnings
            .push(object.path("alphaMode"), format!("{mode} is ignored; the surface is opaque")),
        Some(_) => {
            return Err(malformed(object.path("alphaMode"), "is not OPAQUE, MASK or BLEND"));
        }
    }
    Ok(())
}

fn metallic_roughness<'a>(
    surface: &Object<'a>,
    material: &mut Material,
    textures: &mut Textures<'a, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    if let Some([r, g, b, _]) = surface.numbers::<4>("baseColorFactor")? {
        let at = surface.path("baseColorFactor");
        material.base_color = color([r, g, b], &at, 0.0..=1.0, warnings);
    }
    material.base_color_texture = textures.slot(surface, "baseColorTexture", warnings)?;
    material.metallic = factor(surface, "metallicFactor", 1.0, 0.0..=1.0, warnings)?;
    material.roughness = factor(surface, "roughnessFactor", 1.0, 0.0..=1.0, warnings)?;
    if let Some(reference) = surface.object("metallicRoughnessTexture")? {
        let (_, image) = textures.image(&reference)?;
        let [_, roughness, metallic] = textures.images.mean(image)?;
        material.metallic *= metallic;
        material.roughness *= roughness;
        warnings.push(
            &reference.at,
            format!(
                "enters by its mean: metallic {:.3}, roughness {:.3} all over",
                material.metallic, material.roughness
            ),
        );
    }
    Ok(())
}

fn emission<'a>(
    object: &Object<'a>,
    material: &mut Material,
    textures: &mut Textures<'a, '_>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let Some(values) = object.numbers::<3>("emissiveFactor")? else {
        // The factor is black by default, whatever texture there is.
        return Ok(());
    };
    let at = object.path("emissiveFactor");
    let mut emission = color(values, &at, 0.0..=MAX_EMISSION, warnings);
    if emission.max_element() > 1.0 {
        warnings.push(
            at,
            "is above 1 and used as it is; the format keeps it to 1 and has KHR_materials_emissive_strength for more",
        );
    }
    if let Some(extension) = object.extension("KHR_materials_emissive_strength")? {
        emission *= factor(&extension, "emissiveStrength", 1.0, 0.0..=MAX_EMISSION, warnings)?;
        emission = emission.min(Rgb::splat(MAX_EMISSION));
    }
    material.emission = emission;
    if material.emits() {
        material.emission_texture = textures.slot(object, "emissiveTexture", warnings)?;
    }
    Ok(())
}
