//! Points of a patch.

use crate::patches::{Cut, PatchCell, PatchIndex, PatchedScene};
use crate::rays::{Spot, inset, unit_normal};
use crate::surface::World;
use glam::{Vec2, Vec3};

/// A patch to pick points of, in ray units.
pub struct PatchPoints {
    /// The scene's triangle, and where in it the corners lie.
    triangle: u32,
    source: [Vec2; 3],
    corners: [Vec3; 3],
    /// Of the front.
    normal: Vec3,
    cell: [Vec2; 3],
    inset: f32,
    back: bool,
}

/// A point of a patch that light comes to.
#[derive(Clone, Copy)]
pub struct LitPoint {
    /// The point, off the surface by the rounding error.
    pub start: Vec3,
    /// Unit geometric normal of its side.
    pub normal: Vec3,
    /// Unit normal that it is lit by: that between the vertices' normals, as wherever the camera or a
    /// ray sees it. Light from below the geometric plane does not arrive.
    pub lit_normal: Vec3,
}

impl PatchPoints {
    /// The scene's triangle that they lie on.
    pub fn triangle(&self) -> u32 {
        self.triangle
    }

    /// The points of a patch.
    pub fn new(world: &World, scene: &PatchedScene, patch: PatchIndex) -> Self {
        let (facet, back, at) = scene.cell_of(patch);
        let corners = facet.corners.map(|c| scene.positions[c as usize]);
        let (triangle, source) = (facet.source, facet.source_uv);
        Self::of(world, PatchCell { triangle, corners, source, at, back })
    }

    /// The points of a patch of a scene that may be a crowd; of one of several triangles, those of the
    /// one that a number in [0, 1) picks by area.
    pub fn in_cut(world: &World, cut: &Cut, patch: PatchIndex, x: f32) -> Self {
        Self::of(world, cut.cell(patch, x))
    }

    fn of(world: &World, patch: PatchCell) -> Self {
        let PatchCell { triangle, corners, source, at: cell, back } = patch;
        let corners = corners.map(|corner| world.rays.place(corner));
        let (normal, inset) = (unit_normal(corners), inset(corners));
        Self { triangle, source, corners, normal, cell, inset, back }
    }

    fn corner(&self, at: Vec2) -> Vec3 {
        let [a, b, c] = self.corners;
        a * (1.0 - at.x - at.y) + b * at.x + c * at.y
    }

    /// Area, ray units.
    pub fn area(&self) -> f32 {
        let [a, b, c] = self.cell.map(|at| self.corner(at));
        0.5 * (b - a).cross(c - a).length()
    }

    /// Unit normal of its side.
    pub fn normal(&self) -> Vec3 {
        if self.back { -self.normal } else { self.normal }
    }

    /// Centre and radius of a ball around it.
    pub fn ball(&self) -> (Vec3, f32) {
        let corners = self.cell.map(|at| self.corner(at));
        let center = (corners[0] + corners[1] + corners[2]) / 3.0;
        (center, corners.iter().map(|corner| corner.distance(center)).fold(0.0, f32::max))
    }

    /// The point for two uniform numbers, off the surface by the rounding error, and the normal.
    pub fn point(&self, xi: [f32; 2]) -> (Vec3, Vec3) {
        let (spot, normal) = self.spot(self.place(xi));
        (spot.off_surface(normal), normal)
    }

    /// The same with the normal that it is lit by.
    pub fn lit_point(&self, world: &World, xi: [f32; 2]) -> LitPoint {
        let at = self.place(xi);
        let (spot, normal) = self.spot(at);
        let [a, b, c] = self.source;
        let source = a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
        let side = if self.back { -1.0 } else { 1.0 };
        let lit_normal = world.smooth_normal(self.triangle, source, normal, side);
        LitPoint { start: spot.off_surface(normal), normal, lit_normal }
    }

    /// From the centroid to the point for two uniform numbers, in sides of the patch along the edges of its
    /// facet.
    pub fn offset(&self, xi: [f32; 2]) -> Vec2 {
        let [a, b, c] = self.cell;
        let side = a.max(b).max(c) - a.min(b).min(c);
        (self.place(xi) - (a + b + c) / 3.0) / side
    }

    /// Barycentric coordinates in the facet for two uniform numbers.
    fn place(&self, [x, y]: [f32; 2]) -> Vec2 {
        let [a, b, c] = self.cell;
        let root = x.sqrt();
        let at = a * (1.0 - root) + b * (root * (1.0 - y)) + c * (root * y);
        at.lerp(Vec2::splat(1.0 / 3.0), self.inset)
    }

    /// Where that is, and the unit normal of the side.
    fn spot(&self, at: Vec2) -> (Spot, Vec3) {
        let spot = Spot::new(self.corners, self.normal, at.x, at.y);
        (spot, if self.back { -spot.normal } else { spot.normal })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use std::sync::Arc;

    #[test]
    fn points_lie_on_their_patch_and_fill_it() {
        let imported = import(&made::cornell(), &Resources::default(), &ImportLimits::default());
        let scene = PatchedScene::new(Arc::new(imported.unwrap()), 300);
        let world = World::new(scene.scene.clone());
        let (world, scene) = (&world, &scene);
        let scale = world.rays.scale() as f32;
        const SIDE: usize = 16;
        for patch in (0..scene.patches.len()).step_by(13) {
            let points = PatchPoints::new(world, scene, PatchIndex(patch as u32));
            let area = points.area() / (scale * scale);
            assert!((area / scene.patches.area[patch] - 1.0).abs() < 1e-3);
            assert!(points.normal().dot(scene.patches.normal[patch]) > 0.999);
            let (center, radius) = points.ball();
            let mut mean = Vec3::ZERO;
            for k in 0..SIDE * SIDE {
                let xi = [k / SIDE, k % SIDE].map(|i| (i as f32 + 0.5) / SIDE as f32);
                let (point, normal) = points.point(xi);
                assert!(point.distance(center) <= radius * 1.001);
                assert!(normal.dot(points.normal()) > 0.999);
                mean += point / (SIDE * SIDE) as f32;
            }
            // The mean of a uniform distribution over a triangle is its centroid.
            assert!(mean.distance(center) < 0.01 * radius, "{mean} {center}");
        }
    }
}
