//! Rays against the scene's own triangles: what one meets first, and whether anything is between
//! two points.
//!
//! Lengths here are in *ray units*: the scene moved and scaled by a power of two so that it is
//! about 2²⁰ across. So every tolerance is a share of the scene's size, and a scene of a micrometre
//! is traced like one of a thousand kilometres. Directions and radiance don't depend on it.
//!
//! Neighbouring triangles leave no gap (Woop, Benthin, Wald 2013, "Watertight ray/triangle
//! intersection"), and points on surfaces know how far off rounding may have put them (Pharr,
//! Jakob, Humphreys, "Physically based rendering", §6.8), so rays start off their surface by no
//! more than that.

mod boxes;
mod hierarchy;
mod hit;
mod holes;
mod instanced;
mod ray;
mod tree;
mod triangle;
mod units;

use crate::scene::{Camera, Projection, Scene, Triangle};
use boxes::{Baseline, Boxes, Slabs};
use glam::{DVec3, Vec3, Vec3A};
use hierarchy::Boxed;
use hit::IN_INSTANCE;
use holes::{Chance, Holes};
use instanced::Instanced;
use rayon::prelude::*;
use std::sync::Arc;
use tree::{Found, Look, Tree};
use triangle::Crossing;
use units::{BOX_MARGIN, CHUNK, SIZE};

pub use hit::{Eye, Hit};
pub use holes::RayOfPixel;
pub use ray::{Ray, Segment};
pub use triangle::unit_normal;

/// Points of surfaces are off by at most this share of their coordinates.
const POINT_ERROR: f32 = 1.0 / 1_048_576.0;
/// In place of a triangle without area.
const NO_TRIANGLE: u32 = u32::MAX;
/// Rays between points stop this share short of the end.
const SHORT_OF_END: f32 = 1.0 - 1.0 / 262_144.0;

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Where, in ray units.
    pub point: Vec3,
    /// Unit geometric normal of the front.
    pub normal: Vec3,
    /// How far rounding may have moved the point along the normal, ray units.
    pub error: f32,
}

impl Spot {
    /// The point of a triangle at barycentric (u, v); `normal` is [`unit_normal`].
    pub fn new([a, b, c]: [Vec3; 3], normal: Vec3, u: f32, v: f32) -> Self {
        let w = 1.0 - u - v;
        let point = a * w + b * u + c * v;
        let error = normal.abs().dot(a.abs() * w + b.abs() * u + c.abs() * v) * POINT_ERROR;
        Self { point, normal, error }
    }

    /// Where rays that leave on the side of `normal` start.
    pub fn off_surface(&self, normal: Vec3) -> Vec3 {
        self.point + normal * self.error
    }
}

/// By which share of their way to the middle points of a triangle must be drawn in for rounding
/// not to take them over an edge, behind what stands there: at most half.
pub fn inset(corners: [Vec3; 3]) -> f32 {
    let [a, b, c] = corners;
    let around = (b - a).length() + (c - b).length() + (a - c).length();
    let inner_radius = (b - a).cross(c - a).length() / around;
    let farthest = corners.iter().fold(0.0, |far: f32, corner| far.max(corner.abs().max_element()));
    let share = 4.0 * POINT_ERROR * farthest / inner_radius;
    if share < 0.5 { share } else { 0.5 }
}

/// The scene for rays.
pub struct Rays {
    /// The listed triangles.
    listed: Tree,
    /// Instances, if there are any.
    instanced: Option<Box<Instanced>>,
    center: DVec3,
    scale: f64,
    /// Centre and radius of a ball around everything, ray units.
    ball: (DVec3, f64),
    /// What light passes, if anything has holes.
    holes: Option<Holes>,
    #[cfg(target_arch = "x86_64")]
    has_avx2: bool,
}

impl Rays {
    /// Prepares a scene whose materials may have holes, by alpha: where a material's coverage is
    /// less than 1, a ray passes with the rest as probability, the same ray always alike.
    pub fn of(scene: &Arc<Scene>) -> Self {
        Self { holes: Holes::new(scene), ..Self::new(scene) }
    }

