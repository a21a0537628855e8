//! Which patches are one element: those small ones of a crowded mesh that lie in one cell of space,
//! face the same way and have one material. The work is shared out in parts of fixed size whose
//! groups are numbered in the order of the parts, so that any number of threads finds the same.

use crate::patches::{Crowd, Cut, Focus, Outline, PatchIndex, PatchedScene};
use crate::radiometry::Rgb;
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;
use rayon::prelude::*;

/// Element of patches that have none: the insides of closed bodies, where light never comes.
pub const NONE: u32 = u32::MAX;

/// Patches are grouped where there are more than so many times the wanted ones.
const CROWDED_FACTOR: usize = 4;
/// Groups of a crowd are made larger where they are more than so many times the wanted patches.
const MOST_GROUPS_FACTOR: usize = 8;
/// How often they are, at most.
const MOST_DOUBLINGS: u32 = 12;
/// Patches of a parallel task.
const CHUNK: usize = 1 << 14;

/// What patches of one element have in common: cell of space and its size, as a power of two, how they
/// face, and material.
type GroupKey = ([i32; 3], u8, Facing, u32);

/// Which of six directions a normal is nearest to, and whether the patch is on the back of its surface:
/// of a thin pipe, the inside of one wall faces as the outside of the other one does.
type Facing = (u8, bool);

/// The groups of a mesh's patches.
#[derive(Default)]
pub struct Groups {
    /// The group of each patch, or [`NONE`].
    pub of_patch: Vec<u32>,
    /// Patches of each group.
    pub sizes: Vec<u32>,
    /// Σ albedo × area of each.
    pub reflected: Vec<Rgb>,
    /// Area of each that counts in a focus; empty without one.
    pub counted: Vec<f32>,
}

/// How patches are grouped.
struct Grouping {
    /// Side of a cell of space in the focus, m.
    cell: f32,
    focus: Option<Focus>,
    is_crowded: bool,
}

impl Groups {
    /// The groups of a mesh for which `wanted` patches were asked.
    pub fn new(cut: &Cut, wanted: usize) -> Self {
        match cut {
            Cut::Listed(listed) => Self::of_listed(listed, wanted),
            Cut::Crowd(crowd) => Self::of_crowd(crowd),
        }
    }

    fn of_listed(scene: &PatchedScene, wanted: usize) -> Self {
        let patches = &scene.patches;
        let count = patches.len();
        let weights = scene
            .focus
            .map(|focus| patches.centroid.iter().map(|at| focus.weight(*at)).collect::<Vec<f32>>());
        let counted_area = |patch: usize| {
            weights.as_ref().map_or(1.0, |weights| weights[patch]) * patches.area[patch]
        };
        let all: f32 = (0..count).map(counted_area).sum();
        let grouping = Grouping {
            cell: (all / wanted.max(1) as f32).sqrt(),
            focus: scene.focus,
            is_crowded: count > CROWDED_FACTOR * wanted,
        };
        let mut numbers: HashMap<GroupKey, u32> = HashMap::new();
        let mut this = Self { of_patch: vec![NONE; count], ..Self::default() };
        for patch in 0..count {
            let next = this.sizes.len() as u32;
            let (facet, back, _) = scene.cell_of(PatchIndex(patch as u32));
            let material = scene.scene.triangle(facet.source).material;
            let facing = facing(patches.normal[patch], back);
            let key = grouping.key(patches.area[patch], patches.centroid[patch], facing, material);
            let group = key.map_or(next, |key| *numbers.entry(key).or_insert(next));
            let counted = weights.as_ref().map(|_| counted_area(patch));
            this.add(group, patches.albedo[patch] * patches.area[patch], counted);
            this.of_patch[patch] = group;
        }
        this
    }

    /// Where the patches are so far apart that there would be far more groups than wanted patches,
    /// cells of space are larger.
    fn of_crowd(crowd: &Crowd) -> Self {
        let mut grouping =
            Grouping { cell: crowd.cell_area.sqrt(), focus: crowd.focus, is_crowded: true };
        let mut this = Self::in_cells(crowd, &grouping);
        for _ in 0..MOST_DOUBLINGS {
            if this.sizes.len() <= MOST_GROUPS_FACTOR * crowd.wanted {
                break;
            }
            grouping.cell *= 2.0;
            this = Self::in_cells(crowd, &grouping);
        }
        this
    }

