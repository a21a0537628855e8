//! Meshes that a scene shows many times: each is kept once, as a *shape* in its own space, with the
//! transforms of its *instances*. Triangles and vertices of instances have numbers as if they were
//! listed one instance after another; what a number stands for is found, and placed in the world,
//! when it is asked for.

use super::vertex::{Triangle, Vertex};
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use std::ops::Range;

/// Most triangles of all instances together: codes of a picture's facets have a bit for the side, and
/// one more stays free.
pub const MOST_INSTANCED_TRIANGLES: u64 = 1 << 30;
/// Triangles that take as much memory as an instance does.
pub const INSTANCE_TRIANGLES: u64 = 2;
/// Most vertices of all instances together.
const MOST_INSTANCED_VERTICES: u64 = 1 << 31;

/// Parts of a shape along each axis that have boxes of their own.
const PARTS: usize = 4;

/// A mesh in its own space.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Its vertices; normals are of the mesh's space, too.
    pub vertices: Vec<Vertex>,
    /// Its triangles, which name its own vertices.
    pub triangles: Vec<Triangle>,
    /// Least coordinates of its vertices.
    pub low: Vec3,
    /// Largest coordinates of its vertices.
    pub high: Vec3,
    /// Boxes around its parts, which lie closer about it than one does.
    parts: Vec<(Vec3, Vec3)>,
    /// Number of its first triangle among those of all shapes.
    pub first: u32,
    /// An instance of it.
    pub shown_by: u32,
}

/// A shape in its place.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Which shape.
    pub shape: u32,
    /// Whether the transform turns fronts into backs; then the second and third corner of each
    /// triangle change places, so that fronts are counter-clockwise all the same.
    pub mirrored: bool,
    /// From the shape's space to the world.
    pub to_world: DAffine3,
}

/// A triangle of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstanceTriangle {
    /// Which instance.
    pub instance: u32,
    /// Which triangle of its shape.
    pub local: u32,
}

/// The shapes and instances of a scene.
#[derive(Clone, Debug, Default)]
pub struct Instances {
    shapes: Vec<Shape>,
    all: Vec<Instance>,
    triangles: Numbering,
    vertices: Numbering,
    /// Smallest box around all of them.
    pub(super) bounds: Option<(Vec3, Vec3)>,
}

impl Instance {
    /// A vertex of the shape in the world, by [`Instance::normal_to_world`].
    pub(super) fn place(&self, normal_to_world: &DMat3, vertex: &Vertex) -> Vertex {
        let normal = (*normal_to_world * vertex.normal.as_dvec3()).normalize_or_zero();
        let tangent = match vertex.tangent == Vec4::ZERO {
            true => Vec4::ZERO,
            false => self.tangent(normal, vertex.tangent),
        };
        Vertex {
            position: self.point(vertex.position),
            normal: normal.as_vec3(),
            tangent,
            ..*vertex
        }
    }

    /// A tangent in the world, perpendicular to the normal there, against which uneven scales tilt it.
    fn tangent(&self, normal: DVec3, tangent: Vec4) -> Vec4 {
        let along = self.to_world.matrix3 * tangent.truncate().as_dvec3();
        let along = (along - normal * normal.dot(along)).normalize_or_zero();
        let sign = if self.mirrored { -tangent.w } else { tangent.w };
        if along == DVec3::ZERO { Vec4::ZERO } else { along.as_vec3().extend(sign) }
    }

    /// A point of the shape's space in the world.
    #[inline]
    pub fn point(&self, point: Vec3) -> Vec3 {
        self.to_world.transform_point3(point.as_dvec3()).as_vec3()
    }

    /// What takes normals to the world, but for their length: the matrix of cofactors, which is the
    /// inverse transpose times the determinant.
    pub fn normal_to_world(&self) -> DMat3 {
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = self.to_world.matrix3;
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        if self.mirrored { -cofactors } else { cofactors }
    }

    /// The corners of a triangle of the shape, counter-clockwise in the world.
    #[inline]
    fn wound(&self, [a, b, c]: [u32; 3]) -> [u32; 3] {
        if self.mirrored { [a, c, b] } else { [a, b, c] }
    }

