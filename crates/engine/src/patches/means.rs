//! What a patch reflects and emits: means over points of it.

use crate::radiometry::{Reflectance, Rgb};
use crate::scene::{Material, Scene, Triangle};
use crate::surface::Parameters;
use glam::Vec2;
use std::sync::OnceLock;

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
        if material.varies_in_colour_alone() {
            // Linear in the colour where nothing or all of it is metal, and nearly so between.
            let colour: Rgb = points.map(|at| scene.base_color(triangle, at.x, at.y)).sum();
            return Self::of_colour(material, colour * share);
        }
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

    /// Where a material has that base colour, and textures of nothing else.
    fn of_colour(material: &Material, colour: Rgb) -> Self {
        let emission = if material.emits() { material.emission } else { Rgb::ZERO };
        if material.unlit {
            return Self { emission, ..Self::default() };
        }
        let appearance = material.appearance(colour);
        let Reflectance { diffuse, specular, .. } = material.reflectance(&appearance);
        let albedo = Parameters::new(material, &appearance).mean_albedo();
        Self { diffuse, specular, albedo, emission }
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

/// What triangles reflect and emit over which nothing varies; where vertices have no colour of their
/// own it is found once for each material.
pub struct PlainMeans<'a> {
    scene: &'a Scene,
    of_material: Vec<OnceLock<CellMeans>>,
}

impl<'a> PlainMeans<'a> {
    /// Of a scene; nothing is found yet.
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, of_material: vec![OnceLock::new(); scene.materials.len()] }
    }

    /// What a triangle reflects and emits of which [`colour_varies`] is not true.
    pub fn of(&self, triangle: &Triangle) -> CellMeans {
        let find = || CellMeans::new(self.scene, triangle, [Vec2::ZERO].into_iter());
        let [colour, ..] = self.scene.of_sources(triangle, |vertex| vertex.color);
        match colour == Rgb::ONE {
            true => *self.of_material[triangle.material as usize].get_or_init(find),
            false => find(),
        }
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
