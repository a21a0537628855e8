//! Patches of instances: the sides of a shape's triangles, fronts or backs, that lie in one cell of its
//! space, face the same way and have one material are a cluster, and each cluster of each instance is one patch. Cells
//! are halved as often as it takes for them to be about as large in the world as patches are; what is
//! far smaller than a patch has clusters of its own size, and its element has those of its neighbours,
//! too.

use super::facet::{NO_PATCH, Sides};
use super::focus::Focus;
use super::means::{CellMeans, exponent_of, point_of};
use crate::radiometry::{Reflectance, Rgb};
use crate::scene::instances::{Instance, InstanceTriangle, Shape};
use crate::scene::{Scene, Triangle};
use foldhash::{HashMap, HashMapExt};
use glam::{DVec3, IVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Most halvings of a shape's longest side.
const MOST_LEVELS: usize = 8;
/// Points of a triangle at which its colour is looked at.
const POINTS: u32 = 4;

/// The patches of all instances.
pub struct Clusters {
    /// By shape and level; `None` where no instance has that level.
    shapes: Vec<Vec<Option<Level>>>,
    /// By instance, its level.
    level: Vec<u8>,
    /// By instance, its first patch, and where the last one ends.
    first: Vec<u32>,
}

/// The sides of a shape's triangles in cells of one size.
struct Level {
    /// By triangle, the clusters of its front and its back; [`NO_PATCH`] where a side has none.
    of_side: Vec<[u32; 2]>,
    clusters: Vec<Cluster>,
    /// Sides of each cluster: triangle and whether it is the back.
    members: Vec<(u32, bool)>,
    /// Running sums of their areas, by cluster.
    running: Vec<f32>,
}

/// What is the same in all instances of a cluster, in the shape's space.
#[derive(Clone, Copy)]
struct Cluster {
    /// Its first member, and how many there are.
    first: u32,
    count: u32,
    area: f64,
    /// Mean place, weighted by area.
    center: DVec3,
    /// Sum of the vector areas, along the normals of the sides.
    across: DVec3,
    material: u32,
    /// Means over its area.
    means: CellMeans,
}

/// What groups of patches are made by.
pub struct Outline {
    /// Area, m².
    pub area: f32,
    /// Middle.
    pub center: Vec3,
    /// Along the normal, of any length.
    pub facing: Vec3,
    /// Whether it is on the back of its surface.
    pub back: bool,
    /// Index of the material.
    pub material: u32,
    /// Albedo under uniform light.
    pub albedo: Rgb,
}

impl Clusters {
    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        let of_level = |level: &Level| {
            let lists = size_of_val(&*level.of_side) + size_of_val(&*level.clusters);
            lists + size_of_val(&*level.members) + size_of_val(&*level.running)
        };
        let levels = self.shapes.iter().flatten().flatten().map(of_level).sum::<usize>();
        (levels + size_of_val(&*self.level) + size_of_val(&*self.first)) as u64
    }

    /// The patches of a scene's instances, with `cell` the side of a patch in the focus, metres.
    pub fn new(scene: &Scene, cell: f32, focus: Option<Focus>) -> Self {
        let instances = &scene.instances;
        let level_of = |own: &Instance| {
            let shape = instances.shape_of(own);
            let middle = own.point(0.5 * (shape.low + shape.high));
            let cell = cell * focus.map_or(1.0, |focus| focus.scale_at(middle));
            let extent = f64::from((shape.high - shape.low).max_element());
            let cells = extent * own.area_scale().sqrt() / f64::from(cell.max(f32::MIN_POSITIVE));
            // Below one, and not a number, it is 0.
            cells.log2() as usize
        };
        let level: Vec<u8> =
            instances.all().iter().map(|own| level_of(own).min(MOST_LEVELS) as u8).collect();
        let mut used = vec![[false; MOST_LEVELS + 1]; instances.shapes().len()];
        for (own, level) in instances.all().iter().zip(&level) {
            used[own.shape as usize][usize::from(*level)] = true;
        }
        let of_shape = |(shape, used): (&Shape, &[bool; MOST_LEVELS + 1])| {
            let sides = Side::all(scene, shape);
            let levels = used.iter().enumerate();
            levels.map(|(level, used)| used.then(|| Level::new(shape, &sides, level))).collect()
        };
        let shapes: Vec<Vec<Option<Level>>> =
            instances.shapes().par_iter().zip(&used).map(of_shape).collect();
        let mut this = Self { shapes, level, first: vec![0] };
        let mut end = 0u32;
        for instance in 0..instances.all().len() {
            end += this.level(scene, instance as u32).map_or(0, |own| own.clusters.len() as u32);
            this.first.push(end);
        }
        this
    }

    /// Number of patches.
    pub fn count(&self) -> u32 {
        self.first[self.first.len() - 1]
    }

    fn level(&self, scene: &Scene, instance: u32) -> Option<&Level> {
        let shape = scene.instances.all()[instance as usize].shape as usize;
        self.shapes[shape][usize::from(self.level[instance as usize])].as_ref()
    }

    /// The patches of a triangle; the first patch of all has the number `first`.
    pub fn sides(&self, scene: &Scene, triangle: InstanceTriangle, first: u32) -> Sides {
        let InstanceTriangle { instance, local } = triangle;
        let level = self.level(scene, instance);
        let sides = level.map_or([NO_PATCH; 2], |level| level.of_side[local as usize]);
        let first = first + self.first[instance as usize];
        let [front, back] =
            sides.map(|side| if side == NO_PATCH { NO_PATCH } else { first + side });
        Sides { divisions: 1, front, back }
    }

    /// The instance of a patch, with the level and the cluster.
    fn find(&self, scene: &Scene, patch: u32) -> Option<(u32, &Level, &Cluster)> {
        let instance = self.first.partition_point(|first| *first <= patch) as u32 - 1;
        let level = self.level(scene, instance)?;
        let cluster = patch - self.first[instance as usize];
        Some((instance, level, &level.clusters[cluster as usize]))
    }

    /// What groups are made by.
    pub fn outline(&self, scene: &Scene, patch: u32) -> Option<Outline> {
        let (instance, level, cluster) = self.find(scene, patch)?;
        let own = &scene.instances.all()[instance as usize];
        Some(Outline {
            back: level.members[cluster.first as usize].1,
            area: (cluster.area * own.area_scale()) as f32,
            center: own.point(cluster.center.as_vec3()),
            facing: (own.normal_to_world() * cluster.across).normalize_or(DVec3::Z).as_vec3(),
            material: cluster.material,
            albedo: cluster.means.albedo,
        })
    }

    /// Area of a patch, m²; about that where a transform is uneven.
    pub fn area(&self, scene: &Scene, patch: u32) -> f32 {
        let Some((instance, _, cluster)) = self.find(scene, patch) else { return 0.0 };
        (cluster.area * scene.instances.all()[instance as usize].area_scale()) as f32
    }

    /// The triangle, by its number, and the side of a patch that a number in [0, 1) picks by area.
    pub fn pick(&self, scene: &Scene, patch: u32, x: f32) -> Option<(u32, bool)> {
        let (instance, level, cluster) = self.find(scene, patch)?;
        let (first, count) = (cluster.first as usize, cluster.count as usize);
        let running = &level.running[first..first + count];
        let target = x * running[count - 1];
        let place = running.partition_point(|sum| *sum <= target).min(count - 1);
        let (local, back) = level.members[first + place];
        let start = scene.instances.triangles_of(instance).start + scene.triangles.len() as u32;
        Some((start + local, back))
    }

    /// How a patch reflects, and its albedo under uniform light.
    pub fn reflectance(&self, scene: &Scene, patch: u32) -> Option<(Reflectance, Rgb)> {
        let (_, _, Cluster { means, material, .. }) = self.find(scene, patch)?;
        // Only the material counts.
        let any = Triangle { vertices: [0; 3], material: *material };
        Some((means.reflectance(exponent_of(scene, &any)), means.albedo))
    }
}

