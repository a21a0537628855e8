//! Smooth reconstruction from one value a patch: values at the patches' corners (vertices) by a
//! local linear fit, interpolated linearly in between.
//!
//! Corners are shared by facets that meet there with about the same shading normal, so curved
//! meshes show no facets and creases stay sharp. The fit is linear in the patch values: its
//! coefficients are found once.

use crate::filter::middle_coefficients;
use crate::patches::{Facet, PatchIndex, PatchedScene, cell_index, cells};
use crate::radiometry::Rgb;
use foldhash::{HashMap, HashMapExt};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Facets share a corner where their shading normals there differ by less than this angle's
/// cosine (18°).
const SMOOTH_COSINE: f32 = 0.95;
/// And where the facets themselves differ by less than this one (60°): with normals that are rounded off over
/// a rim, a wall has the same ones there as its narrow edge, and the light of one is not that of the other.
const FOLD_COSINE: f32 = 0.5;
/// Fewest patches of a fit: a vertex with fewer around it takes its neighbours' neighbours, too. A
/// plane takes three.
const LEAST_PATCHES: usize = 5;
/// Ridge of the fit, relative to the patches' mean squared distance: it pulls slopes towards zero.
const RIDGE: f32 = 0.02;
/// Most patches that a fit takes from around one neighbour, such as the hub of a fan.
const MOST_PER_NEIGHBOUR: usize = 32;
/// Start of a side that a facet does not have.
const NO_SIDE: u32 = u32::MAX;

/// How patch values become a function over the surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothness {
    /// Local linear fits at the patches' corners, interpolated.
    Smooth,
    /// Each patch its own value: every vertex of the reconstruction is a patch.
    Flat,
}

/// The vertices of a reconstruction and the coefficients by which patch values become theirs.
pub struct Reconstruction {
    smoothness: Smoothness,
    /// First entry in `lattice` of each facet's front and back; [`NO_SIDE`] for a side without.
    side_start: Vec<[u32; 2]>,
    /// Vertex of each lattice point of each side.
    lattice: Vec<u32>,
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    /// Normal of the first facet at each vertex.
    flat: Vec<Vec3>,
    /// Fit of each vertex: entries `start[v]..start[v + 1]` of `patch` and `coefficient`.
    start: Vec<u32>,
    patch: Vec<u32>,
    coefficient: Vec<f32>,
    /// Centroids of the patches.
    centroid: Vec<Vec3>,
}

/// A lattice point that facets can share: a corner of the mesh, a point k/n along an edge
/// (lowest terms), or a point inside one facet.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum LatticePlace {
    Corner(u32),
    Edge { low: u32, high: u32, part: u32, of: u32 },
    Inside { facet: u32, index: u32 },
}

impl Reconstruction {
    /// Bytes that it takes.
    pub fn held_bytes(&self) -> u64 {
        let of_vertices = size_of_val(&*self.position)
            + size_of_val(&*self.normal)
            + size_of_val(&*self.flat)
            + size_of_val(&*self.start)
            + size_of_val(&*self.patch)
            + size_of_val(&*self.coefficient);
        let of_patches = size_of_val(&*self.side_start)
            + size_of_val(&*self.lattice)
            + size_of_val(&*self.centroid);
        (of_vertices + of_patches) as u64
    }

    /// Finds the vertices and their fits.
    pub fn new(scene: &PatchedScene, smoothness: Smoothness) -> Self {
        let mut this = Self {
            smoothness,
            side_start: vec![[NO_SIDE; 2]; scene.facets.len()],
            lattice: Vec::new(),
            position: Vec::new(),
            normal: Vec::new(),
            flat: Vec::new(),
            start: vec![0],
            patch: Vec::new(),
            coefficient: Vec::new(),
            centroid: scene.patches.centroid.clone(),
        };
        if smoothness == Smoothness::Flat {
            let count = scene.patches.len() as u32;
            this.start = (0..=count).collect();
            this.patch = (0..count).collect();
            this.coefficient = vec![1.0; count as usize];
            return this;
        }
        this.place_vertices(scene);
        let around = this.patches_around(scene);
        let fits: Vec<Vec<(u32, f32)>> = (0..this.position.len())
            .into_par_iter()
            .map(|vertex| this.fit(scene, vertex, &around))
            .collect();
        for fit in fits {
            for (patch, coefficient) in fit {
                this.patch.push(patch);
                this.coefficient.push(coefficient);
            }
            this.start.push(this.patch.len() as u32);
        }
        this
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.start.len() - 1
    }

