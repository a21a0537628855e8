//! Pictures of a whole sky: radiance by direction, laid out as a map of latitude and longitude.
//!
//! Column u = atan2(z, x)/2π + ½ and row v = θ/π, θ the angle from straight up (+Y): the middle of
//! the map looks along +X. The centres of the top row are straight up, those of the last straight
//! down, as Mitsuba has it; other programs put the rows' edges there, which makes a difference of
//! half a row. Between the centres of texels radiance is bilinear, wrapped in u.

use super::SceneError;
use crate::angles::angle_of;
use crate::radiometry::Rgb;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Most columns of a map.
pub const MAX_SKY_WIDTH: u32 = 8192;
/// Most rows of a map.
pub const MAX_SKY_HEIGHT: u32 = 4096;
/// Largest radiance of a texel: the sun's own is 2 · 10⁷ W/(m²·sr), and sums over a map of such
/// texels are far from the end of single precision.
pub const MAX_SKY_RADIANCE: f32 = 1e12;

/// Radiance by direction.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyMap {
    /// Columns, ≥ 1.
    width: u32,
    /// Rows, ≥ 1.
    height: u32,
    /// Rows from the top; finite, ≥ 0.
    texels: Vec<Rgb>,
}

impl SkyMap {
    /// A map of `width` × `height` texels, rows from the top.
    ///
    /// # Errors
    /// [`SceneError`] where the sizes are zero, too large or not those of `texels`, or where a texel
    /// is no radiance (not finite, below zero, above [`MAX_SKY_RADIANCE`]); it names the texel.
    pub fn new(width: u32, height: u32, texels: Vec<Rgb>) -> Result<Self, SceneError> {
        check_size(width, height)?;
        if texels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(SceneError::malformed(
                "sky",
                format!("has {} texels, not {width} × {height}", texels.len()),
                "give a radiance for every texel",
            ));
        }
        let is_radiance = |x: f32| (0.0..=MAX_SKY_RADIANCE).contains(&x);
        if let Some(at) = texels.iter().position(|t| !t.to_array().into_iter().all(is_radiance)) {
            let (column, row) = (at % width as usize, at / width as usize);
            let [red, green, blue] = texels[at].to_array();
            return Err(SceneError::malformed(
                format!("sky, column {column}, row {row}"),
                format!("({red}, {green}, {blue}) is no radiance"),
                format!("make every texel three numbers from 0 to {MAX_SKY_RADIANCE:e}"),
            ));
        }
        Ok(Self { width, height, texels })
    }

    /// The map whose texels are what `radiance` gives for the directions of their centres.
    ///
    /// # Errors
    /// Those of [`SkyMap::new`].
    pub fn from_fn(
        width: u32,
        height: u32,
        radiance: impl Fn(Vec3) -> Rgb,
    ) -> Result<Self, SceneError> {
        check_size(width, height)?;
        let row = |y: u32| {
            let v = if height == 1 { 0.5 } else { y as f32 / (height - 1) as f32 };
            let direction = move |x: u32| direction_of([(x as f32 + 0.5) / width as f32, v]);
            (0..width).map(direction)
        };
        Self::new(width, height, (0..height).flat_map(row).map(radiance).collect())
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Radiances, rows from the top.
    pub fn texels(&self) -> &[Rgb] {
        &self.texels
    }

    /// Radiance from a unit direction.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        self.at(coordinates_of(direction))
    }

    /// Radiance at (u, v), both of [0, 1]; u may lie outside.
    pub fn at(&self, [u, v]: [f32; 2]) -> Rgb {
        let (width, height) = (self.width as usize, self.height as usize);
        // Numbered from the last column, so that nothing is below zero, which truncation rounds up.
        let u = if (0.0..=1.0).contains(&u) { u } else { u.rem_euclid(1.0) };
        let (x, y) = (u * width as f32 + 0.5, (v * (height - 1) as f32).max(0.0));
        let (right, top) = (x as usize, y as usize);
        let (fx, fy) = (x - right as f32, y - top as f32);
        let columns = [
            if right == 0 { width - 1 } else { (right - 1).min(width - 1) },
            if right >= width { 0 } else { right },
        ];
        let rows = [top, top + 1].map(|y| y.min(height - 1));
        let row = |y: usize| {
            let [a, b] = columns.map(|x| self.texels[y * width + x]);
            a.lerp(b, fx)
        };
        row(rows[0]).lerp(row(rows[1]), fy)
    }

    /// Mean radiance over all directions: each texel counts by the solid angle that it takes.
    pub fn mean(&self) -> Rgb {
        let rows = self.texels.chunks(self.width as usize).enumerate();
        let sum = rows.fold(glam::DVec3::ZERO, |sum, (y, row)| {
            let edge = |y: f64| ((y - 0.5) / f64::from((self.height - 1).max(1))).clamp(0.0, 1.0);
            let edges =
                if self.height == 1 { [0.0, 1.0] } else { [edge(y as f64), edge(y as f64 + 1.0)] };
            let [top, bottom] = edges.map(|v| 0.5 * (std::f64::consts::PI * v).cos());
            let share = (top - bottom) / f64::from(self.width);
            sum + row.iter().map(|texel| texel.as_dvec3()).sum::<glam::DVec3>() * share
        });
        sum.as_vec3()
    }

    /// Gives all that makes the map what it is to `digest`, piece by piece.
    pub fn digest_into(&self, digest: &mut impl FnMut(&[u8])) {
        digest(&self.width.to_le_bytes());
        digest(&self.height.to_le_bytes());
        digest(bytemuck::cast_slice(&self.texels));
    }
}

