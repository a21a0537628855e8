//! Scenes for the tests of the tiers, prepared as far as those need them.

use super::coarse::{CoarseMesh, CoarseSolution, Drawing, Elements};
use super::fragments::VisibleSurfaces;
use crate::emitters::DirectLights;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::sampling::Seed;
use crate::scene::environment::{Environment, SUN_RADIUS, Sky, Sun};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made::revolved::ball;
use crate::scene::{Material, Scene, made};
use crate::surface::World;
use glam::Vec3;
use std::sync::Arc;

/// What random numbers of these tests are drawn by.
pub const SEED: Seed = Seed { number: 7, well_spread: true };
/// How their coarse solutions are drawn.
pub const DRAWING: Drawing = Drawing { seed: SEED, hasty: false };
/// What the furnace's walls reflect, and the radiance that they emit.
pub const ALBEDO: f32 = 0.5;
pub const EMISSION: f32 = 2.0;
/// Irradiance of a sun on a plane that faces it.
pub const IRRADIANCE: f32 = 100.0;

/// A scene with its coarse mesh.
pub struct Specimen {
    pub world: Arc<World>,
    pub lights: Arc<DirectLights>,
    pub cut: Arc<Cut>,
    pub coarse: CoarseSolution,
}

impl Specimen {
    /// Of a file, with about so many patches, whose light has been solved for once.
    pub fn new(glb: &[u8], patches: usize) -> Self {
        Self::surrounded(glb, Environment::none(), patches)
    }

    /// The same in its surroundings.
    pub fn surrounded(glb: &[u8], environment: Environment, patches: usize) -> Self {
        let scene = import(glb, &Resources::new(), &ImportLimits::default()).expect("valid");
        Self::of(scene, environment, patches)
    }

    /// The same of a scene.
    pub fn of(scene: Scene, environment: Environment, patches: usize) -> Self {
        let scene = Arc::new(scene);
        let world = Arc::new(World::surrounded(scene.clone(), Arc::new(environment)));
        let lights = DirectLights::new(&world).expect("something shines");
        let lights = Arc::new(lights);
        let cut = Arc::new(Cut::new(scene, patches, None));
        let elements = Elements::new(&cut, patches);
        let mesh = CoarseMesh::new(&world.rays, cut.clone(), elements).with_crevices(&world, false);
        let mut coarse = CoarseSolution::new(world.clone(), lights.clone(), mesh, DRAWING, None);
        coarse.link(SEED, 0, 16);
        Self { world, lights, cut, coarse }
    }

    /// A ball of radius 1 in so many slices under a sun of irradiance [`IRRADIANCE`], its camera to be placed.
    pub fn sunlit_ball(material: Material, slices: u32, sun: Vec3) -> (Scene, Environment) {
        let sun = Sun::towards(sun, Rgb::splat(IRRADIANCE), SUN_RADIUS);
        (
            ball(slices, material),
            Environment { sky: Sky::None, sun: Some(sun), ..Environment::none() },
        )
    }

    /// A closed box in which the radiance is [`EMISSION`]/(1 − [`ALBEDO`]) everywhere and in every
    /// direction, so that every part of the light is known exactly.
    pub fn furnace() -> Self {
        Self::new(&made::furnace(Rgb::splat(ALBEDO), Rgb::splat(EMISSION)), 200)
    }

    /// What the scene's camera sees in a small picture.
    pub fn visible(&self) -> VisibleSurfaces {
        let camera = &self.world.scene.cameras[0];
        VisibleSurfaces::new(&self.world, self.cut.clone(), camera, [24, 20], 16)
    }
}

/// Irradiance that a ball of radius 1 which reflects everything mirrors from a sun in that direction to an eye, on a
/// plane that faces it, and the cosine θ between normal and sun where it does: E/((1 + 2d cos θ) (1 + 2d/cos θ)) at a
/// distance d from there.
pub fn mirrored_by_ball(sun: Vec3, eye: Vec3) -> (f64, f64) {
    let (sun, eye) = (sun.as_dvec3().normalize(), eye.as_dvec3());
    let mut normal = sun;
    for _ in 0..20 {
        normal = (sun + (eye - normal).normalize()).normalize();
    }
    let (cosine, distance) = (normal.dot(sun), eye.distance(normal));
    let spread = (1.0 + 2.0 * distance * cosine) * (1.0 + 2.0 * distance / cosine);
    (f64::from(IRRADIANCE) / spread, cosine)
}

/// Whether all channels are within a share of the exact value.
pub fn is_near(value: Rgb, exact: f32, share: f32) -> bool {
    (value - Rgb::splat(exact)).abs().max_element() <= share * exact.abs()
}