    fn in_cells(crowd: &Crowd, grouping: &Grouping) -> Self {
        let bound = crowd.bound();
        let mut of_patch = vec![NONE; bound];
        let parts: Vec<Part> = of_patch
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, of_patch)| Part::of(crowd, grouping, chunk * CHUNK, of_patch))
            .collect();
        let mut this = Self::default();
        let mut numbers: HashMap<GroupKey, u32> = HashMap::new();
        let mut places: Vec<Vec<u32>> = Vec::with_capacity(parts.len());
        for Part { keys, groups } in parts {
            let mut own = Vec::with_capacity(keys.len());
            for (index, key) in keys.iter().enumerate() {
                let next = this.sizes.len() as u32;
                let group = key.map_or(next, |key| *numbers.entry(key).or_insert(next));
                this.add(group, groups.reflected[index], groups.counted.get(index).copied());
                // Adding has counted one.
                this.sizes[group as usize] += groups.sizes[index] - 1;
                own.push(group);
            }
            places.push(own);
        }
        let chunks = of_patch.par_chunks_mut(CHUNK).zip(&places);
        chunks.for_each(|(of_patch, places)| {
            let reached = of_patch.iter_mut().filter(|group| **group != NONE);
            reached.for_each(|group| *group = places[*group as usize]);
        });
        Self { of_patch, ..this }
    }

    /// Adds a patch to a group, which may be a new one.
    fn add(&mut self, group: u32, reflected: Rgb, counted: Option<f32>) {
        let group = group as usize;
        if group == self.sizes.len() {
            self.sizes.push(0);
            self.reflected.push(Rgb::ZERO);
            self.counted.extend(counted.map(|_| 0.0));
        }
        self.sizes[group] += 1;
        self.reflected[group] += reflected;
        if let Some(counted) = counted {
            self.counted[group] += counted;
        }
    }
}

/// The groups of some of a crowd's patches, in the order in which they come up.
struct Part {
    /// What the patches of each have in common; `None` of a patch that is alone.
    keys: Vec<Option<GroupKey>>,
    groups: Groups,
}

impl Part {
    fn of(crowd: &Crowd, grouping: &Grouping, first: usize, of_patch: &mut [u32]) -> Self {
        let mut this = Self { keys: Vec::new(), groups: Groups::default() };
        let mut numbers: HashMap<GroupKey, u32> = HashMap::new();
        for (offset, own) in of_patch.iter_mut().enumerate() {
            let index = PatchIndex((first + offset) as u32);
            let Some(outline) = crowd.outline(index) else { continue };
            let Outline { area, center, material, albedo, .. } = outline;
            let key = grouping.key(area, center, facing(outline.facing, outline.back), material);
            let next = this.keys.len() as u32;
            let group = key.map_or(next, |key| *numbers.entry(key).or_insert(next));
            if group == next {
                this.keys.push(key);
            }
            let counted = crowd.focus.map(|focus| focus.weight(center) * area);
            this.groups.add(group, albedo * area, counted);
            *own = group;
        }
        this
    }
}

impl Grouping {
    /// What a patch has in common with others of its group; `None` where it is alone.
    fn key(&self, area: f32, center: Vec3, facing: Facing, material: u32) -> Option<GroupKey> {
        if !self.is_crowded {
            return None;
        }
        let scale = self.focus.map_or(1.0, |focus| focus.scale_at(center));
        let level = scale.log2().floor() as u8;
        let cell = self.cell * f32::from(level).exp2();
        let place = || (center / cell).floor().as_ivec3().to_array();
        (area < cell * cell).then(|| (place(), level, facing, material))
    }
}

/// How a patch faces whose normal, of any length, that is.
fn facing(normal: Vec3, back: bool) -> Facing {
    let axis = normal.abs().max_position();
    ((2 * axis) as u8 + u8::from(normal[axis] < 0.0), back)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use crate::scene::made::revolved::revolved;
    use crate::transport::hemilux::coarse::Elements;
    use std::sync::Arc;

    /// In a thin pipe the inside of one wall and the outside of the other face the same way in one cell of
    /// space, and what shines on one of them does not on the other.
    #[test]
    fn insides_and_outsides_are_not_grouped() {
        let material = Material { double_sided: true, ..Material::lambertian("both", Rgb::ONE) };
        let rings: Vec<[f32; 2]> = (0..=200).map(|ring| [0.02, 0.01 * ring as f32]).collect();
        let scene = Arc::new(revolved(&rings, 12, material));
        let listed = PatchedScene::new(scene.clone(), 100);
        for cut in [Cut::Listed(Arc::new(listed)), Cut::new(scene, 100, None)] {
            let elements = Elements::new(&cut, 100);
            let mut together = 0;
            for element in elements.all() {
                let back = |patch: &PatchIndex| cut.place_in(*patch, 0, 1).expect("it is there").2;
                let mut members = elements.members(element).iter();
                let first = back(members.next().expect("there is one"));
                together += members.len();
                assert!(members.all(|patch| back(patch) == first), "{element:?}");
            }
            assert!(together > 5000, "{together}");
        }
    }
}
