//! A scene of many more triangles than patches are wanted. Each side of a triangle is one patch, and
//! all that is kept of it is whether it is so: corners and materials are the scene's. Only triangles
//! that are larger than a patch are cut, and those pieces listed. The patches of instances are clusters
//! of their triangles' sides ([`super::clusters`]).

use super::clusters::{Clusters, Outline};
use super::facet::{NO_PATCH, Sides, cells, in_piece, nth_cell};
use super::focus::{Focus, area_of, pieces_of};
use super::index::{FacetIndex, PatchIndex};
use super::means::{CellMeans, colour_varies, point_of};
use super::split::{MAX_ELONGATION, elongation};
use crate::scene::{Material, Scene, Triangle};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Triangles of a parallel task.
const CHUNK: usize = 1 << 14;
/// Triangles are cut into so many pieces altogether at most; where they would be more, each is one.
const MOST_PIECES: usize = 200_000;
/// Triangles with a larger part of a patch may be cut.
const LEAST_CUT: f32 = 1.5;
/// Points of a patch along each side where its colour varies, of one of ordinary size.
const POINTS: f32 = 8.0;

/// A scene of which little is listed.
pub struct Crowd {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Patches that were wanted.
    pub wanted: usize,
    /// Area of a patch of ordinary size, m², in the focus.
    pub cell_area: f32,
    /// What the patches are finest about.
    pub focus: Option<Focus>,
    /// Triangles without area.
    pub left_out: usize,
    /// Patches that there are.
    pub count: usize,
    /// Patches of a triangle that is not cut: `sides * t` and, if there are two sides, the next.
    sides: u32,
    /// A bit for each triangle that is cut.
    is_cut: Vec<u64>,
    /// Triangles that are cut, each with its first piece, sorted.
    cut: Vec<(u32, u32)>,
    pieces: Vec<CutPiece>,
    /// Patches of instances, if there are any; their numbers come last.
    clusters: Option<Clusters>,
    /// Number of the first of those.
    first_cluster: u32,
}

/// A piece of a triangle that is cut.
#[derive(Clone, Copy)]
struct CutPiece {
    triangle: u32,
    /// Barycentric (u, v) of the corners in the triangle.
    at: [Vec2; 3],
    sides: Sides,
}

/// What a parallel task finds.
struct FoundPieces {
    pieces: Vec<CutPiece>,
    left_out: usize,
    count: usize,
}

/// A side of a triangle, or a part of it, that is a patch of a crowd.
pub struct CrowdPatch {
    /// The facet.
    pub facet: FacetIndex,
    /// The triangle.
    pub triangle: u32,
    /// Whether it is on the back.
    pub back: bool,
    /// Barycentric corners in the triangle.
    pub at: [Vec2; 3],
}

impl Crowd {
    /// Bytes that it takes beside the scene.
    pub fn held_bytes(&self) -> u64 {
        let clusters = self.clusters.as_ref().map_or(0, Clusters::held_bytes);
        let lists =
            size_of_val(&*self.is_cut) + size_of_val(&*self.cut) + size_of_val(&*self.pieces);
        clusters + lists as u64
    }

    /// Cuts what is larger than a patch, for about `wanted` patches of equal area if the triangles
    /// were no smaller.
    pub fn new(scene: Arc<Scene>, wanted: usize, focus: Option<Focus>) -> Self {
        let total: f64 = counted_area(&scene, focus);
        let cell_area = (total / wanted.max(1) as f64) as f32;
        let two_sided = scene.materials.iter().any(|material| material.double_sided);
        let mut this = Self {
            wanted,
            cell_area: cell_area.max(f32::MIN_POSITIVE),
            focus,
            left_out: 0,
            count: 0,
            sides: if two_sided { 2 } else { 1 },
            is_cut: vec![0; scene.triangles.len().div_ceil(64)],
            cut: Vec::new(),
            pieces: Vec::new(),
            clusters: None,
            first_cluster: 0,
            scene,
        };
        let found = this.find_pieces(true);
        let pieces: usize = found.iter().map(|found| found.pieces.len()).sum();
        let found = if pieces > MOST_PIECES { this.find_pieces(false) } else { found };
        this.list(found);
        this.first_cluster = this.listed_bound() as u32;
        if !this.scene.instances.is_empty() {
            let clusters = Clusters::new(&this.scene, this.cell_area.sqrt(), focus);
            this.count += clusters.count() as usize;
            this.clusters = Some(clusters);
        }
        this
    }

