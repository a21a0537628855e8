//! The coarse mesh (tier 1): finds the patch or element that a ray has hit, and interpolates values
//! of patches.

use super::elements::{ElementIndex, Elements};
use crate::measurement::reconstruction::{Reconstruction, Smoothness};
use crate::patches::{Cut, Facet, FacetPlace, PatchIndex, PatchedScene, Sides, cell_index};
use crate::radiometry::Rgb;
use crate::rays::{Hit, Rays};
use crate::surface::World;
use glam::Vec2;
use rayon::prelude::*;
use std::sync::Arc;

/// Near field: a ray that ends within so many sides of the patch it meets sees a small part of it,
/// on which the patch's mean is not the light (docs/decisions/0004).
const NEAR_FIELD: f32 = 2.0;
/// Facets that one thread takes at a time.
const CHUNK: usize = 256;
/// Factor by which an interpolated value may differ from its patch's own: interpolation may take
/// values from the other side of a wall.
const MOST_CHANGE: f32 = 2.5;

/// The coarse mesh: the scene in patches, its elements and their interpolation.
pub struct CoarseMesh {
    /// The scene in patches.
    pub cut: Arc<Cut>,
    /// What the light is solved for.
    pub elements: Elements,
    /// How values become smooth; in a crowd, each element has its own.
    reconstruction: Option<Reconstruction>,
    /// Distance within which a hit is in the near field ([`NEAR_FIELD`]), ray units: by facet, in a
    /// crowd by element.
    near: Vec<f32>,
}

/// A quantity on the mesh, such as irradiance.
#[derive(Clone, Default)]
pub struct MeshValues {
    /// Of each patch; in a crowd, of each element.
    pub own: Vec<Rgb>,
    /// At the vertices of the reconstruction.
    vertices: Vec<Rgb>,
}

impl MeshValues {
    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        (size_of_val(&*self.own) + size_of_val(&*self.vertices)) as u64
    }
}

impl CoarseMesh {
    /// A mesh whose light is solved for these elements.
    pub fn new(rays: &Rays, cut: Arc<Cut>, elements: Elements) -> Self {
        let (near, reconstruction) = match &*cut {
            Cut::Listed(listed) => {
                let reconstruction = Reconstruction::new(listed, Smoothness::Smooth);
                (near_of_facets(rays, listed, &elements), Some(reconstruction))
            }
            Cut::Crowd(_) => (near_of_elements(rays, &elements), None),
        };
        Self { cut, elements, reconstruction, near }
    }

    /// Turns the near field off: hits take interpolated values however near they are.
    pub fn ignore_near_field(&mut self) {
        self.near.fill(0.0);
    }

    /// See [`Elements::leave_out_mirrors`].
    pub fn leave_out_mirrors(&mut self) {
        self.elements.leave_out_mirrors(&self.cut);
    }

    /// Bytes that it takes, about, without the cut.
    pub fn held_bytes(&self) -> u64 {
        let reconstruction = self.reconstruction.as_ref().map_or(0, Reconstruction::held_bytes);
        self.elements.held_bytes() + reconstruction + size_of_val(&*self.near) as u64
    }

    /// Whether a hit of a ray of that length is in the near field of where it is.
    pub fn is_near(&self, place: FacetPlace, distance: f32) -> bool {
        let index = match self.reconstruction {
            Some(_) => Some(place.facet.at()),
            None => self.element_on(place).map(ElementIndex::at),
        };
        index.is_some_and(|index| distance < self.near[index])
    }

    /// A function of the mesh by the value of each element, where it has patches; other patches have
    /// none.
    pub fn values(&self, of_element: impl Fn(ElementIndex) -> Rgb) -> MeshValues {
        let Some(reconstruction) = &self.reconstruction else {
            return MeshValues {
                own: self.elements.all().map(of_element).collect(),
                vertices: Vec::new(),
            };
        };
        let of_patch = |patch: usize| {
            self.elements.of(PatchIndex(patch as u32)).map_or(Rgb::ZERO, &of_element)
        };
        let own: Vec<Rgb> = (0..self.cut.patches()).map(of_patch).collect();
        let vertices = reconstruction.apply(&own);
        MeshValues { own, vertices }
    }

