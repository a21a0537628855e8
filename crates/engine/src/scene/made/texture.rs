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
    let mut png = Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut png,
        &texels,
        SIDE,
        SIDE,
        image::ExtendedColorType::Rgb8,
        image::ImageFormat::Png,
    )
    .expect("a PNG of fixed size in memory can be written");
    png.into_inner()
}
