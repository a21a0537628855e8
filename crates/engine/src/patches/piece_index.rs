//! Finds the facet of a triangle at a place where the triangle was cut into many.
//!
//! A floor on which much furniture stands is two triangles of hundreds of facets each, and every ray
//! that ends there asks for one of them.

use super::facet::{Facet, in_piece};
use super::index::FacetIndex;
use glam::Vec2;

/// Facets of a triangle from which on there is a grid.
const LEAST_PIECES: usize = 6;
/// Cells of a grid for each facet; half of them lie beyond the triangle's diagonal.
const CELLS_PER_PIECE: f32 = 4.0;
/// Most cells along a side of a grid.
const MOST_CELLS: u32 = 256;
/// How far beyond a facet's bounds it is listed, barycentric: more than rounding moves a place.
const MARGIN: f32 = 1e-5;
/// Stands for triangles without a grid.
const NO_GRID: u32 = u32::MAX;

/// Facets of the scene's triangles.
pub struct PieceIndex {
    /// Facets of triangle t: `start[t]..start[t + 1]`.
    start: Vec<u32>,
    /// The grid of each triangle, or [`NO_GRID`]; empty where no triangle has one.
    grid_of: Vec<u32>,
    grids: Vec<Grid>,
}

/// The unit square of a triangle's barycentric coordinates in equal cells.
struct Grid {
    /// Cells along a side.
    side: u32,
    /// Facets that reach into cell c, in their order: `facets[start[c]..start[c + 1]]`.
    start: Vec<u32>,
    facets: Vec<u32>,
}

impl PieceIndex {
    /// Of so many triangles; facets come in the order of the triangles that they are of.
    pub fn new(triangles: usize, facets: &[Facet]) -> Self {
        let mut start = vec![0u32; triangles + 1];
        for facet in facets {
            start[facet.source as usize + 1] += 1;
        }
        for triangle in 1..start.len() {
            start[triangle] += start[triangle - 1];
        }
        let (mut grid_of, mut grids) = (Vec::new(), Vec::new());
        for triangle in 0..triangles {
            let own = start[triangle]..start[triangle + 1];
            if own.len() >= LEAST_PIECES {
                grid_of.resize(triangles, NO_GRID);
                grid_of[triangle] = grids.len() as u32;
                grids.push(Grid::new(own.start, &facets[own.start as usize..own.end as usize]));
            }
        }
        Self { start, grid_of, grids }
    }

    /// Bytes that it takes.
    pub fn held_bytes(&self) -> u64 {
        let of_grid = |grid: &Grid| size_of_val(&*grid.start) + size_of_val(&*grid.facets);
        let grids = self.grids.iter().map(of_grid).sum::<usize>();
        (grids + size_of_val(&*self.start) + size_of_val(&*self.grid_of)) as u64
    }

    /// The facet, and the barycentric coordinates in it, of barycentric (u, v) of a triangle: the first
    /// one that it lies in, or by rounding the nearest one; `None` of triangles that were left out.
    pub fn place(
        &self,
        facets: &[Facet],
        triangle: u32,
        u: f32,
        v: f32,
    ) -> Option<(FacetIndex, Vec2)> {
        let triangle = triangle as usize;
        let (first, end) = (self.start[triangle], self.start[triangle + 1]);
        if end == first + 1 {
            return Some((FacetIndex(first), Vec2::new(u, v)));
        }
        let grid = self.grid_of.get(triangle).and_then(|grid| self.grids.get(*grid as usize));
        let listed = grid.map_or(&[][..], |grid| grid.facets_at(u, v));
        let found = nearest(facets, listed.iter().copied(), u, v);
        found.or_else(|| nearest(facets, first..end, u, v))
    }
}