    /// A box in the world around its shape.
    pub fn box_around(&self, shape: &Shape) -> (Vec3, Vec3) {
        let parts = shape.parts.iter().map(|(low, high)| self.box_of(*low, *high));
        parts.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// A box in the world around one of the shape's space.
    fn box_of(&self, low: Vec3, high: Vec3) -> (Vec3, Vec3) {
        let (low, high) = (low.as_dvec3(), high.as_dvec3());
        let middle = self.to_world.transform_point3(0.5 * (low + high));
        let DMat3 { x_axis, y_axis, z_axis } = self.to_world.matrix3;
        let half = 0.5 * (high - low);
        let half = x_axis.abs() * half.x + y_axis.abs() * half.y + z_axis.abs() * half.z;
        ((middle - half).as_vec3(), (middle + half).as_vec3())
    }

    /// Square metres of a square unit of the shape's space, on average over its directions.
    pub fn area_scale(&self) -> f64 {
        self.to_world.matrix3.determinant().abs().cbrt().powi(2)
    }
}

impl Shape {
    /// Areas of its triangles, in its own space.
    pub fn triangle_areas(&self) -> impl Iterator<Item = f64> + '_ {
        self.triangles.iter().map(|triangle| {
            let corners = triangle.vertices.map(|vertex| self.vertices[vertex as usize].position);
            let [a, b, c] = corners.map(Vec3::as_dvec3);
            0.5 * (b - a).cross(c - a).length()
        })
    }
}

impl Instances {
    /// Bytes of shapes and transforms.
    pub fn held_bytes(&self) -> u64 {
        let of_shape =
            |shape: &Shape| size_of_val(&*shape.vertices) + size_of_val(&*shape.triangles);
        let shapes = self.shapes.iter().map(of_shape).sum::<usize>();
        (shapes + size_of_val(&*self.all)) as u64
    }

    /// Adds a shape of at least one triangle, which use all of the vertices and no others. Returns its
    /// number.
    pub fn add_shape(&mut self, vertices: Vec<Vertex>, triangles: Vec<Triangle>) -> u32 {
        let low = vertices.iter().map(|v| v.position).fold(Vec3::INFINITY, Vec3::min);
        let high = vertices.iter().map(|v| v.position).fold(Vec3::NEG_INFINITY, Vec3::max);
        let first = self.shapes.last().map_or(0, |last| last.first + last.triangles.len() as u32);
        let parts = parts(&vertices, &triangles, (low, high));
        let shown_by = u32::MAX;
        self.shapes.push(Shape { vertices, triangles, low, high, parts, first, shown_by });
        self.shapes.len() as u32 - 1
    }

    /// Adds an instance; `false` where there would be too many triangles or vertices.
    pub fn add(&mut self, shape: u32, to_world: DAffine3) -> bool {
        let number = self.all.len() as u32;
        let own = &mut self.shapes[shape as usize];
        let triangles = u64::from(self.triangles.end()) + own.triangles.len() as u64;
        let vertices = u64::from(self.vertices.end()) + own.vertices.len() as u64;
        if triangles > MOST_INSTANCED_TRIANGLES || vertices > MOST_INSTANCED_VERTICES {
            return false;
        }
        own.shown_by = own.shown_by.min(number);
        self.triangles.first.push(triangles as u32);
        self.vertices.first.push(vertices as u32);
        let mirrored = to_world.matrix3.determinant() < 0.0;
        self.all.push(Instance { shape, mirrored, to_world });
        true
    }

    /// Makes what was added fast to find; to be called when all has been added.
    pub fn finish(&mut self) {
        self.triangles.finish();
        self.vertices.finish();
        self.bounds = self.find_bounds();
    }

    /// The smallest box around all instances: exactly of those that reach out of the others' box.
    fn find_bounds(&self) -> Option<(Vec3, Vec3)> {
        let loose = |instance: &Instance| {
            let shape = &self.shapes[instance.shape as usize];
            instance.box_around(shape)
        };
        let all = self.all.iter().map(loose).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let middle = 0.5 * (all.0 + all.1);
        // Those that reach farthest come first, so that few of the others are looked at closely.
        let mut order: Vec<(f32, &Instance)> = self
            .all
            .iter()
            .map(|instance| {
                let (low, high) = loose(instance);
                ((low - middle).abs().max((high - middle).abs()).max_element(), instance)
            })
            .collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (_, instance) in order {
            let (low, high) = loose(instance);
            if low.cmpge(bounds.0).all() && high.cmple(bounds.1).all() {
                continue;
            }
            for vertex in &self.shapes[instance.shape as usize].vertices {
                let at = instance.point(vertex.position);
                bounds = (bounds.0.min(at), bounds.1.max(at));
            }
        }
        Some(bounds)
    }

