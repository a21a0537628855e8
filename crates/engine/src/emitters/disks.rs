//! Lights as disks (Lange 1994, as Rogers prints it): a disk stands for each connected group of
//! emissive triangles, and is sampled at its centre and at random points of its area or of its
//! edge.

use super::of_triangles::OfTriangles;
use super::triangles::{Emitter, TriangleLights};
use crate::radiometry::{Rgb, importance};
use crate::random::Numbers;
use crate::sampling::Discrete;
use crate::sampling::frame;
use crate::surface::World;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::f32::consts::{PI, TAU};

/// A group is a sheet if its vector area is over this share of its area, else a closed body: that
/// of a closed surface is zero, that of a flat one the area.
const SHEET: f32 = 0.2;

/// The lights of a scene as disks.
pub struct Disks {
    disks: Vec<Disk>,
    choice: Discrete,
    /// Group of each triangle that shines.
    group_of: OfTriangles,
}

/// A connected group of emissive triangles as a disk of the same area.
pub struct Disk {
    center: Vec3,
    /// Unit normal; `None` for closed bodies, which turn the same disk to everyone.
    normal: Option<Vec3>,
    radius: f32,
    radiance: Rgb,
    two_sided: bool,
    group: u32,
}

/// Points that stand for a disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DiskPoints {
    /// Uniform over its area.
    Area,
    /// Uniform along its edge.
    Rim,
}

impl Disks {
    /// The disks that stand for the lights of a scene.
    pub fn new(world: &World, lights: &TriangleLights) -> Self {
        let (group_of, disks) = disks(world, lights.emitters());
        let power = |disk: &Disk| {
            let area = PI * disk.radius * disk.radius;
            f64::from(importance(disk.radiance)).max(f64::MIN_POSITIVE) * f64::from(area)
        };
        let choice = Discrete::new(disks.iter().map(power));
        Self { disks, choice, group_of }
    }

    /// The disk for a uniform number, and its probability.
    pub fn pick(&self, xi: f64) -> (usize, f32) {
        let index = self.choice.pick(xi);
        (index, self.choice.probability(index) as f32)
    }

    /// A disk.
    pub fn disk(&self, index: usize) -> &Disk {
        &self.disks[index]
    }

    /// Whether a triangle belongs to the group that `disk` stands for.
    pub fn is_of(&self, disk: &Disk, triangle: u32) -> bool {
        self.group_of.of(triangle) == Some(disk.group)
    }
}

impl Disk {
    /// Its centre for [`Disk::light`].
    pub fn center(&self) -> [f32; 2] {
        [0.0; 2]
    }

    /// A random point for [`Disk::light`]: polar coordinates, radius in shares of the disk's.
    pub fn random(&self, points: DiskPoints, numbers: &mut Numbers) -> [f32; 2] {
        let radius = match points {
            DiskPoints::Area => numbers.uniform().sqrt(),
            DiskPoints::Rim => 1.0,
        };
        [radius, TAU * numbers.uniform()]
    }

    /// The disk's light as if all of it came from one of its points: where that is, the direction
    /// to it, and radiance × area × cosθ_y/distance². `None` where it shines the other way.
    pub fn light(&self, from: Vec3, [radius, angle]: [f32; 2]) -> Option<(Vec3, Vec3, Rgb)> {
        let normal = self.normal.unwrap_or_else(|| (from - self.center).normalize_or(Vec3::Y));
        let (tangent, _) = frame(normal, angle);
        let point = self.center + tangent * (radius * self.radius);
        let between = point - from;
        let square = between.length_squared();
        if square <= 0.0 {
            return None;
        }
        let direction = between / square.sqrt();
        let mut cosine = -normal.dot(direction);
        if self.two_sided {
            cosine = cosine.abs();
        }
        let area = PI * self.radius * self.radius;
        (cosine > 0.0).then(|| (point, direction, self.radiance * (area * cosine / square)))
    }
}

/// Groups of emissive triangles with common corners, and a disk for each.
fn disks(world: &World, emitters: &[Emitter]) -> (OfTriangles, Vec<Disk>) {
    let mut parent: Vec<usize> = (0..emitters.len()).collect();
    fn root(parent: &mut [usize], mut at: usize) -> usize {
        while parent[at] != at {
            parent[at] = parent[parent[at]];
            at = parent[at];
        }
        at
    }
    let mut first_at: HashMap<[u32; 3], usize> = HashMap::new();
    for (index, emitter) in emitters.iter().enumerate() {
        for corner in emitter.corners {
            let key = (corner + 0.0).to_array().map(f32::to_bits);
            let other = *first_at.entry(key).or_insert(index);
            let (a, b) = (root(&mut parent, index), root(&mut parent, other));
            parent[a] = b;
        }
    }
    #[derive(Default)]
    struct Sum {
        area: f32,
        vector_area: Vec3,
        moment: Vec3,
        power: DVec3,
        two_sided: bool,
    }
    let mut group_of = OfTriangles::new(&world.scene);
    let mut number: HashMap<usize, u32> = HashMap::new();
    let mut sums: Vec<Sum> = Vec::new();
    for (index, emitter) in emitters.iter().enumerate() {
        let root = root(&mut parent, index);
        let group = *number.entry(root).or_insert_with(|| {
            sums.push(Sum { two_sided: true, ..Sum::default() });
            sums.len() as u32 - 1
        });
        group_of.set(emitter.triangle, group);
        let sum = &mut sums[group as usize];
        let [a, b, c] = emitter.corners;
        sum.area += emitter.area;
        sum.vector_area += 0.5 * (b - a).cross(c - a);
        sum.moment += (a + b + c) * (emitter.area / 3.0);
        sum.power += emitter.radiance.as_dvec3() * f64::from(emitter.area);
        sum.two_sided &= world.is_two_sided(emitter.triangle);
    }
    let disk = |(group, sum): (usize, &Sum)| {
        let sheet = sum.vector_area.length() > SHEET * sum.area;
        // A convex body shows a quarter of its surface on average (Cauchy).
        let area = if sheet { sum.area } else { 0.25 * sum.area };
        Disk {
            center: sum.moment / sum.area,
            normal: sheet.then(|| sum.vector_area.normalize()),
            radius: (area / PI).sqrt(),
            radiance: (sum.power / f64::from(sum.area)).as_vec3(),
            two_sided: sum.two_sided,
            group: group as u32,
        }
    };
    (group_of, sums.iter().enumerate().map(disk).collect())
}
