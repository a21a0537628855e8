//! Where direct light comes from: the emissive triangles by themselves, picked by their power, or
//! each connected group of them as a disk (Lange 1994, as Rogers prints it).

use super::surface::{Surface, World};
use crate::patches::cells;
use crate::radiometry::{Rgb, importance};
use crate::random::Numbers;
use crate::rays::Spot;
use glam::Vec3;
use std::collections::HashMap;
use std::f32::consts::{PI, TAU};

/// "In no group."
const NO_GROUP: u32 = u32::MAX;
/// Share of the pick that goes by the emission factor alone, so that no part of a texture that
/// the samples missed is left out.
const FACTOR_SHARE: f64 = 0.1;
/// A group whose vector area is less than this share of its area is a body, not a sheet.
const SHEET: f32 = 0.2;

/// Things by probability.
pub struct Choice {
    /// Running sums of the probabilities.
    cumulative: Vec<f64>,
}

impl Choice {
    /// Things with probabilities in proportion to weights, whose sum is positive.
    pub fn new(weights: impl Iterator<Item = f64>) -> Self {
        let mut total = 0.0;
        let mut cumulative: Vec<f64> = weights
            .map(|weight| {
                total += weight;
                total
            })
            .collect();
        cumulative.iter_mut().for_each(|sum| *sum /= total);
        Self { cumulative }
    }

    /// The thing for a uniform number.
    pub fn pick(&self, xi: f64) -> usize {
        self.cumulative.partition_point(|sum| *sum <= xi).min(self.cumulative.len() - 1)
    }

    /// The probability of a thing.
    pub fn probability(&self, index: usize) -> f64 {
        let before = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        self.cumulative[index] - before
    }
}

/// An emissive triangle.
struct Emitter {
    triangle: u32,
    corners: [Vec3; 3],
    area: f32,
    weight: f64,
    radiance: Rgb,
}

/// The lights of a scene.
pub struct Lights {
    emitters: Vec<Emitter>,
    choice: Choice,
    /// Probability per area, by scene triangle.
    density: Vec<f32>,
    disks: Vec<Disk>,
    disk_choice: Choice,
    group_of: Vec<u32>,
}

/// A point of a light, as a surface sees it.
pub struct LightSample {
    /// Where rays to it end.
    pub end: Vec3,
    /// Unit direction to it.
    pub direction: Vec3,
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Density per solid angle at the surface.
    pub density: f32,
}

/// A point of a light that light leaves from.
pub struct Emitted {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// Where.
    pub spot: Spot,
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Whether both sides emit.
    pub two_sided: bool,
    /// Density per area, square ray units.
    pub density: f32,
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

impl Lights {
    /// The lights of a scene; `None` without any.
    pub fn new(world: &World) -> Option<Self> {
        let scene = &world.scene;
        let mut emitters = Vec::new();
        for (index, triangle) in scene.triangles.iter().enumerate() {
            let material = &scene.materials[triangle.material as usize];
            if !material.emits() {
                continue;
            }
            let (corners, area) = world.rays.corners(scene, index as u32);
            let radiance = mean_emission(world, index as u32);
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            let mixed = f64::from(importance(radiance)) * (1.0 - FACTOR_SHARE)
                + f64::from(importance(material.emission)) * FACTOR_SHARE;
            let weight = mixed * f64::from(area) * sides;
            if weight > 0.0 && weight.is_finite() {
                let triangle = index as u32;
                emitters.push(Emitter { triangle, corners, area, weight, radiance });
            }
        }
        if emitters.is_empty() {
            return None;
        }
        let choice = Choice::new(emitters.iter().map(|emitter| emitter.weight));
        let mut density = vec![0.0; scene.triangles.len()];
        for (index, emitter) in emitters.iter().enumerate() {
            density[emitter.triangle as usize] =
                (choice.probability(index) / f64::from(emitter.area)) as f32;
        }
        let (group_of, disks) = disks(world, &emitters);
        let power = |disk: &Disk| {
            let area = PI * disk.radius * disk.radius;
            f64::from(importance(disk.radiance)).max(f64::MIN_POSITIVE) * f64::from(area)
        };
        let disk_choice = Choice::new(disks.iter().map(power));
        Some(Self { emitters, choice, density, disks, disk_choice, group_of })
    }

