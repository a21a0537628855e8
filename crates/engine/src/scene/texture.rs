//! Textures and how a material reads them.

use crate::radiometry::Rgb;
use glam::{Mat2, Vec2, Vec4};

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

/// What the stored codes of red, green and blue mean. Alpha is linear in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Encoding {
    /// Colour, encoded as sRGB has it.
    #[default]
    Srgb,
    /// Data: the code over 255.
    Linear,
}

/// A decoded image, 8 bits a channel as stored; decoded to linear when sampled.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Width in texels, ≥ 1.
    pub width: u32,
    /// Height in texels, ≥ 1.
    pub height: u32,
    /// Rows from the top, RGBA; alpha is not multiplied into the colour.
    pub texels: Vec<[u8; 4]>,
}

/// A material's use of a texture.
#[derive(Clone, Copy, Debug)]
pub struct TextureSlot {
    /// Index into [`super::Scene::textures`].
    pub texture: u32,
    /// How the texels are to be read; one texture may be read in both ways.
    pub encoding: Encoding,
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

/// A texture that tilts the shading normal.
#[derive(Clone, Copy, Debug)]
pub struct NormalMap {
    /// Red and green are the tilt along tangent and bitangent, blue is along the normal, each from
    /// −1 to 1; linear.
    pub slot: TextureSlot,
    /// Factor of red and green.
    pub scale: f32,
}

impl TextureSlot {
    /// A colour slot with bilinear filter, repeat and no transform.
    pub fn plain(texture: u32) -> Self {
        Self {
            texture,
            encoding: Encoding::Srgb,
            uv_set: 0,
            linear: Mat2::IDENTITY,
            offset: Vec2::ZERO,
            wrap: [Wrap::Repeat; 2],
            nearest: false,
        }
    }

    /// The same for data instead of colour.
    pub fn data(texture: u32) -> Self {
        Self { encoding: Encoding::Linear, ..Self::plain(texture) }
    }

    /// Where in the texture a coordinate of the mesh leads.
    pub fn transformed(&self, uv: Vec2) -> Vec2 {
        self.linear * uv + self.offset
    }
}

/// sRGB code value to linear, IEC 61966-2-1.
pub fn srgb_to_linear(code: u8) -> f32 {
    let x = f32::from(code) / 255.0;
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

impl Encoding {
    /// Linear colour and alpha that stored codes mean.
    pub(crate) fn decode(self, [red, green, blue, alpha]: [u8; 4]) -> Vec4 {
        let data = |code: u8| f32::from(code) / 255.0;
        match self {
            Encoding::Linear => Vec4::new(data(red), data(green), data(blue), data(alpha)),
            Encoding::Srgb => {
                let linear = linear_table();
                let color = |code: u8| linear[code as usize];
                Vec4::new(color(red), color(green), color(blue), data(alpha))
            }
        }
    }
}

impl Wrap {
    /// The texel of an image of `size` texels that stands at any index.
    #[inline]
    pub(crate) fn texel(self, index: i64, size: i64) -> i64 {
        // Most are: a division takes longer than all else that reading a texel takes.
        if (0..size).contains(&index) {
            return index;
        }
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
        self.sample_rgba(slot, uv).truncate()
    }

    /// Linear colour and alpha at a texture coordinate; black and opaque where that overflows.
    pub fn sample_rgba(&self, slot: &TextureSlot, uv: Vec2) -> Vec4 {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let at = slot.transformed(uv) * size;
        if !at.is_finite() {
            return Vec4::W;
        }
        if slot.nearest {
            return self.texel(slot, floor(at.x) as i64, floor(at.y) as i64);
        }
        let at = at - 0.5;
        let (x, y) = (floor(at.x), floor(at.y));
        let (fx, fy) = (at.x - x, at.y - y);
        let (x, y) = (x as i64, y as i64);
        let top = self.texel(slot, x, y).lerp(self.texel(slot, x.saturating_add(1), y), fx);
        let below = y.saturating_add(1);
        let bottom =
            self.texel(slot, x, below).lerp(self.texel(slot, x.saturating_add(1), below), fx);
        top.lerp(bottom, fy)
    }

    fn texel(&self, slot: &TextureSlot, x: i64, y: i64) -> Vec4 {
        let x = slot.wrap[0].texel(x, i64::from(self.width));
        let y = slot.wrap[1].texel(y, i64::from(self.height));
        slot.encoding.decode(self.texels[(y * i64::from(self.width) + x) as usize])
    }
}

/// The greatest whole number that is no greater: `f32::floor` without the call that it is on processors
/// of before 2008, which the program is compiled for.
#[inline]
pub(crate) fn floor(x: f32) -> f32 {
    /// From here on all numbers are whole.
    const WHOLE: f32 = (1u32 << 23) as f32;
    if x.is_nan() || x.abs() >= WHOLE {
        return x;
    }
    let towards_zero = x as i32 as f32;
    if towards_zero > x { towards_zero - 1.0 } else { towards_zero }
}

fn linear_table() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|code| srgb_to_linear(code as u8)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One image, read as colour and as data: the colour is decoded, alpha never is.
    #[test]
    fn an_image_is_read_both_ways() {
        let texels = vec![[188, 188, 0, 64], [188, 188, 0, 128]];
        let texture = Texture { width: 2, height: 1, texels };
        let middle = Vec2::new(0.5, 0.5);
        let color = texture.sample_rgba(&TextureSlot::plain(0), middle);
        assert!((color.x - srgb_to_linear(188)).abs() < 1e-6 && color.z == 0.0);
        let data = texture.sample_rgba(&TextureSlot::data(0), middle);
        assert!((data.x - 188.0 / 255.0).abs() < 1e-6);
        for sampled in [color, data] {
            assert!((sampled.w - 96.0 / 255.0).abs() < 1e-6, "{sampled}");
        }
    }

    #[test]
    fn floors_are_floors() {
        for x in
            [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.75, -2.75, 8_388_607.5, -8_388_607.5, 3e9, -3e9]
        {
            assert_eq!(floor(x), x.floor(), "{x}");
        }
        assert_eq!(floor(f32::INFINITY), f32::INFINITY);
        assert!(floor(f32::NAN).is_nan());
    }

    /// Coordinates beyond what a number holds must not stop the program.
    #[test]
    fn far_coordinates_are_read_without_a_panic() {
        let texture = Texture { width: 2, height: 2, texels: vec![[255; 4]; 4] };
        for far in [1e30, -1e30, f32::MAX, f32::INFINITY, f32::NAN] {
            for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
                let slot = TextureSlot { wrap: [wrap; 2], ..TextureSlot::plain(0) };
                let sampled = texture.sample_rgba(&slot, Vec2::splat(far));
                assert!(sampled.w == 1.0 && sampled.x.is_finite(), "{far} {sampled}");
            }
        }
    }
}
