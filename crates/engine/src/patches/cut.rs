//! A scene cut into patches for methods that follow rays: all of it listed, or hardly any of it.

use super::crowd::Crowd;
use super::facet::Sides;
use super::focus::{Focus, area_of};
use super::index::{FacetIndex, FacetPlace, PatchIndex};
use super::means::{exponent_of, point_of};
use super::patched::PatchedScene;
use crate::radiometry::{Reflectance, Rgb};
use crate::scene::{Scene, Warning};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// Scenes with so many times more triangles than patches are wanted are crowds.
const CROWDED_FACTOR: usize = 4;

/// A scene in facets and patches.
pub enum Cut {
    /// All of them are listed.
    Listed(Arc<PatchedScene>),
    /// Nearly every side of a triangle is a patch, and nothing is listed of those.
    Crowd(Crowd),
}

/// Where a patch lies.
pub struct PatchCell {
    /// The scene's triangle that it lies on.
    pub triangle: u32,
    /// World positions of the corners of a facet of it.
    pub corners: [Vec3; 3],
    /// Barycentric coordinates of these corners in the scene's triangle.
    pub source: [Vec2; 3],
    /// Barycentric corners of the patch in the facet.
    pub at: [Vec2; 3],
    /// Whether it is on the back.
    pub back: bool,
}

impl PatchCell {
    /// World positions of the patch's corners.
    pub fn own_corners(&self) -> [Vec3; 3] {
        let [a, b, c] = self.corners;
        self.at.map(|at| a * (1.0 - at.x - at.y) + b * at.x + c * at.y)
    }
}

impl Cut {
    /// Bytes that it takes beside the scene.
    pub fn held_bytes(&self) -> u64 {
        match self {
            Self::Listed(listed) => listed.held_bytes(),
            Self::Crowd(crowd) => crowd.held_bytes(),
        }
    }

    /// Cuts a scene into about so many patches, at least one a triangle side.
    pub fn new(scene: Arc<Scene>, wanted: usize, focus: Option<Focus>) -> Self {
        // What instances share is not listed for each of them.
        let is_crowd = Self::is_crowd(scene.triangles.len(), wanted) || !scene.instances.is_empty();
        match is_crowd {
            true => Self::Crowd(Crowd::new(scene, wanted, focus)),
            false => Self::Listed(Arc::new(PatchedScene::for_rays(scene, wanted, focus))),
        }
    }

    /// Whether so many triangles are a crowd.
    pub fn is_crowd(triangles: usize, wanted: usize) -> bool {
        triangles > wanted.saturating_mul(CROWDED_FACTOR)
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        match self {
            Self::Listed(listed) => &listed.scene,
            Self::Crowd(crowd) => &crowd.scene,
        }
    }

    /// What was left out.
    pub fn warnings(&self) -> Vec<Warning> {
        match self {
            Self::Listed(listed) => listed.warnings.clone(),
            Self::Crowd(crowd) if crowd.left_out > 0 => {
                let what = format!("{} triangles without area were left out", crowd.left_out);
                vec![Warning::new("scene", what)]
            }
            Self::Crowd(_) => Vec::new(),
        }
    }

    /// Whether any patch emits.
    pub fn any_light(&self) -> bool {
        match self {
            Self::Listed(listed) => listed.patches.any_light(),
            Self::Crowd(Crowd { scene, .. }) => scene.emissive_triangles() > 0,
        }
    }

    /// Number of patches.
    pub fn patches(&self) -> usize {
        match self {
            Self::Listed(listed) => listed.patches.len(),
            Self::Crowd(crowd) => crowd.count,
        }
    }

    /// Number of facets that a picture is made of. Those of a crowd are the scene's triangles.
    pub fn facets(&self) -> usize {
        match self {
            Self::Listed(listed) => listed.facets.len(),
            Self::Crowd(crowd) => crowd.scene.triangle_count(),
        }
    }

    /// How a facet is cut.
    #[inline]
    pub fn sides(&self, facet: FacetIndex) -> Sides {
        match self {
            Self::Listed(listed) => listed.facets[facet.at()].sides(),
            Self::Crowd(crowd) => crowd.sides(facet),
        }
    }

    /// The triangle that a facet lies in.
    #[inline]
    pub fn source(&self, facet: FacetIndex) -> u32 {
        match self {
            Self::Listed(listed) => listed.facets[facet.at()].source,
            Self::Crowd(crowd) => crowd.source(facet),
        }
    }

    /// Whether a triangle bounds a closed body that no light gets into, as far as that is known.
    pub fn bounds_dark_body(&self, triangle: u32, u: f32, v: f32) -> bool {
        let Self::Listed(listed) = self else { return false };
        let facet = listed.place_on_triangle(triangle, u, v);
        facet.is_some_and(|(facet, _)| listed.facets[facet.at()].cull_back)
    }

    /// Barycentric (u, v) of a facet's corners in its triangle.
    #[inline]
    pub fn source_uv(&self, facet: FacetIndex) -> [Vec2; 3] {
        match self {
            Self::Listed(listed) => listed.facets[facet.at()].source_uv,
            Self::Crowd(crowd) => {
                [Vec2::ZERO, Vec2::X, Vec2::Y].map(|at| crowd.to_source(facet, at))
            }
        }
    }