    /// Values at the vertices from values of the patches.
    ///
    /// A patch whose value is exactly zero among lit ones was never reached (it lies inside a
    /// body that stands on it): it says nothing about its surroundings and is left out.
    pub fn apply(&self, values: &[Rgb]) -> Vec<Rgb> {
        if values.is_empty() {
            return Vec::new();
        }
        (0..self.vertices())
            .into_par_iter()
            .with_min_len(1024)
            .map(|vertex| {
                let entries = self.start[vertex] as usize..self.start[vertex + 1] as usize;
                let patches = &self.patch[entries.clone()];
                let unlit = patches.iter().filter(|p| values[**p as usize] == Rgb::ZERO).count();
                let mut value = Rgb::ZERO;
                let (mut lowest, mut highest) = (Rgb::ZERO, Rgb::ZERO);
                let mut add = |patch: u32, coefficient: f32| {
                    value += values[patch as usize] * coefficient;
                    lowest = lowest.min(values[patch as usize]);
                    highest = highest.max(values[patch as usize]);
                };
                if unlit == 0 || unlit == patches.len() {
                    for (patch, coefficient) in patches.iter().zip(&self.coefficient[entries]) {
                        add(*patch, *coefficient);
                    }
                } else {
                    let lit: Vec<u32> = patches
                        .iter()
                        .copied()
                        .filter(|p| values[*p as usize] != Rgb::ZERO)
                        .collect();
                    for (patch, coefficient) in
                        lit.iter().zip(self.coefficients(vertex, &lit, RIDGE))
                    {
                        add(*patch, coefficient);
                    }
                }
                // A fit may overshoot at a border. It must not make light negative that isn't;
                // noise about a known part of the light may be.
                value.clamp(2.0 * lowest, 2.0 * highest)
            })
            .collect()
    }

    /// The patches that the value at a vertex is made of.
    pub fn patches_about(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.patch[self.start[vertex] as usize..self.start[vertex + 1] as usize]
    }

    /// The vertices around barycentric (u, v) of a facet's side with their interpolation weights;
    /// `None` for a black side.
    #[inline]
    pub fn corners(
        &self,
        facet_index: usize,
        back: bool,
        facet: &Facet,
        u: f32,
        v: f32,
    ) -> Option<[(u32, f32); 3]> {
        let n = facet.divisions;
        if self.smoothness == Smoothness::Flat {
            let patch = facet.first_patch(back)? + cell_index(n, u, v);
            return Some([(patch, 1.0), (patch, 0.0), (patch, 0.0)]);
        }
        let start = self.side_start[facet_index][usize::from(back)];
        if start == NO_SIDE {
            return None;
        }
        let (fu, fv) = (u * n as f32, v * n as f32);
        let i = (fu as u32).min(n - 1);
        let j = (fv as u32).min(n - 1 - i);
        let (du, dv) = (fu - i as f32, fv - j as f32);
        let at = |i, j| self.lattice[(start + lattice_index(n, i, j)) as usize];
        Some(if du + dv > 1.0 && j < n - 1 - i {
            [(at(i + 1, j + 1), du + dv - 1.0), (at(i, j + 1), 1.0 - du), (at(i + 1, j), 1.0 - dv)]
        } else {
            [(at(i, j), 1.0 - du - dv), (at(i + 1, j), du), (at(i, j + 1), dv)]
        })
    }

    /// Of a facet's side with such a first patch: slopes of the interpolated values over each cell, per
    /// side of a cell along the first edge and along the second.
    pub fn slopes(
        &self,
        (index, facet): (usize, &Facet),
        back: bool,
        vertices: &[Rgb],
    ) -> impl Iterator<Item = [Rgb; 2]> {
        let is_smooth = self.smoothness == Smoothness::Smooth;
        cells(facet.divisions).map(move |corners| {
            if !is_smooth {
                return [Rgb::ZERO; 2];
            }
            let [a, b, c] = self
                .cell_vertices(index, back, facet, corners)
                .map(|vertex| vertices[vertex as usize]);
            // A cell across a diagonal has its first corner at the far end of both edges.
            match corners[1].x > corners[0].x {
                true => [b - a, c - a],
                false => [a - b, a - c],
            }
        })
    }

