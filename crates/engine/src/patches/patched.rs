//! A scene in facets and patches, all of them listed.

use super::contacts::{cut_at_contacts, find_contacts};
use super::facet::{Facet, NO_PATCH, cells, facet_area, nth_cell};
use super::focus::Focus;
use super::index::{FacetIndex, PatchIndex};
use super::means::{CellMeans, PlainMeans, colour_varies, exponent_of, point_of};
use super::piece_index::PieceIndex;
use super::{bodies, seams, split};
use crate::radiometry::{Reflectance, Rgb, importance};
use crate::scene::{Scene, Warning};
use foldhash::{HashMap, HashMapExt};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A scene cut into facets and patches.
pub struct PatchedScene {
    /// The scene that was cut.
    pub scene: Arc<Scene>,
    /// World positions of facet corners, equal positions stored once.
    pub positions: Vec<Vec3>,
    /// Triangles to rasterise.
    pub facets: Vec<Facet>,
    /// Finite elements.
    pub patches: Patches,
    /// What was left out.
    pub warnings: Vec<Warning>,
    /// What the patches are finest about.
    pub focus: Option<Focus>,
    /// Finds a triangle's facets.
    pieces: PieceIndex,
}

/// The patches, one entry a patch in every array.
#[derive(Default)]
pub struct Patches {
    /// Area A, m².
    pub area: Vec<f32>,
    /// Centroid, world space.
    pub centroid: Vec<Vec3>,
    /// Unit geometric normal of the patch's side.
    pub normal: Vec<Vec3>,
    /// Unit shading normal of the patch's side at the centroid.
    pub shading_normal: Vec<Vec3>,
    /// Diffuse albedo kd, mean over the patch.
    pub diffuse: Vec<Rgb>,
    /// Specular albedo ks, mean over the patch.
    pub specular: Vec<Rgb>,
    /// Phong exponent n.
    pub exponent: Vec<f32>,
    /// Albedo under uniform light, diffuse part and lobe together, as the material's own model has
    /// it; mean over the patch.
    pub albedo: Vec<Rgb>,
    /// Emitted radiance L^e, mean over the patch.
    pub emission: Vec<Rgb>,
    /// The facet that it is a cell of.
    pub facet: Vec<u32>,
}

impl Patches {
    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// Appends the patches of further facets.
    fn append(&mut self, mut more: Self) {
        self.area.append(&mut more.area);
        self.centroid.append(&mut more.centroid);
        self.normal.append(&mut more.normal);
        self.shading_normal.append(&mut more.shading_normal);
        self.diffuse.append(&mut more.diffuse);
        self.specular.append(&mut more.specular);
        self.exponent.append(&mut more.exponent);
        self.albedo.append(&mut more.albedo);
        self.emission.append(&mut more.emission);
        self.facet.append(&mut more.facet);
    }

    /// How the patch reflects.
    pub fn reflectance(&self, patch: usize) -> Reflectance {
        Reflectance {
            diffuse: self.diffuse[patch],
            specular: self.specular[patch],
            exponent: self.exponent[patch],
        }
    }

    /// Whether the patch reflects a Phong lobe.
    pub fn is_glossy(&self, patch: usize) -> bool {
        self.specular[patch].max_element() > 0.0
    }

    /// Whether the patch emits by itself.
    pub fn emits(&self, patch: usize) -> bool {
        self.emission[patch].max_element() > 0.0
    }

    /// Whether any patch is glossy.
    pub fn any_glossy(&self) -> bool {
        (0..self.len()).any(|patch| self.is_glossy(patch))
    }

    /// Whether any patch emits power that a number can hold.
    pub fn any_light(&self) -> bool {
        (0..self.len()).any(|patch| {
            importance(std::f32::consts::PI * self.area[patch] * self.emission[patch]) > 0.0
        })
    }
}

/// Samples of textures in all patches: 64 in each where patches are few enough, never less than 4.
const MOST_SAMPLES: usize = 4 << 20;
/// Facets that one thread takes at a time.
const CHUNK: usize = 512;
/// Most patches of a scene.
pub const MAX_PATCHES: usize = 4_000_000;

impl PatchedScene {
    /// Bytes that positions, facets and patches take.
    pub fn held_bytes(&self) -> u64 {
        // Area, exponent, facet; centroid and normals; albedos and emission.
        const PER_PATCH: usize = 3 * 4 + 3 * size_of::<Vec3>() + 4 * size_of::<Rgb>();
        let lists = size_of_val(&*self.positions) + size_of_val(&*self.facets);
        (lists + self.patches.len() * PER_PATCH) as u64 + self.pieces.held_bytes()
    }

    /// Cuts `scene` into about `target` patches of about equal area, at least one a triangle side.
    ///
    /// Elongated triangles are bisected first (conformingly), so that patches are compact.
    pub fn new(scene: Arc<Scene>, target: usize) -> Self {
        Self::cut(scene, target, None, false)
    }