    /// Of each element the least and the largest value of the others that share a corner with it, by
    /// the value of each; `None` where there are none, in a crowd, and where most elements have several
    /// patches, so that there are many more of those.
    pub fn ranges_beside(&self, of_elements: &[f32]) -> Vec<Option<[f32; 2]>> {
        let is_simple = self.cut.patches() < 2 * self.elements.len();
        let parts = (self.reconstruction.as_ref().filter(|_| is_simple), &*self.cut);
        let (Some(reconstruction), Cut::Listed(listed)) = parts else {
            return vec![None; of_elements.len()];
        };
        let corners = |patch: &PatchIndex| {
            let index = listed.patches.facet[patch.at()] as usize;
            let (facet, back, [a, b, c]) = listed.cell_of(*patch);
            let middle = (a + b + c) / 3.0;
            let corners = reconstruction.corners(index, back, facet, middle.x, middle.y);
            corners.into_iter().flatten().map(|(vertex, _)| vertex)
        };
        let beside = |own: usize| {
            let own = ElementIndex(own as u32);
            let vertices = self.elements.members(own).iter().flat_map(corners);
            let patches = vertices.flat_map(|vertex| reconstruction.patches_about(vertex));
            let others = patches.filter_map(|patch| self.elements.of(PatchIndex(*patch)));
            let values = others.filter(|other| *other != own).map(|other| of_elements[other.at()]);
            values.fold(None, |range: Option<[f32; 2]>, value| {
                let [least, most] = range.unwrap_or([value; 2]);
                Some([least.min(value), most.max(value)])
            })
        };
        (0..self.elements.len()).into_par_iter().with_min_len(CHUNK).map(beside).collect()
    }

    /// The value of an element.
    pub fn of_element(&self, values: &MeshValues, element: ElementIndex) -> Rgb {
        match self.reconstruction {
            Some(_) => values.own[self.elements.members(element)[0].at()],
            None => values.own[element.at()],
        }
    }

    /// The patch at a hit; `None` at a black back.
    pub fn patch_at(&self, hit: &Hit) -> Option<PatchIndex> {
        let FacetPlace { facet, at, back } = self.place_of(hit)?;
        let sides = self.cut.sides(facet);
        let first = sides.first_patch(back)?;
        Some(PatchIndex(first + cell_index(sides.divisions, at.x, at.y)))
    }

    /// The element at a hit, and where in it the hit is; `None` at a black back and inside of closed
    /// bodies.
    pub fn spot_at(&self, world: &World, hit: &Hit) -> Option<(ElementIndex, CellSpot)> {
        let FacetPlace { facet, at, back } = self.place_of(hit)?;
        let sides = self.cut.sides(facet);
        let Sides { divisions, .. } = sides;
        let patch = PatchIndex(sides.first_patch(back)? + cell_index(divisions, at.x, at.y));
        let element = self.elements.of(patch)?;
        let element = self.elements.part_at(world, element, || {
            let spot = world.rays.spot(hit);
            let normal = if hit.back { -spot.normal } else { spot.normal };
            (spot.off_surface(normal), normal)
        });
        let is_alone = self.reconstruction.is_some() && self.elements.members(element).len() == 1;
        let spot = if is_alone { CellSpot::new(divisions, at) } else { CellSpot::MIDDLE };
        Some((element, spot))
    }

