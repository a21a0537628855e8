//! Letters of 8 × 8 pixels, so that pictures get their text without fonts of the system.

use font8x8::{BASIC_FONTS, GREEK_FONTS, LATIN_FONTS, UnicodeFonts};

/// Width and height of a letter, pixels.
pub const SIDE: u32 = 8;

/// Rows of a letter from the top, the lowest bit on the left; `?` where there is none.
pub fn rows(letter: char) -> [u8; 8] {
    let letter = match letter {
        '–' | '—' | '−' => '-',
        '…' => '.',
        '’' | '‘' => '\'',
        '“' | '”' => '"',
        '\u{a0}' => ' ',
        other => other,
    };
    let fonts = [BASIC_FONTS.get(letter), LATIN_FONTS.get(letter), GREEK_FONTS.get(letter)];
    fonts.into_iter().flatten().next().or_else(|| BASIC_FONTS.get('?')).unwrap_or_default()
}

/// How much of the point (`x`, `y`) of a letter is ink, 0 to 1, its corners being (0, 0) and
/// (1, 1): the bitmap with its steps rounded, for letters larger than the bitmap.
pub fn coverage(rows: &[u8; 8], x: f32, y: f32, softness: f32) -> f32 {
    let pixel = |column: i32, row: i32| {
        let inside = (0..8).contains(&column) && (0..8).contains(&row);
        f32::from(u8::from(inside && rows[row.max(0) as usize % 8] & (1 << (column & 7)) != 0))
    };
    let (u, v) = (x * 8.0 - 0.5, y * 8.0 - 0.5);
    let (column, row) = (u.floor() as i32, v.floor() as i32);
    let (fu, fv) = (u - u.floor(), v - v.floor());
    let line = |row: i32| pixel(column, row) * (1.0 - fu) + pixel(column + 1, row) * fu;
    let smooth = line(row) * (1.0 - fv) + line(row + 1) * fv;
    ((smooth - 0.5) / softness.max(1e-3) + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_letters_have_a_shape_and_unknown_ones_a_question_mark() {
        for letter in "aZ09.×±²µπ–".chars() {
            assert_ne!(rows(letter), rows('?'), "{letter}");
        }
        assert_eq!(rows('語'), rows('?'));
        assert_eq!(rows('−'), rows('-'));
    }

    #[test]
    fn enlarged_letters_keep_their_pixels() {
        let letter = rows('E');
        for (row, bits) in letter.iter().enumerate() {
            for column in 0..8 {
                let center = |k: usize| (k as f32 + 0.5) / 8.0;
                let ink = coverage(&letter, center(column), center(row), 0.5);
                assert_eq!(ink, f32::from(u8::from(bits & (1 << column) != 0)));
            }
        }
        assert_eq!(coverage(&letter, -3.0, 0.5, 0.5), 0.0);
    }
}
