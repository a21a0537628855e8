//! Scenes for the tests of the tiers, prepared as far as those need them.

use super::coarse::{CoarseMesh, CoarseSolution, Drawing, Elements};
use super::fragments::VisibleSurfaces;
use crate::emitters::DirectLights;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::sampling::Seed;
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::{Environment, Scene, made};
use crate::surface::World;
use std::sync::Arc;

/// What random numbers of these tests are drawn by.
pub const SEED: Seed = Seed { number: 7, well_spread: true };
/// How their coarse solutions are drawn.
pub const DRAWING: Drawing = Drawing { seed: SEED, hasty: false };
/// What the furnace's walls reflect, and the radiance that they emit.
pub const ALBEDO: f32 = 0.5;
pub const EMISSION: f32 = 2.0;

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

/// Whether all channels are within a share of the exact value.
pub fn is_near(value: Rgb, exact: f32, share: f32) -> bool {
    (value - Rgb::splat(exact)).abs().max_element() <= share * exact.abs()
}