    /// How a function of the mesh, by the value of each element, changes over each element that is one
    /// patch: per side of the patch along the first edge of its facet and along the second. So little
    /// that it stays on one side of zero. Empty in a crowd.
    pub fn slopes(&self, of_element: impl Fn(ElementIndex) -> Rgb) -> Vec<[Rgb; 2]> {
        let (Some(reconstruction), Cut::Listed(listed)) = (&self.reconstruction, &*self.cut) else {
            return Vec::new();
        };
        let values = self.values(of_element);
        let of_side = |index: usize, back: bool| {
            let facet = &listed.facets[index];
            let first = facet.first_patch(back)?;
            let all = reconstruction.slopes((index, facet), back, &values.vertices);
            Some((first..).zip(all).filter_map(|(patch, slope)| {
                let element = self.elements.of(PatchIndex(patch))?;
                let is_alone = self.elements.members(element).len() == 1;
                is_alone.then(|| (element, limited(slope, values.own[patch as usize])))
            }))
        };
        let facets = (0..listed.facets.len()).into_par_iter().with_min_len(CHUNK);
        let sides = facets.flat_map_iter(|index| {
            [false, true].into_iter().filter_map(move |back| of_side(index, back)).flatten()
        });
        let found: Vec<(ElementIndex, [Rgb; 2])> = sides.collect();
        let mut slopes = vec![[Rgb::ZERO; 2]; self.elements.len()];
        for (element, slope) in found {
            slopes[element.at()] = slope;
        }
        slopes
    }

    /// The place on a facet where a hit is.
    pub fn place_of(&self, hit: &Hit) -> Option<FacetPlace> {
        let (facet, at) = self.cut.place_on_triangle(hit.triangle, hit.u, hit.v)?;
        Some(FacetPlace { facet, back: hit.back, at })
    }

    /// The interpolated value at a place.
    pub fn value(&self, values: &MeshValues, place: FacetPlace) -> Rgb {
        let (Some(reconstruction), Cut::Listed(listed)) = (&self.reconstruction, &*self.cut) else {
            let element = self.element_on(place);
            return element.map_or(Rgb::ZERO, |element| values.own[element.at()]);
        };
        let FacetPlace { facet, back, at } = place;
        let (u, v) = (at.x.clamp(0.0, 1.0), at.y.clamp(0.0, 1.0 - at.x.clamp(0.0, 1.0)));
        let piece = &listed.facets[facet.at()];
        let Some(corners) = reconstruction.corners(facet.at(), back, piece, u, v) else {
            return Rgb::ZERO;
        };
        let all = corners.iter();
        let smooth: Rgb =
            all.map(|(vertex, weight)| values.vertices[*vertex as usize] * *weight).sum();
        // A vertex's value may come from patches on the other side of a wall that stands there.
        let Some(first) = piece.first_patch(back) else { return Rgb::ZERO };
        let own = values.own[(first + cell_index(piece.divisions, u, v)) as usize];
        smooth.clamp(own / MOST_CHANGE, own * MOST_CHANGE)
    }

    /// The element at a place, if any.
    pub fn element_on(&self, FacetPlace { facet, back, at }: FacetPlace) -> Option<ElementIndex> {
        let sides = self.cut.sides(facet);
        let u = at.x.clamp(0.0, 1.0);
        let cell = cell_index(sides.divisions, u, at.y.clamp(0.0, 1.0 - u));
        self.elements.of(PatchIndex(sides.first_patch(back)? + cell))
    }
}

/// A place in a cell, by how far it is from the cell's centroid along either edge of the facet: four
/// bits each, of which no place has zeros in the lower ones. Those say that the ray was bent or coloured on its
/// way; then the place has two bits each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct CellSpot(u8);

impl CellSpot {
    /// The centroid, nearly.
    pub const MIDDLE: Self = Self(0x88);
    /// Steps of a side of a cell; the centroid is at most ⅔ of a side away from a corner.
    const STEPS: f32 = 10.5;

    /// Where in its cell a place of a facet is.
    fn new(divisions: u32, at: Vec2) -> Self {
        let n = divisions as f32;
        let (fu, fv) = ((at.x * n).clamp(0.0, n), (at.y * n).clamp(0.0, n));
        let i = (fu as u32).min(divisions - 1);
        let j = (fv as u32).min(divisions - 1 - i);
        let within = Vec2::new(fu - i as f32, fv - j as f32);
        let is_upper = within.x + within.y > 1.0 && j < divisions - 1 - i;
        let middle = if is_upper { 2.0 / 3.0 } else { 1.0 / 3.0 };
        let [x, y] = (within - middle)
            .to_array()
            .map(|along| ((along * Self::STEPS).round() as i32 + 8).clamp(1, 15) as u8);
        Self(x | y << 4)
    }

