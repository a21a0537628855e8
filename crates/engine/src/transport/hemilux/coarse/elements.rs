//! Elements: the unknowns that tier 1 solves for. An element is mostly one patch; where a mesh has
//! many more patches than are wanted, those small ones in one cell of space that face the same way
//! and have one material are one element (docs/decisions/0006).

use super::groups::{Groups, NONE};
use crate::patches::{Cut, PatchIndex};
use crate::radiometry::Rgb;
use crate::surface::World;
use crate::transport::patch_points::PatchPoints;
use glam::Vec2;
use rayon::prelude::*;

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

/// Most of the light that a patch is taken to mirror where links follow mirrors.
const MOST_MIRRORED: f32 = 0.9;

/// Elements that a thread looks at together.
const CHUNK: usize = 256;

/// Which elements are parts of others: crevices, over which something lies close.
#[derive(Default)]
pub struct Crevices {
    /// The crevice of each element, or [`NONE`]; empty where there are none at all.
    of: Vec<u32>,
    /// The elements that the crevices belong to, which are numbered behind all others.
    within: Vec<u32>,
    /// What each crevice takes of its element.
    hidden: Vec<Hidden>,
}

/// The part of an element over which something is close.
#[derive(Clone, Copy, Default)]
pub struct Hidden {
    /// What share of the element it is.
    pub share: f32,
    /// From the centroid of the element to that of the rest, in sides of its patch along the edges of the
    /// facet.
    pub center_beside: Vec2,
}

impl Crevices {
    /// Of all elements' hidden parts: those with all and those with none are whole.
    pub fn new(all: &[Hidden]) -> Self {
        let mut this = Self::default();
        for (element, hidden) in (0u32..).zip(all) {
            if hidden.share > 0.0 && hidden.share < 1.0 {
                this.of.resize(all.len(), NONE);
                this.of[element as usize] = (all.len() + this.within.len()) as u32;
                this.within.push(element);
                this.hidden.push(*hidden);
            }
        }
        this
    }

    /// The centre of what is beside an element's crevice, if it has one ([`Hidden::center_beside`]).
    pub fn center_beside(&self, element: ElementIndex) -> Vec2 {
        let crevice = self.of(element);
        crevice
            .map_or(Vec2::ZERO, |crevice| self.hidden[crevice.at() - self.of.len()].center_beside)
    }

    /// The elements that the crevices belong to, each with the share of it that its crevice takes.
    fn within(&self) -> impl Iterator<Item = (ElementIndex, f32)> {
        let all = self.within.iter().zip(&self.hidden);
        all.map(|(whole, hidden)| (ElementIndex(*whole), hidden.share))
    }

    /// What share of the whole a part is.
    pub fn share(&self, element: ElementIndex) -> f32 {
        let share = |crevice: ElementIndex| self.hidden[crevice.at() - self.of.len()].share;
        match (self.whole(element) != element, self.of(element)) {
            (true, _) => share(element),
            (false, Some(crevice)) => 1.0 - share(crevice),
            (false, None) => 1.0,
        }
    }

    /// The element that another one is a crevice of, or that itself.
    pub fn whole(&self, element: ElementIndex) -> ElementIndex {
        match element.at().checked_sub(self.of.len()) {
            Some(number) if !self.within.is_empty() => ElementIndex(self.within[number]),
            _ => element,
        }
    }

    /// The crevice of an element.
    pub fn of(&self, element: ElementIndex) -> Option<ElementIndex> {
        self.of.get(element.at()).copied().filter(|own| *own != NONE).map(ElementIndex)
    }

    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        (size_of_val(&*self.of) + size_of_val(&*self.within) + size_of_val(&*self.hidden)) as u64
    }
}

/// The elements of a mesh, each with its patches, area and albedo.
pub struct Elements {
    of_patch: Vec<u32>,
    /// Patches of element e: `members[start[e]..start[e + 1]]`.
    start: Vec<u32>,
    members: Vec<PatchIndex>,
    /// Running sums of the areas of each element's members.
    running: Vec<f32>,
    /// Area, m²: of a crevice and of what it is part of, that of both.
    pub area: Vec<f32>,
    /// Area that counts, a crevice's apart: less of it far away from what the camera sees, where there is a focus.
    pub counted: Vec<f32>,
    /// Albedo, all of it taken as diffuse.
    pub albedo: Vec<Rgb>,
    /// Which of them are parts of others.
    pub(super) crevices: Crevices,
}

