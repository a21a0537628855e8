//! Two levels: a tree over the boxes of instances, and below it one tree for each shape, which all its
//! instances share. A ray goes into a shape's own space, in which the shape is about 2²⁰ across like a
//! scene, so that what rounding does there is a share of the shape's size. Its distances stay those of
//! the world, since its direction is transformed with it and keeps its changed length.

use super::boxes::{Boxes, Slabs};
use super::hierarchy::{Boxed, Hierarchy};
use super::hit::{Hit, IN_INSTANCE};
use super::tree::{Look, Tree};
use super::triangle::Crossing;
use super::units::{BOX_MARGIN, SIZE};
use crate::scene::Scene;
use crate::scene::instances::{Instance, InstanceTriangle, Instances, Shape};
use glam::{DAffine3, DVec3, Vec3, Vec3A};
use rayon::prelude::*;
use std::sync::Arc;

/// A ray begins so far before the box of a shape as this share of its own size, if it comes from
/// farther away: numbers are small there, and rounding matters little.
const BEFORE: f64 = 0.0625;

/// Instances for rays.
pub struct Instanced {
    source: Arc<Instances>,
    /// Number of the first of their triangles in the scene.
    first: u32,
    top: Hierarchy,
    /// The instance of each leaf of the tree.
    of_leaf: Vec<u32>,
    shapes: Vec<ShapeTree>,
    /// By instance.
    placed: Vec<PlacedShape>,
}

/// A shape for rays.
struct ShapeTree {
    tree: Tree,
    /// Half the size of its box about the origin, in its ray units.
    half: DVec3,
    /// Its space to its ray units.
    center: DVec3,
    scale: f64,
}

/// Where a shape is.
struct PlacedShape {
    shape: u32,
    mirrored: bool,
    /// Number of its first triangle in the scene.
    first: u32,
    /// From the world's ray units to the shape's.
    to_shape: DAffine3,
}

/// A ray in a shape's space.
struct Inside<'a> {
    tree: &'a Tree,
    look: Look,
    slabs: Slabs,
}

impl Instanced {
    /// Bytes that its trees take.
    pub fn held_bytes(&self) -> u64 {
        let shapes = self.shapes.iter().map(|shape| shape.tree.held_bytes()).sum::<u64>();
        let lists = size_of_val(&*self.of_leaf) + size_of_val(&*self.placed);
        shapes + self.top.held_bytes() + lists as u64
    }

    /// Prepares a scene's instances; `None` without any. Ray units of the world are metres from the
    /// center times the scale.
    pub fn new(scene: &Scene, (center, scale): (DVec3, f64), margin: Vec3A) -> Option<Self> {
        let source = scene.instances.clone();
        if source.is_empty() {
            return None;
        }
        let first = scene.triangles.len() as u32;
        let shapes: Vec<ShapeTree> =
            source.shapes().par_iter().map(|shape| ShapeTree::new(scene, shape)).collect();
        let to_world = DAffine3::from_scale(DVec3::splat(scale.recip()));
        let to_world = DAffine3::from_translation(center) * to_world;
        let placed = |(instance, own): (usize, &Instance)| {
            let shape = &shapes[own.shape as usize];
            let to_ray_units = DAffine3::from_scale(DVec3::splat(shape.scale))
                * DAffine3::from_translation(-shape.center);
            PlacedShape {
                shape: own.shape,
                mirrored: own.mirrored,
                first: first + source.triangles_of(instance as u32).start,
                to_shape: to_ray_units * own.to_world.inverse() * to_world,
            }
        };
        let placed = source.all().iter().enumerate().map(placed).collect();
        let boxed = |(index, own): (usize, &Instance)| {
            let shape = source.shape_of(own);
            let (low, high) = own.box_around(shape);
            let place = |at: Vec3| Vec3A::from(((at.as_dvec3() - center) * scale).as_vec3());
            Boxed { low: place(low) - margin, high: place(high) + margin, index: index as u32 }
        };
        let mut boxes: Vec<Boxed> = source.all().iter().enumerate().map(boxed).collect();
        let top = Hierarchy::new(&mut boxes, 1);
        let of_leaf = top.leaves().iter().map(|run| boxes[run.start as usize].index).collect();
        Some(Self { source, first, top, of_leaf, shapes, placed })
    }

    /// What a ray of the world meets first before `end`, but for what it `passes`.
    #[inline(always)]
    pub fn closest<B: Boxes>(
        &self,
        look: &Look,
        slabs: &Slabs,
        end: f32,
        passes: impl Fn(u32, &Crossing) -> bool,
    ) -> Option<Hit> {
        let mut best = None;
        self.top.walk::<true, B>(slabs, end, |leaf, end| {
            let instance = self.of_leaf[leaf];
            let placed = &self.placed[instance as usize];
            let Some(inside) = self.enter(placed, look) else { return false };
            let Inside { tree, look, slabs } = &inside;
            let found = tree.closest::<B>(look, slabs, *end, |local, crossing| {
                passes(placed.first + local, &placed.turned(*crossing))
            });
            if let Some(found) = found {
                *end = found.seen_at;
                let Crossing { t, u, v, front } = placed.turned(found.crossing);
                let local = tree.packet(found.leaf).triangles[found.lane as usize];
                let (triangle, distance) = (placed.first + local, t + look.offset);
                let (packet, lane) = (instance, IN_INSTANCE);
                best = Some(Hit { triangle, u, v, distance, back: !front, packet, lane });
            }
            false
        });
        best
    }

