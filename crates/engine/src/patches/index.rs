//! Which facet, which patch, and where on a facet: types of their own, so that one is not taken for
//! the other.

use glam::Vec2;

/// A facet by its place in [`super::PatchedScene::facets`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FacetIndex(pub u32);

/// A patch by its place in the lists of [`super::Patches`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PatchIndex(pub u32);

impl FacetIndex {
    /// The place in a list.
    #[inline]
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

impl PatchIndex {
    /// The place in a list.
    #[inline]
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// A place on a side of a facet.
#[derive(Clone, Copy, Debug)]
pub struct FacetPlace {
    /// The facet.
    pub facet: FacetIndex,
    /// Whether it is on the back.
    pub back: bool,
    /// Barycentric (u, v); rounding may put it a little outside.
    pub at: Vec2,
}
