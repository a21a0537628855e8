//! Contact sheets: pictures side by side at one exposure a row, with labels.

use crate::letters;
use hemilux_engine::image::{Picture, linear_to_srgb};
use hemilux_engine::radiometry::Rgb;
use image::{ImageError, RgbImage};

/// Side of a letter, pixels.
const LETTER: u32 = letters::SIDE;
/// Space around a line of text, and between cells.
const GAP: u32 = 4;
const PAPER: image::Rgb<u8> = image::Rgb([250, 250, 250]);
const INK: image::Rgb<u8> = image::Rgb([20, 20, 20]);

/// A row of cells at one exposure.
#[derive(Clone, Debug)]
pub struct Row {
    /// Above the row.
    pub title: String,
    /// Radiance is multiplied by this.
    pub exposure: f32,
    /// Label (one line or more) and picture of each cell.
    pub cells: Vec<(String, Picture)>,
}

/// The sheet as PNG, each pixel of a picture `scale` × `scale` pixels.
///
/// # Errors
/// Where the encoder fails.
pub fn png(rows: &[Row], scale: u32) -> Result<Vec<u8>, ImageError> {
    let cells = || rows.iter().flat_map(|row| &row.cells);
    let letters =
        |text: &str| text.lines().map(|l| l.chars().count()).max().unwrap_or(0) as u32 * LETTER;
    // All columns of the sheet are as wide as the widest.
    let column = cells()
        .map(|(label, picture)| (picture.width * scale).max(letters(label)))
        .max()
        .unwrap_or(0)
        + 2 * GAP;
    let row_width = |row: &Row| (row.cells.len() as u32 * column).max(letters(&row.title) + GAP);
    let text_height = |lines: usize| lines as u32 * (LETTER + 2) + GAP;
    let label_lines = |row: &Row| row.cells.iter().map(|c| c.0.lines().count()).max().unwrap_or(0);
    let picture_height =
        |row: &Row| row.cells.iter().map(|c| c.1.height * scale).max().unwrap_or(0);
    let row_height =
        |row: &Row| text_height(1) + text_height(label_lines(row)) + picture_height(row) + 2 * GAP;
    let width = GAP + rows.iter().map(row_width).max().unwrap_or(0);
    let height = GAP + rows.iter().map(row_height).sum::<u32>();

    let mut sheet = RgbImage::from_pixel(width, height, PAPER);
    let mut y = GAP;
    for row in rows {
        write(&mut sheet, GAP, y, &row.title);
        let labels = y + text_height(1);
        let pictures = labels + text_height(label_lines(row));
        let mut x = GAP;
        for cell in &row.cells {
            for (line, text) in cell.0.lines().enumerate() {
                write(&mut sheet, x, labels + line as u32 * (LETTER + 2), text);
            }
            paste(&mut sheet, (x, pictures), &cell.1, row.exposure, scale);
            x += column;
        }
        y += row_height(row);
    }
    crate::raster::png(&sheet)
}

fn write(sheet: &mut RgbImage, x: u32, y: u32, text: &str) {
    for (letter, left) in text.chars().zip((x..).step_by(LETTER as usize)) {
        for (row, bits) in (y..).zip(letters::rows(letter)) {
            for bit in (0..LETTER).filter(|bit| bits & (1 << bit) != 0) {
                sheet.put_pixel(left + bit, row, INK);
            }
        }
    }
}

fn paste(sheet: &mut RgbImage, (x, y): (u32, u32), picture: &Picture, exposure: f32, scale: u32) {
    for row in 0..picture.height * scale {
        for column in 0..picture.width * scale {
            let at = (row / scale * picture.width + column / scale) as usize;
            let code = (picture.pixels[at] * exposure).to_array().map(linear_to_srgb);
            sheet.put_pixel(x + column, y + row, image::Rgb(code));
        }
    }
}

/// A rectangle of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Width and height.
    pub side: u32,
}

impl Window {
    /// The window of `side` pixels with the largest sum of `weights` (one a pixel).
    pub fn heaviest(weights: &[f64], width: u32, height: u32, side: u32) -> Self {
        let side = side.min(width).min(height);
        let (columns, step) = (width as usize, (side / 8).max(1) as usize);
        let mut best = (f64::NEG_INFINITY, Self { x: 0, y: 0, side });
        for y in (0..=(height - side)).step_by(step) {
            for x in (0..=(width - side)).step_by(step) {
                let rows = y as usize..(y + side) as usize;
                let sum = rows
                    .map(|row| &weights[row * columns + x as usize..][..side as usize])
                    .map(|row| row.iter().sum::<f64>())
                    .sum();
                if sum > best.0 {
                    best = (sum, Self { x, y, side });
                }
            }
        }
        best.1
    }

