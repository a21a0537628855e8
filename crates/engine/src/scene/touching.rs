//! Clear surfaces that lie on others. Glass stands on a table: its bottom and the table's top are in one
//! plane. A ray that has passed the one starts a rounding error behind it, beyond the other, and gets
//! into the table; one that leaves the table starts inside the glass without having entered it. So such
//! surfaces are parted by a little more than the rounding errors of rays: glass is that much smaller, and
//! has air around it.

use super::Scene;
use super::nearby::pairs_nearby;
use foldhash::HashMap;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Rounding errors of rays, over coordinates and over the sizes of triangles, and what places themselves
/// are rounded by.
const RAY_ERROR: f32 = 1.0 / 1_048_576.0;
const PLACE_ERROR: f32 = 1.0 / 8_388_608.0;
/// Rounding errors that surfaces which touch may be apart, and twice as many that they are parted by. Of
/// what is nearer than two, rays cannot be certain that it is before them.
const ERRORS: f32 = 4.0;
/// Coordinates, in extents of the scene, beyond which rays move it to their origin.
const FAR: f32 = 5.0;
/// Most sine of the angle between surfaces in one plane, squared.
const MOST_LEAN: f32 = 1e-6;
/// Least overlap, over the root of the smaller triangle's area: neighbours in a plane share an edge.
const LEAST_OVERLAP: f32 = 1e-3;
/// Triangles that are looked at together.
const CHUNK: usize = 1 << 18;
/// Most clear triangles that are parted, and most of instances that they are parted from, so that crowds do
/// not hold an import up: what is beyond stays as it is.
const MOST_CLEAR: usize = 1 << 21;
const MOST_INSTANCED: usize = 1 << 22;
/// Directions along which a corner is parted, at most; those that are alike count once.
const MOST_WAYS: usize = 3;
/// Cosine from which two directions are alike.
const ALIKE: f32 = 0.9;

/// A triangle that may touch another.
struct Face {
    /// Its number.
    triangle: u32,
    corners: [Vec3; 3],
    /// Unit normal of the front.
    normal: Vec3,
    /// Whether light gets through it into a body.
    is_solid: bool,
    is_clear: bool,
    area: f32,
    /// Length of its longest edge.
    size: f32,
    /// Largest coordinate of its corners.
    farthest: f32,
}

impl Face {
    fn low(&self) -> Vec3 {
        let [a, b, c] = self.corners;
        a.min(b).min(c)
    }

    fn high(&self) -> Vec3 {
        let [a, b, c] = self.corners;
        a.max(b).max(c)
    }

    /// Rounding error of rays between it and another face, in a scene of that extent.
    fn error(&self, other: &Self, extent: f32) -> f32 {
        let farthest = self.farthest.max(other.farthest);
        let size = farthest.min(FAR * extent).max(self.size).max(other.size);
        size * RAY_ERROR + farthest * PLACE_ERROR
    }

    /// Whether it goes along when what has that corner is parted that way: it is the face that lies on
    /// something, or belongs to a body that reaches out that way. A body that lies on another has corners
    /// in the same places, but goes the other way.
    fn follows(&self, corner: Vec3, way: Vec3) -> bool {
        let way = way.normalize_or_zero();
        let reaches = self.corners.iter().map(|at| (*at - corner).dot(way)).sum::<f32>();
        if reaches.abs() > LEAST_OVERLAP * self.area.sqrt() {
            return reaches > 0.0;
        }
        !self.is_solid || self.normal.dot(way) < 0.0
    }
}

impl Scene {
    /// Parts clear surfaces from what they lie on.
    pub fn part_touching(&mut self) {
        let clear = self.triangles_of(|material| material.clear_share() > 0.0).take(MOST_CLEAR);
        let clear: Vec<Face> = clear.map(|index| self.face(index)).collect();
        if clear.is_empty() {
            return;
        }
        let mut ways = Ways::default();
        for (face, found) in clear.iter().zip(self.contacts(&clear)) {
            found.ways(face).for_each(|way| ways.add(self, face, way));
        }
        ways.part(self, &clear);
    }

