//! Diffuse transmission (KHR_materials_diffuse_transmission): light that a sheet such as paper or a
//! leaf lets through and scatters to all directions of its other side.

use super::texture::TextureSlot;
use crate::radiometry::Rgb;
use glam::Vec4;

/// How a material lets light through diffusely, by its factors and textures.
#[derive(Clone, Copy, Debug)]
pub struct Translucency {
    /// Share of what is not reflected by a lobe that goes to the other side, in [0, 1].
    pub share: f32,
    /// Its alpha multiplies the share.
    pub share_texture: Option<TextureSlot>,
    /// What is left of the light that goes through, linear, in [0, 1].
    pub color: Rgb,
    /// Multiplies the colour; sRGB.
    pub color_texture: Option<TextureSlot>,
}

impl Translucency {
    /// So much of white light.
    pub fn plain(share: f32, color: Rgb) -> Self {
        Self { share, share_texture: None, color, color_texture: None }
    }

    /// The textures that say what it is at a point.
    pub fn slots(&self) -> impl Iterator<Item = &TextureSlot> {
        [&self.share_texture, &self.color_texture].into_iter().flatten()
    }

    /// The share at a point where `sample` says what a texture is there.
    pub fn share_at(&self, sample: impl Fn(&TextureSlot) -> Vec4) -> f32 {
        let texel = self.share_texture.as_ref().map_or(1.0, |slot| sample(slot).w);
        (self.share * texel).clamp(0.0, 1.0)
    }

    /// The colour at a point, likewise.
    pub fn color_at(&self, sample: impl Fn(&TextureSlot) -> Vec4) -> Rgb {
        let texel = self.color_texture.as_ref().map_or(Rgb::ONE, |slot| sample(slot).truncate());
        (self.color * texel).clamp(Rgb::ZERO, Rgb::ONE)
    }
}
