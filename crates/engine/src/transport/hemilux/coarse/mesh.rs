//! The coarse mesh (tier 1): finds the patch or element that a ray has hit, and interpolates values
//! of patches.

use super::elements::{ElementIndex, Elements};
use crate::measurement::reconstruction::{Reconstruction, Smoothness};
use crate::patches::{Facet, FacetIndex, FacetPlace, PatchIndex, PatchedScene, cell_index};
use crate::radiometry::Rgb;
use crate::rays::{Hit, Rays};
use std::sync::Arc;

/// Near field: a ray that ends within so many sides of the patch it meets sees a small part of it,
/// on which the patch's mean is not the light (docs/decisions/0004).
const NEAR_FIELD: f32 = 2.0;
/// Factor by which an interpolated value may differ from its patch's own: interpolation may take
/// values from the other side of a wall.
const MOST_CHANGE: f32 = 2.5;

/// The coarse mesh: the scene in patches, its elements and their interpolation.
pub struct CoarseMesh {
    /// The scene in patches.
    pub scene: Arc<PatchedScene>,
    /// What the light is solved for.
    pub elements: Elements,
    reconstruction: Reconstruction,
    /// Distance within which a hit on a facet is in the near field ([`NEAR_FIELD`]), ray units.
    near: Vec<f32>,
}

/// A quantity on the mesh, such as irradiance.
#[derive(Default)]
pub struct PatchValues {
    /// Of each patch.
    pub patches: Vec<Rgb>,
    /// At the vertices of the reconstruction.
    vertices: Vec<Rgb>,
}

impl CoarseMesh {
    /// A mesh whose light is solved for these elements.
    pub fn new(rays: &Rays, scene: Arc<PatchedScene>, elements: Elements) -> Self {
        let near = near_distances(rays, &scene, &elements);
        let reconstruction = Reconstruction::new(&scene, Smoothness::Smooth);
        Self { scene, elements, reconstruction, near }
    }

    /// Turns the near field off: hits take interpolated values however near they are.
    pub fn ignore_near_field(&mut self) {
        self.near.fill(0.0);
    }

    /// Whether a hit of a ray of that length is in the near field of the facet.
    pub fn is_near(&self, facet: FacetIndex, distance: f32) -> bool {
        distance < self.near[facet.at()]
    }

    /// Values of the patches as a smooth function.
    pub fn smooth(&self, patches: Vec<Rgb>) -> PatchValues {
        let vertices = self.reconstruction.apply(&patches);
        PatchValues { patches, vertices }
    }

    /// The patch at a hit; `None` at a black back.
    pub fn patch_at(&self, hit: &Hit) -> Option<PatchIndex> {
        let FacetPlace { facet, at, .. } = self.place_of(hit)?;
        let piece = &self.scene.facets[facet.at()];
        let first = piece.first_patch(hit.back)?;
        Some(PatchIndex(first + cell_index(piece.divisions, at.x, at.y)))
    }

    /// The element at a hit; `None` at a black back and inside of closed bodies.
    pub fn element_at(&self, hit: &Hit) -> Option<ElementIndex> {
        self.elements.of(self.patch_at(hit)?)
    }

    /// The place on a facet where a hit is.
    pub fn place_of(&self, hit: &Hit) -> Option<FacetPlace> {
        let (facet, at) = self.scene.place_on_triangle(hit.triangle, hit.u, hit.v)?;
        Some(FacetPlace { facet, back: hit.back, at })
    }

    /// The interpolated value at a place.
    pub fn value(&self, values: &PatchValues, FacetPlace { facet, back, at }: FacetPlace) -> Rgb {
        let (u, v) = (at.x.clamp(0.0, 1.0), at.y.clamp(0.0, 1.0 - at.x.clamp(0.0, 1.0)));
        let piece = &self.scene.facets[facet.at()];
        let Some(corners) = self.reconstruction.corners(facet.at(), back, piece, u, v) else {
            return Rgb::ZERO;
        };
        let all = corners.iter();
        let smooth: Rgb =
            all.map(|(vertex, weight)| values.vertices[*vertex as usize] * *weight).sum();
        // A vertex's value may come from patches on the other side of a wall that stands there.
        let Some(first) = piece.first_patch(back) else { return Rgb::ZERO };
        let own = values.patches[(first + cell_index(piece.divisions, u, v)) as usize];
        smooth.clamp(own / MOST_CHANGE, own * MOST_CHANGE)
    }

    /// The element at a place, if any.
    pub fn element_on(&self, FacetPlace { facet, back, at }: FacetPlace) -> Option<ElementIndex> {
        let piece = &self.scene.facets[facet.at()];
        let u = at.x.clamp(0.0, 1.0);
        let cell = cell_index(piece.divisions, u, at.y.clamp(0.0, 1.0 - u));
        self.elements.of(PatchIndex(piece.first_patch(back)? + cell))
    }
}

/// By facet, the length of the near field, ray units.
fn near_distances(rays: &Rays, scene: &PatchedScene, elements: &Elements) -> Vec<f32> {
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
    use crate::random::Stream;
    use crate::rays::Eye;
    use crate::sampling::Shifted;
    use crate::sampling::cosine_direction;
    use crate::scene::made;
    use crate::transport::hemilux::specimen::{SEED, Specimen};
    use crate::transport::patch_points::PatchPoints;
    use glam::Vec2;

    /// What a ray meets lies in the patch that is found there, also where facets are pieces of long
    /// triangles.
    #[test]
    fn hits_are_found_on_their_patch() {
        for glb in [made::cornell(), made::corridor()] {
            let specimen = Specimen::new(&glb, 400);
            let (world, mesh) = (&specimen.world, &specimen.coarse.mesh);
            let mut found = 0;
            for patch in (0..mesh.scene.patches.len()).step_by(7) {
                let mut sequence = Shifted::new(SEED, Stream::Gather, patch as u64).at(0);
                let from = PatchPoints::new(world, &mesh.scene, PatchIndex(patch as u32));
                let (start, normal) = from.point(sequence.next_pair());
                let direction = cosine_direction(normal, sequence.second_pair());
                let Some(hit) = world.rays.closest(Eye::Light, start, direction) else { continue };
                let Some(patch) = mesh.patch_at(&hit) else { continue };
                let (center, radius) = PatchPoints::new(world, &mesh.scene, patch).ball();
                let distance = world.rays.spot(&hit).point.distance(center);
                assert!(distance <= 1.01 * radius, "{distance} from a patch of {radius}");
                found += 1;
            }
            assert!(found > 20, "the test tests nothing: {found}");
        }
    }

    #[test]
    fn a_smooth_function_of_equal_values_is_that_value() {
        let specimen = Specimen::furnace();
        let mesh = &specimen.coarse.mesh;
        let values = mesh.smooth(vec![Rgb::splat(3.0); mesh.scene.patches.len()]);
        for facet in (0..mesh.scene.facets.len() as u32).map(FacetIndex) {
            let place = FacetPlace { facet, back: false, at: Vec2::new(0.3, 0.2) };
            let value = mesh.value(&values, place);
            assert!((value - Rgb::splat(3.0)).abs().max_element() < 1e-3, "{value}");
        }
    }
}