impl Elements {
    /// Elements of a mesh for which `wanted` patches were asked.
    pub fn new(cut: &Cut, wanted: usize) -> Self {
        let Groups { of_patch, sizes, reflected, counted } = Groups::new(cut, wanted);
        let mut start = vec![0; sizes.len() + 1];
        for (element, size) in sizes.iter().enumerate() {
            start[element + 1] = start[element] + size;
        }
        let mut next = start.clone();
        let mut members = vec![PatchIndex(0); start[sizes.len()] as usize];
        let reached = of_patch.iter().enumerate().filter(|(_, element)| **element != NONE);
        for (patch, element) in reached {
            let next = &mut next[*element as usize];
            members[*next as usize] = PatchIndex(patch as u32);
            *next += 1;
        }
        let sums_of = |element: usize| {
            let own = &members[start[element] as usize..start[element + 1] as usize];
            let mut sum = 0.0;
            let add = |patch: &PatchIndex| {
                sum += cut.area(*patch);
                sum
            };
            own.iter().map(add).collect::<Vec<f32>>()
        };
        let elements = (0..sizes.len()).into_par_iter().with_min_len(CHUNK);
        let running: Vec<f32> = elements.flat_map_iter(sums_of).collect();
        let last = |element: usize| running[start[element + 1] as usize - 1];
        let area: Vec<f32> = (0..sizes.len()).map(last).collect();
        // The specification's model reflects up to 1.01 of what arrives where it is white; between such
        // walls light would never settle.
        let mean = |(sum, area): (&Rgb, &f32)| (*sum / area.max(1e-30)).min(Rgb::ONE);
        let albedo = reflected.iter().zip(&area).map(mean).collect();
        let counted = if counted.is_empty() { area.clone() } else { counted };
        let crevices = Crevices::default();
        Self { of_patch, start, members, running, area, counted, albedo, crevices }
    }

    /// Makes crevices, each a share of the element that it belongs to, elements of their own.
    pub(super) fn part(&mut self, crevices: Crevices) {
        for (whole, share) in crevices.within() {
            let whole = whole.at();
            self.area.push(self.area[whole]);
            self.albedo.push(self.albedo[whole]);
            self.counted.push(self.counted[whole] * share);
            self.counted[whole] *= 1.0 - share;
        }
        self.crevices = crevices;
    }

    /// Leaves out of the albedos what patches mirror sharply, for links that follow mirrors: what is
    /// left is the albedo of the rest, of links that end at such patches by chance.
    pub fn leave_out_mirrors(&mut self, cut: &Cut) {
        let rest_of = |element: ElementIndex| {
            let members = self.members(element).iter();
            let finishes: Vec<_> =
                members.map(|patch| (cut.reflectance(*patch), cut.area(*patch))).collect();
            if !finishes.iter().any(|((reflectance, _), _)| reflectance.is_sharp()) {
                return self.albedo[element.at()];
            }
            let mut sum = Rgb::ZERO;
            for ((reflectance, albedo), area) in finishes {
                let mut own = albedo;
                if reflectance.is_sharp() {
                    let mirrored = reflectance.specular.max_element().min(MOST_MIRRORED);
                    own = reflectance.diffuse / (1.0 - mirrored);
                }
                sum += own * area;
            }
            (sum / self.area[element.at()].max(1e-30)).min(Rgb::ONE)
        };
        let elements = (0..self.len()).into_par_iter().with_min_len(CHUNK);
        self.albedo = elements.map(|element| rest_of(ElementIndex(element as u32))).collect();
    }

