//! For groups of similar normals: how likely each coarse cell of the sky is, about in proportion to
//! its light times the cosine to the normal.

use super::cells::{COLUMNS, Cells, Cone, Place, ROWS};
use super::cube::{OnCube, point};
use super::picks::{Pick, accumulate, pick, probability};
use glam::Vec3;
use rayon::prelude::*;

/// Groups along the side of a face of the cube.
const SIDE: usize = 8;
/// Groups of normals.
const GROUPS: usize = 6 * SIDE * SIDE;
/// Numbers of a group: running sums over rows, then over the columns of each.
const STRIDE: usize = ROWS + ROWS * COLUMNS;
/// Bytes of the table.
pub const BYTES: usize = GROUPS * STRIDE * size_of::<f32>();

/// Running sums by group of normals.
pub struct Normals {
    sums: Vec<f32>,
}

impl Normals {
    /// The table for a sky.
    pub fn new(cells: &Cells) -> Self {
        let parts = cells.coarse_parts();
        let cones: Vec<Cone> = (0..ROWS * COLUMNS)
            .map(|cell| Cone::new(cells.corners(parts, [cell % COLUMNS, cell / COLUMNS])))
            .collect();
        let mut sums = vec![0.0; GROUPS * STRIDE];
        sums.par_chunks_mut(STRIDE).enumerate().for_each(|(group, sums)| {
            let (rows, columns) = sums.split_at_mut(ROWS);
            let normals = cone_of(group);
            for ((weight, cone), flux) in columns.iter_mut().zip(&cones).zip(&cells.flux) {
                *weight = flux * softened_cosine(&normals, cone);
            }
            for (row, some) in rows.iter_mut().zip(columns.chunks_mut(COLUMNS)) {
                *row = some.iter().sum();
                accumulate(some);
            }
            accumulate(rows);
        });
        Self { sums }
    }

    fn of(&self, normal: Vec3) -> (&[f32], &[f32]) {
        let OnCube { face, at, .. } = OnCube::new(normal);
        let [i, j] = at.map(|x| ((0.5 * (x + 1.0) * SIDE as f32) as usize).min(SIDE - 1));
        self.sums[((face * SIDE + i) * SIDE + j) * STRIDE..][..STRIDE].split_at(ROWS)
    }

    /// A coarse cell for a normal, and what is left of the uniform numbers; `None` where no cell
    /// above the horizon of any normal of its group gives light.
    pub fn pick(&self, normal: Vec3, xi: [f32; 2]) -> Option<(Place, [f32; 2])> {
        let (rows, columns) = self.of(normal);
        if rows[ROWS - 1] == 0.0 {
            return None;
        }
        let Pick { index: row, rest: down } = pick(rows, xi[1]);
        let Pick { index, rest: along } = pick(&columns[row * COLUMNS..][..COLUMNS], xi[0]);
        Some(([index, row], [along, down]))
    }

    /// Probability of a coarse cell for a normal.
    pub fn probability(&self, normal: Vec3, [column, row]: Place) -> f32 {
        let (rows, columns) = self.of(normal);
        probability(rows, row) * probability(&columns[row * COLUMNS..][..COLUMNS], column)
    }
}

/// The cone of a group's normals.
fn cone_of(group: usize) -> Cone {
    let (face, i, j) = (group / (SIDE * SIDE), group / SIDE % SIDE, group % SIDE);
    let edge = |k: usize| 2.0 * k as f32 / SIDE as f32 - 1.0;
    let at = |x: f32, y: f32| point(face, [x, y]).normalize();
    let ([a, b], [c, d]) = ([edge(i), edge(i + 1)], [edge(j), edge(j + 1)]);
    let axis = at(0.5 * (a + b), 0.5 * (c + d));
    let corners = [at(a, c), at(a, d), at(b, c), at(b, d)];
    let cosine = corners.into_iter().map(|corner| corner.dot(axis)).fold(1.0, f32::min);
    Cone { axis, radius: cosine.acos() + 1e-4 }
}

/// About the mean of max(cosθ, 0) between directions of two cones: above zero wherever any two are
/// less than a right angle apart, and no less than a fraction of the largest cosine.
fn softened_cosine(normals: &Cone, cell: &Cone) -> f32 {
    let cosine = normals.axis.dot(cell.axis);
    // The largest angle from the middle; beyond a right angle past the horizon nothing is seen.
    let reach = (normals.radius + cell.radius).min(1.5).sin();
    let above = cosine + reach;
    match () {
        () if above <= 0.0 => 0.0,
        () if cosine >= reach => cosine,
        () => (above * above / (4.0 * reach)).max(above / 8.0),
    }
}