    fn find_pieces(&self, may_cut: bool) -> Vec<FoundPieces> {
        let chunks = 0..self.scene.triangles.len().div_ceil(CHUNK);
        let of_chunk = |chunk: usize| {
            let mut found = FoundPieces { pieces: Vec::new(), left_out: 0, count: 0 };
            let first = chunk * CHUNK;
            let end = (first + CHUNK).min(self.scene.triangles.len());
            for triangle in first as u32..end as u32 {
                self.cut_triangle(triangle, may_cut, &mut found);
            }
            found
        };
        chunks.into_par_iter().map(of_chunk).collect()
    }

    /// Cuts a triangle, if need be.
    fn cut_triangle(&self, triangle: u32, may_cut: bool, found: &mut FoundPieces) {
        let corners = self.scene.corners(&self.scene.triangle(triangle));
        let area = area_of(corners);
        if area.is_nan() || area <= 0.0 {
            found.left_out += 1;
            return;
        }
        let sides = 1 + usize::from(self.is_two_sided(triangle));
        let is_small = |corners| self.cells_of(corners) < LEAST_CUT;
        let is_far_larger = |corners| self.focus.is_some_and(|focus| focus.is_too_large(corners));
        if !may_cut || (is_small(corners) && !is_far_larger(corners)) {
            found.count += sides;
            return;
        }
        let too_large = |piece| {
            is_far_larger(piece) || (!is_small(piece) && elongation(piece) > MAX_ELONGATION)
        };
        for (piece, at) in pieces_of(corners, too_large) {
            let divisions = self.cells_of(piece).sqrt().round().clamp(1.0, 1024.0) as u32;
            let cut = Sides { divisions, front: NO_PATCH, back: NO_PATCH };
            found.pieces.push(CutPiece { triangle, at, sides: cut });
            found.count += sides * (divisions * divisions) as usize;
        }
    }

    /// How many patches a piece of a triangle is worth.
    fn cells_of(&self, corners: [Vec3; 3]) -> f32 {
        let weight = self.focus.map_or(1.0, |focus| focus.weight_of(corners));
        area_of(corners) * weight / self.cell_area
    }

    /// Lists the pieces and numbers their patches behind those of the triangles that are not cut.
    fn list(&mut self, found: Vec<FoundPieces>) {
        let mut next = self.sides * self.scene.triangles.len() as u32;
        for FoundPieces { mut pieces, left_out, count } in found {
            self.left_out += left_out;
            self.count += count;
            for piece in &mut pieces {
                let triangle = piece.triangle;
                if self.cut.last().is_none_or(|last| last.0 != triangle) {
                    self.is_cut[triangle as usize / 64] |= 1 << (triangle % 64);
                    self.cut.push((triangle, self.pieces.len() as u32));
                }
                let cells = piece.sides.divisions * piece.sides.divisions;
                piece.sides.front = next;
                next += cells;
                if self.is_two_sided(triangle) {
                    piece.sides.back = next;
                    next += cells;
                }
                self.pieces.push(*piece);
            }
        }
    }

    /// The bound of the patches' numbers; some of them are no patches.
    pub fn bound(&self) -> usize {
        let of_instances = self.clusters.as_ref().map_or(0, Clusters::count);
        self.first_cluster as usize + of_instances as usize
    }

    /// The same of those that are not of instances.
    fn listed_bound(&self) -> usize {
        let whole = self.sides as usize * self.scene.triangles.len();
        let of = |piece: &CutPiece| {
            let sides = if piece.sides.back == NO_PATCH { 1 } else { 2 };
            sides * (piece.sides.divisions * piece.sides.divisions) as usize
        };
        whole + self.pieces.iter().map(of).sum::<usize>()
    }

    /// Whether a triangle's back has patches, too.
    pub fn is_two_sided(&self, triangle: u32) -> bool {
        let triangle = &self.scene.triangle(triangle);
        self.scene.materials[triangle.material as usize].double_sided
    }

