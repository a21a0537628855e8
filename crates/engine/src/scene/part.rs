//! Parts of triangles, and what a material is on the mean over one: what a pixel, or a sample of
//! one, sees of a texture that is finer than itself.

use super::pyramid::{Lookup, Pyramids, Weight, axes, slots};
use super::{Appearance, Scene, TextureSlot, Triangle};
use crate::radiometry::Rgb;
use glam::{Vec2, Vec3, Vec4};

/// A parallelogram of a triangle's plane, in barycentric coordinates of the triangle.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Its middle.
    pub at: Vec2,
    /// Its edges.
    pub edges: [Vec2; 2],
}

impl Scene {
    /// What the material is on the mean over a part of a triangle: each value is the mean of its
    /// texture there, times factor and vertex colour in the middle.
    pub fn appearance_over(
        &self,
        pyramids: &Pyramids,
        triangle: &Triangle,
        part: &Part,
    ) -> Appearance {
        let material = &self.materials[triangle.material as usize];
        let sample = |slot: &TextureSlot| {
            let is_base =
                material.base_color_texture.as_ref().is_some_and(|b| std::ptr::eq(b, slot));
            let weight = if is_base { Weight::of(material) } else { Weight::Even };
            self.mean_texel(pyramids, (slot, weight), triangle, part)
        };
        self.appearance_by(triangle, part.at.to_array(), sample)
    }

    /// What a part of a triangle lets through on the mean; see [`Scene::passed`].
    pub fn passed_over(&self, pyramids: &Pyramids, triangle: &Triangle, part: &Part) -> Rgb {
        self.passed_by(triangle, part.at.to_array(), |slot| {
            self.mean_texel(pyramids, (slot, Weight::Even), triangle, part)
        })
    }

    /// Mean emitted radiance of a part of a triangle.
    pub fn emission_over(&self, pyramids: &Pyramids, triangle: &Triangle, part: &Part) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        let Some(slot) = material.emission_texture.as_ref().filter(|_| material.emits()) else {
            return material.emission;
        };
        material.emission
            * self.mean_texel(pyramids, (slot, Weight::Even), triangle, part).truncate()
    }

    /// Unit shading normal of the front side in the middle of a part of a triangle, tilted by the
    /// mean of the normal map there; see [`Scene::shading_normal`].
    pub fn shading_normal_over(
        &self,
        pyramids: &Pyramids,
        triangle: &Triangle,
        part: &Part,
    ) -> Option<Vec3> {
        self.shading_normal_by(triangle, part.at.to_array(), |slot| {
            self.mean_texel(pyramids, (slot, Weight::Even), triangle, part)
        })
    }

    /// Texels that a part of a triangle is long, of the texture of which it is longest; 0 without any.
    pub fn texels_along(&self, triangle: &Triangle, part: &Part) -> f32 {
        let of = |slot: &TextureSlot| {
            let texture = &self.textures[slot.texture as usize];
            let size = Vec2::new(texture.width as f32, texture.height as f32);
            let (_, edges) = self.in_texture(slot, triangle, part);
            axes(edges.map(|edge| slot.linear * edge * size)).1
        };
        let material = &self.materials[triangle.material as usize];
        slots(material).map(|(slot, _)| of(slot)).fold(0.0, f32::max)
    }

    fn mean_texel(
        &self,
        pyramids: &Pyramids,
        (slot, weight): (&TextureSlot, Weight),
        triangle: &Triangle,
        part: &Part,
    ) -> Vec4 {
        let texture = &self.textures[slot.texture as usize];
        let (middle, edges) = self.in_texture(slot, triangle, part);
        pyramids.mean(&Lookup { texture, slot, weight, middle, edges })
    }

    /// Middle and edges of a part of a triangle in the mesh's texture coordinates.
    fn in_texture(
        &self,
        slot: &TextureSlot,
        triangle: &Triangle,
        part: &Part,
    ) -> (Vec2, [Vec2; 2]) {
        let [a, b, c] = self.coordinates(slot, triangle);
        let across = |edge: Vec2| (b - a) * edge.x + (c - a) * edge.y;
        (a + across(part.at), part.edges.map(across))
    }
}
