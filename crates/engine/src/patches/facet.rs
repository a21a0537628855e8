//! Facets: the triangles that light sees, each cut into cells.

use glam::{Vec2, Vec3};

/// "This side has no patches."
pub const NO_PATCH: u32 = u32::MAX;

/// A triangle of the visibility geometry: a scene triangle or a piece of one.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    /// Indices into [`super::PatchedScene::positions`], counter-clockwise seen from the front.
    pub corners: [u32; 3],
    /// The scene triangle that it lies in.
    pub source: u32,
    /// Barycentric (u, v) of the corners in the scene triangle.
    pub source_uv: [Vec2; 3],
    /// n: each side has n² patches.
    pub divisions: u32,
    /// First patch of the front.
    pub front: u32,
    /// First patch of the back, or [`NO_PATCH`] where the back is black.
    pub back: u32,
    /// Whether the back is never seen by light: the facet bounds a closed body without light
    /// inside, so rasterisers may skip it when it faces away.
    pub cull_back: bool,
    /// Whether it gives way to others where depths tie within rounding: it goes on behind a
    /// neighbour at a shared edge.
    pub recedes: bool,
}

/// How a facet is cut: what its patches are.
#[derive(Clone, Copy, Debug)]
pub struct Sides {
    /// n: each side has n² patches.
    pub divisions: u32,
    /// First patch of the front.
    pub front: u32,
    /// First patch of the back, or [`NO_PATCH`] where the back is black.
    pub back: u32,
}

impl Sides {
    /// First patch of a side, `None` where that side is black.
    pub fn first_patch(&self, back: bool) -> Option<u32> {
        let first = if back { self.back } else { self.front };
        (first != NO_PATCH).then_some(first)
    }
}

impl Facet {
    /// How it is cut.
    pub fn sides(&self) -> Sides {
        Sides { divisions: self.divisions, front: self.front, back: self.back }
    }

    /// First patch of a side, `None` where that side is black.
    pub fn first_patch(&self, back: bool) -> Option<u32> {
        let first = if back { self.back } else { self.front };
        (first != NO_PATCH).then_some(first)
    }

    /// Barycentric (u, v) in the scene triangle of barycentric (u, v) in the facet.
    pub fn to_source(&self, u: f32, v: f32) -> Vec2 {
        let [a, b, c] = self.source_uv;
        a * (1.0 - u - v) + b * u + c * v
    }
}

/// Area of a facet with corners at these positions, m².
pub fn facet_area(positions: &[Vec3], facet: &Facet) -> f32 {
    let [a, b, c] = facet.corners.map(|p| positions[p as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// Index of the cell at barycentric (u, v) of a triangle cut into `divisions`² congruent cells.
///
/// Cells are numbered by columns of constant ⌊u·n⌋, within a column by ⌊v·n⌋, the cell at the
/// lower corner before the one across its diagonal. Points outside are moved inside.
pub fn cell_index(divisions: u32, u: f32, v: f32) -> u32 {
    let n = divisions as f32;
    let (fu, fv) = ((u * n).max(0.0), (v * n).max(0.0));
    let i = (fu as u32).min(divisions - 1);
    let last = divisions - 1 - i;
    let j = (fv as u32).min(last);
    let upper = (fu - i as f32) + (fv - j as f32) > 1.0 && j < last;
    i * (2 * divisions - i) + 2 * j + u32::from(upper)
}

/// Barycentric corners of every cell of a triangle cut into `divisions`², in the order of
/// [`cell_index`].
pub fn cells(divisions: u32) -> impl Iterator<Item = [Vec2; 3]> {
    let at = move |i: u32, j: u32| Vec2::new(i as f32, j as f32) / divisions as f32;
    (0..divisions).flat_map(move |i| {
        (0..divisions - i).flat_map(move |j| {
            let lower = [at(i, j), at(i + 1, j), at(i, j + 1)];
            let upper = [at(i + 1, j + 1), at(i, j + 1), at(i + 1, j)];
            std::iter::once(lower).chain((j + 1 < divisions - i).then_some(upper))
        })
    })
}

/// Barycentric corners of one cell; the inverse of [`cell_index`].
pub fn nth_cell(divisions: u32, index: u32) -> [Vec2; 3] {
    // Columns start at i(2n − i): i = n − ⌈√(n² − index)⌉.
    let n = f64::from(divisions);
    let mut i = (n - (n * n - f64::from(index)).sqrt().ceil()).max(0.0) as u32;
    while i > 0 && i * (2 * divisions - i) > index {
        i -= 1;
    }
    while i + 1 < divisions && (i + 1) * (2 * divisions - i - 1) <= index {
        i += 1;
    }
    let within = index - i * (2 * divisions - i);
    let (j, upper) = (within / 2, within % 2 == 1);
    let at = |i: u32, j: u32| Vec2::new(i as f32, j as f32) / divisions as f32;
    if upper {
        [at(i + 1, j + 1), at(i, j + 1), at(i + 1, j)]
    } else {
        [at(i, j), at(i + 1, j), at(i, j + 1)]
    }
}

/// Barycentric coordinates in a piece of the barycentric (u, v) of its triangle.
pub fn in_piece(corners: &[Vec2; 3], u: f32, v: f32) -> Vec2 {
    let [a, b, c] = *corners;
    let (ab, ac, p) = (b - a, c - a, Vec2::new(u, v) - a);
    let determinant = ab.perp_dot(ac);
    Vec2::new(p.perp_dot(ac), ab.perp_dot(p)) / determinant
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbered_as_they_are_listed() {
        for divisions in [1, 2, 3, 7, 16, 100] {
            let mut count = 0;
            for (index, corners) in cells(divisions).enumerate() {
                let center = (corners[0] + corners[1] + corners[2]) / 3.0;
                assert_eq!(cell_index(divisions, center.x, center.y), index as u32);
                assert_eq!(nth_cell(divisions, index as u32), corners);
                count += 1;
            }
            assert_eq!(count, divisions * divisions);
        }
    }

    #[test]
    fn points_outside_stay_in_the_triangle() {
        for (u, v) in [(-0.1, 0.5), (1.2, 0.0), (0.7, 0.7), (0.0, 1.0), (1.0, 0.0)] {
            assert!(cell_index(5, u, v) < 25);
        }
    }
}
