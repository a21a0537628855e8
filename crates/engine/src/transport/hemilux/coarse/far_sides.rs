//! What elements let through diffusely: part of an element's radiosity is light that arrives at the
//! other side of its surface, which is another element.

use super::elements::ElementIndex;
use super::mesh::CoarseMesh;
use crate::patches::{FacetPlace, PatchIndex};
use crate::radiometry::Rgb;
use crate::surface::World;
use rayon::prelude::*;

/// Places of an element at which it is asked what it lets through.
const PLACES: u32 = 16;
/// Elements that a thread looks at together.
const CHUNK: usize = 256;

/// The other sides of all elements.
pub struct FarSides {
    /// Of each element that on the other side and the share of its light that comes through; `None`
    /// where nothing does.
    of: Vec<Option<(ElementIndex, Rgb)>>,
}

impl FarSides {
    /// Those of a mesh; `None` where nothing lets light through diffusely.
    pub fn new(world: &World, mesh: &CoarseMesh) -> Option<Self> {
        let elements = (0..mesh.elements.len()).into_par_iter().with_min_len(CHUNK);
        let of = |element: usize| far_side(world, mesh, ElementIndex(element as u32));
        world.has_translucent().then(|| Self { of: elements.map(of).collect() })
    }

    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        size_of_val(&*self.of) as u64
    }

    /// What an element sends of light from the other side, where `arriving` says what arrives at each
    /// element.
    #[inline]
    pub fn passed(&self, element: ElementIndex, arriving: impl Fn(ElementIndex) -> Rgb) -> Rgb {
        self.of[element.at()].map_or(Rgb::ZERO, |(other, share)| share * arriving(other))
    }
}

/// The element on the other side of most of an element's places, and the mean share of its light that
/// comes through.
fn far_side(
    world: &World,
    mesh: &CoarseMesh,
    element: ElementIndex,
) -> Option<(ElementIndex, Rgb)> {
    let members = mesh.elements.members(element);
    let (mut sum, mut others) = (Rgb::ZERO, Vec::new());
    for number in 0..PLACES {
        let member = members[number as usize * members.len() / PLACES as usize];
        let Some((other, share)) = at_place(world, mesh, (member, number)) else { continue };
        sum += share;
        others.push(other);
    }
    others.sort_unstable();
    let most = others.chunk_by(|a, b| a == b).max_by_key(|same| same.len())?;
    Some((most[0], sum / PLACES as f32)).filter(|_| sum != Rgb::ZERO)
}

/// The same at a place of a patch.
fn at_place(
    world: &World,
    mesh: &CoarseMesh,
    (patch, number): (PatchIndex, u32),
) -> Option<(ElementIndex, Rgb)> {
    let (triangle, at, back) = mesh.cut.place_in(patch, number, PLACES)?;
    if !world.is_translucent(triangle) {
        return None;
    }
    let surface = world.at(triangle, at.to_array(), back);
    let opaque = 1.0 - surface.clear.map_or(0.0, |clear| clear.share);
    let (facet, at) = mesh.cut.place_on_triangle(triangle, at.x, at.y)?;
    let other = mesh.element_on(FacetPlace { facet, back: !back, at })?;
    Some((other, world.far_side_on_the_mean(&surface).1 * opaque))
}