    /// The same for methods that follow rays: facets end where others stand on them, and with a focus
    /// patches are the larger the farther they are from what the camera sees. Facets on both sides of
    /// such a line share no corners there, which leaves cracks as wide as rounding.
    pub fn for_rays(scene: Arc<Scene>, target: usize, focus: Option<Focus>) -> Self {
        Self::cut(scene, target, focus, true)
    }

    fn cut(scene: Arc<Scene>, target: usize, focus: Option<Focus>, at_contacts: bool) -> Self {
        let (mut positions, mut facets) = weld(&scene);
        let mut warnings = Vec::new();
        let dropped = scene.triangle_count() - facets.len();
        if dropped > 0 {
            let what = format!("{dropped} triangles without area were left out");
            warnings.push(Warning::new("scene", what));
        }
        let sides = |facet: &Facet| {
            let material = scene.triangle(facet.source).material;
            if scene.materials[material as usize].double_sided { 2.0 } else { 1.0 }
        };
        if let Some(focus) = focus {
            split::split_far(&mut positions, &mut facets, focus);
            facets.retain(|facet| facet_area(&positions, facet) > 0.0);
        }
        // What counts of a facet's area.
        let counted = |positions: &[Vec3], facet: &Facet| {
            let corners = facet.corners.map(|corner| positions[corner as usize]);
            let weight = focus.map_or(1.0, |focus| focus.weight_of(corners));
            facet_area(positions, facet) * weight
        };
        let total: f64 = facets.iter().map(|f| sides(f) * f64::from(counted(&positions, f))).sum();
        let cell_area = (total / target.clamp(1, MAX_PATCHES) as f64) as f32;
        split::split_elongated(&scene, (&mut positions, &mut facets), cell_area, focus);
        // A midpoint may round onto the opposite corner and leave a piece without area.
        facets.retain(|facet| facet_area(&positions, facet) > 0.0);

        let ((closed, recedes), cuts) = rayon::join(
            || {
                let closed = bodies::facets_of_dark_closed_bodies(&scene, &positions, &facets);
                (closed, seams::facets_that_recede(&scene, &positions, &facets))
            },
            || at_contacts.then(|| find_contacts(&positions, &facets, cell_area, focus)),
        );
        for (index, facet) in facets.iter_mut().enumerate() {
            (facet.cull_back, facet.recedes) = (closed[index], recedes[index]);
        }
        if let Some(cuts) = cuts {
            cut_at_contacts(&mut positions, &mut facets, &cuts);
            split::split_elongated(&scene, (&mut positions, &mut facets), cell_area, focus);
            facets.retain(|facet| facet_area(&positions, facet) > 0.0);
        }
        let mut count = 0;
        for facet in &mut facets {
            let area = counted(&positions, facet);
            let wanted = (area / cell_area.max(f32::MIN_POSITIVE)).sqrt().round();
            facet.divisions = wanted.clamp(1.0, 1024.0) as u32;
            let material = scene.material_of(facet.source);
            let of_side = facet.divisions * facet.divisions;
            facet.front = count;
            count += of_side;
            if material.double_sided && !facet.cull_back {
                facet.back = count;
                count += of_side;
            }
        }
        let patches = patches_of(&scene, &positions, &facets, count as usize);
        if facets.is_empty() {
            warnings.push(Warning::new("scene", "there is no surface to be seen"));
        }
        let pieces = PieceIndex::new(scene.triangle_count(), &facets);
        Self { scene, positions, facets, patches, warnings, focus, pieces }
    }

    /// The facet, and the barycentric coordinates in it, of barycentric (u, v) of a scene triangle;
    /// `None` of triangles that were left out.
    pub fn place_on_triangle(&self, triangle: u32, u: f32, v: f32) -> Option<(FacetIndex, Vec2)> {
        self.pieces.place(&self.facets, triangle, u, v)
    }

    /// Whether base colour or emission changes over a facet.
    pub fn colour_varies(&self, facet: &Facet) -> bool {
        colour_varies(&self.scene, &self.scene.triangle(facet.source))
    }