/// A side of a shape's triangle.
struct Side {
    triangle: u32,
    back: bool,
    center: DVec3,
    across: DVec3,
    material: u32,
    means: CellMeans,
}

impl Side {
    /// All sides of a shape that are there for light.
    fn all(scene: &Scene, shape: &Shape) -> Vec<Side> {
        let first = match shape.shown_by {
            u32::MAX => return Vec::new(),
            instance => scene.instances.triangles_of(instance).start,
        };
        let mut sides = Vec::with_capacity(shape.triangles.len());
        for (local, triangle) in (0u32..).zip(&shape.triangles) {
            let corners = triangle.vertices.map(|vertex| shape.vertices[vertex as usize].position);
            let [a, b, c] = corners.map(Vec3::as_dvec3);
            let across = 0.5 * (b - a).cross(c - a);
            if across.length_squared() <= 0.0 {
                continue;
            }
            let material = triangle.material;
            let shown = scene.triangle(scene.triangles.len() as u32 + first + local);
            let whole = [Vec2::ZERO, Vec2::X, Vec2::Y];
            let points = (0..POINTS).map(|number| point_of(whole, POINTS * local + number));
            let means = CellMeans::new(scene, &shown, points);
            let front = Side {
                triangle: local,
                back: false,
                center: (a + b + c) / 3.0,
                across,
                material,
                means,
            };
            let two_sided = scene.materials[material as usize].double_sided;
            let back = two_sided.then(|| Side { back: true, across: -across, ..front });
            sides.push(front);
            sides.extend(back);
        }
        sides
    }
}

