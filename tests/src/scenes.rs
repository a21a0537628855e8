//! Small scenes built directly, for tests that need exact control.

use glam::Vec3;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Device, ShootingSettings, Sums};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::{Material, Scene, Triangle, Vertex};
use std::sync::Arc;

/// Imports a scene that must be valid.
pub fn imported(glb: &[u8]) -> Arc<Scene> {
    Arc::new(import(glb, &Resources::new(), &ImportLimits::default()).expect("a valid scene"))
}

/// A scene under construction.
#[derive(Default)]
pub struct Builder {
    scene: Scene,
}

impl Builder {
    /// Adds a material and says its index.
    pub fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// A Lambertian material.
    pub fn lambertian(&mut self, albedo: Rgb) -> u32 {
        self.material(Material::lambertian("lambertian", albedo))
    }

    /// A Lambertian emitter.
    pub fn light(&mut self, albedo: Rgb, emission: Rgb) -> u32 {
        self.material(Material { emission, ..Material::lambertian("light", albedo) })
    }

    /// A parallelogram whose front is the side from which `edge_u` to `edge_v` turns left.
    pub fn quad(&mut self, corner: Vec3, edge_u: Vec3, edge_v: Vec3, material: u32) -> &mut Self {
        let normal = edge_u.cross(edge_v).normalize();
        let first = self.scene.vertices.len() as u32;
        for position in [corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v] {
            self.scene.vertices.push(Vertex::new(position, normal));
        }
        for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
            self.scene.triangles.push(Triangle { vertices, material });
        }
        self
    }

    /// A regular polygon about `center` with corners at `radius`·(cos·u + sin·v), whose front is
    /// the side from which `u` to `v` turns left.
    pub fn polygon(
        &mut self,
        center: Vec3,
        [u, v]: [Vec3; 2],
        radius: f32,
        sides: u32,
        material: u32,
    ) -> &mut Self {
        let normal = u.cross(v).normalize();
        let first = self.scene.vertices.len() as u32;
        let rim = (0..sides).map(|side| {
            let (sin, cos) = (side as f32 / sides as f32 * std::f32::consts::TAU).sin_cos();
            center + radius * (cos * u + sin * v)
        });
        for position in std::iter::once(center).chain(rim) {
            self.scene.vertices.push(Vertex::new(position, normal));
        }
        for side in 0..sides {
            let vertices = [first, first + 1 + side, first + 1 + (side + 1) % sides];
            self.scene.triangles.push(Triangle { vertices, material });
        }
        self
    }

    /// An axis-parallel box seen from inside (`inward`) or outside.
    pub fn cuboid(&mut self, low: Vec3, high: Vec3, inward: bool, material: u32) -> &mut Self {
        let size = high - low;
        let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
        for (corner, u, v) in [
            (low, x, y),
            (low, y, z),
            (low, z, x),
            (low + z, y, x),
            (low + x, z, y),
            (low + y, x, z),
        ] {
            let (u, v) = if inward { (u, v) } else { (v, u) };
            self.quad(corner, u, v, material);
        }
        self
    }

    /// The scene.
    pub fn build(self) -> Arc<Scene> {
        Arc::new(self.scene)
    }
}

/// Settings with everything random switched on.
pub fn settings(resolution: u32, shots_per_iteration: u32, seed: u64) -> ShootingSettings {
    ShootingSettings { resolution, shots_per_iteration, seed, ..ShootingSettings::default() }
}

/// Runs iterations on the CPU device after `burn_in` that are dropped.
pub fn solve(
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    burn_in: u32,
    iterations: u32,
) -> (Sums, f64) {
    let mut device = CpuDevice::new(None).expect("threads");
    let mut shooting = device.begin(scene.clone(), settings).expect("the CPU device begins");
    shooting.iterate(burn_in).expect("the CPU device does not fail");
    shooting.drain().expect("the CPU device does not fail");
    let tally = shooting.iterate(iterations).expect("the CPU device does not fail");
    let sums = shooting.drain().expect("the CPU device does not fail");
    (sums, tally.light_shots as f64 / tally.shots.max(1) as f64)
}