    /// That part of a picture.
    pub fn crop(&self, picture: &Picture) -> Picture {
        let row = |y: u32| {
            let begin = ((self.y + y) * picture.width + self.x) as usize;
            &picture.pixels[begin..][..self.side as usize]
        };
        let pixels = (0..self.side).flat_map(|y| row(y).iter().copied()).collect();
        Picture::new(self.side, self.side, pixels)
    }
}

/// A picture of `factor` times fewer pixels a side; whole blocks of pixels are averaged.
///
/// # Errors
/// Where the sides are not multiples of `factor`.
pub fn reduced(picture: &Picture, factor: u32) -> Result<Picture, String> {
    let (width, height) = (picture.width / factor, picture.height / factor);
    if (width * factor, height * factor) != (picture.width, picture.height) {
        let (w, h) = (picture.width, picture.height);
        return Err(format!("{w}×{h} pixels can't be reduced {factor} times"));
    }
    let mut reduced = Picture::black(width, height);
    let share = 1.0 / (factor * factor) as f32;
    for (at, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (at as u32 % picture.width / factor, at as u32 / picture.width / factor);
        let sum: &mut Rgb = &mut reduced.pixels[(y * width + x) as usize];
        *sum += *pixel * share;
    }
    Ok(reduced)
}

/// A picture of `factor` times fewer pixels a side, at least one; blocks at the right and the
/// lower edge may be smaller than the others.
pub fn shrunk(picture: &Picture, factor: u32) -> Picture {
    let factor = factor.max(1);
    let (width, height) = (picture.width.div_ceil(factor), picture.height.div_ceil(factor));
    let mut small = Picture::black(width, height);
    let mut counts = vec![0u32; small.pixels.len()];
    for (at, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (at as u32 % picture.width / factor, at as u32 / picture.width / factor);
        let slot = (y * width + x) as usize;
        small.pixels[slot] += *pixel;
        counts[slot] += 1;
    }
    small.pixels.iter_mut().zip(counts).for_each(|(sum, count)| *sum /= count.max(1) as f32);
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> Picture {
        let pixels = (0..width * height).map(|i| Rgb::splat(i as f32)).collect();
        Picture::new(width, height, pixels)
    }

    #[test]
    fn a_sheet_shows_pictures_at_the_rows_exposure() {
        let mut picture = Picture::black(3, 2);
        picture.pixels[4] = Rgb::new(0.25, 0.0, 0.0);
        let row = Row {
            title: "row".into(),
            exposure: 4.0,
            cells: vec![("a".into(), picture), ("b\nc".into(), Picture::black(3, 2))],
        };
        let bytes = png(&[row], 2).unwrap();
        let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
        let red = decoded.pixels().filter(|p| p.0 == [255, 0, 0]).count();
        let black = decoded.pixels().filter(|p| p.0 == [0, 0, 0]).count();
        assert_eq!((red, black), (4, 5 * 4 + 6 * 4));
        assert!(decoded.pixels().any(|p| *p == INK), "no text");
    }

    #[test]
    fn the_heaviest_window_is_found_and_cropped() {
        let mut weights = vec![0.0; 16 * 16];
        weights[9 * 16 + 12] = 5.0;
        weights[10 * 16 + 13] = 4.0;
        let window = Window::heaviest(&weights, 16, 16, 4);
        assert!((window.x..window.x + 4).contains(&12) && (window.y..window.y + 4).contains(&10));
        let crop = Window { x: 1, y: 1, side: 2 }.crop(&ramp(4, 4));
        assert_eq!(crop.pixels.iter().map(|p| p.x).collect::<Vec<_>>(), [5.0, 6.0, 9.0, 10.0]);
    }

    #[test]
    fn reduction_averages_blocks() {
        let small = reduced(&ramp(4, 2), 2).unwrap();
        assert_eq!(small.pixels.iter().map(|p| p.y).collect::<Vec<_>>(), [2.5, 4.5]);
        assert!(reduced(&ramp(5, 2), 2).is_err());
        let cut = shrunk(&ramp(5, 2), 2);
        assert_eq!((cut.width, cut.height), (3, 1));
        assert_eq!(cut.pixels.iter().map(|p| p.z).collect::<Vec<_>>(), [3.0, 5.0, 6.5]);
    }
}