    fn is_cut(&self, triangle: u32) -> bool {
        if triangle as usize >= self.scene.triangles.len() {
            return false;
        }
        self.is_cut[triangle as usize / 64] >> (triangle % 64) & 1 == 1
    }

    /// The triangle of a facet: a triangle that is not cut, or a piece.
    pub fn source(&self, facet: FacetIndex) -> u32 {
        let piece = facet.at().checked_sub(self.scene.triangle_count());
        piece.map_or(facet.0, |piece| self.pieces[piece].triangle)
    }

    /// Barycentric (u, v) in the triangle of a place in a facet.
    pub fn to_source(&self, facet: FacetIndex, at: Vec2) -> Vec2 {
        let Some(piece) = facet.at().checked_sub(self.scene.triangle_count()) else { return at };
        let [a, b, c] = self.pieces[piece].at;
        a * (1.0 - at.x - at.y) + b * at.x + c * at.y
    }

    /// How a facet is cut.
    pub fn sides(&self, facet: FacetIndex) -> Sides {
        match facet.at().checked_sub(self.scene.triangle_count()) {
            Some(piece) => self.pieces[piece].sides,
            None if facet.at() >= self.scene.triangles.len() => self.sides_of_instance(facet),
            None => {
                let front = self.sides * facet.0;
                let back = if self.is_two_sided(facet.0) { front + 1 } else { NO_PATCH };
                Sides { divisions: 1, front, back }
            }
        }
    }

    fn sides_of_instance(&self, facet: FacetIndex) -> Sides {
        let found = self.scene.instance_of(facet.0).zip(self.clusters.as_ref());
        let none = Sides { divisions: 1, front: NO_PATCH, back: NO_PATCH };
        found.map_or(none, |(triangle, clusters)| {
            clusters.sides(&self.scene, triangle, self.first_cluster)
        })
    }

    /// The patches of instances and a patch's number among them, if it is one of those.
    pub fn cluster(&self, patch: PatchIndex) -> Option<(&Clusters, u32)> {
        Some((self.clusters.as_ref()?, patch.0.checked_sub(self.first_cluster)?))
    }

    /// What groups of patches are made by; `None` where the number is that of no patch.
    pub fn outline(&self, index: PatchIndex) -> Option<Outline> {
        if let Some((clusters, number)) = self.cluster(index) {
            return clusters.outline(&self.scene, number);
        }
        let patch = self.patch(index)?;
        let [a, b, c] = self.corners(&patch);
        let across = (b - a).cross(c - a);
        let area = 0.5 * across.length();
        if area.is_nan() || area <= 0.0 {
            return None;
        }
        Some(Outline {
            area,
            center: (a + b + c) / 3.0,
            facing: if patch.back { -across } else { across },
            back: patch.back,
            material: self.scene.triangle(patch.triangle).material,
            albedo: self.means(index, &patch).albedo,
        })
    }

    /// The facet, and the place in it, of barycentric (u, v) of a triangle.
    pub fn place_on_triangle(&self, triangle: u32, u: f32, v: f32) -> Option<(FacetIndex, Vec2)> {
        if !self.is_cut(triangle) {
            return Some((FacetIndex(triangle), Vec2::new(u, v)));
        }
        let number = self.cut.binary_search_by_key(&triangle, |cut| cut.0).ok()?;
        let first = self.cut[number].1 as usize;
        let end = self.cut.get(number + 1).map_or(self.pieces.len(), |next| next.1 as usize);
        let mut found = None;
        let mut nearest = f32::NEG_INFINITY;
        for piece in first..end {
            let at = in_piece(&self.pieces[piece].at, u, v);
            let inside = at.x.min(at.y).min(1.0 - at.x - at.y);
            if inside > nearest {
                let facet = FacetIndex((self.scene.triangle_count() + piece) as u32);
                (nearest, found) = (inside, Some((facet, at)));
            }
            if inside >= 0.0 {
                break;
            }
        }
        found
    }

