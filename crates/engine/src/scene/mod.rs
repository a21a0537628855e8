//! What is there: world-space triangles, materials, textures, lights without extent, cameras.
//! Built by [`gltf`] or in code; always valid once built (finite positions, indices in range,
//! reflectances ≤ 1).

mod background;
mod camera;
pub mod daylight;
pub mod emission_means;
pub mod environment;
pub mod gltf;
pub mod instances;
mod layers;
mod lit_texels;
pub mod made;
mod material;
mod message;
pub(crate) mod nearby;
mod numbers;
pub mod part;
mod punctual;
pub mod pyramid;
mod sky_file;
pub mod sky_map;
mod texture;
mod touching;
mod translucency;
mod vertex;

use crate::radiometry::Rgb;
use glam::{Vec2, Vec3, Vec4};
use instances::Instances;
use std::sync::Arc;

pub use background::Background;
pub use camera::{Camera, Projection};
pub use environment::{Environment, PlacedMap, Sky, Sun};
pub use layers::{COAT_F0, COAT_MEAN, LEAST_SHEEN_ROUGHNESS, Layering, Layers};
pub use material::{Alpha, Appearance, Material, Model, Volume};
pub use message::{SceneError, Warning};
pub use punctual::{LightKind, PunctualLight};
pub use texture::{Encoding, NormalMap, Texture, TextureSlot, Wrap, srgb_to_linear};
pub use translucency::Translucency;
pub use vertex::{Triangle, Vertex};

/// A scene in world space, metres, right-handed, +Y up.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Vertices of the listed triangles; world space. [`Scene::vertex`] has those of instances, too.
    pub vertices: Vec<Vertex>,
    /// Triangles that are listed, counter-clockwise seen from the front. [`Scene::triangle`] has those
    /// of instances, too.
    pub triangles: Vec<Triangle>,
    /// Meshes that are there many times.
    pub instances: Arc<Instances>,
    /// Materials that triangles name; never empty when there are triangles.
    pub materials: Vec<Material>,
    /// Decoded textures that material slots name.
    pub textures: Vec<Texture>,
    /// Lights without extent, in node order.
    pub lights: Vec<PunctualLight>,
    /// Cameras, in node order.
    pub cameras: Vec<Camera>,
    /// Names of the sets of materials that the file offers, in its order; the triangles have those
    /// of the set that was chosen at import.
    pub variants: Vec<String>,
    /// The animations that the file offers, in its order; at most one was chosen at import.
    pub animations: Vec<AnimationName>,
    /// Names of the scenes that the file offers, in its order, where they have names; one of them
    /// was chosen at import.
    pub scenes: Vec<Option<String>>,
    /// What was approximated or ignored at import.
    pub warnings: Vec<Warning>,
}

/// An animation that a file offers.
#[derive(Clone, Debug, PartialEq)]
pub struct AnimationName {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// When its last key is, in seconds; from then on nothing moves.
    pub seconds: f32,
}

impl Scene {
    /// Bytes of its vertices, triangles and textures, those of shared meshes too.
    pub fn held_bytes(&self) -> u64 {
        let own = size_of_val(&*self.vertices) + size_of_val(&*self.triangles);
        let texels = self.textures.iter().map(|texture| size_of_val(&*texture.texels));
        own as u64 + texels.sum::<usize>() as u64 + self.instances.held_bytes()
    }