    /// Whether a ray of the world meets anything before `end`, but for what it `passes`.
    #[inline(always)]
    pub fn blocked<B: Boxes>(
        &self,
        look: &Look,
        slabs: &Slabs,
        end: f32,
        passes: impl Fn(u32, &Crossing) -> bool,
    ) -> bool {
        self.top.walk::<false, B>(slabs, end, |leaf, _| {
            let placed = &self.placed[self.of_leaf[leaf] as usize];
            let Some(inside) = self.enter(placed, look) else { return false };
            inside.tree.blocked::<B>(&inside.look, &inside.slabs, end, |local, crossing| {
                passes(placed.first + local, &placed.turned(*crossing))
            })
        })
    }

    /// A ray of the world in the space of an instance's shape; `None` where it passes its box.
    #[inline]
    fn enter(&self, placed: &PlacedShape, look: &Look) -> Option<Inside<'_>> {
        let shape = &self.shapes[placed.shape as usize];
        let origin = placed.to_shape.transform_point3(look.origin.as_dvec3());
        let direction = placed.to_shape.transform_vector3(look.direction.as_dvec3());
        // Where it is inside the box: a division by zero gives infinities of the right signs, or
        // what is not a number and taken for no bound.
        let inverse = direction.recip();
        let (low, high) = ((-shape.half - origin) * inverse, (shape.half - origin) * inverse);
        let (enter, leave) = (low.min(high), low.max(high));
        let enter = f64::NEG_INFINITY.max(enter.x).max(enter.y).max(enter.z);
        let leave = f64::INFINITY.min(leave.x).min(leave.y).min(leave.z);
        if enter > leave || leave < 0.0 {
            return None;
        }
        let offset = (enter - BEFORE * SIZE / direction.length()).max(0.0) as f32;
        let origin = (origin + direction * f64::from(offset)).as_vec3();
        let direction = direction.as_vec3();
        let look = Look::new(origin, direction, offset, look.eye);
        Some(Inside { tree: &shape.tree, look, slabs: Slabs::new(origin, direction) })
    }

    /// World positions of the corners of the triangle of a hit.
    pub fn corners(&self, hit: &Hit) -> [Vec3; 3] {
        let first = self.first + self.source.triangles_of(hit.packet).start;
        let local = hit.triangle - first;
        self.source.corners(InstanceTriangle { instance: hit.packet, local })
    }
}

impl PlacedShape {
    /// A crossing as the triangle is in the world: its second and third corner change places where
    /// fronts become backs otherwise.
    #[inline(always)]
    fn turned(&self, crossing: Crossing) -> Crossing {
        let Crossing { t, u, v, front } = crossing;
        if self.mirrored { Crossing { t, u: v, v: u, front } } else { crossing }
    }
}

impl ShapeTree {
    fn new(scene: &Scene, shape: &Shape) -> Self {
        let (low, high) = (shape.low.as_dvec3(), shape.high.as_dvec3());
        let center = 0.5 * (low + high);
        let extent = (high - low).max_element().max(f64::from(f32::MIN_POSITIVE));
        let scale = (SIZE / extent).log2().floor().exp2();
        let margin = Vec3A::splat(SIZE as f32 * BOX_MARGIN);
        let corners = |index: u32| {
            let vertices = shape.triangles[index as usize].vertices;
            vertices.map(|vertex| {
                let position = shape.vertices[vertex as usize].position.as_dvec3();
                ((position - center) * scale).as_vec3()
            })
        };
        let boxed = |index: u32| {
            let [a, b, c] = corners(index);
            let has_area = (b - a).cross(c - a).length_squared() > 0.0;
            let low = Vec3A::from(a.min(b).min(c)) - margin;
            let high = Vec3A::from(a.max(b).max(c)) + margin;
            has_area.then_some(Boxed { low, high, index })
        };
        let boxes: Vec<Boxed> = (0..shape.triangles.len() as u32).filter_map(boxed).collect();
        let two_sided = |index: u32| {
            let material = shape.triangles[index as usize].material;
            scene.materials[material as usize].is_there_from_behind()
        };
        let tree = Tree::new(boxes, corners, two_sided);
        // A little larger, so that nothing that is flat is passed by.
        let half = 0.5 * (high - low) * scale + DVec3::splat(2.0 * f64::from(margin.x));
        Self { tree, half, center, scale }
    }
}
