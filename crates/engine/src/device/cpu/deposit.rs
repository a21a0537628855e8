//! Sums delta form factors per patch over an item buffer (Antal eq. 8).
//!
//! Rows are walked in runs of equal items. In a run the patch follows from the barycentric
//! coordinates of each pixel's hit, computed for a block of pixels at a time.

use super::lobe;
use super::raster::{Grid, Raster, Setup};
use crate::hemicube::{DeltaFormFactors, FACES, Face, Shot, item};
use crate::patches::PatchedScene;
use crate::raster::PixelPlane;

const BLOCK: usize = 64;

/// Sums of every patch that a shot is deposited in.
pub struct FactorSums<'a> {
    /// Σ ΔF.
    pub form_factor: &'a mut [f32],
    /// Σ ΔF·cosⁿα; empty where no shot has a lobe.
    pub lobe_factor: &'a mut [f32],
}

/// Adds Σ ΔF (and, for a shot with a lobe, Σ ΔF·cosⁿα) of a rendered shot to the patches' sums.
#[inline(always)]
pub fn deposit(
    scene: &PatchedScene,
    raster: &Raster,
    table: &DeltaFormFactors,
    shot: &Shot,
    FactorSums { form_factor, lobe_factor }: FactorSums<'_>,
) {
    let resolution = table.resolution;
    let width = resolution as usize;
    let eye_extent = shot.position.abs().max_element();
    let lobe_axis = shot.to_frame(shot.lobe_axis);
    let mut lobe_row = vec![0f32; if shot.has_lobe() { width } else { 0 }];
    for face in 0..FACES {
        let weight = shot.face_weights[face];
        if weight <= 0.0 {
            continue;
        }
        let grid = Grid::new(Face::ALL[face], resolution, shot);
        let lobe = Lobe { axis: grid.plane(lobe_axis), exponent: shot.exponent };
        for row in 0..Face::ALL[face].rows(resolution) {
            let start = (Face::ALL[face].first_row(resolution) + row) as usize * width;
            let items = &raster.items[start..start + width];
            let delta = &table.values[start..start + width];
            if shot.has_lobe() {
                lobe_weights(&mut lobe_row, delta, &grid, &lobe, row);
            }
            let mut column = 0;
            while column < width {
                let code = items[column];
                let end = run_end(items, column);
                if let Some((facet_index, back)) = item::decode(code) {
                    let facet = &scene.facets[facet_index as usize];
                    if let Some(first) = facet.first_patch(back) {
                        let sums = PatchSums {
                            weight,
                            form_factor: &mut form_factor[first as usize..],
                            lobe_factor,
                            first: first as usize,
                        };
                        if facet.divisions == 1 {
                            sums.add_run(&delta[column..end], &lobe_row, column, end);
                        } else {
                            let corners = raster.corners_of(facet.corners);
                            if let Some(setup) = Setup::new(corners, eye_extent) {
                                let cells = CellLocator::new(&grid, &setup, row, facet.divisions);
                                sums.add_cells(&delta[column..end], &lobe_row, column, &cells);
                            }
                        }
                    }
                }
                column = end;
            }
        }
    }
}

#[inline(always)]
fn run_end(items: &[u32], start: usize) -> usize {
    let code = items[start];
    let mut end = start + 1;
    while end + 8 <= items.len() && items[end..end + 8].iter().all(|i| *i == code) {
        end += 8;
    }
    while end < items.len() && items[end] == code {
        end += 1;
    }
    end
}

/// A shot's lobe as a face of its hemicube sees it.
struct Lobe {
    /// Cosine α to its axis, times the distance to the pixel.
    axis: PixelPlane,
    /// n.
    exponent: f32,
}

/// ΔF·cosⁿα of every pixel of a row.
#[inline(always)]
fn lobe_weights(out: &mut [f32], delta: &[f32], grid: &Grid, lobe: &Lobe, row: u32) {
    let Lobe { axis, exponent } = lobe;
    let (first_x, step) = grid.x();
    let y = grid.y(row);
    let along = axis.at_row(row);
    for (column, (out, delta)) in out.iter_mut().zip(delta).enumerate() {
        let column = column as i32 as f32;
        let x = first_x + step * column;
        let cosine = (along + axis.per_column * column).max(0.0);
        let square = (cosine * cosine / (1.0 + x * x + y * y)).clamp(1e-37, 1.0);
        let weight = delta * lobe::exp2((0.5 * exponent * lobe::log2(square)).min(0.0));
        *out = if cosine > 0.0 { weight } else { 0.0 };
    }
}