    fn face(&self, index: u32) -> Face {
        let corners @ [a, b, c] = self.corners(&self.triangle(index));
        let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
        let material = self.material_of(index);
        let is_clear = material.clear_share() > 0.0;
        Face {
            triangle: index,
            corners,
            normal: across.normalize_or_zero().as_vec3(),
            is_solid: is_clear && material.volume.is_some(),
            is_clear,
            area: 0.5 * across.length() as f32,
            size: (b - a).length().max((c - b).length()).max((a - c).length()),
            farthest: a.abs().max(b.abs()).max(c.abs()).max_element(),
        }
    }

    /// What each clear face lies on.
    fn contacts(&self, clear: &[Face]) -> Vec<Contact> {
        let extent = self.extent();
        // Of triangles as large as the scene.
        let reach = |face: &Face| ERRORS * (extent * RAY_ERROR + face.error(face, extent));
        let first: Vec<_> = clear.iter().map(|face| (face.corners, reach(face))).collect();
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (corners, reach) in &first {
            low = corners.iter().fold(low, |low, at| low.min(*at - *reach));
            high = corners.iter().fold(high, |high, at| high.max(*at + *reach));
        }
        let is_near = |a: Vec3, b: Vec3| a.cmple(high).all() && b.cmpge(low).all();
        let mut others = self.listed_and_instanced(is_near);
        let contacts: Vec<Contact> = clear.iter().map(|_| Contact::default()).collect();
        loop {
            let chunk: Vec<u32> = others.by_ref().take(CHUNK).collect();
            if chunk.is_empty() {
                return contacts;
            }
            let faces = chunk.into_par_iter().with_min_len(4096).map(|index| self.face(index));
            let faces: Vec<Face> = faces.filter(|face| is_near(face.low(), face.high())).collect();
            let second: Vec<_> = faces.iter().map(|face| face.corners).collect();
            // No list of pairs: of what lies in one plane many times there are too many.
            pairs_nearby(&first, &second, &|i, j| {
                let (face, other) = (&clear[i as usize], &faces[j as usize]);
                if touch(face, other, extent) {
                    contacts[i as usize].note(face, other, extent);
                }
                false
            });
        }
    }

    /// Triangles that are listed, and those of instances whose boxes are near.
    fn listed_and_instanced(
        &self,
        is_near: impl Fn(Vec3, Vec3) -> bool,
    ) -> impl Iterator<Item = u32> {
        let listed = self.triangles.len() as u32;
        let near = (0u32..).zip(self.instances.all()).filter(move |(_, instance)| {
            let (low, high) = instance.box_around(self.instances.shape_of(instance));
            is_near(low, high)
        });
        let of_instances = near.flat_map(|(number, _)| self.instances.triangles_of(number));
        (0..listed).chain(of_instances.take(MOST_INSTANCED).map(move |number| listed + number))
    }

    fn extent(&self) -> f32 {
        self.bounds().map_or(1.0, |(low, high)| (high - low).max_element())
    }
}

/// Whether a clear face lies on another one: on what is opaque, or a body on another body.
fn touch(face: &Face, other: &Face, extent: f32) -> bool {
    if face.triangle == other.triangle {
        return false;
    }
    let cosine = face.normal.dot(other.normal);
    let is_wanted = !other.is_clear || (face.is_solid && other.is_solid && cosine < 0.0);
    // Neither is true of triangles without area, which have no normal.
    if !is_wanted || face.normal.cross(other.normal).length_squared() > MOST_LEAN || cosine == 0.0 {
        return false;
    }
    let (large, small) = if face.area > other.area { (face, other) } else { (other, face) };
    let reach = ERRORS * face.error(other, extent);
    let is_in_plane = |at: &Vec3| {
        let off = large.normal.dot(*at - large.corners[0]).abs();
        off <= reach
    };
    small.corners.iter().all(is_in_plane) && overlap(large, small)
}

