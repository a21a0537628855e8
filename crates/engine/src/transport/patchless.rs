//! Light that no patch sends: of the sky, of the sun and of lights without extent. Methods that
//! shoot light from patches can't shoot this; so they find what it does to every patch before they
//! begin, by shadow rays from points of the patch, and shoot what the patches reflect of it.

use super::light_sums::LightSums;
use super::patch_points::PatchPoints;
use crate::emitters::DirectLights;
use crate::patches::{PatchIndex, PatchedScene};
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::sampling::{Seed, Shifted};
use crate::scene::environment::Environment;
use crate::scene::{PunctualLight, Scene};
use crate::surface::World;
use rayon::prelude::*;
use std::sync::Arc;

/// Fewest and most shadow rays of a patch.
const RAYS: (usize, usize) = (32, 256);
/// Shadow rays of all patches together that are worth their time, about a second of two cores.
const ALL_RAYS: usize = 1 << 20;

/// Whether there is any.
pub fn shines(scene: &Scene, environment: &Environment) -> bool {
    !environment.is_dark() || scene.lights.iter().any(PunctualLight::shines)
}

/// Mean irradiance of every patch by it, without what is reflected; `None` where there is no such
/// light. The same seed gives the same bits.
pub fn irradiance(
    scene: &PatchedScene,
    environment: &Arc<Environment>,
    seed: u64,
) -> Option<Vec<Rgb>> {
    if !shines(&scene.scene, environment) {
        return None;
    }
    let world = World::surrounded(scene.scene.clone(), environment.clone());
    let lights = DirectLights::without_surfaces(&world)?;
    let patches = scene.patches.len();
    let rays = (ALL_RAYS / patches.max(1)).clamp(RAYS.0, RAYS.1);
    let seed = Seed { number: seed, well_spread: true };
    let of_patch = |patch: usize| {
        let points = PatchPoints::new(&world, scene, PatchIndex(patch as u32));
        let mut sequence = Shifted::new(seed, Stream::PatchLight, patch as u64);
        let mut sums = LightSums::default();
        for _ in 0..rays {
            let (start, normal) = points.point(sequence.next_pair());
            sums.add(lights.sample_by_shadow_ray(&world, start, normal, sequence.triple()));
        }
        sums.irradiance()
    };
    Some((0..patches).into_par_iter().with_max_len(64).map(of_patch).collect())
}
