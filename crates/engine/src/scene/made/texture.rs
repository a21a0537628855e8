//! Textures by integer arithmetic, the same on every platform.

use std::io::Cursor;

/// Texels along a side of [`parquet`].
const SIDE: u32 = 128;
/// Texels across a plank.
const PLANK: u32 = 16;

/// A well mixed number of two.
pub(super) fn hash(a: u32, b: u32) -> u32 {
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b).rotate_left(13);
    for factor in [0x7feb_352d, 0x846c_a68b] {
        x = (x ^ (x >> 16)).wrapping_mul(factor);
    }
    x ^ (x >> 15)
}

/// Tileable wooden planks with grain, as a PNG of 128 × 128 texels.
pub(super) fn parquet() -> Vec<u8> {
    let mut texels = Vec::with_capacity((SIDE * SIDE * 3) as usize);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let row = y / PLANK;
            // Each row of planks begins elsewhere; two planks to a row.
            let shift = hash(row, 1) % SIDE;
            let along = (x + shift) % SIDE;
            let plank = row * 2 + along / (SIDE / 2);
            let joint = y % PLANK == 0 || along.is_multiple_of(SIDE / 2);
            let tone = 88 + hash(plank, 2) % 25;
            let grain = hash(plank * SIDE + y, 3) % 9 + hash(along / 8 + plank * SIDE, y) % 5;
            let level = if joint { tone * 5 / 9 } else { tone + grain };
            // Brown: red, green and blue in fixed proportion.
            texels.extend([
                (level * 14 / 10).min(255) as u8,
                level.min(255) as u8,
                (level * 13 / 20) as u8,
            ]);
        }
    }
    png(&texels, SIDE, image::ExtendedColorType::Rgb8)
}

/// Squares along a side of [`checker`].
pub(super) const CHECKER_SQUARES: u32 = 8;
/// Texels along a side of one.
const SQUARE: u32 = 8;

/// A tileable checker, dark and light, as a PNG of 64 × 64 texels.
pub(super) fn checker() -> Vec<u8> {
    let side = CHECKER_SQUARES * SQUARE;
    let code = |at: u32| {
        let is_dark = (at % side / SQUARE + at / side / SQUARE).is_multiple_of(2);
        if is_dark { 60 } else { 240 }
    };
    png(
        &(0..side * side).flat_map(|at| [code(at); 3]).collect::<Vec<_>>(),
        side,
        image::ExtendedColorType::Rgb8,
    )
}

/// Texels along a side of [`screen`].
const SCREEN: u32 = 64;

/// What a video screen may show: black texels and bright ones of random colour, in patches of
/// one to eight texels, as a PNG of 64 × 64 texels.
pub(super) fn screen(seed: u32) -> Vec<u8> {
    let texel = |at: u32| {
        let (x, y) = (at % SCREEN, at / SCREEN);
        // Each sixteenth of the screen has patches of its own size.
        let size = 1 << (hash(seed ^ 0x51, y / 16 * 4 + x / 16) % 4);
        let random = hash(seed, y / size * SCREEN + x / size);
        if random >> 30 == 0 { [0; 3] } else { [0, 8, 16].map(|shift| (random >> shift) as u8) }
    };
    png(
        &(0..SCREEN * SCREEN).flat_map(texel).collect::<Vec<_>>(),
        SCREEN,
        image::ExtendedColorType::Rgb8,
    )
}

/// A square PNG of `side` × `side` texels.
pub(super) fn png(texels: &[u8], side: u32, kind: image::ExtendedColorType) -> Vec<u8> {
    let mut png = Cursor::new(Vec::new());
    let format = image::ImageFormat::Png;
    image::write_buffer_with_format(&mut png, texels, side, side, kind, format)
        .expect("a PNG of fixed size in memory can be written");
    png.into_inner()
}
