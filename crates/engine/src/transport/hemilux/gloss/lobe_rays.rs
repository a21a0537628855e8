//! What a lobe reflects: rays by the lobe and rays to the lights, weighed against each other (Veach
//! and Guibas 1995), from lobe to lobe. What a lobe ray meets that is diffuse has its direct light
//! found out afresh, and the rest is the coarse solution's.

use crate::emitters::Axis;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Hit};
use crate::sampling::{Afresh, power_heuristic};
use crate::surface::{Reflection, Surface};
use crate::transport::hemilux::coarse::Coarse;
use glam::Vec3;

/// A lobe is followed if it carries at least such a share of its light to the first; what is
/// fainter, or comes later, is taken to be diffuse.
const FAINT: f32 = 0.02;

/// How often a lobe that a gather ray meets is followed: so many times its share of what the surface
/// reflects, and at least so often; and how many lobes from there.
const LOBES: f32 = 2.0;
const LEAST_LOBES: f32 = 0.1;
const MOST_LOBES: u32 = 2;

/// Random numbers of a ray through lobes.
pub struct Through {
    /// Its direction from the first.
    pub xi: [f32; 2],
    /// Those for lights, and for what lies behind.
    pub numbers: Afresh,
    /// Most lobes.
    pub most: u32,
}

/// Radiance that a surface's lobe reflects towards the unit vector `viewer`, by one ray, and by one
/// to the lights from each lobe on its way; and 1 over the distance to what it met first, 0 where
/// that is nothing. Ray by ray: many ways that are kept side by side and traced together take 0.5 to
/// 1.6 % longer.
pub fn reflected(
    coarse: &Coarse,
    surface: Surface,
    mut viewer: Vec3,
    through: Through,
) -> (Rgb, f32) {
    let Through { mut xi, mut numbers, most } = through;
    let (world, lights) = (&*coarse.world, &*coarse.lights);
    let mut surface = surface.lobe_only();
    let (mut sum, mut carried, mut nearness) = (Rgb::ZERO, Rgb::ONE, 0.0);
    for lobe in 1.. {
        let start = surface.start();
        let reflection = surface.reflection();
        let axis = Axis { direction: surface.mirrored(viewer), exponent: reflection.exponent() };
        let unoccluded = lights.toward(start, surface.normal, axis);
        if let Some(light) = lights.sample(&unoccluded, start, surface.normal, numbers.light) {
            let direction = (light.end - start).normalize_or_zero();
            let (parts, density) = reflection.evaluate_with_pdf(viewer, direction, 0.0);
            let value = parts.both();
            if value != Rgb::ZERO && !world.rays.blocked(start, light.end, |_| false) {
                sum += carried * value * light.irradiance * power_heuristic(light.density, density);
            }
        }
        let Some(scattered) = reflection.sample(viewer, 0.0, false, xi) else { break };
        let direction = scattered.direction;
        let Some(hit) = world.rays.closest(Eye::Light, start, direction) else { break };
        if lobe == 1 {
            nearness = 1.0 / hit.distance.max(1e-3);
        }
        let Some(met) = world.surface(&hit) else { break };
        let place = (start, surface.normal);
        carried *= scattered.factor.both();
        if met.emission != Rgb::ZERO {
            let other = lights.density(&unoccluded, place, &hit, met.normal, direction);
            sum += carried * met.emission * power_heuristic(scattered.pdf, other);
        }
        let worth = (carried * met.reflection().specular()).max_element();
        let Some(next) = numbers.next.filter(|_| worth > FAINT && lobe < most) else {
            sum += carried * coarse.reflected_as_diffuse(&hit, Some(numbers));
            break;
        };
        sum += carried * coarse.reflected_diffusely(&hit, numbers);
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
pub fn reflected_at(coarse: &Coarse, hit: &Hit, direction: Vec3, afresh: Option<Afresh>) -> Rgb {
    let Some(surface) = coarse.world.surface(hit) else { return Rgb::ZERO };
    let numbers = afresh.filter(|_| surface.reflection().is_glossy());
    let Some((numbers, next)) = numbers.and_then(|numbers| Some((numbers, numbers.next?))) else {
        return coarse.by_albedo(&surface, surface.reflection().mean_albedo(), hit, afresh);
    };
    let diffuse = coarse.by_albedo(&surface, surface.reflection().diffuse(), hit, Some(numbers));
    let probability =
        (LOBES * (1.0 - surface.reflection().diffuse_share(-direction))).clamp(LEAST_LOBES, 1.0);
    if next.number() >= probability {
        return diffuse;
    }
    let numbers = Afresh { next: Some(next.after()), ..next.afresh() };
    let through = Through { xi: numbers.bounce, numbers, most: MOST_LOBES };
    diffuse + reflected(coarse, surface, -direction, through).0 / probability
}