impl Level {
    fn new(shape: &Shape, sides: &[Side], halvings: usize) -> Self {
        let low = shape.low.as_dvec3();
        let extent = (shape.high - shape.low).max_element();
        let cells = (1 << halvings) as f64 / f64::from(extent.max(f32::MIN_POSITIVE));
        let mut numbers: HashMap<(IVec3, u8, bool, u32), usize> = HashMap::new();
        let mut members: Vec<Vec<usize>> = Vec::new();
        for (index, side) in sides.iter().enumerate() {
            let last = IVec3::splat((1 << halvings) - 1);
            let cell = ((side.center - low) * cells).floor().as_ivec3().clamp(IVec3::ZERO, last);
            let axis = side.across.abs().max_position();
            let facing = (2 * axis) as u8 + u8::from(side.across[axis] < 0.0);
            let key = (cell, facing, side.back, side.material);
            let number = *numbers.entry(key).or_insert(members.len());
            if number == members.len() {
                members.push(Vec::new());
            }
            members[number].push(index);
        }
        let mut this = Self {
            of_side: vec![[NO_PATCH; 2]; shape.triangles.len()],
            clusters: Vec::with_capacity(members.len()),
            members: Vec::with_capacity(sides.len()),
            running: Vec::with_capacity(sides.len()),
        };
        for own in members {
            this.add(own.into_iter().map(|index| &sides[index]));
        }
        this
    }

    /// Adds a cluster of some sides, at least one.
    fn add<'a>(&mut self, sides: impl ExactSizeIterator<Item = &'a Side>) {
        let (first, count) = (self.members.len() as u32, sides.len() as u32);
        let (mut area, mut moment, mut across) = (0.0, DVec3::ZERO, DVec3::ZERO);
        let (mut sum, mut material) = (CellMeans::default(), 0);
        for side in sides {
            let own = side.across.length();
            area += own;
            moment += own * side.center;
            across += side.across;
            sum.add(&side.means, own as f32);
            material = side.material;
            let number = self.clusters.len() as u32;
            self.of_side[side.triangle as usize][usize::from(side.back)] = number;
            self.members.push((side.triangle, side.back));
            self.running.push(area as f32);
        }
        let means = sum.over(area as f32);
        let center = moment / area;
        self.clusters.push(Cluster { first, count, area, center, across, material, means });
    }
}