    /// Smallest box around all vertices that triangles use; `None` without triangles.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut bounds = self.instance_bounds();
        for triangle in &self.triangles {
            for &index in &triangle.vertices {
                let p = self.vertices[index as usize].position;
                let (low, high) = bounds.unwrap_or((p, p));
                bounds = Some((low.min(p), high.max(p)));
            }
        }
        bounds
    }

    /// Number of triangles whose material emits.
    pub fn emissive_triangles(&self) -> usize {
        self.count_of(Material::emits)
    }

    /// Whether anything is shown in its colour whatever the light (KHR_materials_unlit).
    pub fn has_unlit(&self) -> bool {
        self.used_materials().iter().zip(&self.materials).any(|(used, own)| *used && own.unlit)
    }

    /// Base colour (factor × texture × vertex colour, linear) at barycentric (u, v) of a triangle.
    pub fn base_color(&self, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        self.base_color_by(triangle, [u, v], |slot| self.sample(Some(slot), triangle, u, v))
    }

    /// What the material is at barycentric (u, v) of a triangle, textures and vertex colours
    /// applied.
    pub fn appearance(&self, triangle: &Triangle, u: f32, v: f32) -> Appearance {
        self.appearance_by(triangle, [u, v], |slot| self.sample(Some(slot), triangle, u, v))
    }

    /// The base colour where `sample` says what a texture is there.
    fn base_color_by(
        &self,
        triangle: &Triangle,
        [u, v]: [f32; 2],
        sample: impl Fn(&TextureSlot) -> Vec4,
    ) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        let [a, b, c] = self.of_sources(triangle, |vertex| vertex.color);
        let color = a * (1.0 - u - v) + b * u + c * v;
        let texel = material.base_color_texture.as_ref().map_or(Vec4::ONE, sample).truncate();
        (material.base_color * color * texel).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// The appearance where `sample` says what a texture is there.
    fn appearance_by(
        &self,
        triangle: &Triangle,
        at: [f32; 2],
        sample: impl Fn(&TextureSlot) -> Vec4,
    ) -> Appearance {
        let material = &self.materials[triangle.material as usize];
        let mut seen = material.appearance(self.base_color_by(triangle, at, &sample));
        if let Some(slot) = &material.metallic_roughness_texture {
            let texel = sample(slot);
            seen.roughness *= texel.y;
            seen.metallic *= texel.z;
        }
        if let Some(slot) = &material.specular_texture {
            seen.specular_factor *= sample(slot).w;
        }
        if let Some(slot) = &material.specular_color_texture {
            seen.specular_color *= sample(slot).truncate();
        }
        if let Some(slot) = &material.transmission_texture {
            seen.transmission *= sample(slot).x;
        }
        if let Some(layering) = &material.layering {
            seen.layers = layering.at(&sample);
        }
        if let Some(translucency) = &material.translucency {
            seen.translucency = translucency.share_at(&sample);
        }
        seen
    }

    /// The share of light, by its colour, that a surface which reflects no lobe lets through to
    /// its other side at barycentric (u, v) of a triangle.
    pub fn passed(&self, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        self.passed_by(triangle, [u, v], |slot| self.sample(Some(slot), triangle, u, v))
    }

    /// The same where `sample` says what a texture is there.
    fn passed_by(
        &self,
        triangle: &Triangle,
        at: [f32; 2],
        sample: impl Fn(&TextureSlot) -> Vec4,
    ) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        let translucency = material.translucency.as_ref().filter(|_| !material.unlit);
        let Some(translucency) = translucency else { return Rgb::ZERO };
        let seen = self.appearance_by(triangle, at, &sample);
        let dielectric = 1.0 - seen.metallic.clamp(0.0, 1.0);
        translucency.color_at(&sample) * (seen.translucency * dielectric)
    }

    /// The share of light that meets the surface at barycentric (u, v) of a triangle instead of
    /// passing through it as if it were not there: 1 of opaque materials, 0 or 1 of masked ones,
    /// alpha (factor × texture × vertex alpha) of blended ones.
    pub fn coverage(&self, triangle: &Triangle, u: f32, v: f32) -> f32 {
        let material = &self.materials[triangle.material as usize];
        if material.alpha == Alpha::Opaque {
            return 1.0;
        }
        let [a, b, c] = self.of_sources(triangle, |vertex| vertex.alpha);
        let vertex = a * (1.0 - u - v) + b * u + c * v;
        let texel = self.sample(material.base_color_texture.as_ref(), triangle, u, v).w;
        let alpha = (material.opacity * vertex * texel).clamp(0.0, 1.0);
        match material.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask { cutoff } => f32::from(u8::from(alpha >= cutoff)),
            Alpha::Blend => alpha,
        }
    }

    /// Unit shading normal of the front side at barycentric (u, v) of a triangle: the vertices'
    /// normals interpolated, tilted by the normal map. `None` where they cancel each other out.
    ///
    /// With the interpolated normal N, tangent T and B = w · N × T, not normalised (Mikkelsen 2008,
    /// "Simulation of wrinkled surfaces revisited", §3), and a texel (x, y, z) in [−1, 1]³, it is
    /// the direction of s·x·T + s·y·B + z·N, where s is [`NormalMap::scale`]. A map may tilt it
    /// behind the triangle's plane.
    pub fn shading_normal(&self, triangle: &Triangle, u: f32, v: f32) -> Option<Vec3> {
        self.shading_normal_by(triangle, [u, v], |slot| self.sample(Some(slot), triangle, u, v))
    }

    /// The same of a clear coat on it, which has a normal map of its own or none.
    pub fn coat_normal(&self, triangle: &Triangle, u: f32, v: f32) -> Option<Vec3> {
        let layering = self.materials[triangle.material as usize].layering.as_ref();
        let map = layering.and_then(|layering| layering.coat_normal_map.as_ref());
        self.tilted_normal(map, triangle, [u, v], |slot| self.sample(Some(slot), triangle, u, v))
    }

    /// The shading normal where `sample` says what the normal map is there.
    fn shading_normal_by(
        &self,
        triangle: &Triangle,
        at: [f32; 2],
        sample: impl Fn(&TextureSlot) -> Vec4,
    ) -> Option<Vec3> {
        let material = &self.materials[triangle.material as usize];
        self.tilted_normal(material.normal_map.as_ref(), triangle, at, sample)
    }

    /// The vertices' normals interpolated, and tilted by a map where `sample` says what that is.
    fn tilted_normal(
        &self,
        map: Option<&NormalMap>,
        triangle: &Triangle,
        [u, v]: [f32; 2],
        sample: impl Fn(&TextureSlot) -> Vec4,
    ) -> Option<Vec3> {
        let normal = self.interpolate(triangle, u, v, |vertex| vertex.normal);
        let plain = normal.try_normalize();
        let Some(map) = map else { return plain };
        let tangent = self.interpolate(triangle, u, v, |vertex| vertex.tangent.truncate());
        let signs = self.of_corners(triangle, |vertex| vertex.tangent.w);
        let sign: f32 = signs.iter().sum();
        if tangent == Vec3::ZERO || sign == 0.0 {
            return plain;
        }
        let texel = 2.0 * sample(&map.slot).truncate() - Vec3::ONE;
        if texel.z <= 0.0 {
            // The format knows no such texel.
            return plain;
        }
        let bitangent = sign.signum() * normal.cross(tangent);
        let tilt = map.scale * (texel.x * tangent + texel.y * bitangent);
        (tilt + texel.z * normal).try_normalize().or(plain)
    }

    /// The vector of space that has these coordinates along tangent and bitangent at barycentric
    /// (u, v) of a triangle; 0 where there are no tangents.
    pub fn in_tangents(&self, triangle: &Triangle, at: Vec2, along: Vec2) -> Vec3 {
        let of = |attribute: fn(&Vertex) -> Vec3| self.interpolate(triangle, at.x, at.y, attribute);
        let (normal, tangent) =
            (of(|vertex| vertex.normal), of(|vertex| vertex.tangent.truncate()));
        let signs = self.of_corners(triangle, |vertex| vertex.tangent.w);
        let bitangent = signs.iter().sum::<f32>().signum() * normal.cross(tangent);
        along.x * tangent + along.y * bitangent
    }

    /// Emitted radiance at barycentric (u, v) of a triangle.
    pub fn emission(&self, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        if !material.emits() {
            return Rgb::ZERO;
        }
        let texel = self.sample(material.emission_texture.as_ref(), triangle, u, v);
        material.emission * texel.truncate()
    }

    /// Barycentric interpolation of a vertex attribute: (1−u−v)·a₀ + u·a₁ + v·a₂.
    pub fn interpolate(
        &self,
        triangle: &Triangle,
        u: f32,
        v: f32,
        attribute: impl Fn(&Vertex) -> Vec3,
    ) -> Vec3 {
        let [a, b, c] = self.of_corners(triangle, attribute);
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Linear colour and alpha of a texture; ones without.
    fn sample(&self, slot: Option<&TextureSlot>, triangle: &Triangle, u: f32, v: f32) -> Vec4 {
        let Some(slot) = slot else { return Vec4::ONE };
        let [a, b, c] = self.coordinates(slot, triangle);
        let uv = a * (1.0 - u - v) + b * u + c * v;
        self.textures[slot.texture as usize].sample_rgba(slot, uv)
    }

    /// Texture coordinates of a triangle's corners as a slot takes them, before its transform.
    pub fn coordinates(&self, slot: &TextureSlot, triangle: &Triangle) -> [Vec2; 3] {
        self.of_sources(triangle, |vertex| vertex.uv[slot.uv_set as usize])
    }
}

#[cfg(test)]
mod tests;
