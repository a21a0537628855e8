//! What a patch reflects and emits: means over points of it.

use crate::radiometry::{Reflectance, Rgb};
use crate::scene::{Scene, Triangle};
use crate::surface::Parameters;
use glam::Vec2;

/// Means over points of a patch.
#[derive(Clone, Copy, Default)]
pub struct CellMeans {
    /// Diffuse albedo.
    pub diffuse: Rgb,
    /// Specular albedo.
    pub specular: Rgb,
    /// Albedo under uniform light, as the material's own model has it.
    pub albedo: Rgb,
    /// Emitted radiance.
    pub emission: Rgb,
}

impl CellMeans {
    /// Over points of a triangle that are given by their barycentric (u, v).
    pub fn new(
        scene: &Scene,
        triangle: &Triangle,
        points: impl ExactSizeIterator<Item = Vec2>,
    ) -> Self {
        let material = &scene.materials[triangle.material as usize];
        let share = 1.0 / points.len() as f32;
        let mut sum = Self::default();
        for at in points {
            let appearance = scene.appearance(triangle, at.x, at.y);
            if !material.unlit {
                let reflectance = material.reflectance(&appearance);
                sum.diffuse += reflectance.diffuse;
                sum.specular += reflectance.specular;
                sum.albedo += Parameters::new(material, &appearance).mean_albedo();
            }
            sum.emission += scene.emission(triangle, at.x, at.y);
        }
        Self {
            diffuse: sum.diffuse * share,
            specular: sum.specular * share,
            albedo: sum.albedo * share,
            emission: sum.emission * share,
        }
    }

    /// Adds those of a part with a weight.
    pub fn add(&mut self, part: &Self, weight: f32) {
        self.diffuse += part.diffuse * weight;
        self.specular += part.specular * weight;
        self.albedo += part.albedo * weight;
        self.emission += part.emission * weight;
    }

    /// The means where these are sums over so much area.
    pub fn over(&self, area: f32) -> Self {
        let share = 1.0 / area.max(f32::MIN_POSITIVE);
        let mut means = Self::default();
        means.add(self, share);
        means
    }

    /// How the patch reflects, with a material's exponent.
    pub fn reflectance(&self, exponent: f32) -> Reflectance {
        Reflectance { diffuse: self.diffuse, specular: self.specular, exponent }
    }
}

/// Exponent of the lobe of a triangle's material, everywhere alike.
pub fn exponent_of(scene: &Scene, triangle: &Triangle) -> f32 {
    let material = &scene.materials[triangle.material as usize];
    material.reflectance(&material.typical(Rgb::ONE)).exponent
}

/// Whether what a triangle reflects or emits changes over it.
pub fn colour_varies(scene: &Scene, triangle: &Triangle) -> bool {
    let material = &scene.materials[triangle.material as usize];
    let [a, b, c] = scene.of_sources(triangle, |vertex| vertex.color);
    material.has_textured_reflection() || material.emission_texture.is_some() || a != b || b != c
}

/// A point of a triangle, another one for each number and spread evenly over it, so that no texture
/// is in step with the points of many triangles: a checker would look all black or all white to
/// them.
pub fn point_of([a, b, c]: [Vec2; 3], number: u32) -> Vec2 {
    let step = Vec2::new(0.754_877_7, 0.569_840_3);
    let mut at = (step * (number % (1 << 14)) as f32).fract();
    if at.x + at.y > 1.0 {
        at = 1.0 - at;
    }
    a * (1.0 - at.x - at.y) + b * at.x + c * at.y
}