    /// A patch that is not of an instance by its number; `None` where that is none.
    pub fn patch(&self, patch: PatchIndex) -> Option<CrowdPatch> {
        let triangles = self.scene.triangles.len();
        let whole = self.sides * triangles as u32;
        if patch.0 < whole {
            let (triangle, back) = (patch.0 / self.sides, patch.0 % self.sides == 1);
            let at = [Vec2::ZERO, Vec2::X, Vec2::Y];
            let is_there = !self.is_cut(triangle) && (!back || self.is_two_sided(triangle));
            let facet = FacetIndex(triangle);
            return is_there.then_some(CrowdPatch { facet, triangle, back, at });
        }
        let piece = self.pieces.partition_point(|piece| piece.sides.front <= patch.0) - 1;
        let CutPiece { triangle, at, sides } = &self.pieces[piece];
        let back = sides.back != NO_PATCH && patch.0 >= sides.back;
        let first = if back { sides.back } else { sides.front };
        let [a, b, c] = *at;
        let place = |at: Vec2| a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
        let at = nth_cell(sides.divisions, patch.0 - first).map(place);
        let facet = FacetIndex((self.scene.triangle_count() + piece) as u32);
        Some(CrowdPatch { facet, triangle: *triangle, back, at })
    }

    /// All sides of triangles, also of instances', or the patches of those that are cut, each with the
    /// patch that it is or belongs to.
    pub fn all_sides(&self) -> impl ParallelIterator<Item = (PatchIndex, CrowdPatch)> + '_ {
        let at = [Vec2::ZERO, Vec2::X, Vec2::Y];
        let whole = (0..self.scene.triangle_count() as u32).into_par_iter().with_min_len(CHUNK);
        let sides_of = move |triangle: u32| {
            let facet = FacetIndex(triangle);
            let sides = if self.is_cut(triangle) { None } else { Some(self.sides(facet)) };
            [false, true].into_iter().filter_map(move |back| {
                let patch = PatchIndex(sides?.first_patch(back)?);
                Some((patch, CrowdPatch { facet, triangle, back, at }))
            })
        };
        let first = self.sides * self.scene.triangles.len() as u32;
        let parts = (first..self.first_cluster).into_par_iter().with_min_len(CHUNK);
        let parts = parts.filter_map(|patch| {
            let patch = PatchIndex(patch);
            Some((patch, self.patch(patch)?))
        });
        whole.flat_map_iter(sides_of).chain(parts)
    }

    /// World positions of the corners of a patch.
    pub fn corners(&self, patch: &CrowdPatch) -> [Vec3; 3] {
        let [a, b, c] = self.scene.corners(&self.scene.triangle(patch.triangle));
        patch.at.map(|at| a * (1.0 - at.x - at.y) + b * at.x + c * at.y)
    }

    /// What a patch reflects and emits, by the fewer points the smaller it is.
    pub fn means(&self, index: PatchIndex, patch: &CrowdPatch) -> CellMeans {
        let triangle = &self.scene.triangle(patch.triangle);
        let mut divisions = 1;
        if colour_varies(&self.scene, triangle) {
            let cells = self.cells_of(self.corners(patch));
            divisions = (POINTS * cells.sqrt()).ceil().clamp(1.0, POINTS) as u32;
        }
        let count = divisions * divisions;
        let [a, b, c] = patch.at;
        let parts: Vec<[Vec2; 3]> = cells(divisions).collect();
        let points = parts.iter().enumerate().map(|(number, part)| {
            let number = index.0.wrapping_mul(count).wrapping_add(number as u32);
            let sample = point_of(*part, number);
            a * (1.0 - sample.x - sample.y) + b * sample.x + c * sample.y
        });
        CellMeans::new(&self.scene, triangle, points)
    }
}

