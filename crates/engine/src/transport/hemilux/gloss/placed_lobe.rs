//! Where the lobes of glossy fragments are and look to, by which it is told whether two of them look at the
//! same place.

use crate::radiometry::{Rgb, importance};
use crate::surface::{Reflection, World, is_same_normal};
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use glam::Vec3;

/// Lobes share rays if they look less than 1/√this beside each other, as a share of the angle at
/// which a lobe has fallen to e^−½: half of it. A wider reach flattens highlights on balls.
const NARROWNESS: f32 = 4.0;
/// The same across the edge of a flat facet: an eighth. The light of lobes has a step there, and no plane
/// goes through that.
const CREASE_NARROWNESS: f32 = 64.0;
/// Lobes share rays if the way between their places leaves the surface by less than this, as the sine
/// of an angle: what lies before another surface takes light from it close by.
const MOST_STEP: f32 = 0.3;
/// Lobes share rays if their exponents, at least 1, differ by less than this factor.
const LIKE_EXPONENTS: f32 = 1.3;

/// A lobe is faint that reflects at most this share of what the diffuse part of its fragment does, as that of a
/// painted wall looked at from before.
const FAINT: f32 = 0.2;

/// The lobe of a fragment: its place, and the mirrored direction to the camera.
#[derive(Clone, Copy)]
pub struct PlacedLobe {
    point: Vec3,
    /// Unit normal of the surface.
    normal: Vec3,
    /// Whether that is the same all over the facet, and turns at its edges.
    is_flat: bool,
    /// Unit vector.
    direction: Vec3,
    exponent: f32,
    /// Whether all of it is of microfacets.
    pub has_slopes: bool,
    /// Albedo towards the camera; 1 of what is clear.
    pub albedo: Rgb,
    /// Whether it shows little beside what its fragment reflects diffusely.
    pub is_faint: bool,
}

impl PlacedLobe {
    /// That of a glossy fragment.
    pub fn new(world: &World, visible: &VisibleSurfaces, lobe: &Lobe) -> Self {
        let surface = visible.surface(world, lobe, (0, 0));
        let viewer = visible.frame.towards_eye(surface.spot.point);
        let exponent =
            surface.clear.map_or_else(|| surface.reflection().exponent(), |clear| clear.exponent());
        let fragment = &visible.fragments[lobe.fragment as usize];
        let normal = fragment.normal;
        let is_flat = world.has_one_normal(surface.triangle);
        let (point, direction) = (surface.spot.point, surface.mirrored(viewer));
        let albedo = match surface.clear {
            Some(_) => Rgb::ONE,
            None => surface.lobe_only().reflection().albedo(viewer),
        };
        let is_faint = is_faint(visible, lobe, albedo);
        let has_slopes = surface.clear.is_none() && surface.reflection().has_slopes();
        Self { point, normal, is_flat, direction, exponent, has_slopes, albedo, is_faint }
    }

    /// Exponent of the narrowest of its lobes.
    pub fn exponent(&self) -> f32 {
        self.exponent
    }

    /// Weight of two lobes for each other, where what they look at is that near (1/distance): 1 where it is
    /// the same place, 0 where they look half a lobe's width beside each other.
    pub fn looks_at_the_same(&self, other: &Self, nearness: f32) -> f32 {
        let (a, b) = (self, other);
        let [least, most] = [a.exponent.min(b.exponent), a.exponent.max(b.exponent)];
        if most.max(1.0) > least.max(1.0) * LIKE_EXPONENTS {
            return 0.0;
        }
        let apart = b.point - a.point;
        let step = a.normal.dot(apart).abs().min(b.normal.dot(apart).abs());
        if step * step > MOST_STEP * MOST_STEP * apart.length_squared() {
            return 0.0;
        }
        let is_crease = (a.is_flat || b.is_flat) && !is_same_normal(a.normal, b.normal);
        let narrowness = if is_crease { CREASE_NARROWNESS } else { NARROWNESS };
        let between = apart * nearness + (b.direction - a.direction);
        let across = between - a.direction * a.direction.dot(between);
        1.0 - (across.length_squared() * most.max(1.0) * narrowness).min(1.0)
    }
}