impl Grid {
    /// Of a triangle's facets, the first of which has that number.
    fn new(first: u32, facets: &[Facet]) -> Self {
        let side = (CELLS_PER_PIECE * facets.len() as f32).sqrt().ceil() as u32;
        let side = side.min(MOST_CELLS);
        let cell = |at: f32| cell_at(at, side);
        let reaches = facets.iter().map(|facet| {
            let [a, b, c] = facet.source_uv;
            let (low, high) = (a.min(b).min(c) - MARGIN, a.max(b).max(c) + MARGIN);
            let columns = cell(low.x)..=cell(high.x);
            let all = (cell(low.y)..=cell(high.y)).flat_map(move |row| {
                columns.clone().map(move |column| (row * side + column) as usize)
            });
            all.collect::<Vec<usize>>()
        });
        let reaches: Vec<Vec<usize>> = reaches.collect();
        let mut start = vec![0u32; (side * side) as usize + 1];
        for cell in reaches.iter().flatten() {
            start[cell + 1] += 1;
        }
        for cell in 1..start.len() {
            start[cell] += start[cell - 1];
        }
        let mut next = start.clone();
        let mut listed = vec![0; start[start.len() - 1] as usize];
        for (number, cells) in (first..).zip(&reaches) {
            for cell in cells {
                listed[next[*cell] as usize] = number;
                next[*cell] += 1;
            }
        }
        Self { side, start, facets: listed }
    }

    fn facets_at(&self, u: f32, v: f32) -> &[u32] {
        let cell = (cell_at(v, self.side) * self.side + cell_at(u, self.side)) as usize;
        &self.facets[self.start[cell] as usize..self.start[cell + 1] as usize]
    }
}

/// The row or column that a coordinate lies in, of so many.
fn cell_at(at: f32, side: u32) -> u32 {
    ((at * side as f32) as u32).min(side - 1)
}

/// The first of those facets that a place lies in, or else the nearest one.
fn nearest(
    facets: &[Facet],
    numbers: impl Iterator<Item = u32>,
    u: f32,
    v: f32,
) -> Option<(FacetIndex, Vec2)> {
    let mut found = None;
    let mut most_inside = f32::NEG_INFINITY;
    for facet in numbers.map(FacetIndex) {
        let at = in_piece(&facets[facet.at()].source_uv, u, v);
        let inside = at.x.min(at.y).min(1.0 - at.x - at.y);
        if inside > most_inside {
            (most_inside, found) = (inside, Some((facet, at)));
        }
        if inside >= 0.0 {
            break;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::PatchedScene;
    use super::*;
    use crate::random::Stream;
    use crate::sampling::{Seed, Shifted};
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use std::sync::Arc;

    fn divided() -> PatchedScene {
        let glb = made::divided_room(0.1, 0.0);
        let scene = import(&glb, &Resources::default(), &ImportLimits::default()).unwrap();
        PatchedScene::for_rays(Arc::new(scene), 3000, None)
    }

    #[test]
    fn a_place_is_found_where_looking_at_all_finds_it() {
        let patched = divided();
        let facets = &patched.facets;
        let index = PieceIndex::new(patched.scene.triangle_count(), facets);
        assert!(!index.grids.is_empty(), "no triangle of this scene is cut into many");
        let seed = Seed { number: 7, well_spread: false };
        for triangle in 0..patched.scene.triangle_count() as u32 {
            let own = index.start[triangle as usize]..index.start[triangle as usize + 1];
            let mut points = Shifted::new(seed, Stream::PatchLight, u64::from(triangle));
            for _ in 0..200 {
                let [u, v] = points.next_pair();
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let (found, at) = index.place(facets, triangle, u, v).unwrap();
                let (expected, expected_at) = nearest(facets, own.clone(), u, v).unwrap();
                assert_eq!(found.at(), expected.at(), "triangle {triangle} at {u}, {v}");
                assert!(own.len() == 1 || at == expected_at);
            }
        }
    }

    /// At corners, on edges and a little beyond them there is a facet, too.
    #[test]
    fn rims_have_a_facet() {
        let patched = divided();
        for triangle in 0..patched.scene.triangle_count() as u32 {
            for (u, v) in
                [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (-1e-6, 0.3), (0.7, 0.3001)]
            {
                assert!(patched.place_on_triangle(triangle, u, v).is_some());
            }
        }
    }
}