#[cfg(test)]
mod tests {
    use crate::patches::{Crowd, FacetIndex, PatchIndex};
    use crate::radiometry::Rgb;
    use crate::scene::instances::Instances;
    use crate::scene::{Material, Scene, Triangle, Vertex};
    use glam::{DAffine3, DQuat, DVec3, Vec3};
    use std::sync::Arc;

    /// Bumpy sheets of 800 triangles, every second column of which has two sides, of all sizes.
    fn sheets() -> Arc<Scene> {
        let dull = Material::lambertian("dull", Rgb::splat(0.5));
        let both = Material { double_sided: true, ..Material::lambertian("both", Rgb::splat(0.2)) };
        let mut scene = Scene { materials: vec![dull, both], ..Scene::default() };
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        scene.vertices.extend(corners.map(|corner| Vertex::new(9.0 * corner, Vec3::Z)));
        scene.triangles.push(Triangle { vertices: [0, 1, 2], material: 0 });
        let at = |index: u32| {
            let (x, y) = ((index % 21) as f32 / 20.0, (index / 21) as f32 / 20.0);
            Vec3::new(x, y, 0.2 * (9.0 * x).sin() * (7.0 * y).cos())
        };
        let vertices = (0..441).map(|index| Vertex::new(at(index), Vec3::Z)).collect();
        let triangles = (0..400u32).flat_map(|cell| {
            let first = cell / 20 * 21 + cell % 20;
            let corners = [[first, first + 1, first + 22], [first, first + 22, first + 21]];
            corners.map(|vertices| Triangle { vertices, material: cell % 2 })
        });
        let mut instances = Instances::default();
        let shape = instances.add_shape(vertices, triangles.collect());
        for index in 0..12 {
            let size = DVec3::splat(0.02 * 1.8f64.powi(index)) * DVec3::new(-1.0, 1.0, 1.0);
            let turn = DQuat::from_rotation_y(f64::from(index));
            let place = DVec3::new(f64::from(index), 0.0, 0.0);
            let to_world = DAffine3::from_scale_rotation_translation(size, turn, place);
            assert!(instances.add(shape, to_world));
        }
        instances.finish();
        scene.instances = Arc::new(instances);
        Arc::new(scene)
    }

    /// Together the patches of instances have all of their area, each side of a triangle is in the
    /// patch that picks it, and large instances have many patches, small ones few.
    #[test]
    fn sides_of_instances_are_in_their_patches() {
        let scene = sheets();
        let crowd = Crowd::new(scene.clone(), 2000, None);
        let listed = scene.triangles.len() as u32;
        let (mut patches, mut area) = (0, 0.0);
        let mut of_instance = [0; 12];
        for index in (0..crowd.bound() as u32).map(PatchIndex) {
            let Some((clusters, number)) = crowd.cluster(index) else { continue };
            patches += 1;
            area += f64::from(clusters.area(&scene, number));
            let outline = clusters.outline(&scene, number).expect("it is there");
            for x in [0.0, 0.3, 0.99] {
                let (triangle, back) = clusters.pick(&scene, number, x).expect("it is there");
                let sides = crowd.sides(FacetIndex(triangle));
                assert_eq!(sides.first_patch(back), Some(index.0));
                assert!(triangle >= listed);
                assert_eq!(back, outline.back, "fronts and backs are apart");
            }
            let (triangle, _) = clusters.pick(&scene, number, 0.5).expect("it is there");
            let found = scene.instance_of(triangle).expect("it is of one");
            of_instance[found.instance as usize] += 1;
        }
        let mut expected = 0.0;
        for index in listed..scene.triangle_count() as u32 {
            let triangle = scene.triangle(index);
            let [a, b, c] = scene.corners(&triangle);
            let own = f64::from(0.5 * (b - a).cross(c - a).length());
            expected += own * f64::from(1 + triangle.material);
        }
        assert!((area / expected - 1.0).abs() < 1e-3, "{area} {expected}");
        assert!(patches < 12 * 1200 / 2, "{patches}");
        assert!(of_instance[11] > 100 && of_instance[0] < 20, "{of_instance:?}");
        assert!(of_instance.is_sorted(), "{of_instance:?}");
    }
}
