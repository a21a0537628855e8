//! Textures in linear RGB and how a material reads them.

use crate::radiometry::Rgb;
use glam::{Mat2, Vec2};

/// What happens outside [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Periodic.
    #[default]
    Repeat,
    /// Periodic, every second copy mirrored.
    MirroredRepeat,
    /// The border texel goes on.
    ClampToEdge,
}

/// A decoded image, 8 bits a channel as stored; decoded to linear when sampled.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Width in texels, ≥ 1.
    pub width: u32,
    /// Height in texels, ≥ 1.
    pub height: u32,
    /// Rows from the top, RGB.
    pub texels: Vec<[u8; 3]>,
}

/// A material's use of a texture; the texture is sRGB-encoded colour.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Index into [`super::Scene::textures`].
    pub texture: u32,
    /// Which of the two coordinate sets.
    pub uv_set: u8,
    /// KHR_texture_transform, linear part (rotation × scale).
    pub linear: Mat2,
    /// KHR_texture_transform, offset.
    pub offset: Vec2,
    /// Wrap mode of u and v.
    pub wrap: [Wrap; 2],
    /// Nearest texel instead of bilinear.
    pub nearest: bool,
}

impl TextureSlot {
    /// A slot with bilinear filter, repeat and no transform.
    pub fn plain(texture: u32) -> Self {
        Self {
            texture,
            uv_set: 0,
            linear: Mat2::IDENTITY,
            offset: Vec2::ZERO,
            wrap: [Wrap::Repeat; 2],
            nearest: false,
        }
    }
}

/// sRGB code value to linear, IEC 61966-2-1.
pub fn srgb_to_linear(code: u8) -> f32 {
    let x = f32::from(code) / 255.0;
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

impl Wrap {
    fn texel(self, index: i64, size: i64) -> i64 {
        match self {
            Wrap::Repeat => index.rem_euclid(size),
            Wrap::ClampToEdge => index.clamp(0, size - 1),
            Wrap::MirroredRepeat => {
                let period = index.rem_euclid(2 * size);
                if period < size { period } else { 2 * size - 1 - period }
            }
        }
    }
}

impl Texture {
    /// Linear colour at a texture coordinate (v down, as glTF has it).
    pub fn sample(&self, slot: &TextureSlot, uv: Vec2) -> Rgb {
        let uv = slot.linear * uv + slot.offset;
        if !uv.is_finite() {
            return Rgb::ZERO;
        }
        let size = Vec2::new(self.width as f32, self.height as f32);
        let at = uv * size;
        if slot.nearest {
            return self.texel(slot, at.x.floor() as i64, at.y.floor() as i64);
        }
        let at = at - 0.5;
        let (x, y) = (at.x.floor(), at.y.floor());
        let (fx, fy) = (at.x - x, at.y - y);
        let (x, y) = (x as i64, y as i64);
        let top = self.texel(slot, x, y).lerp(self.texel(slot, x + 1, y), fx);
        let bottom = self.texel(slot, x, y + 1).lerp(self.texel(slot, x + 1, y + 1), fx);
        top.lerp(bottom, fy)
    }

    fn texel(&self, slot: &TextureSlot, x: i64, y: i64) -> Rgb {
        let x = slot.wrap[0].texel(x, i64::from(self.width));
        let y = slot.wrap[1].texel(y, i64::from(self.height));
        let texel = self.texels[(y * i64::from(self.width) + x) as usize];
        let linear = linear_table();
        Rgb::new(linear[texel[0] as usize], linear[texel[1] as usize], linear[texel[2] as usize])
    }
}

fn linear_table() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|code| srgb_to_linear(code as u8)))
}