    /// The same place, nearly, of a ray that was bent or coloured on its way to it.
    pub fn apart(self) -> Self {
        let coarse = |bits: u8| (bits.max(1) - 1) / 4;
        Self((coarse(self.0 & 15) | coarse(self.0 >> 4) << 2) << 4)
    }

    /// Whether the ray was bent or coloured on its way.
    pub fn is_apart(self) -> bool {
        self.0 & 15 == 0
    }

    /// From the centroid, in sides of the cell.
    pub fn offset(self) -> Vec2 {
        let along = |step: f32| (step - 8.0) / Self::STEPS;
        if self.is_apart() {
            // The middle of four steps.
            let middle = |bits: u8| along(f32::from(4 * bits) + 2.5);
            return Vec2::new(middle(self.0 >> 4 & 3), middle(self.0 >> 6));
        }
        Vec2::new(along(f32::from(self.0 & 15)), along(f32::from(self.0 >> 4)))
    }
}

/// A slope over a cell, so small that the value changes by no more than itself.
fn limited([along_u, along_v]: [Rgb; 2], own: Rgb) -> [Rgb; 2] {
    // From the centroid to the corners.
    let corners = [(-1.0, -1.0), (2.0, -1.0), (-1.0, 2.0)]
        .map(|(u, v)| ((along_u * u + along_v * v) / 3.0).abs());
    let most = corners[0].max(corners[1]).max(corners[2]);
    let factor = (own.abs() / most.max(Rgb::splat(f32::MIN_POSITIVE))).min(Rgb::ONE);
    [along_u * factor, along_v * factor]
}

/// By element, the length of the near field, ray units.
fn near_of_elements(rays: &Rays, elements: &Elements) -> Vec<f32> {
    let scale = rays.scale() as f32;
    elements.area.iter().map(|area| NEAR_FIELD * (2.0 * area).sqrt() * scale).collect()
}

