//! Filters: what turns decoded attributes into what accessors read.

use serde::Deserialize;

/// What is done to every element after decoding.
#[derive(Clone, Copy, Default, Deserialize, PartialEq)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum Filter {
    /// Nothing.
    #[default]
    None,
    /// Unit vectors from the octahedron that they are projected to.
    Octahedral,
    /// Unit quaternions from their three lesser components.
    Quaternion,
    /// Floating point numbers from an exponent and a mantissa.
    Exponential,
    /// Red, green and blue from luma and two differences.
    Color,
}

impl Filter {
    /// Whether elements may have so many bytes.
    pub fn fits(self, stride: usize) -> bool {
        match self {
            Self::None => true,
            Self::Octahedral | Self::Color => matches!(stride, 4 | 8),
            Self::Quaternion => stride == 8,
            Self::Exponential => stride.is_multiple_of(4),
        }
    }

    /// Filters elements of `stride` bytes in place.
    pub fn apply(self, bytes: &mut [u8], stride: usize) {
        let short = |pair: &[u8]| i32::from(i16::from_le_bytes([pair[0], pair[1]]));
        match (self, stride) {
            (Self::None, _) => {}
            (Self::Exponential, _) => {
                for number in bytes.as_chunks_mut::<4>().0 {
                    *number = exponential(i32::from_le_bytes(*number)).to_le_bytes();
                }
            }
            (Self::Octahedral, 4) => {
                for element in bytes.as_chunks_mut::<4>().0 {
                    let [x, y, z] =
                        octahedral([0, 1, 2].map(|i| i32::from(element[i] as i8)), 127.0);
                    element[..3].copy_from_slice(&[x as i8 as u8, y as i8 as u8, z as i8 as u8]);
                }
            }
            (Self::Color, 4) => {
                for element in bytes.as_chunks_mut::<4>().0 {
                    let [y, co, cg, a] = *element;
                    let stored = [y.into(), (co as i8).into(), (cg as i8).into(), a.into()];
                    *element = color(stored, 255.0).map(|code| code as u8);
                }
            }
            (Self::Octahedral, _) => shorts(bytes, |element| {
                let [x, y, z, w] = element.map(|pair| short(&pair));
                let [x, y, z] = octahedral([x, y, z], 32767.0);
                [x, y, z, w]
            }),
            (Self::Quaternion, _) => {
                shorts(bytes, |element| quaternion(element.map(|pair| short(&pair))))
            }
            (Self::Color, _) => shorts(bytes, |element| {
                let whole = |pair: [u8; 2]| i32::from(u16::from_le_bytes(pair));
                let [y, co, cg, a] = element;
                color([whole(y), short(&co), short(&cg), whole(a)], 65535.0)
            }),
        }
    }
}

/// Filters elements of four components of 16 bits.
fn shorts(bytes: &mut [u8], filter: impl Fn([[u8; 2]; 4]) -> [i32; 4]) {
    for element in bytes.as_chunks_mut::<8>().0 {
        let [a, b, c, d, e, f, g, h] = *element;
        let filtered = filter([[a, b], [c, d], [e, f], [g, h]]);
        for (pair, value) in element.as_chunks_mut::<2>().0.iter_mut().zip(filtered) {
            *pair = (value as u16).to_le_bytes();
        }
    }
}

/// 2ᵉ·m of an exponent in the highest 8 bits and a mantissa in the others, both with signs.
fn exponential(stored: i32) -> f32 {
    let (exponent, mantissa) = (stored >> 24, stored << 8 >> 8);
    (f64::from(mantissa) * 2f64.powi(exponent)) as f32
}

/// A unit vector times `full`, of two components and what stands for 1.
fn octahedral([x, y, one]: [i32; 3], full: f32) -> [i32; 3] {
    let one = one as f32;
    let (mut x, mut y) = (x as f32 / one, y as f32 / one);
    let z = 1.0 - x.abs() - y.abs();
    // The lower half of the octahedron is folded over the upper.
    let fold = z.min(0.0);
    x -= fold.copysign(x);
    y -= fold.copysign(y);
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|component| (component / length * full).round() as i32)
}

/// A unit quaternion of its three lesser components; the last number has what stands for 1 and, in
/// its two lowest bits, which component is left out.
fn quaternion([a, b, c, last]: [i32; 4]) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (last | 3) as f32;
    let [x, y, z] = [a, b, c].map(|component| component as f32 * scale);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let mut filtered = [0; 4];
    for (turn, component) in [w, x, y, z].into_iter().enumerate() {
        filtered[((last & 3) as usize + turn) % 4] = (component * 32767.0).round() as i32;
    }
    filtered
}

/// Red, green, blue and alpha up to `full`, of luma, two differences, and alpha below a bit that
/// says how many bits all have.
fn color([y, co, cg, alpha]: [i32; 4], full: f32) -> [i32; 4] {
    // As many ones as the numbers have bits; none where there is no such bit, which is nonsense.
    let most = (1i32 << (i32::BITS - alpha.leading_zeros())) - 1;
    let a = alpha & (most >> 1);
    let scale = full / most.max(1) as f32;
    [y + co - cg, y + cg, y - co - cg, a << 1 | a & 1]
        .map(|code| (code as f32 * scale).round().clamp(0.0, full) as i32)
}
