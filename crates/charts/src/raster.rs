//! A canvas of pixels for plotters, with smooth edges and its own letters: charts as PNG.

use crate::letters;
use image::{ImageFormat, RgbImage};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};
use std::convert::Infallible;
use std::io::Cursor;

/// Letters advance by this share of the font size.
const ADVANCE: f32 = 0.6;
/// Height of a letter's 8 rows, as a share of the font size.
const LETTER_HEIGHT: f32 = 0.82;
/// Rows of a letter above its base line, of 8.
const ABOVE_BASE: f32 = 7.0 / 8.0;
/// Plotters gives sizes of fonts, which its SVG backend makes smaller by this.
const FONT_SCALE: f64 = 1.24;
/// Samples a pixel has down and across where polygons are filled.
const SAMPLES: i32 = 4;

/// An RGB image that is drawn to in units of `scale` pixels.
pub struct Raster<'a> {
    image: &'a mut RgbImage,
    scale: u32,
}

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

impl<'a> Raster<'a> {
    /// A canvas over an image whose sides are multiples of `scale`.
    pub fn new(image: &'a mut RgbImage, scale: u32) -> Self {
        Self { image, scale: scale.max(1) }
    }

    /// The middle of a unit, in pixels.
    fn center(&self, at: BackendCoord) -> [f32; 2] {
        let scale = self.scale as f32;
        [(at.0 as f32 + 0.5) * scale, (at.1 as f32 + 0.5) * scale]
    }

    fn blend(&mut self, x: i32, y: i32, color: BackendColor, coverage: f32) {
        let (width, height) = self.image.dimensions();
        if x < 0 || y < 0 || x >= width as i32 || y >= height as i32 || coverage <= 0.0 {
            return;
        }
        let share = coverage.min(1.0) * color.alpha as f32;
        let pixel = self.image.get_pixel_mut(x as u32, y as u32);
        let (r, g, b) = color.rgb;
        for (old, new) in pixel.0.iter_mut().zip([r, g, b]) {
            let mixed = f32::from(*old) + (f32::from(new) - f32::from(*old)) * share;
            *old = mixed.round() as u8;
        }
    }

    /// Blends every pixel of a rectangle by how much of it is covered.
    fn cover(
        &mut self,
        low: [f32; 2],
        high: [f32; 2],
        color: BackendColor,
        coverage: impl Fn([f32; 2]) -> f32,
    ) {
        let (width, height) = self.image.dimensions();
        let span = |low: f32, high: f32, size: u32| {
            (low.floor().max(0.0) as i32)..(high.ceil().min(size as f32) as i32)
        };
        for y in span(low[1], high[1], height) {
            for x in span(low[0], high[0], width) {
                let share = coverage([x as f32 + 0.5, y as f32 + 0.5]);
                self.blend(x, y, color, share);
            }
        }
    }

    /// Lines along `points`, in pixels, each pixel blended once however the lines cross in it.
    fn stroke(&mut self, points: &[[f32; 2]], width: f32, color: BackendColor) {
        let reach = 0.5 * width + 1.0;
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f32::INFINITY, f32::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f32::NEG_INFINITY, f32::max);
        let (left, right, top, bottom) = (low(0), high(0), low(1), high(1));
        let size = (self.image.width() as usize, self.image.height() as usize);
        let columns = (left - reach).floor().max(0.0) as usize
            ..((right + reach).ceil().max(0.0) as usize).min(size.0);
        let rows = (top - reach).floor().max(0.0) as usize
            ..((bottom + reach).ceil().max(0.0) as usize).min(size.1);
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let mut shares = vec![0f32; columns.len() * rows.len()];
        for pair in points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let clip = |from: f32, to: f32, within: &std::ops::Range<usize>| {
                let first = (from.min(to) - reach).floor().max(within.start as f32) as usize;
                let last = (from.max(to) + reach).ceil().max(0.0) as usize;
                first.min(within.end)..last.clamp(within.start, within.end)
            };
            for y in clip(a[1], b[1], &rows) {
                for x in clip(a[0], b[0], &columns) {
                    let away = distance([x as f32 + 0.5, y as f32 + 0.5], a, b);
                    let share = (0.5 * width + 0.5 - away).clamp(0.0, 1.0).min(width);
                    let slot = &mut shares[(y - rows.start) * columns.len() + x - columns.start];
                    *slot = slot.max(share);
                }
            }
        }
        for (at, share) in shares.iter().enumerate() {
            let (x, y) = (columns.start + at % columns.len(), rows.start + at / columns.len());
            self.blend(x as i32, y as i32, color, *share);
        }
    }
}

