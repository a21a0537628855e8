//! Finite elements: the scene's triangles as *facets* (what hemicubes rasterise) and, on each
//! side of a facet that light can reach, n² *patches* (what carries irradiance).
//!
//! Visibility geometry and finite elements are kept apart: a wall of two triangles stays two
//! triangles for the rasteriser however many patches it has, and the patch that a pixel sees
//! follows from the facet and the barycentric coordinates of the hit ([`cell_index`]).
//!
//! [`PatchedScene`] lists facets and patches. [`Cut`] is that, or a [`Crowd`], where triangles are so
//! many more than the wanted patches that nothing but a number a triangle is kept.

mod bodies;
mod clusters;
mod contacts;
mod crowd;
mod cut;
mod facet;
mod focus;
mod index;
mod means;
mod patched;
mod piece_index;
mod seams;
mod split;

pub use clusters::Outline;
pub use crowd::{Crowd, CrowdPatch};
pub use cut::{Cut, PatchCell};
pub use facet::{Facet, NO_PATCH, Sides, cell_index, cells, nth_cell};
pub use focus::Focus;
pub use index::{FacetIndex, FacetPlace, PatchIndex};
pub use patched::{MAX_PATCHES, PatchedScene, Patches};