    /// Barycentric (u, v) in its triangle of a place in a facet.
    #[inline]
    pub fn to_source(&self, facet: FacetIndex, at: Vec2) -> Vec2 {
        match self {
            Self::Listed(listed) => listed.facets[facet.at()].to_source(at.x, at.y),
            Self::Crowd(crowd) => crowd.to_source(facet, at),
        }
    }

    /// World positions of the corners of a facet that a picture is made of.
    pub fn corners(&self, facet: FacetIndex) -> [Vec3; 3] {
        match self {
            Self::Listed(listed) => {
                listed.facets[facet.at()].corners.map(|corner| listed.positions[corner as usize])
            }
            Self::Crowd(Crowd { scene, .. }) => scene.corners(&scene.triangle(facet.0)),
        }
    }

    /// The facet, and the place in it, of barycentric (u, v) of a triangle.
    #[inline]
    pub fn place_on_triangle(&self, triangle: u32, u: f32, v: f32) -> Option<(FacetIndex, Vec2)> {
        match self {
            Self::Listed(listed) => listed.place_on_triangle(triangle, u, v),
            Self::Crowd(crowd) => crowd.place_on_triangle(triangle, u, v),
        }
    }

    /// The place on a facet that has patches of a place on one that a picture is made of.
    pub fn with_patches(&self, place: FacetPlace) -> FacetPlace {
        let Self::Crowd(crowd) = self else { return place };
        let found = crowd.place_on_triangle(place.facet.0, place.at.x, place.at.y);
        found.map_or(place, |(facet, at)| FacetPlace { facet, at, ..place })
    }

    /// Whether a patch is made of several triangles.
    pub fn is_cluster(&self, patch: PatchIndex) -> bool {
        matches!(self, Self::Crowd(crowd) if crowd.cluster(patch).is_some())
    }

    /// Where a patch lies; of one that is made of several triangles, where the one lies that a number
    /// in [0, 1) picks by area.
    pub fn cell(&self, patch: PatchIndex, x: f32) -> PatchCell {
        match self {
            Self::Listed(listed) => {
                let (facet, back, at) = listed.cell_of(patch);
                let corners = facet.corners.map(|corner| listed.positions[corner as usize]);
                let (triangle, source) = (facet.source, facet.source_uv);
                PatchCell { triangle, corners, source, at, back }
            }
            Self::Crowd(crowd) => {
                let whole = [Vec2::ZERO, Vec2::X, Vec2::Y];
                let (triangle, at, back) = match crowd.cluster(patch) {
                    Some((clusters, number)) => {
                        let (triangle, back) =
                            clusters.pick(&crowd.scene, number, x).unwrap_or_default();
                        (triangle, whole, back)
                    }
                    None => {
                        let own = crowd.patch(patch);
                        own.map_or((0, [Vec2::ZERO; 3], false), |own| {
                            (own.triangle, own.at, own.back)
                        })
                    }
                };
                let corners = crowd.scene.corners(&crowd.scene.triangle(triangle));
                PatchCell { triangle, corners, source: whole, at, back }
            }
        }
    }

    /// A place in a patch, the n-th of so many that are spread over it: triangle, barycentric (u, v) there,
    /// and whether it is on the back.
    pub fn place_in(&self, patch: PatchIndex, n: u32, of: u32) -> Option<(u32, Vec2, bool)> {
        match self {
            Self::Listed(listed) => {
                let (facet, back, cell) = listed.cell_of(patch);
                let at = point_of(cell, n);
                Some((facet.source, facet.to_source(at.x, at.y), back))
            }
            Self::Crowd(crowd) => match crowd.cluster(patch) {
                Some((clusters, number)) => {
                    let x = (n as f32 + 0.5) / of as f32;
                    let (triangle, back) = clusters.pick(&crowd.scene, number, x)?;
                    Some((triangle, point_of([Vec2::ZERO, Vec2::X, Vec2::Y], n), back))
                }
                None => {
                    let own = crowd.patch(patch)?;
                    Some((own.triangle, point_of(own.at, n), own.back))
                }
            },
        }
    }

    /// Area of a patch, m².
    pub fn area(&self, patch: PatchIndex) -> f32 {
        match self {
            Self::Listed(listed) => listed.patches.area[patch.at()],
            Self::Crowd(crowd) => {
                if let Some((clusters, number)) = crowd.cluster(patch) {
                    return clusters.area(&crowd.scene, number);
                }
                crowd.patch(patch).map_or(0.0, |own| area_of(crowd.corners(&own)))
            }
        }
    }

    /// How a patch reflects, and its albedo under uniform light.
    pub fn reflectance(&self, patch: PatchIndex) -> (Reflectance, Rgb) {
        match self {
            Self::Listed(listed) => {
                let patches = &listed.patches;
                (patches.reflectance(patch.at()), patches.albedo[patch.at()])
            }
            Self::Crowd(crowd) => {
                let none = (Reflectance::lambertian(Rgb::ZERO), Rgb::ZERO);
                if let Some((clusters, number)) = crowd.cluster(patch) {
                    return clusters.reflectance(&crowd.scene, number).unwrap_or(none);
                }
                let Some(own) = crowd.patch(patch) else { return none };
                let means = crowd.means(patch, &own);
                let triangle = &crowd.scene.triangle(own.triangle);
                (means.reflectance(exponent_of(&crowd.scene, triangle)), means.albedo)
            }
        }
    }
}