/// Whether two triangles in a plane overlap, by separating lines along their edges.
fn overlap(large: &Face, small: &Face) -> bool {
    let (across, up) = large.normal.any_orthonormal_pair();
    let origin = small.corners[0];
    let flat = |at: Vec3| Vec2::new((at - origin).dot(across), (at - origin).dot(up));
    let [one, other] = [large, small].map(|face| face.corners.map(flat));
    let least = LEAST_OVERLAP * small.area.sqrt();
    let is_apart = |[a, b]: [Vec2; 2]| {
        let axis = (b - a).perp().normalize_or_zero();
        let [(low, high), (other_low, other_high)] = [one, other].map(|corners| {
            let [a, b, c] = corners.map(|at| at.dot(axis));
            (a.min(b).min(c), a.max(b).max(c))
        });
        high.min(other_high) - low.max(other_low) <= least
    };
    let edges = |[a, b, c]: [Vec2; 3]| [[a, b], [b, c], [c, a]];
    !edges(one).into_iter().chain(edges(other)).any(is_apart)
}

/// What a clear face lies on: the largest rounding error of rays, as bits, between it and what faces the
/// same way, and what faces it; 0 without.
#[derive(Default)]
struct Contact([AtomicU32; 2]);

impl Contact {
    fn note(&self, face: &Face, other: &Face, extent: f32) {
        let side = usize::from(face.normal.dot(other.normal) < 0.0);
        // Bits of positive numbers are in the order of the numbers.
        self.0[side].fetch_max(face.error(other, extent).to_bits(), Ordering::Relaxed);
    }

    /// The ways by which the face is parted: into its body, or, of a sheet, before what it lies on.
    fn ways(self, face: &Face) -> impl Iterator<Item = Vec3> {
        let normals = if face.is_solid { [-1.0, -1.0] } else { [1.0, -1.0] };
        let normals = normals.map(|side| side * face.normal);
        let ways = self
            .0
            .into_iter()
            .zip(normals)
            .map(|(error, normal)| 2.0 * ERRORS * f32::from_bits(error.into_inner()) * normal);
        ways.filter(|way| *way != Vec3::ZERO)
    }
}

/// Ways by which things are parted.
#[derive(Default)]
struct Ways {
    /// Of listed corners by the bits of their places.
    corners: HashMap<[u32; 3], Vec<Vec3>>,
    /// Of instances.
    instances: BTreeMap<u32, Vec<Vec3>>,
}

impl Ways {
    fn add(&mut self, scene: &Scene, face: &Face, way: Vec3) {
        let Some(own) = scene.instance_of(face.triangle) else {
            for corner in face.corners {
                put(self.corners.entry(bits(corner)).or_default(), way);
            }
            return;
        };
        put(self.instances.entry(own.instance).or_default(), way);
    }

    /// Moves the corners of all clear triangles, and instances.
    fn part(self, scene: &mut Scene, clear: &[Face]) {
        let mut is_shared = vec![false; scene.vertices.len()];
        for triangle in &scene.triangles {
            if scene.materials[triangle.material as usize].clear_share() == 0.0 {
                triangle.vertices.iter().for_each(|vertex| is_shared[*vertex as usize] = true);
            }
        }
        for face in clear.iter().filter(|face| (face.triangle as usize) < scene.triangles.len()) {
            let vertices = scene.triangles[face.triangle as usize].vertices;
            for (vertex, corner) in vertices.into_iter().zip(face.corners) {
                let at = &mut scene.vertices[vertex as usize].position;
                // A vertex of several faces is moved once: then it is elsewhere.
                if let Some(ways) = self.corners.get(&bits(*at))
                    && !is_shared[vertex as usize]
                {
                    let own = ways.iter().filter(|way| face.follows(corner, **way));
                    *at += own.sum::<Vec3>();
                }
            }
        }
        let sum = |(instance, ways): (&u32, &Vec<Vec3>)| (*instance, ways.iter().sum::<Vec3>());
        let moves: Vec<(u32, Vec3)> = self.instances.iter().map(sum).collect();
        if !moves.is_empty() {
            Arc::make_mut(&mut scene.instances).shift(&moves);
        }
    }
}

