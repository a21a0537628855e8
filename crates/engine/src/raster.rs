//! Triangles to pixels, for hemicubes and cameras alike: edge functions that are linear over the
//! pixel grid, one span a row, a depth comparison that vectorises.
//!
//! Rasterisation is homogeneous: a triangle is given by the planes through the eye and its edges,
//! so nothing is clipped and there is no near plane. Neighbours compute a shared edge from the
//! same two corners with opposite sign, bit for bit, so they neither overlap nor leave a crack.

use glam::{DVec3, Vec3};

/// A linear function of the pixel: per_column·column + at_row(row).
#[derive(Clone, Copy, Debug)]
pub struct PixelPlane {
    /// Change from one column to the next.
    pub per_column: f32,
    /// Change from one row to the next.
    pub per_row: f32,
    /// Value at column 0, row 0.
    pub constant: f32,
}

impl PixelPlane {
    /// Value at column 0 of a row.
    #[inline(always)]
    pub fn at_row(&self, row: u32) -> f32 {
        self.constant + self.per_row * row as f32
    }
}

/// Planes through the eye and the edges opposite to corners 0, 1, 2 of a triangle, for corners
/// relative to the eye.
#[inline(always)]
pub fn edge_planes([a, b, c]: [Vec3; 3]) -> [Vec3; 3] {
    [b.cross(c), c.cross(a), a.cross(b)]
}

/// The same in double precision.
pub fn exact_edge_planes(corners: [Vec3; 3]) -> [DVec3; 3] {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    [b.cross(c), c.cross(a), a.cross(b)]
}

/// One triangle over the pixel grid. A pixel is inside where all edges are ≥ 0; barycentric
/// coordinates are the edge values over their sum.
pub struct PixelTriangle {
    /// Edge functions opposite to corners 0, 1, 2.
    pub edges: [PixelPlane; 3],
    /// Grows towards the eye; > 0 where anything may be drawn.
    pub nearness: PixelPlane,
    /// First row that may see the triangle, and the one after the last.
    pub rows: (u32, u32),
    /// What to write where it is nearest.
    pub code: u32,
}

/// A window of the pixel grid with a depth buffer: full rows from `first_row` on.
pub struct Target<'a> {
    /// Columns.
    pub width: u32,
    /// Grid row of the window's first row.
    pub first_row: u32,
    /// Codes, row by row.
    pub items: &'a mut [u32],
    /// Nearness of what is drawn, row by row.
    pub depth: &'a mut [f32],
}

/// Draws the pixels of a triangle that see it nearer than anything before.
#[inline(always)]
pub fn fill(target: &mut Target<'_>, triangle: &PixelTriangle) {
    let width = target.width;
    let rows = (target.items.len() / width as usize) as u32;
    let [e0, e1, e2] = &triangle.edges;
    let slopes = [-e0.per_column.recip(), -e1.per_column.recip(), -e2.per_column.recip()];
    let first = triangle.rows.0.max(target.first_row);
    let end = triangle.rows.1.min(target.first_row + rows);
    for row in first..end {
        let (mut low, mut high) = (0f32, width as f32);
        for (edge, slope) in triangle.edges.iter().zip(&slopes) {
            let value = edge.at_row(row);
            // Columns with per_column·column + value ≥ 0.
            let crossing = ceiling(value * slope);
            if edge.per_column > 0.0 {
                low = low.max(crossing);
            } else if edge.per_column < 0.0 {
                high = high.min(crossing);
            } else if value < 0.0 {
                high = -1.0;
            }
        }
        if low < high {
            let start = ((row - target.first_row) * width) as usize;
            let span = start + low as usize..start + high as usize;
            fill_span(
                &mut target.items[span.clone()],
                &mut target.depth[span],
                triangle.nearness.at_row(row) + triangle.nearness.per_column * low,
                triangle.nearness.per_column,
                triangle.code,
            );
        }
    }
}

/// The least whole number that is not below `x`, as far as columns of pixels are concerned: without a
/// call, which `f32::ceil` is where the processor need not have an instruction for it.
#[inline(always)]
fn ceiling(x: f32) -> f32 {
    if x.is_nan() {
        return x;
    }
    let towards_zero = x as i32 as f32;
    if towards_zero < x { towards_zero + 1.0 } else { towards_zero }
}

/// Depth test of one span; written so that it becomes compare-and-blend on vectors.
#[inline(always)]
fn fill_span(items: &mut [u32], depth: &mut [f32], first: f32, step: f32, code: u32) {
    for (column, (item, depth)) in items.iter_mut().zip(depth).enumerate() {
        let value = first + step * column as i32 as f32;
        let nearer = value > *depth;
        *depth = if nearer { value } else { *depth };
        *item = if nearer { code } else { *item };
    }
}

/// Pixel centres (whole numbers below `count`) that can lie between three coordinates, as a
/// half-open range, with a little slack for rounding: the edge functions decide.
#[inline(always)]
pub fn centre_range([a, b, c]: [f32; 3], count: u32) -> (u32, u32) {
    const SLACK: f32 = 0.05;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let first = (low - SLACK).ceil().clamp(0.0, count as f32);
    let end = ((high + SLACK).floor() + 1.0).clamp(0.0, count as f32);
    (first as u32, end as u32)
}

#[cfg(test)]
mod tests {
    use super::ceiling;

    #[test]
    fn ceilings_are_those_of_the_library() {
        for x in [-3.0f32, -2.5, -0.3, 0.0, 1e-30, 0.5, 1.0, 7.000_001, 8_388_607.5, 1e9] {
            assert_eq!(ceiling(x), x.ceil(), "{x}");
            assert_eq!(ceiling(-x), (-x).ceil(), "{x}");
        }
        assert!(ceiling(f32::NAN).is_nan());
        assert!(ceiling(f32::INFINITY) > 1e9 && ceiling(f32::NEG_INFINITY) < -1e9);
    }
}
