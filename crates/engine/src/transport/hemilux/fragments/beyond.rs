//! Fragments beyond fragments: where a surface lets light through diffusely, a fragment has another
//! one on the surface's other side, which is lit there as all fragments are. What it would reflect,
//! its diffuse albedo being the share that comes through, is what comes through.

use super::band::{SeenPart, SeenPlace};
use super::{Fragment, SampleGroup, VisibleSurfaces, other_side};
use crate::hemicube::item;
use crate::patches::FacetIndex;
use crate::radiometry::Rgb;
use crate::surface::World;
use glam::Vec2;

impl VisibleSurfaces {
    /// Whether light may go diffusely through what a code stands for.
    pub(super) fn is_translucent(&self, world: &World, code: u32) -> bool {
        let facet = item::decode(code).filter(|_| world.has_translucent());
        facet.is_some_and(|(facet, _)| world.is_translucent(self.cut.source(FacetIndex(facet))))
    }

    /// Appends the other sides of a pixel's fragments, which begin at the `first`, where these let
    /// light through; `of_group` has each group's fragment.
    #[cold]
    #[inline(never)]
    pub(super) fn look_beyond(
        &self,
        world: &World,
        groups: &[SampleGroup],
        of_group: &[usize],
        (fragments, first): (&mut Vec<Fragment>, usize),
    ) {
        for near in first..fragments.len() {
            let own = fragments[near];
            let (mut passed, mut all) = (Rgb::ZERO, 0.0);
            let mine = groups.iter().zip(of_group).filter(|(_, of)| **of == near);
            for (group, _) in mine {
                let seen = self.part_of(world, own.pixel, group);
                let share = seen.share;
                passed += self.passed(world, own.pixel, group.code, seen) * share;
                all += share;
            }
            if passed == Rgb::ZERO {
                continue;
            }
            let code = other_side(own.code);
            let Some((facet, back)) = item::decode(code) else { continue };
            let middle = self.offsets(own.mask).sum::<Vec2>() / own.mask.count_ones().max(1) as f32;
            let at = self.barycentric(facet, own.pixel, middle);
            fragments.push(Fragment {
                code,
                point: self.spot(facet, back, at).0,
                normal: -own.normal,
                shading_normal: -own.shading_normal,
                diffuse: passed / all,
                lobe_factor: Rgb::ONE,
                lobe_albedo: None,
                glossy: false,
                is_beyond: true,
                ..own
            });
        }
    }

    /// The mean share of the light from the other side of a facet that comes through what is seen of
    /// it.
    #[cold]
    #[inline(never)]
    pub(super) fn passed(
        &self,
        world: &World,
        pixel: u32,
        code: u32,
        seen: SeenPart<impl Iterator<Item = SeenPlace>>,
    ) -> Rgb {
        let Some((facet, back)) = item::decode(code) else { return Rgb::ZERO };
        let source = self.cut.source(FacetIndex(facet));
        // What is clear is seen by rays, with all that comes through.
        if !world.is_translucent(source) || world.is_clear(source) {
            return Rgb::ZERO;
        }
        let side = if back { -1.0 } else { 1.0 };
        let placed = self.placed(facet);
        let mut sum = Rgb::ZERO;
        for SeenPlace { offset, side: width, weight } in seen.places {
            let (point, flat) = placed.spot(back, self.within(&placed, pixel, offset));
            let part = self.part((facet, &placed), (pixel, offset), width);
            let normal = world.shading_normal_over(&self.pyramids, (source, &part), flat, side);
            let cosine = normal.dot(self.frame.towards_eye(point));
            sum += world.passed_over(&self.pyramids, (source, &part), cosine) * weight;
        }
        sum
    }

    /// Whether any fragment may let light through diffusely.
    pub fn has_beyond(&self) -> bool {
        self.placing.world.has_translucent()
    }

    /// The fragment on the other side of a fragment, if light comes through from there.
    pub fn beyond(&self, near: usize) -> Option<usize> {
        let pixel = self.fragments[near].pixel as usize;
        let first = self.start[pixel] as usize;
        let own = &self.fragments[first..self.start[pixel + 1] as usize];
        self.beyond_in(own, near - first).map(|index| first + index)
    }

    /// The same among the fragments of a pixel.
    pub(super) fn beyond_in(&self, own: &[Fragment], near: usize) -> Option<usize> {
        if !self.has_beyond() {
            return None;
        }
        let code = other_side(own[near].code);
        own.iter().position(|other| other.is_beyond && other.code == code)
    }
}
