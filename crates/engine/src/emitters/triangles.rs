//! Emissive triangles, sampled by their power: for direct light, and for paths that begin at
//! lights.

use super::cells::{CellLimits, EmissionCells};
use super::of_triangles::OfTriangles;
use crate::radiometry::{Rgb, importance};
use crate::rays::{Spot, unit_normal};
use crate::sampling::Discrete;
use crate::scene::Material;
use crate::surface::{Surface, World};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// How finely emissive textures are divided for picks, which take little longer where cells are
/// many.
const CELLS: CellLimits = CellLimits { most: 1 << 15, least_difference: 1e-6, fine: 1.0, dim: 0.0 };

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
    /// Mean emitted radiance.
    pub radiance: Rgb,
}

/// The emissive triangles of a scene.
pub struct TriangleLights {
    emitters: Vec<Emitter>,
    /// What is picked: parts of textured triangles, a cell each, then whole triangles.
    parts: Vec<Part>,
    choice: Discrete,
    cells: EmissionCells,
    /// Probability per area of each of `parts`, square ray units.
    density: Vec<f32>,
    /// Of each triangle that shines and has no texture, which of `parts` it is.
    whole: OfTriangles,
}

/// A part of an emissive triangle, in which points are uniform.
struct Part {
    /// Index into [`TriangleLights::emitters`].
    emitter: u32,
    /// Barycentric coordinates of its corners.
    corners: [Vec2; 3],
    /// Its share of the triangle's area.
    share: f32,
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
        let cells = EmissionCells::new(world, CELLS);
        let mut parts =
            Parts { world, emitters: Vec::new(), parts: Vec::new(), weights: Vec::new() };
        let mut textured: HashMap<u32, u32> = HashMap::new();
        for cell in &cells.cells {
            let emitter = *textured
                .entry(cell.triangle)
                .or_insert_with(|| parts.add_emitter(cell.triangle, Rgb::ZERO));
            // Together they have the triangle's mean.
            parts.emitters[emitter as usize].radiance += cell.radiance * cell.share;
            parts.add(emitter, cell.corners, cell.share, cell.radiance);
        }
        let mut whole = OfTriangles::new(scene);
        let is_untextured =
            |material: &Material| material.emits() && material.emission_texture.is_none();
        for index in scene.triangles_of(is_untextured) {
            let material = world.material(index);
            if world.rays.corners(scene, index).1 > 0.0 {
                let emitter = parts.add_emitter(index, material.emission);
                whole.set(index, parts.parts.len() as u32);
                parts.add(emitter, [Vec2::ZERO, Vec2::X, Vec2::Y], 1.0, material.emission);
            }
        }
        let Parts { emitters, parts, weights, .. } = parts;
        if !weights.iter().any(|weight| *weight > 0.0) {
            return None;
        }
        let choice = Discrete::new(weights.into_iter());
        let density = |(index, part): (usize, &Part)| {
            let area = emitters[part.emitter as usize].area * part.share;
            (choice.probability(index) / f64::from(area)) as f32
        };
        let density = parts.iter().enumerate().map(density).collect();
        Some(Self { emitters, parts, choice, cells, density, whole })
    }

    /// The part that a place of a triangle belongs to; `None` where it is black.
    fn part_at(&self, triangle: u32, at: [f32; 2]) -> Option<usize> {
        match self.whole.of(triangle) {
            None => self.cells.find(triangle, at),
            Some(part) => Some(part as usize),
        }
    }

    /// A point of the emissive triangles by uniform numbers: of which emitter, where in
    /// barycentric coordinates, and its density per area.
    fn point(&self, pick: f64, xi: [f32; 2]) -> (&Emitter, [f32; 2], f32) {
        let index = self.choice.pick(pick);
        let Part { emitter, corners: [a, b, c], .. } = self.parts[index];
        let root = xi[0].sqrt();
        let (u, v) = (root * (1.0 - xi[1]), root * xi[1]);
        let at = a * (1.0 - u - v) + b * u + c * v;
        (&self.emitters[emitter as usize], at.to_array(), self.density[index])
    }

    /// A point of the emissive triangles, picked by power, uniform over cells; `None` where
    /// `surface` can't see its light.
    pub fn sample(
        &self,
        world: &World,
        surface: &Surface,
        pick: f64,
        xi: [f32; 2],
    ) -> Option<LightSample> {
        let (emitter, [u, v], per_area) = self.point(pick, xi);
        if emitter.triangle == surface.triangle {
            return None;
        }
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
        let density = per_area * square / cosine.abs();
        let end = spot.off_surface(spot.normal * cosine.signum());
        let radiance = world.emission(emitter.triangle, u, v);
        Some(LightSample { end, direction, radiance, density })
    }

    /// Density per solid angle at which [`TriangleLights::sample`] picks the place of `light` that
    /// a ray along the unit `direction` met at `distance`.
    pub fn density(&self, light: &Surface, direction: Vec3, distance: f32) -> f32 {
        let cosine = light.normal.dot(direction).abs().max(f32::MIN_POSITIVE);
        let part = self.part_at(light.triangle, light.at);
        part.map_or(0.0, |part| self.density[part]) * distance * distance / cosine
    }

    /// A point of the emissive triangles, picked by power, uniform over cells.
    pub fn emit(&self, world: &World, pick: f64, xi: [f32; 2]) -> EmissionSample {
        let (emitter, [u, v], density) = self.point(pick, xi);
        EmissionSample {
            triangle: emitter.triangle,
            spot: Spot::new(emitter.corners, emitter.normal, u, v),
            radiance: world.emission(emitter.triangle, u, v),
            two_sided: world.is_two_sided(emitter.triangle),
            density,
        }
    }

    /// The emissive triangles.
    pub fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }
}

/// The emitters and their parts while they are listed.
struct Parts<'a> {
    world: &'a World,
    emitters: Vec<Emitter>,
    parts: Vec<Part>,
    /// Importance of each part's power, over π: it is picked in proportion to this.
    weights: Vec<f64>,
}

impl Parts<'_> {
    fn add_emitter(&mut self, triangle: u32, radiance: Rgb) -> u32 {
        let (corners, area) = self.world.rays.corners(&self.world.scene, triangle);
        let normal = unit_normal(corners);
        self.emitters.push(Emitter { triangle, corners, normal, area, radiance });
        self.emitters.len() as u32 - 1
    }

    fn add(&mut self, emitter: u32, corners: [Vec2; 3], share: f32, radiance: Rgb) {
        let Emitter { triangle, area, .. } = &self.emitters[emitter as usize];
        let sides = if self.world.is_two_sided(*triangle) { 2.0 } else { 1.0 };
        let weight = f64::from(importance(radiance)) * f64::from(*area) * f64::from(share) * sides;
        self.parts.push(Part { emitter, corners, share });
        self.weights.push(if weight.is_finite() { weight } else { 0.0 });
    }
}