/// The area of all sides that counts, m².
fn counted_area(scene: &Scene, focus: Option<Focus>) -> f64 {
    let of_chunk = |triangles: &[Triangle]| {
        let of = |triangle: &Triangle| {
            let corners = scene.corners(triangle);
            let two_sided = scene.materials[triangle.material as usize].double_sided;
            let sides = if two_sided { 2.0 } else { 1.0 };
            sides * focus.map_or(f64::from(area_of(corners)), |focus| focus.counted(corners))
        };
        triangles.iter().map(of).filter(|area| area.is_finite()).sum()
    };
    let sums: Vec<f64> = scene.triangles.par_chunks(CHUNK).map(of_chunk).collect();
    let sides = |material: &Material| if material.double_sided { 2.0 } else { 1.0 };
    let of_instances = scene
        .instance_areas(sides)
        .map(|(middle, area)| area * f64::from(focus.map_or(1.0, |focus| focus.weight(middle))));
    sums.iter().sum::<f64>() + of_instances.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::cell_index;
    use crate::radiometry::Rgb;
    use crate::scene::Vertex;

    /// Many small triangles, every second one with two sides, over two large ones.
    fn scene() -> Arc<Scene> {
        let mut scene = Scene {
            materials: vec![
                Material::lambertian("one-sided", Rgb::splat(0.5)),
                Material {
                    double_sided: true,
                    ..Material::lambertian("two-sided", Rgb::splat(0.3))
                },
            ],
            ..Scene::default()
        };
        let mut square = |x: f32, y: f32, height: f32, side: f32, material: u32| {
            let first = scene.vertices.len() as u32;
            for (across, up) in [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)] {
                let at = Vec3::new(x + across, y + up, height);
                scene.vertices.push(Vertex::new(at, Vec3::Z));
            }
            for corners in [[0, 1, 2], [0, 2, 3]] {
                let vertices = corners.map(|corner| first + corner);
                scene.triangles.push(Triangle { vertices, material });
            }
        };
        for index in 0..900u32 {
            let (x, y) = ((index % 30) as f32, (index / 30) as f32);
            square(0.1 * x, 0.1 * y, 1.0, 0.1, index % 2);
        }
        square(-500.0, -500.0, 0.0, 1000.0, 0);
        square(7.0, 7.0, 7.0, 0.0, 0);
        Arc::new(scene)
    }

    fn patches(crowd: &Crowd) -> Vec<(PatchIndex, CrowdPatch)> {
        let all = (0..crowd.bound() as u32).map(PatchIndex);
        all.filter_map(|index| Some((index, crowd.patch(index)?)))
            .filter(|(_, patch)| area_of(crowd.corners(patch)) > 0.0)
            .collect()
    }

    #[test]
    fn every_patch_is_found_where_it_is() {
        let focus = Focus { center: Vec3::new(1.5, 1.5, 0.5), radius: 2.0 };
        for focus in [None, Some(focus)] {
            let crowd = Crowd::new(scene(), 400, focus);
            let all = patches(&crowd);
            assert_eq!((all.len(), crowd.left_out), (crowd.count, 2));
            let mut area = 0f64;
            for (index, patch) in all {
                area += f64::from(area_of(crowd.corners(&patch)));
                let [a, b, c] = patch.at;
                let middle = (a + b + c) / 3.0;
                let place = crowd.place_on_triangle(patch.triangle, middle.x, middle.y);
                let (facet, at) = place.expect("it has an area");
                let sides = crowd.sides(facet);
                let first = sides.first_patch(patch.back).expect("the side is there");
                assert_eq!(first + cell_index(sides.divisions, at.x, at.y), index.0);
                assert_eq!(crowd.source(facet), patch.triangle);
                let there = crowd.to_source(facet, at);
                assert!(there.distance(middle) < 1e-5, "{there} {middle}");
            }
            let expected = 1e6 + 9.0 * 1.5;
            assert!((area / expected - 1.0).abs() < 1e-4, "{area}");
        }
    }

    /// Without a focus all of the small triangles are less than a patch of the plain.
    #[test]
    fn patches_are_finest_in_focus() {
        let focus = Focus { center: Vec3::new(1.5, 1.5, 0.5), radius: 2.0 };
        let crowd = Crowd::new(scene(), 400, Some(focus));
        assert!(crowd.cell_area < 1.0, "{}", crowd.cell_area);
        for (_, patch) in patches(&crowd) {
            let corners = crowd.corners(&patch);
            let weight = focus.weight_of(corners);
            assert!(area_of(corners) * weight < 4.0 * crowd.cell_area);
        }
        assert!(Crowd::new(scene(), 400, None).cell_area > 1000.0);
    }
}