    /// Prepares a scene as if its materials had no holes. Triangles without area are left out.
    pub fn new(scene: &Scene) -> Self {
        let (low, high) = scene.bounds().unwrap_or((Vec3::ZERO, Vec3::ONE));
        let (low, high) = (low.as_dvec3(), high.as_dvec3());
        let extent = (high - low).max_element().max(f64::from(f32::MIN_POSITIVE));
        let farthest = low.abs().max(high.abs()).max_element();
        // Moving costs a rounding, so only scenes far from the origin are.
        let center = if farthest > 4.0 * extent { 0.5 * (low + high) } else { DVec3::ZERO };
        let scale = (SIZE / extent).log2().floor().exp2();
        let middle = (0.5 * (low + high) - center) * scale;
        let mut rays = Self {
            listed: Tree::default(),
            instanced: None,
            center,
            scale,
            ball: (middle, 0.51 * (high - low).length() * scale),
            holes: None,
            #[cfg(target_arch = "x86_64")]
            has_avx2: is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
        };
        let margin = Vec3A::splat((extent * scale) as f32 * BOX_MARGIN);
        let triangle = |index: u32| scene.triangles[index as usize];
        let corners = |index: u32| scene.corners(&triangle(index)).map(|corner| rays.place(corner));
        let two_sided =
            |index: u32| scene.materials[triangle(index).material as usize].is_there_from_behind();
        let listed = Tree::new(rays.boxes(scene, margin), corners, two_sided);
        rays.listed = listed;
        rays.instanced = Instanced::new(scene, (center, scale), margin).map(Box::new);
        rays
    }

    /// The boxes of all triangles that have an area, larger by a margin.
    fn boxes(&self, scene: &Scene, margin: Vec3A) -> Vec<Boxed> {
        let of_triangle = |(index, triangle): (usize, &Triangle)| {
            let [a, b, c] = scene.corners(triangle).map(|corner| self.place(corner));
            let low = Vec3A::from(a.min(b).min(c)) - margin;
            let high = Vec3A::from(a.max(b).max(c)) + margin;
            let is_empty = (b - a).cross(c - a).length_squared() <= 0.0;
            Boxed { low, high, index: if is_empty { NO_TRIANGLE } else { index as u32 } }
        };
        let all = scene.triangles.par_iter().enumerate().with_min_len(CHUNK);
        let mut boxes: Vec<Boxed> = all.map(of_triangle).collect();
        boxes.retain(|item| item.index != NO_TRIANGLE);
        boxes
    }

    /// Whether there is nothing to hit.
    pub fn is_empty(&self) -> bool {
        self.listed.is_empty() && self.instanced.is_none()
    }

    /// Bytes that [`Rays::new`] takes at its peak for a scene of so many triangles.
    pub fn needed_bytes(triangles: u64) -> u64 {
        triangles * 500
    }

    /// Bytes that hierarchies and triangles take.
    pub fn held_bytes(&self) -> u64 {
        let instanced = self.instanced.as_ref().map_or(0, |instanced| instanced.held_bytes());
        self.listed.held_bytes() + instanced
    }

    /// Ray units of a metre.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// A world position in ray units.
    pub fn place(&self, world: Vec3) -> Vec3 {
        ((world.as_dvec3() - self.center) * self.scale).as_vec3()
    }

