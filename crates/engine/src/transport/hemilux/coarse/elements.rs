//! Elements: the unknowns that tier 1 solves for. An element is mostly one patch; where a mesh has
//! many more patches than are wanted, those small ones in one cell of space that face the same way
//! and have one material are one element (docs/decisions/0006).

use crate::patches::{NO_PATCH, PatchIndex, PatchedScene};
use crate::radiometry::{Rgb, importance};
use crate::surface::World;
use crate::transport::known::albedo;
use crate::transport::patch_points::PatchPoints;
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;

/// Element of patches that have none: the insides of closed bodies, where light never comes.
const NONE: u32 = u32::MAX;

/// An element by its place in the lists of [`Elements`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ElementIndex(pub u32);

impl ElementIndex {
    /// The place in a list.
    #[inline]
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// Patches are grouped where there are more than so many times the wanted ones.
const CROWDED_FACTOR: usize = 4;

/// Most of the light that a patch is taken to mirror where links follow mirrors.
const MOST_MIRRORED: f32 = 0.9;

/// The elements of a mesh, each with its patches, area and albedo.
pub struct Elements {
    of_patch: Vec<u32>,
    /// Patches of element e: `members[start[e]..start[e + 1]]`.
    start: Vec<u32>,
    members: Vec<PatchIndex>,
    /// Running sums of the areas of each element's members.
    running: Vec<f32>,
    /// Area, m².
    pub area: Vec<f32>,
    /// Albedo, all of it taken as diffuse.
    pub albedo: Vec<Rgb>,
}

/// What patches of one element have in common: cell of space, one of six directions, and material.
type GroupKey = ([i32; 3], u8, u32);

impl Elements {
    /// Elements of a mesh for which `wanted` patches were asked.
    pub fn new(scene: &PatchedScene, wanted: usize) -> Self {
        let patches = &scene.patches;
        let count = patches.len();
        let mut hidden = vec![false; count];
        for facet in scene.facets.iter().filter(|facet| facet.cull_back && facet.back != NO_PATCH) {
            let first = facet.back as usize;
            hidden[first..first + (facet.divisions * facet.divisions) as usize].fill(true);
        }
        let crowded = count > CROWDED_FACTOR * wanted;
        let all: f32 = patches.area.iter().sum();
        let cell = (all / wanted.max(1) as f32).sqrt();
        let mut numbers: HashMap<GroupKey, u32> = HashMap::new();
        let mut of_patch = vec![NONE; count];
        let mut sizes: Vec<u32> = Vec::new();
        for patch in 0..count {
            if hidden[patch] {
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
        let mut members = vec![PatchIndex(0); start[sizes.len()] as usize];
        let mut running = vec![0.0; members.len()];
        let mut area = vec![0.0; sizes.len()];
        let mut reflected = vec![Rgb::ZERO; sizes.len()];
        let reached = of_patch.iter().enumerate().filter(|(_, element)| **element != NONE);
        for (patch, element) in reached {
            let element = *element as usize;
            area[element] += patches.area[patch];
            let place = next[element] as usize;
            (members[place], running[place]) = (PatchIndex(patch as u32), area[element]);
            next[element] += 1;
            reflected[element] += albedo(scene, patch) * patches.area[patch];
        }
        let albedo =
            reflected.iter().zip(&area).map(|(sum, area)| *sum / area.max(1e-30)).collect();
        Self { of_patch, start, members, running, area, albedo }
    }

    /// Leaves out of the albedos what patches mirror sharply, for links that follow mirrors: what is
    /// left is the albedo of the rest, of links that end at such patches by chance.
    pub fn leave_out_mirrors(&mut self, scene: &PatchedScene) {
        for element in self.all() {
            let members = self.members(element);
            let is_sharp = |patch: &PatchIndex| scene.patches.reflectance(patch.at()).is_sharp();
            if !members.iter().any(is_sharp) {
                continue;
            }
            let mut sum = Rgb::ZERO;
            for patch in members {
                let patch = patch.at();
                let mut own = albedo(scene, patch);
                if scene.patches.reflectance(patch).is_sharp() {
                    let mirrored = importance(scene.patches.specular[patch]).min(MOST_MIRRORED);
                    own = scene.patches.diffuse[patch] / (1.0 - mirrored);
                }
                sum += own * scene.patches.area[patch];
            }
            self.albedo[element.at()] = (sum / self.area[element.at()].max(1e-30)).min(Rgb::ONE);
        }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// All elements by their indices.
    pub fn all(&self) -> impl Iterator<Item = ElementIndex> + use<> {
        (0..self.len() as u32).map(ElementIndex)
    }

    /// The element of a patch, if any.
    pub fn of(&self, patch: PatchIndex) -> Option<ElementIndex> {
        let element = self.of_patch[patch.at()];
        (element != NONE).then_some(ElementIndex(element))
    }

    /// Patches of an element.
    pub fn members(&self, element: ElementIndex) -> &[PatchIndex] {
        let [first, end] = [self.start[element.at()], self.start[element.at() + 1]];
        &self.members[first as usize..end as usize]
    }

    /// Points of one of an element's patches, which the uniform number `x` picks by area.
    pub fn points(
        &self,
        world: &World,
        scene: &PatchedScene,
        element: ElementIndex,
        x: f32,
    ) -> PatchPoints {
        let members = self.members(element);
        let running = &self.running[self.start[element.at()] as usize..][..members.len()];
        let pick = running.partition_point(|area| *area <= x * self.area[element.at()]);
        PatchPoints::new(world, scene, members[pick.min(members.len() - 1)])
    }
}

/// Which of six directions a normal is nearest to.
fn facing(normal: Vec3) -> u8 {
    let axis = normal.abs().max_position();
    (2 * axis) as u8 + u8::from(normal[axis] < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use std::sync::Arc;

    #[test]
    fn crowded_patches_become_one_without_loss_of_area() {
        let room = made::tessellated_room(20_000);
        let scene = import(&room, &Resources::default(), &ImportLimits::default()).unwrap();
        let scene = Arc::new(scene);
        let world = World::new(scene.clone());
        let patched = PatchedScene::new(scene, 1000);
        let alone = Elements::new(&patched, patched.patches.len());
        assert_eq!(alone.len(), patched.patches.len());
        let together = Elements::new(&patched, 1000);
        assert!(together.len() < patched.patches.len() / 2, "{}", together.len());
        let reached =
            (0..patched.patches.len()).filter(|p| together.of(PatchIndex(*p as u32)).is_some());
        let area: f32 = reached.map(|patch| patched.patches.area[patch]).sum();
        assert!((together.area.iter().sum::<f32>() / area - 1.0).abs() < 1e-3);
        // Members are picked by their areas.
        let most = |element: &ElementIndex| together.members(*element).len();
        let element = together.all().max_by_key(most).unwrap();
        let members = together.members(element);
        const TRIES: usize = 10_000;
        let scale = world.rays.scale() as f32;
        let picked = |k: usize| {
            let x = (k as f32 + 0.5) / TRIES as f32;
            together.points(&world, &patched, element, x).area() / (scale * scale)
        };
        let mean = (0..TRIES).map(picked).sum::<f32>() / TRIES as f32;
        let own = members.iter().map(|patch| patched.patches.area[patch.at()]);
        let expected = own.map(|area| area * area).sum::<f32>() / together.area[element.at()];
        assert!((mean / expected - 1.0).abs() < 0.01, "{mean} {expected}");
    }
}
