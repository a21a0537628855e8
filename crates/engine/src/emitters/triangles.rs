//! Emissive triangles, sampled by their power: for direct light, and for paths that begin at
//! lights.

use crate::patches::cells;
use crate::radiometry::{Rgb, importance};
use crate::rays::{Spot, unit_normal};
use crate::sampling::Discrete;
use crate::surface::{Surface, World};
use glam::Vec3;

/// Share of the pick that goes by the material's emission factor without its texture, so that
/// bright parts of a texture that the 64 samples of its mean missed are still picked.
const FACTOR_SHARE: f64 = 0.1;

/// An emissive triangle.
pub struct Emitter {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// Corners, ray units.
    pub corners: [Vec3; 3],
    /// Unit normal of the front.
    normal: Vec3,
    /// Area, square ray units.
    pub area: f32,
    /// Importance of its power, over π: it is picked in proportion to this.
    weight: f64,
    /// Mean emitted radiance.
    pub radiance: Rgb,
}

/// The emissive triangles of a scene.
pub struct TriangleLights {
    emitters: Vec<Emitter>,
    choice: Discrete,
    /// Probability per area, by scene triangle.
    density: Vec<f32>,
}

/// A point of a light, sampled for a surface.
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

/// A point of a light, sampled for a path that begins there.
pub struct EmissionSample {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// The point.
    pub spot: Spot,
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Whether both sides emit.
    pub two_sided: bool,
    /// Density per area, square ray units.
    pub density: f32,
}

impl TriangleLights {
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
                let normal = unit_normal(corners);
                emitters.push(Emitter { triangle, corners, normal, area, weight, radiance });
            }
        }
        if emitters.is_empty() {
            return None;
        }
        let choice = Discrete::new(emitters.iter().map(|emitter| emitter.weight));
        let mut density = vec![0.0; scene.triangles.len()];
        for (index, emitter) in emitters.iter().enumerate() {
            density[emitter.triangle as usize] =
                (choice.probability(index) / f64::from(emitter.area)) as f32;
        }
        Some(Self { emitters, choice, density })
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
        let spot = Spot::new(emitter.corners, emitter.normal, u, v);
        let between = spot.point - surface.spot.point;
        let square = between.length_squared();
        let direction = between / square.sqrt();
        let cosine = -spot.normal.dot(direction);
        let seen = cosine > 0.0 || (cosine < 0.0 && world.is_two_sided(emitter.triangle));
        if !seen
            || surface.normal.dot(direction) <= 0.0
            || surface.shading_normal.dot(direction) <= 0.0
        {
            return None;
        }
        let density = self.density[emitter.triangle as usize] * square / cosine.abs();
        let end = spot.off_surface(spot.normal * cosine.signum());
        let radiance = world.emission(emitter.triangle, u, v);
        Some(LightSample { end, direction, radiance, density })
    }

    /// Density per solid angle at which [`TriangleLights::sample`] picks the place of `light` that
    /// a ray along the unit `direction` met at `distance`.
    pub fn density(&self, light: &Surface, direction: Vec3, distance: f32) -> f32 {
        let cosine = light.normal.dot(direction).abs().max(f32::MIN_POSITIVE);
        self.density[light.triangle as usize] * distance * distance / cosine
    }

    /// A point of the emissive triangles, picked by power, uniform over the triangle.
    pub fn emit(&self, world: &World, pick: f64, xi: [f32; 2]) -> EmissionSample {
        let emitter = &self.emitters[self.choice.pick(pick)];
        let root = xi[0].sqrt();
        let (u, v) = (root * (1.0 - xi[1]), root * xi[1]);
        EmissionSample {
            triangle: emitter.triangle,
            spot: Spot::new(emitter.corners, emitter.normal, u, v),
            radiance: world.emission(emitter.triangle, u, v),
            two_sided: world.is_two_sided(emitter.triangle),
            density: self.density[emitter.triangle as usize],
        }
    }

    /// The emissive triangles.
    pub fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }
}

/// Emission averaged over a triangle by 64 samples where a texture varies it.
fn mean_emission(world: &World, triangle: u32) -> Rgb {
    if !world.varies(triangle) {
        return world.emission(triangle, 0.0, 0.0);
    }
    let samples: Vec<Rgb> = cells(8)
        .map(|[a, b, c]| (a + b + c) / 3.0)
        .map(|at| world.emission(triangle, at.x, at.y))
        .collect();
    samples.iter().sum::<Rgb>() / samples.len() as f32
}