/// By facet, the length of the near field, ray units.
fn near_of_facets(rays: &Rays, scene: &PatchedScene, elements: &Elements) -> Vec<f32> {
    let near = |facet: &Facet| {
        let [a, b, c] = facet.corners.map(|c| rays.place(scene.positions[c as usize]));
        NEAR_FIELD * (b - a).cross(c - a).length().sqrt() / facet.divisions as f32
    };
    let mut near: Vec<f32> = scene.facets.iter().map(near).collect();
    for element in elements.all().filter(|element| elements.members(*element).len() > 1) {
        let area = elements.area[element.at()] * (rays.scale() as f32).powi(2);
        for patch in elements.members(element) {
            let near = &mut near[scene.patches.facet[patch.at()] as usize];
            *near = near.max(NEAR_FIELD * (2.0 * area).sqrt());
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::FacetIndex;
    use crate::random::Stream;
    use crate::rays::Eye;
    use crate::sampling::Shifted;
    use crate::sampling::cosine_direction;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{SEED, Specimen};
    use crate::transport::patch_points::PatchPoints;
    use glam::Vec3;

    /// What a ray meets lies in the patch that is found there, also where facets are pieces of long
    /// triangles.
    #[test]
    fn hits_are_found_on_their_patch() {
        for glb in [made::cornell(), made::corridor()] {
            let specimen = Specimen::new(&glb, 400);
            let (world, mesh) = (&specimen.world, &specimen.coarse.mesh);
            let mut found = 0;
            for patch in (0..mesh.cut.patches()).step_by(7) {
                let mut sequence = Shifted::new(SEED, Stream::Gather, patch as u64).at(0);
                let from = PatchPoints::in_cut(world, &mesh.cut, PatchIndex(patch as u32), 0.0);
                let (start, normal) = from.point(sequence.next_pair());
                let direction = cosine_direction(normal, sequence.second_pair());
                let Some(hit) = world.rays.closest(Eye::Light, start, direction) else { continue };
                let Some(patch) = mesh.patch_at(&hit) else { continue };
                let (center, radius) = PatchPoints::in_cut(world, &mesh.cut, patch, 0.0).ball();
                let distance = world.rays.spot(&hit).point.distance(center);
                assert!(distance <= 1.01 * radius, "{distance} from a patch of {radius}");
                found += 1;
            }
            assert!(found > 20, "the test tests nothing: {found}");
        }
    }

    /// What is kept of a place in a cell is where it is, to half a step, and 0 at the middle on average.
    #[test]
    fn places_in_cells_are_kept() {
        const POINTS: u32 = 64;
        for divisions in [1, 3, 8] {
            let mut sums = vec![(Vec2::ZERO, 0.0f32); (divisions * divisions) as usize];
            let side = divisions as f32;
            for (index, [a, b, c]) in crate::patches::cells(divisions).enumerate() {
                let middle = (a + b + c) / 3.0;
                for k in 0..POINTS * POINTS {
                    let [x, y] = [k % POINTS, k / POINTS].map(|k| (k as f32 + 0.5) / POINTS as f32);
                    if x + y > 0.99 {
                        continue;
                    }
                    let at = a + (b - a) * x + (c - a) * y;
                    let spot = CellSpot::new(divisions, at);
                    let offset = spot.offset();
                    let off = (offset - (at - middle) * side).abs().max_element();
                    assert!(off < 0.6 / CellSpot::STEPS, "{offset} at {at}");
                    let apart = spot.apart();
                    assert!(apart.is_apart() && !spot.is_apart());
                    let off = (apart.offset() - offset).abs().max_element();
                    assert!(off < 1.6 / CellSpot::STEPS, "{} for {offset}", apart.offset());
                    sums[index].0 += offset;
                    sums[index].1 += 1.0;
                }
            }
            assert!(sums.iter().all(|(sum, count)| (*sum / *count).abs().max_element() < 0.01));
        }
    }

    /// Links to a function that is linear along walls are right wherever they end in an element.
    #[test]
    fn slopes_are_those_of_the_function() {
        let specimen = Specimen::furnace();
        let mesh = &specimen.coarse.mesh;
        let Cut::Listed(listed) = &*mesh.cut else { unreachable!("a furnace is small") };
        let middle = |element: ElementIndex| {
            let patch = mesh.elements.members(element)[0];
            listed.patches.centroid[patch.at()]
        };
        let function = |point: Vec3| Rgb::splat(2.0 + point.x + 0.5 * point.y - 0.7 * point.z);
        let slopes = mesh.slopes(|element| function(middle(element)));
        let mut inner = 0;
        for (element, [along_u, along_v]) in mesh.elements.all().zip(slopes) {
            let patch = mesh.elements.members(element)[0];
            let (facet, _, [a, b, c]) = listed.cell_of(patch);
            let [a, b, c] = [a, b, c].map(|at| function(listed.point(facet, at.x, at.y)));
            let sign = if listed.cell_of(patch).2[1].x > listed.cell_of(patch).2[0].x {
                1.0
            } else {
                -1.0
            };
            let off = (along_u - sign * (b - a)).abs() + (along_v - sign * (c - a)).abs();
            let most = (b - a).abs().max_element() + (c - a).abs().max_element();
            // At edges of the room the fits are of fewer patches.
            inner += usize::from(off.max_element() <= 0.15 * most.max(1e-3));
        }
        assert!(inner * 10 > mesh.elements.len() * 6, "{inner} of {}", mesh.elements.len());
    }

    #[test]
    fn a_smooth_function_of_equal_values_is_that_value() {
        let specimen = Specimen::furnace();
        let mesh = &specimen.coarse.mesh;
        let values = mesh.values(|_| Rgb::splat(3.0));
        for facet in (0..mesh.cut.facets() as u32).map(FacetIndex) {
            let place = FacetPlace { facet, back: false, at: Vec2::new(0.3, 0.2) };
            let value = mesh.value(&values, place);
            assert!((value - Rgb::splat(3.0)).abs().max_element() < 1e-3, "{value}");
        }
    }
}