    /// Moves some instances.
    pub(super) fn shift(&mut self, moves: &[(u32, Vec3)]) {
        for (instance, by) in moves {
            self.all[*instance as usize].to_world.translation += by.as_dvec3();
        }
        self.bounds = self.find_bounds();
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// All shapes.
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// All instances.
    pub fn all(&self) -> &[Instance] {
        &self.all
    }

    /// The shape of an instance.
    pub fn shape_of(&self, instance: &Instance) -> &Shape {
        &self.shapes[instance.shape as usize]
    }

    /// Number of triangles of all instances.
    pub fn triangle_count(&self) -> usize {
        self.triangles.end() as usize
    }

    /// Number of vertices of all instances.
    pub fn vertex_count(&self) -> usize {
        self.vertices.end() as usize
    }

    /// Number of triangles of all shapes.
    pub fn unique_count(&self) -> usize {
        self.shapes.iter().map(|shape| shape.triangles.len()).sum()
    }

    /// The numbers of an instance's triangles, the first one of all being 0.
    pub fn triangles_of(&self, instance: u32) -> Range<u32> {
        self.triangles.range(instance)
    }

    /// Which triangle of which instance has a number.
    #[inline]
    pub fn find(&self, number: u32) -> InstanceTriangle {
        let instance = self.triangles.find(number);
        InstanceTriangle { instance, local: number - self.triangles.first[instance as usize] }
    }

    /// The triangle of a number; the first vertex of all is `first_vertex`.
    pub(super) fn triangle(&self, number: u32, first_vertex: u32) -> Triangle {
        let InstanceTriangle { instance, local } = self.find(number);
        let own = &self.all[instance as usize];
        let Triangle { vertices, material } = self.shape_of(own).triangles[local as usize];
        let first = first_vertex + self.vertices.first[instance as usize];
        Triangle { vertices: own.wound(vertices).map(|vertex| first + vertex), material }
    }

    /// The instance that the vertex of a number belongs to, and its vertices' first number.
    #[inline]
    pub(super) fn of_vertex(&self, number: u32) -> (&Instance, u32) {
        let instance = self.vertices.find(number);
        (&self.all[instance as usize], self.vertices.first[instance as usize])
    }

    /// World positions of the corners of a triangle of an instance.
    pub fn corners(&self, InstanceTriangle { instance, local }: InstanceTriangle) -> [Vec3; 3] {
        let own = &self.all[instance as usize];
        let shape = self.shape_of(own);
        let corners = own.wound(shape.triangles[local as usize].vertices);
        corners.map(|vertex| own.point(shape.vertices[vertex as usize].position))
    }
}

/// Boxes around the triangles of a shape that lie in the same of [`PARTS`] cells along each axis of its
/// own box.
fn parts(
    vertices: &[Vertex],
    triangles: &[Triangle],
    (low, high): (Vec3, Vec3),
) -> Vec<(Vec3, Vec3)> {
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut parts = vec![none; PARTS * PARTS * PARTS];
    let per_metre = (high - low).map(|size| if size > 0.0 { PARTS as f32 / size } else { 0.0 });
    for triangle in triangles {
        let [a, b, c] = triangle.vertices.map(|vertex| vertices[vertex as usize].position);
        let cell = ((a + b + c) / 3.0 - low) * per_metre;
        let [x, y, z] = cell.to_array().map(|at| (at.max(0.0) as usize).min(PARTS - 1));
        let part = &mut parts[(x * PARTS + y) * PARTS + z];
        *part = (part.0.min(a.min(b).min(c)), part.1.max(a.max(b).max(c)));
    }
    parts.retain(|part| *part != none);
    parts
}

/// Which of many ranges of numbers, one after another, a number is in.
#[derive(Clone, Debug)]
struct Numbering {
    /// Where each range begins, and where the last one ends.
    first: Vec<u32>,
    /// By the number without its lowest bits, the range of the first such number.
    hints: Vec<u32>,
    /// How many bits that leaves out.
    shift: u32,
}

impl Default for Numbering {
    fn default() -> Self {
        Self { first: vec![0], hints: Vec::new(), shift: 0 }
    }
}

impl Numbering {
    fn end(&self) -> u32 {
        self.first[self.first.len() - 1]
    }

    fn range(&self, index: u32) -> Range<u32> {
        self.first[index as usize]..self.first[index as usize + 1]
    }

    /// Makes about as many hints as there are ranges.
    fn finish(&mut self) {
        let ranges = self.first.len() as u32;
        self.shift = (self.end() / ranges).max(1).ilog2();
        let last = self.end() >> self.shift;
        let of = |bits: u32| self.first.partition_point(|first| *first <= bits << self.shift) - 1;
        self.hints = (0..=last).map(|bits| of(bits) as u32).collect();
        self.hints.push(ranges - 1);
    }

    #[inline]
    fn find(&self, number: u32) -> u32 {
        let bits = (number >> self.shift) as usize;
        let (from, to) = (self.hints[bits], self.hints[bits + 1]);
        let some = &self.first[from as usize + 1..=to as usize];
        // Mostly there is one range or two.
        from + some.partition_point(|first| *first <= number) as u32
    }
}

#[cfg(test)]
mod tests;
