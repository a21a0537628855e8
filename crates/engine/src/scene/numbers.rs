//! Triangles and vertices by their numbers: those that a scene lists, and those of instances, which are
//! placed in the world when they are asked for.

use super::instances::{INSTANCE_TRIANGLES, Instance, InstanceTriangle, Shape};
use super::{Material, Scene, Triangle, Vertex};
use glam::Vec3;
use std::ops::Range;

impl Scene {
    /// Number of triangles, with those of all instances.
    #[inline]
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() + self.instances.triangle_count()
    }

    /// Number of vertices, with those of all instances.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len() + self.instances.vertex_count()
    }

    /// A triangle by its number: those that are listed come first, then those of instances.
    #[inline]
    pub fn triangle(&self, index: u32) -> Triangle {
        match self.triangles.get(index as usize) {
            Some(triangle) => *triangle,
            None => {
                let number = index - self.triangles.len() as u32;
                self.instances.triangle(number, self.vertices.len() as u32)
            }
        }
    }

    /// Material of a triangle by its number.
    #[inline]
    pub fn material_of(&self, triangle: u32) -> &Material {
        &self.materials[self.triangle(triangle).material as usize]
    }

    /// Which instance a triangle belongs to; `None` of one that is listed.
    #[inline]
    pub fn instance_of(&self, triangle: u32) -> Option<InstanceTriangle> {
        let number = triangle.checked_sub(self.triangles.len() as u32)?;
        Some(self.instances.find(number))
    }

    /// A vertex by its number, in the world.
    pub fn vertex(&self, index: u32) -> Vertex {
        match self.vertices.get(index as usize) {
            Some(vertex) => *vertex,
            None => {
                let number = index - self.vertices.len() as u32;
                let (instance, first) = self.instances.of_vertex(number);
                let vertices = &self.instances.shape_of(instance).vertices;
                instance.place(&instance.normal_to_world(), &vertices[(number - first) as usize])
            }
        }
    }

    /// Something of each corner of a triangle, in the world.
    #[inline]
    pub fn of_corners<T>(&self, triangle: &Triangle, of: impl Fn(&Vertex) -> T) -> [T; 3] {
        if (triangle.vertices[0] as usize) < self.vertices.len() {
            return triangle.vertices.map(|index| of(&self.vertices[index as usize]));
        }
        self.placed_corners(triangle).each_ref().map(of)
    }

    /// Something of each corner of a triangle that transforms do not change, such as its colour.
    #[inline]
    pub fn of_sources<T>(&self, triangle: &Triangle, of: impl Fn(&Vertex) -> T) -> [T; 3] {
        if (triangle.vertices[0] as usize) < self.vertices.len() {
            return triangle.vertices.map(|index| of(&self.vertices[index as usize]));
        }
        let (_, sources) = self.source_corners(triangle);
        sources.map(of)
    }

    /// World positions of a triangle's corners.
    #[inline]
    pub fn corners(&self, triangle: &Triangle) -> [Vec3; 3] {
        if (triangle.vertices[0] as usize) < self.vertices.len() {
            return triangle.vertices.map(|index| self.vertices[index as usize].position);
        }
        let (instance, sources) = self.source_corners(triangle);
        sources.map(|vertex| instance.point(vertex.position))
    }

    #[inline(never)]
    fn placed_corners(&self, triangle: &Triangle) -> [Vertex; 3] {
        let (instance, sources) = self.source_corners(triangle);
        let normal_to_world = instance.normal_to_world();
        sources.map(|vertex| instance.place(&normal_to_world, vertex))
    }

    /// The instance of a triangle that is of one, and its corners in the shape's space.
    #[inline(never)]
    fn source_corners(&self, triangle: &Triangle) -> (&Instance, [&Vertex; 3]) {
        let numbers = triangle.vertices.map(|index| index - self.vertices.len() as u32);
        let (instance, first) = self.instances.of_vertex(numbers[0]);
        let vertices = &self.instances.shape_of(instance).vertices;
        (instance, numbers.map(|number| &vertices[(number - first) as usize]))
    }

    /// As many triangles as the scene takes the memory of: those that are kept, [`INSTANCE_TRIANGLES`]
    /// for each instance, and those of instances that emit, which are lights one by one.
    pub fn kept_triangles(&self) -> u64 {
        let instances = self.instances.all().len() as u64 * INSTANCE_TRIANGLES;
        let emits = |own: &&Triangle| self.materials[own.material as usize].emits();
        let emitting = self.emissive_triangles() - self.triangles.iter().filter(emits).count();
        self.unique_count() as u64 + instances + emitting as u64
    }

    /// Number of triangles that are kept: those of each shape once.
    pub fn unique_count(&self) -> usize {
        self.triangles.len() + self.instances.unique_count()
    }

    /// A triangle's number among those that are kept.
    #[inline]
    pub fn unique(&self, triangle: u32) -> usize {
        match self.instance_of(triangle) {
            None => triangle as usize,
            Some(InstanceTriangle { instance, local }) => {
                let own = &self.instances.all()[instance as usize];
                self.triangles.len() + (self.instances.shape_of(own).first + local) as usize
            }
        }
    }

    /// Each triangle that is kept once, by the number of one that shows it; in order.
    pub fn unique_triangles(&self) -> impl Iterator<Item = u32> {
        let listed = self.triangles.len() as u32;
        let shapes = self.instances.shapes().iter().filter(|shape| shape.shown_by != u32::MAX);
        let of_shape = move |shape: &Shape| {
            let Range { start, end } = self.instances.triangles_of(shape.shown_by);
            start + listed..end + listed
        };
        (0..listed).chain(shapes.flat_map(of_shape))
    }

    /// The triangles whose material is as asked, in order. Instances of shapes that have none cost
    /// next to nothing.
    pub fn triangles_of<'a>(
        &'a self,
        is_asked: impl Fn(&Material) -> bool + 'a,
    ) -> impl Iterator<Item = u32> + 'a {
        let asked: Vec<bool> = self.materials.iter().map(&is_asked).collect();
        let of_shape = |shape: &Shape| -> Vec<u32> {
            let all = (0u32..).zip(&shape.triangles);
            all.filter(|(_, own)| asked[own.material as usize]).map(|(local, _)| local).collect()
        };
        let of_shapes: Vec<Vec<u32>> = self.instances.shapes().iter().map(of_shape).collect();
        let listed: Vec<u32> = (0u32..)
            .zip(&self.triangles)
            .filter(|(_, triangle)| asked[triangle.material as usize])
            .map(|(index, _)| index)
            .collect();
        let count = self.triangles.len() as u32;
        let mut next = (0, 0);
        let of_instances = std::iter::from_fn(move || {
            loop {
                let instance = self.instances.all().get(next.0)?;
                let locals = &of_shapes[instance.shape as usize];
                if let Some(local) = locals.get(next.1) {
                    next.1 += 1;
                    return Some(count + self.instances.triangles_of(next.0 as u32).start + local);
                }
                next = (next.0 + 1, 0);
            }
        });
        listed.into_iter().chain(of_instances)
    }

    /// By material, whether any triangle has it.
    pub fn used_materials(&self) -> Vec<bool> {
        let mut used = vec![false; self.materials.len()];
        let shapes = self.instances.shapes().iter().filter(|shape| shape.shown_by != u32::MAX);
        let triangles = self.triangles.iter().chain(shapes.flat_map(|shape| &shape.triangles));
        triangles.for_each(|triangle| used[triangle.material as usize] = true);
        used
    }

    /// Number of triangles, with those of all instances, whose material is as asked.
    pub fn count_of(&self, is_asked: impl Fn(&Material) -> bool) -> usize {
        let asked = |triangle: &&Triangle| is_asked(&self.materials[triangle.material as usize]);
        let of_shape = |shape: &Shape| shape.triangles.iter().filter(asked).count();
        let of_shapes: Vec<usize> = self.instances.shapes().iter().map(of_shape).collect();
        let of_instances = self.instances.all().iter().map(|one| of_shapes[one.shape as usize]);
        self.triangles.iter().filter(asked).count() + of_instances.sum::<usize>()
    }

    /// The same with every triangle listed and no instances, numbers being the same.
    pub fn flattened(&self) -> Scene {
        let listed = self.triangles.len() as u32;
        let mut flat = Scene { instances: Default::default(), ..self.clone() };
        for instance in self.instances.all() {
            let vertices = &self.instances.shape_of(instance).vertices;
            let normal_to_world = instance.normal_to_world();
            flat.vertices.extend(vertices.iter().map(|own| instance.place(&normal_to_world, own)));
        }
        flat.triangles.extend((listed..self.triangle_count() as u32).map(|t| self.triangle(t)));
        flat
    }

    /// The middle of each instance's box and its area in square metres, which uneven scales make
    /// inexact; a triangle counts as often as is said of its material.
    pub fn instance_areas(
        &self,
        times: impl Fn(&Material) -> f64,
    ) -> impl Iterator<Item = (Vec3, f64)> + '_ {
        let area_of = |shape: &Shape| -> f64 {
            let times = |own: &Triangle| times(&self.materials[own.material as usize]);
            shape
                .triangles
                .iter()
                .zip(shape.triangle_areas())
                .map(|(own, area)| times(own) * area)
                .sum()
        };
        let areas: Vec<f64> = self.instances.shapes().iter().map(area_of).collect();
        self.instances.all().iter().map(move |instance| {
            let shape = self.instances.shape_of(instance);
            let middle = instance.point(0.5 * (shape.low + shape.high));
            (middle, areas[instance.shape as usize] * instance.area_scale())
        })
    }

    /// Smallest box around all instances.
    pub(super) fn instance_bounds(&self) -> Option<(Vec3, Vec3)> {
        self.instances.bounds
    }
}