struct PatchSums<'a> {
    weight: f32,
    form_factor: &'a mut [f32],
    lobe_factor: &'a mut [f32],
    first: usize,
}

impl PatchSums<'_> {
    /// A run that lies in one patch.
    #[inline(always)]
    fn add_run(self, delta: &[f32], lobe_row: &[f32], column: usize, end: usize) {
        self.form_factor[0] += self.weight * sum(delta);
        if !lobe_row.is_empty() {
            self.lobe_factor[self.first] += self.weight * sum(&lobe_row[column..end]);
        }
    }

    /// A run over many patches of a facet.
    #[inline(always)]
    fn add_cells(self, delta: &[f32], lobe_row: &[f32], column: usize, cells: &CellLocator) {
        let mut index = [0i32; BLOCK];
        for (block, delta) in delta.chunks(BLOCK).enumerate() {
            let start = column + block * BLOCK;
            let index = &mut index[..delta.len()];
            cells.locate(start, index);
            for (cell, delta) in index.iter().zip(delta) {
                self.form_factor[*cell as usize] += self.weight * delta;
            }
            if !lobe_row.is_empty() {
                for (cell, value) in index.iter().zip(&lobe_row[start..]) {
                    self.lobe_factor[self.first + *cell as usize] += self.weight * value;
                }
            }
        }
    }
}

/// Sum in eight lanes, so that it vectorises and its order is fixed.
#[inline(always)]
fn sum(values: &[f32]) -> f32 {
    let mut lanes = [0f32; 8];
    let (blocks, rest) = values.as_chunks::<8>();
    for block in blocks {
        for (lane, value) in lanes.iter_mut().zip(block) {
            *lane += value;
        }
    }
    let rest: f32 = rest.iter().sum();
    lanes.iter().sum::<f32>() + rest
}

/// Finds the cell of a facet that each pixel of a row sees.
struct CellLocator {
    u: (f32, f32),
    v: (f32, f32),
    sum: (f32, f32),
    divisions: i32,
}

impl CellLocator {
    #[inline(always)]
    fn new(grid: &Grid, setup: &Setup, row: u32, divisions: u32) -> Self {
        let line = |plane: PixelPlane| (plane.at_row(row), plane.per_column);
        let [e0, e1, e2] = &setup.edges;
        let (e0, e1, e2) = (line(grid.plane(*e0)), line(grid.plane(*e1)), line(grid.plane(*e2)));
        let sum = (e0.0 + e1.0 + e2.0, e0.1 + e1.1 + e2.1);
        let n = divisions as f32;
        Self { u: (e1.0 * n, e1.1 * n), v: (e2.0 * n, e2.1 * n), sum, divisions: divisions as i32 }
    }

    /// Cell indices as [`crate::patches::cell_index`] gives them, for consecutive columns.
    #[inline(always)]
    fn locate(&self, first_column: usize, out: &mut [i32]) {
        let n = self.divisions;
        let top = (n - 1) as f32;
        for (offset, out) in out.iter_mut().enumerate() {
            let column = (first_column + offset) as i32 as f32;
            let scale = 1.0 / (self.sum.0 + self.sum.1 * column);
            let u = ((self.u.0 + self.u.1 * column) * scale).max(0.0);
            let v = ((self.v.0 + self.v.1 * column) * scale).max(0.0);
            let i = u.min(top).floor();
            let j = v.min(top - i).floor();
            // SAFETY: both are in [0, n − 1]: `max` and `min` drop NaN and infinities.
            let (wi, wj) = unsafe { (i.to_int_unchecked::<i32>(), j.to_int_unchecked::<i32>()) };
            let upper = i32::from((u - i) + (v - j) > 1.0) & i32::from(j < top - i);
            *out = wi * (2 * n - wi) + 2 * wj + upper;
        }
    }
}