/// Whether a lobe of that albedo is faint in its fragment.
fn is_faint(visible: &VisibleSurfaces, lobe: &Lobe, albedo: Rgb) -> bool {
    let fragment = &visible.fragments[lobe.fragment as usize];
    let albedo = fragment.lobe_albedo.unwrap_or(albedo) * fragment.lobe_factor;
    importance(albedo) <= FAINT * importance(fragment.diffuse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::made::revolved::hollow_ball;
    use crate::scene::{Material, Vertex};
    use std::sync::Arc;

    /// A broad lobe whose normal leans by that angle, in radians, where it has gone so far.
    fn lobe(angle: f32, point: Vec3, is_flat: bool) -> PlacedLobe {
        let normal = Vec3::new(angle.sin(), angle.cos(), 0.0);
        let direction = Vec3::new((2.0 * angle).sin(), (2.0 * angle).cos(), 0.0);
        let (albedo, is_faint) = (Rgb::ONE, false);
        let has_slopes = true;
        PlacedLobe {
            point,
            normal,
            is_flat,
            direction,
            exponent: 1.0,
            has_slopes,
            albedo,
            is_faint,
        }
    }

    /// Lobes of surfaces one behind the other do not share what is close by to one of them alone.
    #[test]
    fn what_lies_behind_is_not_shared() {
        let first = lobe(0.0, Vec3::ZERO, true);
        let beside = |step: f32| lobe(0.0, Vec3::new(0.1, 0.1 * step, 0.0), true);
        for other in [beside(0.1), beside(-0.1)] {
            assert!(first.looks_at_the_same(&other, 0.1) > 0.9);
            assert!(other.looks_at_the_same(&first, 0.1) > 0.9);
        }
        assert_eq!(first.looks_at_the_same(&beside(-1.0), 0.1), 0.0);
        assert_eq!(beside(-1.0).looks_at_the_same(&first, 0.1), 0.0);
    }

    /// Where facets are flat, light has a step at their edges; where normals go over into each other, it
    /// has none.
    #[test]
    fn creases_part_what_bends_do_not() {
        let beside = Vec3::new(0.01, 0.0, 0.0);
        let across = |angle: f32, is_flat: [bool; 2]| {
            let [one, other] = is_flat;
            lobe(0.0, Vec3::ZERO, one).looks_at_the_same(&lobe(angle, beside, other), 0.0)
        };
        assert!(across(0.1, [false; 2]) > 0.8, "{}", across(0.1, [false; 2]));
        for is_flat in [[true, false], [false, true], [true; 2]] {
            assert_eq!(across(0.1, is_flat), 0.0, "{is_flat:?}");
            assert!(across(0.02, is_flat) > 0.8, "{is_flat:?}: hardly any step");
            assert!(across(0.001, is_flat) > 0.99, "{is_flat:?}: rounding");
        }
    }

    /// What counts is that a facet's corners have one normal, not that this is quite the facet's: files round.
    #[test]
    fn a_facet_is_flat_if_its_corners_have_one_normal() {
        let mut scene = hollow_ball(24, Material::lambertian("grey", Rgb::splat(0.5)));
        let flat = scene.triangles.len() / 2;
        let [a, b, c] =
            scene.triangles[flat].vertices.map(|vertex| scene.vertices[vertex as usize]);
        let up = (a.normal + b.normal + c.normal).normalize();
        let rounded = (up + 0.01 * up.any_orthonormal_vector()).normalize();
        let first = scene.vertices.len() as u32;
        scene.vertices.extend([a, b, c].map(|vertex| Vertex { normal: rounded, ..vertex }));
        scene.triangles[flat].vertices = [first, first + 1, first + 2];
        let world = World::new(Arc::new(scene));
        let all = 0..world.scene.triangles.len();
        let found: Vec<usize> = all.filter(|facet| world.has_one_normal(*facet as u32)).collect();
        assert_eq!(found, [flat]);
    }
}