    /// World position of barycentric (u, v) of a facet.
    pub fn point(&self, facet: &Facet, u: f32, v: f32) -> Vec3 {
        let [a, b, c] = facet.corners.map(|p| self.positions[p as usize]);
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Facet, side, and barycentric corners in the facet of a patch.
    pub fn cell_of(&self, patch: PatchIndex) -> (&Facet, bool, [Vec2; 3]) {
        let facet = &self.facets[self.patches.facet[patch.at()] as usize];
        let back = facet.back != NO_PATCH && patch.0 >= facet.back;
        let first = if back { facet.back } else { facet.front };
        let corners = nth_cell(facet.divisions, patch.0 - first);
        (facet, back, corners)
    }

    /// The point of a patch for two uniform numbers: uniform over its area.
    pub fn point_on_patch(&self, patch: PatchIndex, xi: Vec2) -> Vec3 {
        let (facet, _, [a, b, c]) = self.cell_of(patch);
        let root = xi.x.sqrt();
        let at = a * (1.0 - root) + b * (root * (1.0 - xi.y)) + c * (root * xi.y);
        self.point(facet, at.x, at.y)
    }
}

/// Stores equal positions once, so that neighbours share corners bit for bit.
fn weld(scene: &Scene) -> (Vec<Vec3>, Vec<Facet>) {
    let mut positions = Vec::new();
    let mut index_of: HashMap<[u32; 3], u32> = HashMap::new();
    let mut facets = Vec::with_capacity(scene.triangle_count());
    for source in 0..scene.triangle_count() as u32 {
        let corners = scene.corners(&scene.triangle(source)).map(|p| {
            // Adding zero turns −0 into +0.
            let key = (p + 0.0).to_array().map(f32::to_bits);
            *index_of.entry(key).or_insert_with(|| {
                positions.push(p);
                positions.len() as u32 - 1
            })
        });
        facets.push(Facet {
            corners,
            source,
            source_uv: [Vec2::ZERO, Vec2::X, Vec2::Y],
            divisions: 1,
            front: NO_PATCH,
            back: NO_PATCH,
            cull_back: false,
            recedes: false,
        });
    }
    facets.retain(|facet| facet_area(&positions, facet) > 0.0);
    (positions, facets)
}

/// The patches of all facets, of which there are so many.
fn patches_of(scene: &Scene, positions: &[Vec3], facets: &[Facet], count: usize) -> Patches {
    let samples = (MOST_SAMPLES / count.max(1)) as f32;
    let sub_side = (samples.sqrt() as u32).clamp(2, 8);
    let plain = PlainMeans::new(scene);
    let of_chunk = |(chunk, facets): (usize, &[Facet])| {
        let mut patches = Patches::default();
        for (index, facet) in (CHUNK * chunk..).zip(facets) {
            let sides = [(facet.front, false), (facet.back, true)];
            for (_, back) in sides.into_iter().filter(|(first, _)| *first != NO_PATCH) {
                let side = (index as u32, facet, back);
                cut_side((scene, positions), side, (sub_side, &plain), &mut patches);
            }
        }
        patches
    };
    let all: Vec<Patches> = facets.par_chunks(CHUNK).enumerate().map(of_chunk).collect();
    let mut patches = Patches::default();
    all.into_iter().for_each(|chunk| patches.append(chunk));
    patches
}

/// Appends the patches of one side of a facet, which has that number; colours that vary are sampled in
/// so many sub-cells along a patch's side, others are looked up.
fn cut_side(
    (scene, positions): (&Scene, &[Vec3]),
    (index, facet, back): (u32, &Facet, bool),
    (sub_side, plain): (u32, &PlainMeans),
    patches: &mut Patches,
) {
    let triangle = &scene.triangle(facet.source);
    let [a, b, c] = facet.corners.map(|p| positions[p as usize]);
    let geometric = (b - a).cross(c - a);
    let side = if back { -1.0 } else { 1.0 };
    let normal = geometric.normalize() * side;
    let area = 0.5 * geometric.length() / (facet.divisions * facet.divisions) as f32;
    let varies = colour_varies(scene, triangle);
    let sub_cells: Vec<[Vec2; 3]> = cells(if varies { sub_side } else { 1 }).collect();
    let alike = (!varies).then(|| plain.of(triangle));
    let exponent = exponent_of(scene, triangle);
    for (cell, [pa, pb, pc]) in cells(facet.divisions).enumerate() {
        let points = sub_cells.iter().enumerate().map(|(number, sub_cell)| {
            let sample = point_of(*sub_cell, (cell * sub_cells.len() + number) as u32);
            let at = pa * (1.0 - sample.x - sample.y) + pb * sample.x + pc * sample.y;
            facet.to_source(at.x, at.y)
        });
        let means = alike.unwrap_or_else(|| CellMeans::new(scene, triangle, points));
        let center = (pa + pb + pc) / 3.0;
        let at = facet.to_source(center.x, center.y);
        let shading = scene.interpolate(triangle, at.x, at.y, |vertex| vertex.normal);
        let shading = (shading * side).normalize_or(normal);
        patches.area.push(area);
        patches.centroid.push(a * (1.0 - center.x - center.y) + b * center.x + c * center.y);
        patches.normal.push(normal);
        patches.shading_normal.push(if shading.dot(normal) > 0.0 { shading } else { normal });
        patches.diffuse.push(means.diffuse);
        patches.specular.push(means.specular);
        patches.exponent.push(exponent);
        patches.albedo.push(means.albedo);
        patches.emission.push(means.emission);
        patches.facet.push(index);
    }
}