    fn place_vertices(&mut self, scene: &PatchedScene) {
        // Vertices at a place, one for each direction that a surface faces there.
        let mut at_place: HashMap<LatticePlace, Vec<u32>> = HashMap::new();
        for (index, facet) in scene.facets.iter().enumerate() {
            for back in [false, true] {
                if facet.first_patch(back).is_none() {
                    continue;
                }
                self.side_start[index][usize::from(back)] = self.lattice.len() as u32;
                let (n, flat) = (facet.divisions, flat_normal(scene, facet, back));
                for i in 0..=n {
                    for j in 0..=n - i {
                        let (place, position) = locate(scene, facet, index as u32, i, j);
                        let normal = shading_normal(scene, facet, i, j, back);
                        let candidates = at_place.entry(place).or_default();
                        let shared = candidates.iter().copied().find(|vertex| {
                            let at = *vertex as usize;
                            self.normal[at].dot(normal) > SMOOTH_COSINE
                                && self.flat[at].dot(flat) > FOLD_COSINE
                        });
                        let vertex = shared.unwrap_or_else(|| {
                            let vertex = self.position.len() as u32;
                            self.position.push(position);
                            self.normal.push(normal);
                            self.flat.push(flat);
                            candidates.push(vertex);
                            vertex
                        });
                        self.lattice.push(vertex);
                    }
                }
            }
        }
    }

    /// Per vertex, the patches that have it as a corner.
    fn patches_around(&self, scene: &PatchedScene) -> Vec<Vec<u32>> {
        let mut around = vec![Vec::new(); self.position.len()];
        for (index, facet) in scene.facets.iter().enumerate() {
            for back in [false, true] {
                let Some(first) = facet.first_patch(back) else { continue };
                for (cell, corners) in cells(facet.divisions).enumerate() {
                    for vertex in self.cell_vertices(index, back, facet, corners) {
                        around[vertex as usize].push(first + cell as u32);
                    }
                }
            }
        }
        around
    }

    fn cell_vertices(
        &self,
        index: usize,
        back: bool,
        facet: &Facet,
        corners: [Vec2; 3],
    ) -> [u32; 3] {
        let n = facet.divisions;
        let start = self.side_start[index][usize::from(back)];
        corners.map(|corner| {
            let at = (corner * n as f32).round();
            self.lattice[(start + lattice_index(n, at.x as u32, at.y as u32)) as usize]
        })
    }

    /// Patches of a vertex's fit with their coefficients.
    fn fit(&self, scene: &PatchedScene, vertex: usize, around: &[Vec<u32>]) -> Vec<(u32, f32)> {
        let mut patches = around[vertex].clone();
        if patches.len() < LEAST_PATCHES {
            for patch in around[vertex].clone() {
                let (facet, back, corners) = scene.cell_of(PatchIndex(patch));
                let index = scene.patches.facet[patch as usize] as usize;
                for neighbour in self.cell_vertices(index, back, facet, corners) {
                    // The hub of a fan has too many to copy to every rim vertex.
                    let around = &around[neighbour as usize];
                    patches.extend(around.iter().take(MOST_PER_NEIGHBOUR));
                }
            }
        }
        patches.sort_unstable();
        patches.dedup();
        let coefficients = self.coefficients(vertex, &patches, RIDGE);
        patches.into_iter().zip(coefficients).collect()
    }

    /// Coefficients of the weighted least-squares plane through patch values, at the vertex.
    fn coefficients(&self, vertex: usize, patches: &[u32], ridge: f32) -> Vec<f32> {
        let (tangent, bitangent) = crate::sampling::frame(self.normal[vertex], 0.0);
        let offset = |patch: &u32| {
            let relative = self.centroid[*patch as usize] - self.position[vertex];
            Vec2::new(relative.dot(tangent), relative.dot(bitangent))
        };
        let offsets: Vec<Vec2> = patches.iter().map(offset).collect();
        let nearest = offsets
            .iter()
            .map(|o| o.length_squared())
            .fold(f32::INFINITY, f32::min)
            .max(f32::MIN_POSITIVE);
        // Gaussian over about the first ring of patches.
        let weights: Vec<f32> = offsets
            .iter()
            .map(|o| (-o.length_squared() / (6.0 * nearest)).exp().max(1e-6))
            .collect();
        middle_coefficients(&offsets, &weights, ridge)
    }
}

/// Index of lattice point (i, j), i + j ≤ n, in columns of constant i.
#[inline]
fn lattice_index(n: u32, i: u32, j: u32) -> u32 {
    i * (n + 1) - i * i.saturating_sub(1) / 2 + j
}

fn shading_normal(scene: &PatchedScene, facet: &Facet, i: u32, j: u32, back: bool) -> Vec3 {
    let n = facet.divisions as f32;
    let at = facet.to_source(i as f32 / n, j as f32 / n);
    let triangle = &scene.scene.triangle(facet.source);
    let normal = scene.scene.interpolate(triangle, at.x, at.y, |vertex| vertex.normal);
    let normal = normal.normalize_or(flat_normal(scene, facet, false));
    if back { -normal } else { normal }
}

