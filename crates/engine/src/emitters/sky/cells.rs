//! The sky cut into fine cells of about equal radiance, gathered in a grid of coarse cells: how much
//! light each gives, and picks of one by it.

use super::grid::{Axis, Parts};
use super::picks::{Pick, accumulate, pick, probability};
use crate::radiometry::{Rgb, importance};
use crate::scene::sky_map::{SkyMap, coordinates_of};
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::f64;

/// Coarse columns.
pub const COLUMNS: usize = 64;
/// Coarse rows.
pub const ROWS: usize = 32;
/// Columns and rows of the parts that moments are taken of; there are at least as many fine cells.
pub const PARTS: [usize; 2] = [2 * COLUMNS, 2 * ROWS];
/// Most fine columns; of a wider map, neighbouring texels share a cell.
pub const MOST_COLUMNS: usize = 2048;
/// Most fine rows.
pub const MOST_ROWS: usize = 1024;

/// Which fine cell a direction is in: column and row.
pub type Place = [usize; 2];

/// The sky in fine cells.
pub struct Cells {
    columns: Axis,
    rows: Axis,
    /// Azimuth where each column begins and the width of it, rad.
    azimuths: Vec<[f32; 2]>,
    /// Of each row.
    bands: Vec<Band>,
    coarse_columns: Parts,
    coarse_rows: Parts,
    /// Row by row: running sums over the columns of the coarse cell that each is in.
    in_row: Vec<f32>,
    /// Coarse column by coarse column: running sums over the rows of the coarse cell.
    of_rows: Vec<f32>,
    /// Coarse cells, row by row: importance of their flux, W/m² facing it.
    pub flux: Vec<f32>,
}

/// The band of the unit sphere between two circles about the poles.
#[derive(Clone, Copy)]
struct Band {
    /// 1 where the nearer pole is the upper one, −1 where it is the lower one.
    sign: f32,
    /// Heights of the caps about the nearer pole down to its top and its bottom, exact however small
    /// they are.
    caps: [f32; 2],
}

impl Band {
    /// Between those row coordinates.
    fn new([top, bottom]: [f64; 2]) -> Self {
        let (sign, ends) = match top + bottom < 1.0 {
            true => (1.0, [top, bottom]),
            false => (-1.0, [1.0 - top, 1.0 - bottom]),
        };
        Self { sign, caps: ends.map(cap) }
    }
}

/// Light of many directions together: column k is ∫ L ω_k dω, so that the product with a normal
/// above whose horizon all of them are is their irradiance.
pub type Moment = Mat3;

/// What a part of the sky gives.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    /// In which directions.
    pub moment: Moment,
    /// Importance of the flux, ∫ L dω.
    pub flux: f32,
}

/// The moments of a sky over a grid of equal parts, rows from the top.
pub struct Moments {
    /// Parts of the fine columns and of the rows.
    pub parts: [Parts; 2],
    /// Rows from the top.
    pub given: Vec<Given>,
}

impl Cells {
    /// Cuts a map, its radiance multiplied by `scale`, with the moments of [`PARTS`].
    pub fn new(map: &SkyMap, scale: Rgb) -> (Self, Moments) {
        let columns = Axis::new(map.width() as usize, PARTS[0], MOST_COLUMNS);
        let rows = Axis::between_centres(map.height() as usize, PARTS[1], MOST_ROWS);
        let parts = [
            Parts { count: PARTS[0], of: columns.cells },
            Parts { count: PARTS[1], of: rows.cells },
        ];
        let made: Vec<(Vec<f32>, Vec<Given>)> = (0..parts[1].count)
            .into_par_iter()
            .map(|part| {
                let nothing = Given { moment: Moment::ZERO, flux: 0.0 };
                let mut given = vec![nothing; parts[0].count];
                let flux = (parts[1].range(part))
                    .flat_map(|row| {
                        flux_of_row(
                            map,
                            scale,
                            [&columns, &rows],
                            row,
                            &mut Sums { parts: parts[0], given: &mut given },
                        )
                    })
                    .collect();
                (flux, given)
            })
            .collect();
        let (flux, given): (Vec<_>, Vec<_>) = made.into_iter().unzip();
        let mut cells = Self {
            coarse_columns: Parts { count: COLUMNS, of: columns.cells },
            coarse_rows: Parts { count: ROWS, of: rows.cells },
            in_row: flux.concat(),
            of_rows: vec![0.0; COLUMNS * rows.cells],
            flux: vec![0.0; COLUMNS * ROWS],
            azimuths: (0..columns.cells)
                .map(|column| columns.edges(column))
                .map(|[left, right]| {
                    [(left - 0.5), right - left].map(|x| (f64::consts::TAU * x) as f32)
                })
                .collect(),
            bands: (0..rows.cells).map(|row| Band::new(rows.edges(row))).collect(),
            columns,
            rows,
        };
        cells.sum_up();
        (cells, Moments { parts, given: given.concat() })
    }