    /// A point of the emissive triangles, picked by power, uniform over the triangle; `None` where
    /// `surface` can't see its light.
    pub fn sample(
        &self,
        world: &World,
        surface: &Surface,
        pick: f64,
        xi: [f32; 2],
    ) -> Option<LightSample> {
        let emitter = &self.emitters[self.choice.pick(pick)];
        if emitter.triangle == surface.triangle {
            return None;
        }
        let root = xi[0].sqrt();
        let (u, v) = (root * (1.0 - xi[1]), root * xi[1]);
        let spot = Spot::new(emitter.corners, u, v);
        let between = spot.point - surface.spot.point;
        let square = between.length_squared();
        let direction = between / square.sqrt();
        let cosine = -spot.normal.dot(direction);
        let seen = cosine > 0.0 || (cosine < 0.0 && world.is_two_sided(emitter.triangle));
        if !seen || surface.normal.dot(direction) <= 0.0 {
            return None;
        }
        let density = self.density[emitter.triangle as usize] * square / cosine.abs();
        let end = spot.off_surface(spot.normal * cosine.signum());
        let radiance = world.emission(emitter.triangle, u, v);
        Some(LightSample { end, direction, radiance, density })
    }

    /// Density per solid angle at which [`Lights::sample`] picks the place of `light` that a ray
    /// along the unit `direction` met at `distance`.
    pub fn density(&self, light: &Surface, direction: Vec3, distance: f32) -> f32 {
        let cosine = light.normal.dot(direction).abs().max(f32::MIN_POSITIVE);
        self.density[light.triangle as usize] * distance * distance / cosine
    }

    /// A point of the emissive triangles, picked by power, uniform over the triangle.
    pub fn emit(&self, world: &World, pick: f64, xi: [f32; 2]) -> Emitted {
        let emitter = &self.emitters[self.choice.pick(pick)];
        let root = xi[0].sqrt();
        let (u, v) = (root * (1.0 - xi[1]), root * xi[1]);
        Emitted {
            triangle: emitter.triangle,
            spot: Spot::new(emitter.corners, u, v),
            radiance: world.emission(emitter.triangle, u, v),
            two_sided: world.is_two_sided(emitter.triangle),
            density: self.density[emitter.triangle as usize],
        }
    }

    /// The disk for a uniform number, and its probability.
    pub fn pick_disk(&self, xi: f64) -> (usize, f32) {
        let index = self.disk_choice.pick(xi);
        (index, self.disk_choice.probability(index) as f32)
    }

    /// A disk.
    pub fn disk(&self, index: usize) -> &Disk {
        &self.disks[index]
    }

    /// Whether a triangle belongs to the group that `disk` stands for.
    pub fn is_of(&self, disk: &Disk, triangle: u32) -> bool {
        self.group_of[triangle as usize] == disk.group
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
        let (tangent, bitangent) = crate::hemicube::frame(normal, angle);
        debug_assert!(bitangent.is_finite());
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

/// Emission averaged over a triangle by 64 samples where a texture varies it.
fn mean_emission(world: &World, triangle: u32) -> Rgb {
    let samples: Vec<Rgb> = cells(8)
        .map(|[a, b, c]| (a + b + c) / 3.0)
        .map(|at| world.emission(triangle, at.x, at.y))
        .collect();
    samples.iter().sum::<Rgb>() / samples.len() as f32
}

/// Groups of emissive triangles with common corners, and a disk for each.
fn disks(world: &World, emitters: &[Emitter]) -> (Vec<u32>, Vec<Disk>) {
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
        power: Rgb,
        two_sided: bool,
    }
    let mut group_of = vec![NO_GROUP; world.scene.triangles.len()];
    let mut number: HashMap<usize, u32> = HashMap::new();
    let mut sums: Vec<Sum> = Vec::new();
    for (index, emitter) in emitters.iter().enumerate() {
        let root = root(&mut parent, index);
        let group = *number.entry(root).or_insert_with(|| {
            sums.push(Sum { two_sided: true, ..Sum::default() });
            sums.len() as u32 - 1
        });
        group_of[emitter.triangle as usize] = group;
        let sum = &mut sums[group as usize];
        let [a, b, c] = emitter.corners;
        sum.area += emitter.area;
        sum.vector_area += 0.5 * (b - a).cross(c - a);
        sum.moment += (a + b + c) * (emitter.area / 3.0);
        sum.power += emitter.radiance * emitter.area;
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
            radiance: sum.power / sum.area,
            two_sided: sum.two_sided,
            group: group as u32,
        }
    };
    (group_of, sums.iter().enumerate().map(disk).collect())
}