/// Where on a map a unit direction is: (u, v), both in [0, 1].
pub fn coordinates_of(direction: Vec3) -> [f32; 2] {
    let Vec3 { x, y, z } = direction;
    // The angle from straight up by its tangent: exact near both poles, unlike by its cosine.
    let across = (x * x + z * z).sqrt();
    [angle_of(z, x) / TAU + 0.5, angle_of(across, y) * FRAC_1_PI]
}

/// The unit direction at (u, v).
pub fn direction_of([u, v]: [f32; 2]) -> Vec3 {
    let (sin_azimuth, cos_azimuth) = ((u - 0.5) * TAU).sin_cos();
    let (sin, cos) = (v * std::f32::consts::PI).sin_cos();
    Vec3::new(sin * cos_azimuth, cos, sin * sin_azimuth)
}

/// Refuses maps without texels and maps that are too large.
pub(super) fn check_size(width: u32, height: u32) -> Result<(), SceneError> {
    if width == 0 || height == 0 {
        let fix = "send a map of at least one texel";
        return Err(SceneError::malformed("sky", "has no texels", fix));
    }
    if width > MAX_SKY_WIDTH || height > MAX_SKY_HEIGHT {
        return Err(SceneError::too_large(
            "sky",
            format!("has {width} × {height} texels"),
            format!("send a map of at most {MAX_SKY_WIDTH} × {MAX_SKY_HEIGHT}"),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: u32, height: u32) -> SkyMap {
        let texels = (0..width * height).map(|i| Rgb::splat(i as f32)).collect();
        SkyMap::new(width, height, texels).unwrap()
    }

    #[test]
    fn directions_are_where_the_convention_has_them() {
        for (direction, [u, v]) in [
            (Vec3::X, [0.5, 0.5]),
            (Vec3::Z, [0.75, 0.5]),
            (Vec3::NEG_Z, [0.25, 0.5]),
            (Vec3::new(0.0, 0.8, 0.6), [0.75, 0.6f32.asin() * FRAC_1_PI]),
        ] {
            let [x, y] = coordinates_of(direction);
            assert!((x - u).abs() < 1e-6 && (y - v).abs() < 1e-6, "{direction}: {x} {y}");
            assert!((direction_of([x, y]) - direction).length() < 1e-6);
        }
        assert_eq!(coordinates_of(Vec3::Y)[1], 0.0);
        assert_eq!(coordinates_of(Vec3::NEG_Y)[1], 1.0);
    }

    #[test]
    fn radiance_is_bilinear_wrapped_and_clamped() {
        let map = numbered(4, 2);
        assert_eq!(map.at([0.375, 0.0]), Rgb::splat(1.0));
        assert_eq!(map.at([0.375, 0.25]), Rgb::splat(2.0));
        assert_eq!(map.at([0.5, 0.5]), Rgb::splat(3.5));
        // Half-way between the last column and the first, which are 3 and 0.
        assert_eq!(map.at([0.0, 0.0]), Rgb::splat(1.5));
        assert_eq!(map.at([1.0, 0.0]), Rgb::splat(1.5));
        assert_eq!(map.at([0.125, 1.0]), Rgb::splat(4.0));
        for direction in [Vec3::Y, Vec3::NEG_Y, Vec3::NEG_X, Vec3::new(-1.0, 0.0, -1e-30)] {
            assert!(map.radiance(direction).is_finite());
        }
    }

    #[test]
    fn the_mean_is_over_solid_angle() {
        // A row's share of the sphere is the difference of cosines.
        let map = numbered(1, 3);
        // Edges at 45° and 135°: caps of ½(1 − √½) each.
        let cap = 0.5 * (1.0 - 0.5f32.sqrt());
        let exact = 1.0 * (1.0 - 2.0 * cap) + 2.0 * cap;
        assert!((map.mean().x - exact).abs() < 1e-6, "{}", map.mean());
        let white = SkyMap::from_fn(7, 5, |_| Rgb::ONE).unwrap();
        assert!((white.mean() - Rgb::ONE).length() < 1e-6);
    }

    #[test]
    fn what_is_no_sky_is_refused_with_its_place() {
        let with = |at: usize, value: f32| {
            let mut texels = vec![Rgb::ONE; 6];
            texels[at].y = value;
            SkyMap::new(3, 2, texels)
        };
        for value in [f32::NAN, f32::INFINITY, -1e-3, 2e12] {
            let error = with(4, value).unwrap_err();
            assert_eq!(error.at, "sky, column 1, row 1", "{error}");
            assert!(!error.too_large);
        }
        assert!(with(4, 1e12).is_ok());
        assert!(SkyMap::new(0, 2, vec![]).is_err() && SkyMap::new(2, 2, vec![Rgb::ONE]).is_err());
        assert!(SkyMap::new(8193, 1, vec![Rgb::ONE; 8193]).unwrap_err().too_large);
        assert!(SkyMap::from_fn(1, 4097, |_| Rgb::ONE).unwrap_err().too_large);
    }
}