/// Distance of a point from a segment.
fn distance(p: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let from = [p[0] - a[0], p[1] - a[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let share = match length > 0.0 {
        true => ((from[0] * along[0] + from[1] * along[1]) / length).clamp(0.0, 1.0),
        false => 0.0,
    };
    (from[0] - share * along[0]).hypot(from[1] - share * along[1])
}

/// Whether a point is inside a polygon, by crossings.
fn inside(p: [f32; 2], corners: &[[f32; 2]]) -> bool {
    let next = corners.iter().cycle().skip(1);
    let crossings = corners.iter().zip(next).filter(|(a, b)| {
        let crosses = (a[1] > p[1]) != (b[1] > p[1]);
        crosses && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    });
    crossings.count() % 2 == 1
}

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.image.width() / self.scale, self.image.height() / self.scale)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn {
        let scale = self.scale as f32;
        let low = [point.0 as f32 * scale, point.1 as f32 * scale];
        self.cover(low, low.map(|x| x + scale), color, |_| 1.0);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let color = style.color();
        if color.alpha > 0.0 {
            let points: Vec<[f32; 2]> = path.into_iter().map(|at| self.center(at)).collect();
            self.stroke(&points, (style.stroke_width() * self.scale) as f32, color);
        }
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let ((left, top), (right, bottom)) = (upper_left, bottom_right);
        if fill {
            let scale = self.scale as f32;
            let low = [left as f32 * scale, top as f32 * scale];
            let high = [right as f32 * scale, bottom as f32 * scale];
            self.cover(low, high, style.color(), |_| 1.0);
            return Ok(());
        }
        self.draw_path(
            [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)],
            style,
        )
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let middle = self.center(center);
        let radius = (radius * self.scale) as f32;
        let half = 0.5 * (style.stroke_width() * self.scale) as f32;
        let outer = radius + if fill { 0.0 } else { half } + 1.0;
        let (low, high) = (middle.map(|x| x - outer), middle.map(|x| x + outer));
        self.cover(low, high, style.color(), |p| {
            let away = (p[0] - middle[0]).hypot(p[1] - middle[1]);
            let edge = if fill { radius - away } else { half - (away - radius).abs() };
            (edge + 0.5).clamp(0.0, 1.0)
        });
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        let corners: Vec<[f32; 2]> = corners.into_iter().map(|at| self.center(at)).collect();
        if corners.len() < 3 {
            return Ok(());
        }
        let low = |axis: usize| corners.iter().map(|p| p[axis]).fold(f32::INFINITY, f32::min);
        let high = |axis: usize| corners.iter().map(|p| p[axis]).fold(f32::NEG_INFINITY, f32::max);
        self.cover([low(0), low(1)], [high(0), high(1)], style.color(), |p| {
            let at = |k: i32| (k as f32 + 0.5) / SAMPLES as f32 - 0.5;
            let hits = (0..SAMPLES * SAMPLES)
                .filter(|k| inside([p[0] + at(k % SAMPLES), p[1] + at(k / SAMPLES)], &corners));
            hits.count() as f32 / (SAMPLES * SAMPLES) as f32
        });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let size = (style.size() / FONT_SCALE) as f32;
        let width = text.chars().count() as f32 * ADVANCE * size;
        Ok((width.ceil() as u32, (LETTER_HEIGHT * size).ceil() as u32))
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let size = (style.size() / FONT_SCALE) as f32 * self.scale as f32;
        let (advance, height) = (ADVANCE * size, LETTER_HEIGHT * size);
        let length = advance * text.chars().count() as f32;
        let across = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => -0.5 * length,
            HPos::Right => -length,
        };
        let down = match style.anchor().v_pos {
            VPos::Top => 0.0,
            VPos::Center => -0.5 * ABOVE_BASE * height,
            VPos::Bottom => -ABOVE_BASE * height,
        };
        let turn = style.transform();
        let origin = self.center(at);
        // From the text's own axes to the picture's, and back.
        let placed = |x: f32, y: f32| match turn {
            FontTransform::None => [origin[0] + x, origin[1] + y],
            FontTransform::Rotate90 => [origin[0] - y, origin[1] + x],
            FontTransform::Rotate180 => [origin[0] - x, origin[1] - y],
            FontTransform::Rotate270 => [origin[0] + y, origin[1] - x],
        };
        let found = |p: [f32; 2]| {
            let (x, y) = (p[0] - origin[0], p[1] - origin[1]);
            match turn {
                FontTransform::None => (x, y),
                FontTransform::Rotate90 => (y, -x),
                FontTransform::Rotate180 => (-x, -y),
                FontTransform::Rotate270 => (-y, x),
            }
        };
        let softness = letters::SIDE as f32 / advance.max(1.0);
        for (index, letter) in text.chars().enumerate() {
            let rows = letters::rows(letter);
            let left = across + advance * index as f32;
            let (a, b) = (placed(left, down), placed(left + advance, down + height));
            let low = [a[0].min(b[0]) - 1.0, a[1].min(b[1]) - 1.0];
            let high = [a[0].max(b[0]) + 1.0, a[1].max(b[1]) + 1.0];
            self.cover(low, high, style.color(), |p| {
                let (x, y) = found(p);
                letters::coverage(&rows, (x - left) / advance, (y - down) / height, softness)
            });
        }
        Ok(())
    }
}