    /// Bytes that they take, about.
    pub fn held_bytes(&self) -> u64 {
        let of_patches = size_of_val(&*self.of_patch)
            + size_of_val(&*self.members)
            + size_of_val(&*self.running);
        let of_elements = size_of_val(&*self.start)
            + size_of_val(&*self.area)
            + size_of_val(&*self.counted)
            + size_of_val(&*self.albedo);
        (of_patches + of_elements) as u64 + self.crevices.held_bytes()
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// All elements by their indices.
    pub fn all(&self) -> impl Iterator<Item = ElementIndex> + use<> {
        (0..self.len() as u32).map(ElementIndex)
    }

    /// The element of a patch, if any, but for a crevice.
    pub fn of(&self, patch: PatchIndex) -> Option<ElementIndex> {
        let element = self.of_patch[patch.at()];
        (element != NONE).then_some(ElementIndex(element))
    }

    /// Patches of an element.
    pub fn members(&self, element: ElementIndex) -> &[PatchIndex] {
        let element = self.crevices.whole(element).at();
        let [first, end] = [self.start[element], self.start[element + 1]];
        &self.members[first as usize..end as usize]
    }

    /// The patch of an element that the uniform number `x` picks by area.
    pub fn member(&self, element: ElementIndex, x: f32) -> PatchIndex {
        self.picked(element, x).0
    }

    /// Points of one of an element's patches, which the uniform number `x` picks by area.
    pub fn points(&self, world: &World, cut: &Cut, element: ElementIndex, x: f32) -> PatchPoints {
        let (member, within) = self.picked(element, x);
        PatchPoints::in_cut(world, cut, member, within)
    }

    /// The patch that a uniform number picks, and where in its share of them the number lies, which
    /// picks among several triangles of a patch.
    fn picked(&self, element: ElementIndex, x: f32) -> (PatchIndex, f32) {
        let members = self.members(element);
        let element = self.crevices.whole(element);
        let running = &self.running[self.start[element.at()] as usize..][..members.len()];
        let pick = running.partition_point(|area| *area <= x * self.area[element.at()]);
        let pick = pick.min(members.len() - 1);
        let before = if pick > 0 { running[pick - 1] } else { 0.0 };
        let within = (x * self.area[element.at()] - before) / (running[pick] - before);
        (members[pick], within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::PatchedScene;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made::revolved::hollow_ball;
    use crate::scene::{Material, made};
    use std::sync::Arc;

    #[test]
    fn crowded_patches_become_one_without_loss_of_area() {
        let room = made::tessellated_room(20_000);
        let scene = import(&room, &Resources::default(), &ImportLimits::default()).unwrap();
        let scene = Arc::new(scene);
        let world = World::new(scene.clone());
        let listed = PatchedScene::new(scene.clone(), 1000);
        let area: f32 = listed.patches.area.iter().sum();
        let listed = Cut::Listed(Arc::new(listed));
        let alone = Elements::new(&listed, listed.patches());
        assert_eq!(alone.len(), listed.patches());
        let crowd = Cut::new(scene, 1000, None);
        assert!(matches!(crowd, Cut::Crowd(_)));
        for cut in [listed, crowd] {
            let together = Elements::new(&cut, 1000);
            assert!(together.len() < cut.patches() / 2, "{}", together.len());
            assert!((together.area.iter().sum::<f32>() / area - 1.0).abs() < 1e-3);
            members_are_picked_by_their_areas(&world, &cut, &together);
        }
    }

    fn members_are_picked_by_their_areas(world: &World, cut: &Cut, together: &Elements) {
        let most = |element: &ElementIndex| together.members(*element).len();
        let element = together.all().max_by_key(most).unwrap();
        let members = together.members(element);
        const TRIES: usize = 10_000;
        let scale = world.rays.scale() as f32;
        let picked = |k: usize| {
            let x = (k as f32 + 0.5) / TRIES as f32;
            together.points(world, cut, element, x).area() / (scale * scale)
        };
        let mean = (0..TRIES).map(picked).sum::<f32>() / TRIES as f32;
        let own = members.iter().map(|patch| cut.area(*patch));
        let expected = own.map(|area| area * area).sum::<f32>() / together.area[element.at()];
        assert!((mean / expected - 1.0).abs() < 0.01, "{mean} {expected}");
    }

    /// The specification's model may reflect more than arrives; elements do not, for light to settle.
    #[test]
    fn no_element_reflects_more_than_arrives() {
        let white = Material { roughness: 0.3, ..Material::lambertian("white", Rgb::ONE) };
        let white = Material { specular_factor: 1.0, ..white };
        let scene = Arc::new(hollow_ball(12, white));
        let cut = Cut::new(scene, 100, None);
        let (_, whole) = cut.reflectance(PatchIndex(0));
        assert!(whole.max_element() > 1.0, "{whole}");
        let elements = Elements::new(&cut, 100);
        assert!(elements.albedo.iter().all(|own| *own == Rgb::ONE), "{:?}", elements.albedo);
    }
}