    /// Turns the flux of fine cells into running sums.
    fn sum_up(&mut self) {
        let (width, height) = (self.columns.cells, self.rows.cells);
        for coarse in 0..COLUMNS {
            let columns = self.coarse_columns.range(coarse);
            for row in 0..height {
                let some = &mut self.in_row[row * width..][columns.clone()];
                self.of_rows[coarse * height + row] = some.iter().sum();
                accumulate(some);
            }
            for coarse_row in 0..ROWS {
                let rows = self.coarse_rows.range(coarse_row);
                let some = &mut self.of_rows[coarse * height..][..height][rows];
                self.flux[coarse_row * COLUMNS + coarse] = some.iter().sum();
                accumulate(some);
            }
        }
    }

    /// The fine cell of a direction in the map's frame.
    pub fn place(&self, direction: Vec3) -> Place {
        let [u, v] = coordinates_of(direction);
        [self.columns.cell(u), self.rows.cell(v)]
    }

    /// The coarse cell that a fine one is in: column and row.
    pub fn coarse(&self, [column, row]: Place) -> Place {
        [self.coarse_columns.part(column), self.coarse_rows.part(row)]
    }

    /// Density, 1/sr, of [`Cells::sample`] in a fine cell.
    pub fn density(&self, [column, row]: Place) -> f32 {
        let [coarse_column, coarse_row] = self.coarse([column, row]);
        let rows = self.coarse_rows.range(coarse_row);
        let first = rows.start;
        let of_rows = &self.of_rows[coarse_column * self.rows.cells..][..self.rows.cells][rows];
        let columns = self.coarse_columns.range(coarse_column);
        let start = columns.start;
        let in_row = &self.in_row[row * self.columns.cells..][columns];
        probability(of_rows, row - first) * probability(in_row, column - start)
            / self.solid_angle([column, row])
    }

    /// A direction in a coarse cell that gives light, by the flux of the fine cells in it, uniform in
    /// solid angle within one; and the fine cell.
    pub fn sample(&self, [coarse_column, coarse_row]: Place, xi: [f32; 2]) -> (Vec3, Place) {
        let rows = self.coarse_rows.range(coarse_row);
        let first = rows.start;
        let of_rows = &self.of_rows[coarse_column * self.rows.cells..][..self.rows.cells][rows];
        let Pick { index, rest: down } = pick(of_rows, xi[1]);
        let row = first + index;
        let columns = self.coarse_columns.range(coarse_column);
        let start = columns.start;
        let Pick { index, rest: along } =
            pick(&self.in_row[row * self.columns.cells..][columns], xi[0]);
        let place = [start + index, row];
        (self.direction(place, [along, down]), place)
    }

    /// The direction to the middle of a fine cell.
    pub fn middle(&self, place: Place) -> Vec3 {
        self.direction(place, [0.5; 2])
    }

    /// The direction at (x, y), both in [0, 1], of a fine cell; uniform in solid angle for uniform x
    /// and y.
    fn direction(&self, [column, row]: Place, [x, y]: [f32; 2]) -> Vec3 {
        let [left, width] = self.azimuths[column];
        let azimuth = left + width * x;
        let Band { sign, caps: [a, b] } = self.bands[row];
        let height = a + (b - a) * y;
        let radius = (height * (2.0 - height)).max(0.0).sqrt();
        let (sin, cos) = azimuth.sin_cos();
        Vec3::new(radius * cos, sign * (1.0 - height), radius * sin)
    }

    /// Solid angle of a fine cell, sr.
    pub fn solid_angle(&self, [column, row]: Place) -> f32 {
        let Band { caps: [a, b], .. } = self.bands[row];
        self.azimuths[column][1] * (b - a).abs()
    }