    /// A camera in ray units.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let mut camera = camera.clone();
        let eye = self.place(camera.to_world.w_axis.truncate());
        camera.to_world.w_axis = eye.extend(1.0);
        if let Projection::Orthographic { ymag } = &mut camera.projection {
            *ymag = (f64::from(*ymag) * self.scale) as f32;
        }
        camera
    }

    /// The corners of a triangle in ray units, and its area.
    pub fn corners(&self, scene: &Scene, triangle: u32) -> ([Vec3; 3], f32) {
        let corners = scene.corners(&scene.triangle(triangle));
        let [a, b, c] = corners.map(|corner| self.place(corner));
        ([a, b, c], 0.5 * (b - a).cross(c - a).length())
    }

    /// A world position in ray units, moved along a unit direction to just before the scene: far
    /// away, single precision would not do. `None` where the ray passes the scene.
    pub fn approach(&self, world: Vec3, direction: Vec3) -> Option<Vec3> {
        let origin = (world.as_dvec3() - self.center) * self.scale;
        let (middle, radius) = self.ball;
        let direction = direction.as_dvec3();
        let along = (middle - origin).dot(direction);
        let square = (origin + along * direction - middle).length_squared();
        if square > radius * radius {
            return None;
        }
        let before = (along - (radius * radius - square).sqrt()).max(0.0);
        Some((origin + before * direction).as_vec3())
    }

    /// What a ray from `origin` (ray units) along the unit `direction` meets first.
    pub fn closest(&self, eye: Eye, origin: Vec3, direction: Vec3) -> Option<Hit> {
        self.closest_with(eye, origin, direction, None)
    }

    /// The same for one of the rays of a pixel, which pass holes by numbers that they have well spread
    /// among them, instead of by chance.
    pub fn closest_in_pixel(&self, origin: Vec3, direction: Vec3, ray: RayOfPixel) -> Option<Hit> {
        self.closest_with(Eye::Camera, origin, direction, Some(Chance::OfPixel(ray)))
    }

    /// Whether light passes a triangle somewhere.
    pub fn has_holes(&self, triangle: u32) -> bool {
        self.holes.as_ref().is_some_and(|holes| holes.are_in(triangle))
    }

    #[inline(always)]
    fn closest_with(
        &self,
        eye: Eye,
        origin: Vec3,
        direction: Vec3,
        chance: Option<Chance>,
    ) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if self.has_avx2 {
            // SAFETY: the feature was detected.
            return unsafe { self.closest_avx2(eye, origin, direction, chance) };
        }
        self.closest_by::<Baseline>(eye, origin, direction, chance)
    }

    /// [`Rays::closest`] of many rays, in their order; what `hits` held before goes.
    ///
    /// Batches are for callers whose rays do not depend on what those before them meet: what traces
    /// has them all at once, and each step of the work goes over all of them.
    pub fn closest_many(&self, eye: Eye, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        hits.extend(rays.iter().map(|ray| self.closest(eye, ray.origin, ray.direction)));
    }

    /// Whether any triangle but those that `skip` names lies between two points (ray units).
    pub fn blocked(&self, from: Vec3, to: Vec3, skip: impl Fn(u32) -> bool) -> bool {
        let (between, distance) = (to - from, (to - from).length());
        if distance <= 0.0 {
            return false;
        }
        let (direction, end) = (between / distance, distance * SHORT_OF_END);
        #[cfg(target_arch = "x86_64")]
        if self.has_avx2 {
            // SAFETY: the feature was detected.
            return unsafe { self.blocked_avx2(from, direction, end, skip) };
        }
        self.blocked_by::<Baseline>(from, direction, end, skip)
    }

    /// [`Rays::blocked`] of many segments, in their order; what `blocked` held before goes. `skip`
    /// is told the segment's index, too.
    pub fn blocked_many(
        &self,
        segments: &[Segment],
        skip: impl Fn(usize, u32) -> bool,
        blocked: &mut Vec<bool>,
    ) {
        blocked.clear();
        blocked.extend(segments.iter().enumerate().map(|(index, segment)| {
            self.blocked(segment.from, segment.to, |triangle| skip(index, triangle))
        }));
    }

    /// Whether the ray passes through a hole where it crosses a triangle.
    #[inline(always)]
    fn passes(&self, triangle: u32, crossing: &Crossing, chance: impl FnOnce() -> Chance) -> bool {
        let Some(holes) = &self.holes else { return false };
        holes.are_in(triangle) && holes.pass(triangle, [crossing.u, crossing.v], chance())
    }

    /// Distance beyond everything in the scene from any of its points, ray units: where light from
    /// infinity comes from.
    pub fn beyond(&self) -> f32 {
        (4.0 * self.ball.1) as f32
    }

    /// The place that a hit tells.
    pub fn spot(&self, hit: &Hit) -> Spot {
        if hit.lane == IN_INSTANCE {
            return self.spot_of_instance(hit);
        }
        let (packet, lane) = (self.listed.packet(hit.packet), hit.lane as usize);
        Spot::new(packet.corners(lane), packet.normal(lane), hit.u, hit.v)
    }

    #[inline(never)]
    fn spot_of_instance(&self, hit: &Hit) -> Spot {
        let corners = self.instanced.as_ref().map(|instanced| instanced.corners(hit));
        let corners = corners.unwrap_or_default().map(|corner| self.place(corner));
        Spot::new(corners, unit_normal(corners), hit.u, hit.v)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn closest_avx2(
        &self,
        eye: Eye,
        origin: Vec3,
        direction: Vec3,
        chance: Option<Chance>,
    ) -> Option<Hit> {
        self.closest_by::<boxes::Avx2>(eye, origin, direction, chance)
    }

    #[inline(always)]
    fn closest_by<B: Boxes>(
        &self,
        eye: Eye,
        origin: Vec3,
        direction: Vec3,
        chance: Option<Chance>,
    ) -> Option<Hit> {
        let look = Look::new(origin, direction, 0.0, eye);
        let slabs = Slabs::new(origin, direction);
        let chance = || chance.unwrap_or_else(|| Chance::Ray(look.sheared.key()));
        let found = self.listed.closest::<B>(&look, &slabs, f32::INFINITY, |triangle, crossing| {
            self.passes(triangle, crossing, chance)
        });
        if let Some(instanced) = &self.instanced {
            return self.closest_with_instances::<B>(instanced, (&look, &slabs), found, chance);
        }
        Some(self.hit(found?))
    }

    /// The nearer of what was found of the listed triangles and of what instances have.
    #[inline(always)]
    fn closest_with_instances<B: Boxes>(
        &self,
        instanced: &Instanced,
        (look, slabs): (&Look, &Slabs),
        found: Option<Found>,
        chance: impl Fn() -> Chance + Copy,
    ) -> Option<Hit> {
        let end = found.as_ref().map_or(f32::INFINITY, |found| found.seen_at);
        let passes = |triangle: u32, crossing: &Crossing| self.passes(triangle, crossing, chance);
        let nearer = instanced.closest::<B>(look, slabs, end, passes);
        nearer.or_else(|| found.map(|found| self.hit(found)))
    }

    #[inline(always)]
    fn hit(&self, Found { leaf, lane, crossing, .. }: Found) -> Hit {
        let Crossing { t, u, v, front } = crossing;
        let triangle = self.listed.packet(leaf).triangles[lane as usize];
        Hit { triangle, u, v, distance: t, back: !front, packet: leaf, lane }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn blocked_avx2(
        &self,
        origin: Vec3,
        direction: Vec3,
        end: f32,
        skip: impl Fn(u32) -> bool,
    ) -> bool {
        self.blocked_by::<boxes::Avx2>(origin, direction, end, skip)
    }

    #[inline(always)]
    fn blocked_by<B: Boxes>(
        &self,
        origin: Vec3,
        direction: Vec3,
        end: f32,
        skip: impl Fn(u32) -> bool,
    ) -> bool {
        // The eye makes no difference: backs block, too.
        let look = Look::new(origin, direction, 0.0, Eye::Light);
        let slabs = Slabs::new(origin, direction);
        let passes = |triangle: u32, crossing: &Crossing| {
            skip(triangle) || self.passes(triangle, crossing, || Chance::Ray(look.sheared.key()))
        };
        if self.listed.blocked::<B>(&look, &slabs, end, passes) {
            return true;
        }
        let Some(instanced) = &self.instanced else { return false };
        instanced.blocked::<B>(&look, &slabs, end, passes)
    }
}

#[cfg(test)]
mod tests;
