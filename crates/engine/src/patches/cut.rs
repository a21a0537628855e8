//! A scene cut into patches for methods that follow rays: all of it listed, or hardly any of it.

use super::crowd::Crowd;
use super::facet::Sides;
use super::focus::{Focus, area_of};
use super::index::{FacetIndex, FacetPlace, PatchIndex};
use super::means::exponent_of;
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
    /// World positions of the corners of a triangle.
    pub corners: [Vec3; 3],
    /// Barycentric corners of the patch in it.
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
    /// Cuts a scene into about so many patches, at least one a triangle side.
    pub fn new(scene: Arc<Scene>, wanted: usize, focus: Option<Focus>) -> Self {
        match Self::is_crowd(scene.triangles.len(), wanted) {
            true => Self::Crowd(Crowd::new(scene, wanted, focus)),
            false => Self::Listed(Arc::new(PatchedScene::focused(scene, wanted, focus))),
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
            Self::Crowd(crowd) => crowd.scene.triangles.len(),
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

    /// Whether the back of a facet is there for light and cameras.
    pub fn is_two_sided(&self, facet: FacetIndex) -> bool {
        match self {
            Self::Listed(listed) => listed.facets[facet.at()].first_patch(true).is_some(),
            Self::Crowd(crowd) => crowd.is_two_sided(crowd.source(facet)),
        }
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
            Self::Crowd(Crowd { scene, .. }) => scene.corners(&scene.triangles[facet.at()]),
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

    /// Where a patch lies.
    pub fn cell(&self, patch: PatchIndex) -> PatchCell {
        match self {
            Self::Listed(listed) => {
                let (facet, back, at) = listed.cell_of(patch);
                let corners = facet.corners.map(|corner| listed.positions[corner as usize]);
                PatchCell { corners, at, back }
            }
            Self::Crowd(crowd) => {
                let own = crowd.patch(patch);
                let (triangle, at, back) = own.map_or((0, [Vec2::ZERO; 3], false), |own| {
                    (own.triangle as usize, own.at, own.back)
                });
                let corners = crowd.scene.corners(&crowd.scene.triangles[triangle]);
                PatchCell { corners, at, back }
            }
        }
    }

    /// Area of a patch, m².
    pub fn area(&self, patch: PatchIndex) -> f32 {
        match self {
            Self::Listed(listed) => listed.patches.area[patch.at()],
            Self::Crowd(crowd) => {
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
                let Some(own) = crowd.patch(patch) else {
                    return (Reflectance::lambertian(Rgb::ZERO), Rgb::ZERO);
                };
                let means = crowd.means(patch, &own);
                let triangle = &crowd.scene.triangles[own.triangle as usize];
                (means.reflectance(exponent_of(&crowd.scene, triangle)), means.albedo)
            }
        }
    }
}