    /// Edges of a range of parts of the fine cells: (u, v) of its first corner and of its last.
    pub fn corners(&self, parts: [Parts; 2], [column, row]: Place) -> [[f32; 2]; 2] {
        let (columns, rows) = (parts[0].range(column), parts[1].range(row));
        let start = [self.columns.edges(columns.start)[0], self.rows.edges(rows.start)[0]];
        let end = [self.columns.edges(columns.end - 1)[1], self.rows.edges(rows.end - 1)[1]];
        [start, end].map(|corner| corner.map(|x| x as f32))
    }

    /// Bytes that they take.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        (self.in_row.len() + self.of_rows.len() + self.flux.len()) * size_of::<f32>()
    }

    /// The coarse cells as parts of the fine ones.
    pub fn coarse_parts(&self) -> [Parts; 2] {
        [self.coarse_columns, self.coarse_rows]
    }
}

/// Height of the cap of the unit sphere down to the row coordinate v: 1 − cos πv.
fn cap(v: f64) -> f32 {
    (2.0 * (0.5 * f64::consts::PI * v).sin().powi(2)) as f32
}

/// Where the moments of a row of cells go.
struct Sums<'a> {
    parts: Parts,
    given: &'a mut [Given],
}

/// Importance of the flux of a row of fine cells: the integral of what is bilinear between texels,
/// taken in (u, v), times the solid angle.
fn flux_of_row(
    map: &SkyMap,
    scale: Rgb,
    [columns, rows]: [&Axis; 2],
    row: usize,
    sums: &mut Sums<'_>,
) -> Vec<f32> {
    let width = map.width() as usize;
    let mut flux = vec![0.0; columns.cells];
    for (y, weights, [top, bottom]) in rows.pieces(row) {
        let last = map.height() as usize - 1;
        let of = |y: usize| &map.texels()[y * width..][..width];
        let (above, here, below) = (of(y.saturating_sub(1)), of(y), of((y + 1).min(last)));
        let blended: Vec<Rgb> = (0..width)
            .map(|x| scale * (above[x] * weights[0] + here[x] * weights[1] + below[x] * weights[2]))
            .collect();
        let [a, b] = [top, bottom].map(|v| v * f64::consts::PI);
        // Over the polar angle: ∫ sinθ, ∫ sin²θ and ∫ sinθ cosθ.
        let area = (a.cos() - b.cos()) as f32;
        let across = (0.5 * (b - a) - 0.25 * ((2.0 * b).sin() - (2.0 * a).sin())) as f32;
        let along = (0.5 * (b.sin().powi(2) - a.sin().powi(2))) as f32;
        for (column, flux) in flux.iter_mut().enumerate() {
            let Given { moment, flux: sum } = &mut sums.given[sums.parts.part(column)];
            for (x, weights, edges) in columns.pieces(column) {
                let left = blended[if x == 0 { width - 1 } else { x - 1 }];
                let right = blended[if x + 1 == width { 0 } else { x + 1 }];
                let mean = left * weights[0] + blended[x] * weights[1] + right * weights[2];
                let [from, to] = edges.map(|u| (u as f32 - 0.5) * TAU);
                let turn = to - from;
                let here = importance(mean) * (area * turn);
                *flux += here;
                *sum += here;
                // Over the azimuth, ∫ cosφ = 2 sin(Δφ/2) cos φ of the middle, and so on.
                let chord = 2.0 * (0.5 * turn).sin();
                let (sin, cos) = (0.5 * (from + to)).sin_cos();
                moment.x_axis += mean * (across * chord * cos);
                moment.y_axis += mean * (along * turn);
                moment.z_axis += mean * (across * chord * sin);
            }
        }
    }
    flux
}

/// A cone about a unit axis that a rectangle of the map lies in.
#[derive(Clone, Copy)]
pub struct Cone {
    /// Unit vector to the rectangle's middle.
    pub axis: Vec3,
    /// Angle to the farthest corner, radians.
    pub radius: f32,
}

impl Cone {
    /// The cone of a rectangle between two corners, at most a quarter turn wide.
    pub fn new([[left, top], [right, bottom]]: [[f32; 2]; 2]) -> Self {
        let direction = crate::scene::sky_map::direction_of;
        let axis = direction([0.5 * (left + right), 0.5 * (top + bottom)]);
        // Along an edge the distance to the middle is largest at its ends.
        let corners = [[left, top], [right, top], [left, bottom], [right, bottom]];
        let chord = corners.map(|corner| (direction(corner) - axis).length());
        let chord = chord.into_iter().fold(0.0, f32::max);
        Self { axis, radius: (2.0 * (0.5 * chord).min(1.0).asin() + 1e-5).min(PI) }
    }
}
