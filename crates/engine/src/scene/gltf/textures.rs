//! What a material's references to textures lead to.

use super::document::{malformed, valid};
use super::factors::factor;
use super::picture::Images;
use super::warnings::Warnings;
use crate::scene::{Encoding, NormalMap, SceneError, TextureSlot, Wrap};
use glam::{Mat2, Vec2};
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::NormalTexture;
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{self, Root};

/// Extensions that name an image to be taken instead of the one that all readers know, the best last.
const SOURCES: [&str; 2] = ["KHR_texture_basisu", "EXT_texture_webp"];

/// Largest factor of a normal map's tilt: beyond it every tilt is a right angle.
const MAX_NORMAL_SCALE: f32 = 1e6;

/// A material's reference to a texture, of whatever kind.
pub(super) struct Reference {
    /// Index of the texture.
    index: usize,
    /// Its set of texture coordinates, unless the transform has another.
    set: u32,
    transform: Option<TextureTransform>,
    /// Its place in the file.
    pub at: String,
}

impl Reference {
    /// A reference to colour or data.
    pub fn new(info: &Info, at: String) -> Self {
        let extensions = info.extensions.as_ref();
        let transform = extensions.and_then(|all| all.texture_transform.clone());
        Self { index: info.index.value(), set: info.tex_coord, transform, at }
    }

    /// The reference to a normal map, whose extensions the crate leaves untyped.
    pub fn to_normals(info: &NormalTexture, at: String) -> Result<Self, SceneError> {
        let extensions = info.extensions.as_ref();
        let transform = extensions.and_then(|all| all.others.get("KHR_texture_transform"));
        let transform = transform.map(|value| serde_json::from_value(value.clone())).transpose();
        let transform = transform.map_err(|error| {
            let at = format!("{at}.extensions.KHR_texture_transform");
            malformed(at, super::document::clip(&error.to_string()))
        })?;
        Ok(Self { index: info.index.value(), set: info.tex_coord, transform, at })
    }
}

/// Everything that a material may refer to.
pub(super) struct Textures<'a, 'i> {
    /// The file.
    pub root: &'a Root,
    /// Its images.
    pub images: &'i mut Images<'a>,
}

impl<'a> Textures<'a, '_> {
    /// The texture that a reference leads to, and its image; `None`, with a warning, where it has no
    /// source that can be read.
    fn image(
        &self,
        reference: &Reference,
        warnings: &mut Warnings,
    ) -> Result<Option<(&'a json::Texture, usize)>, SceneError> {
        let index = reference.index;
        let Some(texture) = self.root.textures.get(index) else {
            let what = format!("{index}, but there are {} textures", self.root.textures.len());
            return Err(malformed(format!("{}.index", reference.at), what));
        };
        let at = || format!("textures[{index}]");
        let mut image = texture.source.value();
        let extensions = texture.extensions.as_ref();
        for name in SOURCES {
            let object = extensions.and_then(|all| all.others.get(name));
            let Some(source) = object.and_then(|object| object.get("source")) else { continue };
            let index = source.as_u64().and_then(|source| usize::try_from(source).ok());
            image = index.filter(|index| self.images.has(*index)).ok_or_else(|| {
                let at = format!("{}.extensions.{name}.source", at());
                malformed(at, "is not the index of an image")
            })?;
        }
        if !self.images.has(image) {
            let what = "has no PNG, JPEG, WebP or KTX2 source; surfaces are shown without it, export textures as one of these";
            warnings.push(at(), what);
            return Ok(None);
        }
        if let Some(what) = self.images.missing(image) {
            let what =
                format!("{what}; surfaces are shown without it, send it along under this name");
            warnings.push(format!("images[{image}].uri"), what);
            return Ok(None);
        }
        Ok(Some((texture, image)))
    }

    /// A texture as a material uses it; `None` where it cannot be had, as if none were named.
    pub fn slot(
        &mut self,
        reference: &Reference,
        encoding: Encoding,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureSlot>, SceneError> {
        let Some((texture, image)) = self.image(reference, warnings)? else { return Ok(None) };
        let place = self.images.texture(image)?;
        let slot = TextureSlot { encoding, ..TextureSlot::plain(place) };
        self.placed(slot, texture, reference, warnings).map(Some)
    }

    /// A normal map as a material uses it.
    pub fn normal_map(
        &mut self,
        info: &NormalTexture,
        at: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<NormalMap>, SceneError> {
        let reference = Reference::to_normals(info, at.to_owned())?;
        let slot = self.slot(&reference, Encoding::Linear, warnings)?;
        let Some(slot) = slot else { return Ok(None) };
        let range = -MAX_NORMAL_SCALE..=MAX_NORMAL_SCALE;
        let scale = factor(info.scale, &format!("{at}.scale"), range, warnings);
        Ok(Some(NormalMap { slot, scale }))
    }

    /// The texture of roughness that a texture with glossiness in its alpha says, as a material
    /// uses it; see [`Images::roughness`].
    pub fn roughness_slot(
        &mut self,
        reference: &Reference,
        glossiness: f32,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureSlot>, SceneError> {
        let Some((texture, image)) = self.image(reference, warnings)? else { return Ok(None) };
        let slot = TextureSlot::data(self.images.roughness(image, glossiness)?);
        self.placed(slot, texture, reference, warnings).map(Some)
    }

    /// A slot with the coordinates, the transform and the sampler that the file gives it.
    fn placed(
        &self,
        mut slot: TextureSlot,
        texture: &json::Texture,
        reference: &Reference,
        warnings: &mut Warnings,
    ) -> Result<TextureSlot, SceneError> {
        let at = &reference.at;
        let mut set = reference.set;
        if let Some(transform) = &reference.transform {
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