/// The image as PNG.
///
/// # Errors
/// Where the encoder fails.
pub fn png(image: &RgbImage) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::prelude::*;

    fn canvas(draw: impl Fn(&mut Raster<'_>)) -> RgbImage {
        let mut image = RgbImage::from_pixel(80, 60, image::Rgb([255; 3]));
        draw(&mut Raster::new(&mut image, 2));
        image
    }

    fn ink(image: &RgbImage) -> f64 {
        image.pixels().map(|p| 1.0 - f64::from(p.0[0]) / 255.0).sum()
    }

    #[test]
    fn shapes_cover_their_area() {
        let filled = BLACK.filled();
        let disk = canvas(|c| c.draw_circle((20, 15), 5, &filled, true).unwrap());
        assert!((ink(&disk) / (std::f64::consts::PI * 100.0) - 1.0).abs() < 0.02, "{}", ink(&disk));
        let thick = Color::stroke_width(&BLACK, 2);
        let line = canvas(|c| c.draw_path([(5, 5), (30, 25)], &thick).unwrap());
        let expected = 2.0 * 25f64.hypot(20.0) * 4.0;
        assert!((ink(&line) / expected - 1.0).abs() < 0.08, "{} {expected}", ink(&line));
        let triangle =
            canvas(|c| c.fill_polygon([(5, 5), (25, 5), (5, 25)], &BLACK.mix(0.5)).unwrap());
        assert!((ink(&triangle) / 400.0 - 1.0).abs() < 0.02, "{}", ink(&triangle));
        let rect = canvas(|c| c.draw_rect((1, 1), (4, 3), &filled, true).unwrap());
        assert_eq!(ink(&rect), 24.0);
    }

    /// Turned text has the same ink elsewhere, and what lies outside is cut off.
    #[test]
    fn text_is_drawn_where_its_anchor_says() {
        let style = |turn| ("sans-serif", 14).into_font().transform(turn).color(&BLACK);
        let lying = canvas(|c| c.draw_text("Fx", &style(FontTransform::None), (10, 10)).unwrap());
        let standing =
            canvas(|c| c.draw_text("Fx", &style(FontTransform::Rotate270), (10, 28)).unwrap());
        assert!(ink(&lying) > 20.0);
        assert!((ink(&lying) / ink(&standing) - 1.0).abs() < 0.1);
        let first_column = (0..80).find(|x| (0..60).any(|y| lying.get_pixel(*x, y).0[0] < 128));
        assert!((20..25).contains(&first_column.unwrap()), "{first_column:?}");
        let outside =
            canvas(|c| c.draw_text("Fx", &style(FontTransform::None), (-90, 99)).unwrap());
        assert_eq!(ink(&outside), 0.0);
    }
}
