//! Where shadow rays of a fragment start, and the normal that light has there.

use super::{Fragment, VisibleSurfaces};
use crate::hemicube::item;
use crate::patches::{FacetIndex, FacetPlace};
use glam::{Vec2, Vec3};

impl VisibleSurfaces {
    /// A surface point of a fragment, off the surface by the rounding error: that of its n-th sample,
    /// on the facet that this one sees; where all had their turn one near it or, where the fragment
    /// takes the whole pixel, between all of them.
    pub fn sample_point(&self, fragment: &Fragment, n: u32) -> Vec3 {
        self.nth_spot(fragment, n).map_or(fragment.point, |(_, (point, _))| point)
    }

    /// The same with the unit shading normal that light has there: where a map tilts it, each place has its
    /// own; elsewhere all of them have the fragment's.
    pub fn start_of_ray(&self, fragment: &Fragment, n: u32) -> (Vec3, Vec3) {
        let Some((place, (point, flat))) = self.nth_spot(fragment, n) else {
            return (fragment.point, fragment.shading_normal);
        };
        if !self.is_mapped(fragment) {
            return (point, fragment.shading_normal);
        }
        let FacetPlace { facet, back, at } = place;
        let (source, at) = (self.cut.source(facet), self.cut.to_source(facet, at));
        let side = if back { -1.0 } else { 1.0 };
        (point, self.placing.world.shading_normal(source, at, flat, side))
    }

    /// Whether a map tilts the normals of a fragment.
    pub fn is_mapped(&self, fragment: &Fragment) -> bool {
        let world = &self.placing.world;
        world.has_normal_maps()
            && item::decode(fragment.code).is_some_and(|(facet, _)| {
                world.material(self.cut.source(FacetIndex(facet))).has_normal_map()
            })
    }

    /// Where on its facet that is, the point, and the unit normal of the facet on that side.
    fn nth_spot(&self, fragment: &Fragment, n: u32) -> Option<(FacetPlace, (Vec3, Vec3))> {
        let (code, offset) = self.nth_place(fragment, n);
        let (facet, back) = item::decode(code)?;
        let placed = self.placed(facet);
        let at = self.within(&placed, fragment.pixel, offset);
        Some((FacetPlace { facet: FacetIndex(facet), back, at }, placed.spot(back, at)))
    }

    /// Code of facet and side, and the place in the pixel.
    fn nth_place(&self, fragment: &Fragment, n: u32) -> (u32, Vec2) {
        let (code, offset) = self.nth_sample(fragment, n);
        let round = n / self.count(fragment);
        if round == 0 {
            return (code, offset);
        }
        // A shadow's edge needs places that are ever closer to each other. But not beyond the
        // facets, where a wall may stand.
        let other = self.another_place(fragment, offset, n);
        if self.is_whole(fragment) && fragment.has_one_facet() {
            return (code, other);
        }
        self.covering(fragment, (code, other)).map_or((code, offset), |covers| (covers, other))
    }
}