/// Adds a way; of those that go alike the longest counts.
fn put(ways: &mut Vec<Vec3>, way: Vec3) {
    let is_alike = |known: &Vec3| known.dot(way) > ALIKE * known.length() * way.length();
    match ways.iter().position(is_alike) {
        Some(known) if ways[known].length() < way.length() => ways[known] = way,
        Some(_) => {}
        None if ways.len() < MOST_WAYS => ways.push(way),
        None => {}
    }
}

fn bits(at: Vec3) -> [u32; 3] {
    // Zero has two signs.
    (at + 0.0).to_array().map(f32::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::Rgb;
    use crate::scene::{Material, Triangle, Vertex};

    /// A box, whose front is outside, with its own vertices for each face.
    fn add_box(scene: &mut Scene, low: Vec3, high: Vec3, material: u32) {
        for axis in 0..3 {
            for side in [false, true] {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let corner = |a: bool, b: bool| {
                    let mut at = if side { high } else { low };
                    at[u] = if a { high[u] } else { low[u] };
                    at[v] = if b { high[v] } else { low[v] };
                    Vertex::new(at, Vec3::ZERO)
                };
                let first = scene.vertices.len() as u32;
                let mut corners = [
                    corner(false, false),
                    corner(true, false),
                    corner(true, true),
                    corner(false, true),
                ];
                if !side {
                    corners.reverse();
                }
                scene.vertices.extend(corners);
                for [b, c] in [[1, 2], [2, 3]] {
                    let vertices = [first, first + b, first + c];
                    scene.triangles.push(Triangle { vertices, material });
                }
            }
        }
    }

    fn scene() -> Scene {
        let wood = Material::lambertian("wood", Rgb::splat(0.5));
        let glass = Material::glass("glass", 1.5);
        let water = Material::glass("water", 1.33);
        let mut scene = Scene { materials: vec![wood, glass, water], ..Scene::default() };
        add_box(&mut scene, Vec3::new(-1.0, -1.0, -1.0), Vec3::new(2.0, 0.0, 2.0), 0);
        scene
    }

    /// Least and largest coordinates of a material's triangles.
    fn extremes(scene: &Scene, material: u32) -> (Vec3, Vec3) {
        let own = scene.triangles.iter().filter(|triangle| triangle.material == material);
        let corners = own.flat_map(|triangle| scene.corners(triangle));
        corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), at| {
            (low.min(at), high.max(at))
        })
    }

    #[test]
    fn a_glass_is_lifted_off_the_table_and_off_the_wall_beside() {
        let mut scene = scene();
        add_box(&mut scene, Vec3::new(-1.0, 0.0, -0.5), Vec3::new(-0.8, 1.0, 0.5), 0);
        let (low, high) = (Vec3::new(-0.8, 0.0, 0.0), Vec3::new(-0.2, 0.4, 0.25));
        add_box(&mut scene, low, high, 1);
        let before = scene.clone();
        scene.part_touching();
        let (moved_low, moved_high) = extremes(&scene, 1);
        assert_eq!(moved_high, high);
        let lifted = moved_low - low;
        println!("{lifted}");
        assert!(lifted.x.min(lifted.y) > 1e-6 && lifted.max_element() < 1e-4);
        assert_eq!(lifted.z, 0.0);
        assert_eq!(extremes(&scene, 0), extremes(&before, 0));
        // It remains closed: corners that were in one place still are.
        let place = |scene: &Scene, vertex: usize| bits(scene.vertices[vertex].position);
        for (one, other) in (0..scene.vertices.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let is_glass = |vertex| {
                let own = |triangle: &&Triangle| triangle.vertices.contains(&(vertex as u32));
                scene.triangles.iter().find(own).is_some_and(|triangle| triangle.material == 1)
            };
            if is_glass(one) && is_glass(other) && place(&before, one) == place(&before, other) {
                assert_eq!(place(&scene, one), place(&scene, other));
            }
        }
        // It no longer touches anything.
        let contacts = |scene: &Scene| {
            let all = (0..scene.triangles.len() as u32).map(|index| scene.face(index));
            let clear: Vec<Face> = all.filter(|face| face.is_clear).collect();
            let contacts = scene.contacts(&clear).into_iter().zip(&clear);
            contacts.flat_map(|(contact, face)| contact.ways(face).collect::<Vec<_>>()).count()
        };
        assert!(contacts(&before) >= 4 && contacts(&scene) == 0);
    }

    #[test]
    fn what_is_beside_or_above_stays() {
        let mut scene = scene();
        // In the table's plane beside it, above it, sunk into it.
        for at in [Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.001, 0.0), Vec3::new(1.0, -0.1, 0.0)]
        {
            add_box(&mut scene, at, at + 0.5, 1);
        }
        let before = scene.vertices.clone();
        scene.part_touching();
        let moved = before.iter().zip(&scene.vertices).filter(|(a, b)| a.position != b.position);
        assert_eq!(moved.count(), 0);
    }

    #[test]
    fn water_in_glass_is_parted_from_it_and_a_sheet_from_a_wall() {
        let mut scene = scene();
        add_box(&mut scene, Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.5, 1.0, 0.5), 1);
        add_box(&mut scene, Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.5, 1.2, 0.5), 2);
        let pane = Material { volume: None, ..Material::glass("pane", 1.5) };
        scene.materials.push(pane);
        let first = scene.vertices.len() as u32;
        for [x, z] in [[1.0, 0.0], [1.0, 1.0], [1.5, 1.0]] {
            scene.vertices.push(Vertex::new(Vec3::new(x, 0.0, z), Vec3::Y));
        }
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: 3 });
        scene.part_touching();
        assert!(extremes(&scene, 1).1.y < 1.0 && extremes(&scene, 2).0.y > 1.0);
        assert!(extremes(&scene, 3).0.y > 1e-6);
    }

    #[test]
    fn instances_are_parted_whole() {
        let mut scene = scene();
        let mut glass = Scene::default();
        add_box(&mut glass, Vec3::ZERO, Vec3::new(0.2, 0.5, 0.2), 1);
        let instances = Arc::make_mut(&mut scene.instances);
        let shape = instances.add_shape(glass.vertices, glass.triangles);
        for (at, height) in [(0.0, 0.0), (0.5, 0.0), (1.0, 0.1)] {
            let at = glam::DVec3::new(at, height, 0.0);
            assert!(instances.add(shape, glam::DAffine3::from_translation(at)));
        }
        instances.finish();
        scene.part_touching();
        let heights = scene.instances.all().iter().map(|own| own.to_world.translation.y);
        let heights: Vec<f64> = heights.collect();
        assert!(heights[..2].iter().all(|height| *height > 1e-6 && *height < 1e-4), "{heights:?}");
        assert_eq!(heights[2], 0.1);
    }

    #[test]
    fn what_lies_in_a_plane_many_times_is_parted_once() {
        let lifted = |times: u32| {
            let mut scene = scene();
            let high = Vec3::new(0.5, 0.4, 0.5);
            (0..times).for_each(|_| add_box(&mut scene, Vec3::ZERO, high, 1));
            for _ in 1..times {
                add_box(&mut scene, Vec3::new(-1.0, -1.0, -1.0), Vec3::new(2.0, 0.0, 2.0), 0);
            }
            scene.part_touching();
            extremes(&scene, 1).0.y
        };
        assert!(lifted(1) > 1e-6);
        assert_eq!(lifted(150), lifted(1));
    }
}
