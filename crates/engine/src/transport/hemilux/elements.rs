//! What tier 1 solves for. Mostly a patch each; where a mesh has many more triangles than the light
//! on it needs patches, all those of a cell of space that face the same way are one.

use super::links::PatchPoints;
use crate::patches::{NO_PATCH, PatchedScene};
use crate::radiometry::Rgb;
use crate::transport::known::albedo;
use crate::transport::ray_traced::surface::World;
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;

/// "Of no element": the inside of a closed body, where light never comes.
const NONE: u32 = u32::MAX;
/// With so many times the wanted patches they become elements together.
const CROWDED: usize = 4;

/// Patches, alone or together.
pub struct Elements {
    of_patch: Vec<u32>,
    /// Patches of element e: `members[start[e]..start[e + 1]]`.
    start: Vec<u32>,
    members: Vec<u32>,
    /// Area, m².
    pub area: Vec<f32>,
    /// Albedo, all of it taken as diffuse.
    pub albedo: Vec<Rgb>,
}

/// Cell, direction and material of patches that become one.
type Key = ([i32; 3], u8, u32);

impl Elements {
    /// Of a mesh of which `wanted` patches were wanted; of each patch alone unless they may be
    /// `together`.
    pub fn new(scene: &PatchedScene, wanted: usize, together: bool) -> Self {
        let patches = &scene.patches;
        let count = patches.len();
        let mut hidden = vec![false; count];
        for facet in scene.facets.iter().filter(|facet| facet.cull_back && facet.back != NO_PATCH) {
            let first = facet.back as usize;
            hidden[first..first + (facet.divisions * facet.divisions) as usize].fill(true);
        }
        let crowded = together && count > CROWDED * wanted;
        let all: f32 = patches.area.iter().sum();
        let cell = (all / wanted.max(1) as f32).sqrt();
        let mut numbers: HashMap<Key, u32> = HashMap::new();
        let mut of_patch = vec![NONE; count];
        let mut sizes: Vec<u32> = Vec::new();
        for patch in 0..count {
            if hidden[patch] && together {
                continue;
            }
            let next = sizes.len() as u32;
            let element = if crowded && patches.area[patch] < cell * cell {
                let place = (patches.centroid[patch] / cell).floor().as_ivec3().to_array();
                let facet = &scene.facets[patches.facet[patch] as usize];
                let material = scene.scene.triangles[facet.source as usize].material;
                let key = (place, facing(patches.normal[patch]), material);
                *numbers.entry(key).or_insert(next)
            } else {
                next
            };
            if element == next {
                sizes.push(0);
            }
            of_patch[patch] = element;
            sizes[element as usize] += 1;
        }
        let mut start = vec![0; sizes.len() + 1];
        for (element, size) in sizes.iter().enumerate() {
            start[element + 1] = start[element] + size;
        }
        let mut next = start.clone();
        let mut members = vec![0; start[sizes.len()] as usize];
        let mut area = vec![0.0; sizes.len()];
        let mut reflected = vec![Rgb::ZERO; sizes.len()];
        let reached = of_patch.iter().enumerate().filter(|(_, element)| **element != NONE);
        for (patch, element) in reached {
            let element = *element as usize;
            members[next[element] as usize] = patch as u32;
            next[element] += 1;
            area[element] += patches.area[patch];
            reflected[element] += albedo(scene, patch) * patches.area[patch];
        }
        let albedo =
            reflected.iter().zip(&area).map(|(sum, area)| *sum / area.max(1e-30)).collect();
        Self { of_patch, start, members, area, albedo }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// The element of a patch, if any.
    pub fn of(&self, patch: u32) -> Option<u32> {
        Some(self.of_patch[patch as usize]).filter(|element| *element != NONE)
    }

    /// Patches of an element.
    pub fn members(&self, element: usize) -> &[u32] {
        &self.members[self.start[element] as usize..self.start[element + 1] as usize]
    }

    /// To pick points of an element: those of one of its patches, for a uniform number. (They are
    /// of about the same size.)
    pub fn points(
        &self,
        world: &World,
        scene: &PatchedScene,
        element: usize,
        x: f32,
    ) -> PatchPoints {
        let members = self.members(element);
        let pick = ((x * members.len() as f32) as usize).min(members.len() - 1);
        PatchPoints::new(world, scene, members[pick])
    }
}

/// Which of six directions a normal is nearest to.
fn facing(normal: Vec3) -> u8 {
    let axis = normal.abs().max_position();
    (2 * axis) as u8 + u8::from(normal[axis] < 0.0)
}