fn flat_normal(scene: &PatchedScene, facet: &Facet, back: bool) -> Vec3 {
    let [a, b, c] = facet.corners.map(|p| scene.positions[p as usize]);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if back { -normal } else { normal }
}

/// What facets share at lattice point (i, j), and where it is.
fn locate(scene: &PatchedScene, facet: &Facet, index: u32, i: u32, j: u32) -> (LatticePlace, Vec3) {
    let n = facet.divisions;
    let [a, b, c] = facet.corners;
    let k = n - i - j;
    let edge = |from: u32, to: u32, part: u32| {
        // Counted from the lower corner, so that both neighbours name the same place.
        let (low, high, part) = if from < to { (from, to, part) } else { (to, from, n - part) };
        let divisor = gcd(part, n);
        let place = LatticePlace::Edge { low, high, part: part / divisor, of: n / divisor };
        let (p, q) = (scene.positions[low as usize], scene.positions[high as usize]);
        (place, p.lerp(q, part as f32 / n as f32))
    };
    let corner = |at: u32| (LatticePlace::Corner(at), scene.positions[at as usize]);
    match (i, j, k) {
        (_, _, k) if k == n => corner(a),
        (i, _, _) if i == n => corner(b),
        (_, j, _) if j == n => corner(c),
        (i, 0, _) => edge(a, b, i),
        (0, j, _) => edge(a, c, j),
        (_, j, 0) => edge(b, c, j),
        (i, j, _) => {
            let point = scene.point(facet, i as f32 / n as f32, j as f32 / n as f32);
            (LatticePlace::Inside { facet: index, index: lattice_index(n, i, j) }, point)
        }
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Scene, Triangle, Vertex};
    use std::sync::Arc;

    /// A plate, 1 × 1 m and a centimetre thick, with the normals of its corners rounded off.
    fn rounded_plate() -> Scene {
        let mut scene = Scene::default();
        scene.materials.push(Material::lambertian("plate", Rgb::splat(0.5)));
        let corner =
            |k: u32| Vec3::new((k & 1) as f32, 0.01 * (k >> 1 & 1) as f32, (k >> 2) as f32);
        let middle = Vec3::new(0.5, 0.005, 0.5);
        let outwards = |at: Vec3| ((at - middle) / middle).normalize();
        for at in (0..8).map(corner) {
            scene.vertices.push(Vertex::new(at, outwards(at)));
        }
        for [a, b, c, d] in
            [[2, 6, 7, 3], [0, 1, 5, 4], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [4, 5, 7, 6]]
        {
            for vertices in [[a, b, c], [a, c, d]] {
                scene.triangles.push(Triangle { vertices, material: 0 });
            }
        }
        scene
    }

    /// What lights one side of a thin wall is not taken to light its edge or the other side, though they have
    /// the same shading normals where they meet.
    #[test]
    fn light_stays_on_its_side_of_a_rounded_plate() {
        let scene = PatchedScene::new(Arc::new(rounded_plate()), 200);
        let smooth = Reconstruction::new(&scene, Smoothness::Smooth);
        let normals = &scene.patches.normal;
        let lit = |normal: &Vec3| if normal.y > 0.9 { Rgb::ONE } else { Rgb::ZERO };
        let mut values: Vec<Rgb> = normals.iter().map(lit).collect();
        // Below there is a little light: what is exactly dark is left out anyway.
        values.iter_mut().for_each(|value| *value = value.max(Rgb::splat(0.01)));
        let vertices = smooth.apply(&values);
        let mut corners = 0;
        for (index, facet) in scene.facets.iter().enumerate() {
            let up = flat_normal(&scene, facet, false).y;
            for [u, v] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
                let all = smooth.corners(index, false, facet, u, v).expect("a front");
                let value: Rgb = all.iter().map(|(v, w)| vertices[*v as usize] * *w).sum();
                let own = if up > 0.9 { 1.0 } else { 0.01 };
                corners += 1;
                assert!((value.x - own).abs() < 1e-3, "{value} at a facet with {up}");
            }
        }
        assert!(corners >= 36, "{corners}");
    }

    #[test]
    fn lattice_points_are_numbered_without_gaps() {
        for n in [1, 2, 5, 33] {
            let mut expected = 0;
            for i in 0..=n {
                for j in 0..=n - i {
                    assert_eq!(lattice_index(n, i, j), expected);
                    expected += 1;
                }
            }
        }
    }
}
