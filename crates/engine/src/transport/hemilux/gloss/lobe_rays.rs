//! Radiance that a glossy lobe reflects: rays sampled by the lobe and rays sampled by the lights,
//! combined by the power heuristic (Veach and Guibas 1995), from lobe to lobe. Where such a ray
//! ends on a diffuse surface, direct light is found afresh, and bounced light is the coarse
//! solution's.

use crate::emitters::LobeAxis;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Hit};
use crate::sampling::{Afresh, power_heuristic};
use crate::surface::{Reflection, Surface};
use crate::transport::hemilux::coarse::CoarseSolution;
use glam::Vec3;

/// A path goes on by the next lobe if at least this share of its radiance would get to the first
/// one; else that lobe is taken to be diffuse.
const LEAST_CARRIED: f32 = 0.02;

/// Probability at which a gather ray follows a lobe that it meets, as a multiple of the lobe's
/// share of what the surface reflects.
const FOLLOWED_PER_SHARE: f32 = 2.0;
/// Lower bound of that probability: its inverse, 10, is the largest weight of such a path.
const LEAST_FOLLOWED: f32 = 0.1;
/// Most lobes that a gather ray follows one after the other.
const MOST_LOBES: u32 = 2;

/// Random numbers of a path from lobe to lobe, and its greatest length.
pub struct LobePathNumbers {
    /// Its direction from the first.
    pub xi: [f32; 2],
    /// Numbers for the lights, and for what comes after.
    pub numbers: Afresh,
    /// Most lobes that it follows.
    pub most_lobes: u32,
}

/// Radiance that a surface's lobe reflects towards the unit vector `viewer`, by one ray, and by one
/// to the lights from each lobe on its way; and 1 over the distance to what it met first, 0 where
/// that is nothing. Paths are traced one by one: many paths side by side took 0.5 to 1.6 % longer.
pub fn radiance_by_lobe(
    coarse: &CoarseSolution,
    surface: Surface,
    mut viewer: Vec3,
    path_numbers: LobePathNumbers,
) -> (Rgb, f32) {
    let LobePathNumbers { mut xi, mut numbers, most_lobes } = path_numbers;
    let (world, lights) = (&*coarse.world, &*coarse.lights);
    let mut surface = surface.lobe_only();
    let (mut sum, mut carried, mut nearness) = (Rgb::ZERO, Rgb::ONE, 0.0);
    for lobe in 1.. {
        let start = surface.start();
        let reflection = surface.reflection();
        let axis =
            LobeAxis { direction: surface.mirrored(viewer), exponent: reflection.exponent() };
        let normal = surface.shading_normal;
        let unoccluded = lights.for_lobe(start, normal, axis);
        if let Some(light) = lights.sample(&unoccluded, start, normal, numbers.light) {
            let direction = (light.end - start).normalize_or_zero();
            let (parts, density) = reflection.evaluate_with_pdf(viewer, direction, 0.0);
            let value = parts.both();
            let above = surface.normal.dot(direction) > 0.0;
            if value != Rgb::ZERO && above && !world.rays.blocked(start, light.end, |_| false) {
                sum += carried * value * light.irradiance * power_heuristic(light.density, density);
            }
        }
        let Some(scattered) = reflection.sample(viewer, 0.0, false, xi) else { break };
        let direction = scattered.direction;
        let Some(hit) = world.rays.closest(Eye::Light, start, direction) else {
            carried *= scattered.factor.both();
            for (radiance, other) in lights.escaping(&unoccluded, normal, direction) {
                if radiance != Rgb::ZERO {
                    sum += carried * radiance * power_heuristic(scattered.pdf, other);
                }
            }
            break;
        };
        if lobe == 1 {
            nearness = 1.0 / hit.distance.max(1e-3);
        }
        let Some(met) = world.surface(&hit) else { break };
        let place = (start, normal);
        carried *= scattered.factor.both();
        if met.emission != Rgb::ZERO {
            let other = lights.density(&unoccluded, place, &hit, met.normal, direction);
            sum += carried * met.emission * power_heuristic(scattered.pdf, other);
        }
        let next_carried = (carried * met.reflection().specular()).max_element();
        let Some(next) = numbers.next.filter(|_| next_carried > LEAST_CARRIED && lobe < most_lobes)
        else {
            sum += carried * coarse.reflected_as_diffuse(&hit, Some(numbers));
            break;
        };
        sum += carried * coarse.reflected_diffusely(&hit, -direction, numbers);
        (surface, viewer) = (met.lobe_only(), -direction);
        numbers = Afresh { next: Some(next.after()), ..next.afresh() };
        xi = numbers.bounce;
    }
    (sum, nearness)
}

/// Radiance that a hit reflects against the `direction` of the ray. With random numbers the
/// light there is found out afresh: the emitters' by a shadow ray, what a lobe reflects, at
/// times, by another ray, and, where the patch is so near that its mean will not do, what has
/// bounced by one more.
pub fn reflected_at(
    coarse: &CoarseSolution,
    hit: &Hit,
    direction: Vec3,
    afresh: Option<Afresh>,
) -> Rgb {
    let Some(surface) = coarse.world.surface(hit) else { return Rgb::ZERO };
    let numbers = afresh.filter(|_| surface.reflection().is_glossy());
    let Some((numbers, next)) = numbers.and_then(|numbers| Some((numbers, numbers.next?))) else {
        return coarse.by_albedo(&surface, surface.reflection().mean_albedo(), hit, afresh);
    };
    let diffuse =
        coarse.by_albedo(&surface, surface.reflection().diffuse(-direction), hit, Some(numbers));
    let probability = (FOLLOWED_PER_SHARE * (1.0 - surface.reflection().diffuse_share(-direction)))
        .clamp(LEAST_FOLLOWED, 1.0);
    if next.number() >= probability {
        return diffuse;
    }
    let numbers = Afresh { next: Some(next.after()), ..next.afresh() };
    let path_numbers = LobePathNumbers { xi: numbers.bounce, numbers, most_lobes: MOST_LOBES };
    diffuse + radiance_by_lobe(coarse, surface, -direction, path_numbers).0 / probability
}
