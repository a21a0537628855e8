//! Radiance between diffuse and glossy surfaces by random walks from the receiver: no patches of
//! the engine but their materials, no hemicube, no stored irradiance.
//!
//! f_r = kd/π + ks (n+2)/(2π) cosⁿα, one channel.

use super::rays::{Generator, Hit, World, cosine_direction};
use super::statistics::Moments;
use glam::DVec3;
use hemilux_engine::patches::PatchedScene;
use std::f64::consts::{PI, TAU};

/// What a patch reflects and emits in one channel.
#[derive(Clone, Copy, Debug)]
struct Surface {
    diffuse: f64,
    specular: f64,
    exponent: f64,
    emission: f64,
}

/// Random walks through a scene.
pub struct Walks {
    world: World,
    surfaces: Vec<Surface>,
}

/// Walks this much shorter than the light they could still bring are ended by chance.
const ROULETTE: f64 = 0.3;

impl Walks {
    /// Walks through a scene, in its red channel.
    pub fn new(scene: &PatchedScene) -> Self {
        let patches = &scene.patches;
        let surface = |i: usize| Surface {
            diffuse: f64::from(patches.diffuse[i].x),
            specular: f64::from(patches.specular[i].x),
            exponent: f64::from(patches.exponent[i]),
            emission: f64::from(patches.emission[i].x),
        };
        Self { world: World::new(scene), surfaces: (0..patches.len()).map(surface).collect() }
    }

    /// Irradiance of a patch, averaged over it: `count` walks.
    pub fn irradiance(&self, patch: usize, count: u64, generator: &mut Generator) -> Moments {
        let mut moments = Moments::default();
        for _ in 0..count {
            let [a, b, c, d] = [(); 4].map(|()| generator.uniform());
            let from = self.world.point(patch, a, b);
            let direction = cosine_direction(self.world.normal(patch), c, d);
            let hit = self.world.cast(patch, from, direction);
            moments.push(PI * self.radiance(hit, direction, generator));
        }
        moments
    }

    /// An estimate of the radiance that arrives at `eye` from a direction.
    pub fn seen(&self, eye: DVec3, direction: DVec3, generator: &mut Generator) -> f64 {
        self.radiance(self.world.look(eye, direction), direction, generator)
    }

    /// An estimate of the radiance that comes from what a ray hit.
    fn radiance(&self, mut hit: Hit, mut direction: DVec3, generator: &mut Generator) -> f64 {
        let (mut radiance, mut weight) = (0.0, 1.0);
        loop {
            let Hit::Patch { patch, point } = hit else { return radiance };
            let surface = self.surfaces[patch];
            radiance += weight * surface.emission;
            let normal = self.world.normal(patch);
            let Some((next, factor)) = surface.scatter(normal, -direction, generator) else {
                return radiance;
            };
            weight *= factor;
            if weight < ROULETTE {
                if generator.uniform() * ROULETTE >= weight {
                    return radiance;
                }
                weight = ROULETTE;
            }
            (hit, direction) = (self.world.cast(patch, point, next), next);
        }
    }
}

impl Surface {
    /// A direction that light comes from which leaves towards `outgoing`, and f_r·cosθ over the
    /// density that it was picked with. `None` where the pick lies below the horizon.
    fn scatter(
        &self,
        normal: DVec3,
        outgoing: DVec3,
        generator: &mut Generator,
    ) -> Option<(DVec3, f64)> {
        let Self { diffuse, specular, exponent, .. } = *self;
        let total = diffuse + specular;
        if total <= 0.0 {
            return None;
        }
        let lobe_share = specular / total;
        let mirror = 2.0 * normal.dot(outgoing) * normal - outgoing;
        let [pick, u, v] = [(); 3].map(|()| generator.uniform());
        let direction = if pick < lobe_share {
            lobe_direction(mirror, exponent, u, v)
        } else {
            cosine_direction(normal, u, v)
        };
        let cosine = normal.dot(direction);
        if cosine <= 0.0 {
            return None;
        }
        let lobe = mirror.dot(direction).max(0.0).powf(exponent);
        let density = (1.0 - lobe_share) * cosine / PI + lobe_share * (exponent + 1.0) / TAU * lobe;
        let reflectance = diffuse / PI + specular * (exponent + 2.0) / TAU * lobe;
        Some((direction, reflectance * cosine / density))
    }
}

/// A direction about `axis` whose density is (n+1)/(2π) cosⁿα.
fn lobe_direction(axis: DVec3, exponent: f64, u: f64, v: f64) -> DVec3 {
    let helper = if axis.x.abs() < 0.5 { DVec3::X } else { DVec3::Y };
    let tangent = helper.cross(axis).normalize();
    let bitangent = axis.cross(tangent);
    let cosine = (1.0 - u).powf(1.0 / (exponent + 1.0));
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (along, across) = (TAU * v).sin_cos();
    axis * cosine + tangent * (sine * across) + bitangent * (sine * along)
}
