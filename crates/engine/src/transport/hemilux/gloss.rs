//! Lobes: what a glossy fragment's mirror lobe shows of the scene. Rays by the lobe and rays to
//! the lights, weighed against each other (Veach and Guibas 1995); where a lobe ray ends, the
//! direct light is found out afresh and the rest is the coarse solution's.

use super::fragments::{Fragment, Seen};
use super::lights::Lights;
use super::sequence::{Seed, Shifted};
use super::shoot::Coarse;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::Eye;
use crate::transport::ray_traced::surface::World;
use rayon::prelude::*;

/// Lobe rays of a fragment in each pass, and as many to the lights.
const RAYS: u32 = 8;

/// Light that the lobes of glossy fragments reflect towards the camera.
pub struct Gloss {
    /// Glossy fragments, ascending.
    fragments: Vec<u32>,
    /// Per glossy fragment: Σ radiance, Σ squared radiance over rays.
    pub(super) sums: Vec<(Rgb, Rgb)>,
    /// Passes so far.
    pub(super) passes: u32,
}

impl Gloss {
    /// Without a ray.
    pub fn new(seen: &Seen) -> Self {
        let all = seen.fragments.iter().enumerate();
        let fragments: Vec<u32> =
            all.filter(|(_, fragment)| fragment.glossy).map(|(index, _)| index as u32).collect();
        let sums = vec![(Rgb::ZERO, Rgb::ZERO); fragments.len()];
        Self { fragments, sums, passes: 0 }
    }

    /// Number of glossy fragments.
    pub fn len(&self) -> usize {
        self.fragments.len()
    }

    /// Casts another pass of rays.
    pub fn pass(
        &mut self,
        world: &World,
        lights: &Lights,
        coarse: &Coarse<'_>,
        seen: &Seen,
        seed: Seed,
    ) {
        let passes = self.passes;
        let all = self.sums.par_iter_mut().zip(&self.fragments).with_max_len(256);
        all.for_each(|(sum, fragment)| {
            let fragment = &seen.fragments[*fragment as usize];
            for ray in passes * RAYS..(passes + 1) * RAYS {
                let radiance = lobe(world, lights, coarse, seen, fragment, seed, ray);
                sum.0 += radiance;
                sum.1 += radiance * radiance;
            }
        });
        self.passes += 1;
    }

    /// Adds each glossy fragment's radiance and the variance of it: `each(fragment, radiance,
    /// variance)`.
    pub fn each(&self, mut each: impl FnMut(usize, Rgb, Rgb)) {
        let count = (self.passes * RAYS).max(2) as f32;
        for (fragment, (sum, squares)) in self.fragments.iter().zip(&self.sums) {
            let mean = *sum / count;
            let scatter = (*squares / count - mean * mean).max(Rgb::ZERO);
            each(*fragment as usize, mean, scatter / (count - 1.0));
        }
    }
}

fn lobe(
    world: &World,
    lights: &Lights,
    coarse: &Coarse<'_>,
    seen: &Seen,
    fragment: &Fragment,
    seed: Seed,
    ray: u32,
) -> Rgb {
    let sequence = Shifted::new(seed, Stream::Gloss, u64::from(fragment.pixel));
    let mut sum = Rgb::ZERO;
    let mut surface = seen.surface(world, fragment, ray);
    surface.reflectance.diffuse = Rgb::ZERO;
    let (start, viewer) = (surface.start(), seen.frame.towards_eye(surface.spot.point));
    let unoccluded = lights.unoccluded(start, surface.normal);
    let at = sequence.at(ray);
    if let Some(scattered) = surface.scatter(viewer, 0.0, false, at.pair())
        && let Some(hit) = world.rays.closest(Eye::Light, start, scattered.direction)
        && let Some(met) = world.surface(&hit)
    {
        let mut radiance = coarse.reflected(&hit, Some(at.afresh()));
        if met.emission != Rgb::ZERO {
            let other = lights.density(
                &unoccluded,
                (start, surface.normal),
                &hit,
                met.normal,
                scattered.direction,
            );
            radiance += met.emission * heuristic(scattered.density, other);
        }
        sum += scattered.factor.both() * radiance;
    }
    if let Some(light) = lights.sample(&unoccluded, start, surface.normal, at.triple()) {
        let direction = (light.end - start).normalize_or_zero();
        let (parts, density) = surface.evaluate(viewer, direction, 0.0);
        let value = parts.both();
        if value != Rgb::ZERO && !world.rays.blocked(start, light.end, |_| false) {
            sum += value * light.irradiance * heuristic(light.density, density);
        }
    }
    sum
}

/// Weight of a sample whose own density is `own` where the other way has density `other`: the
/// power heuristic with exponent 2.
fn heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    let ratio = other / own.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + ratio * ratio)
}
