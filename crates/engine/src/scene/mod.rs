//! What is there: world-space triangles, materials, textures, cameras. Built by [`gltf`] or in
//! code; always valid once built (finite positions, indices in range, reflectances ≤ 1).

pub mod gltf;
pub mod made;
mod texture;

use crate::radiometry::{Reflectance, Rgb};
use glam::{Mat4, Vec2, Vec3};
use serde::Serialize;

pub use texture::{Texture, TextureSlot, Wrap, srgb_to_linear};

/// A scene in world space, metres, right-handed, +Y up.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Vertices of all triangles; world space.
    pub vertices: Vec<Vertex>,
    /// Triangles, counter-clockwise seen from the front.
    pub triangles: Vec<Triangle>,
    /// Materials that triangles name; never empty when there are triangles.
    pub materials: Vec<Material>,
    /// Decoded textures that material slots name.
    pub textures: Vec<Texture>,
    /// Cameras, in node order.
    pub cameras: Vec<Camera>,
    /// What was approximated or ignored at import.
    pub warnings: Vec<Warning>,
}

/// A vertex with everything that is interpolated over a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// World position in metres.
    pub position: Vec3,
    /// Unit shading normal; the geometric normal where the file gives none.
    pub normal: Vec3,
    /// Texture coordinate sets 0 and 1.
    pub uv: [Vec2; 2],
    /// Linear vertex colour; multiplies the base colour.
    pub color: Rgb,
}

/// One triangle: three vertex indices and a material index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into [`Scene::vertices`].
    pub vertices: [u32; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// A glTF metallic-roughness material with the extensions that change reflection.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in the file, or a made-up one.
    pub name: String,
    /// Base colour factor, linear.
    pub base_color: Rgb,
    /// Base colour texture; multiplies the factor.
    pub base_color_texture: Option<TextureSlot>,
    /// Metallic factor (a texture enters by its mean).
    pub metallic: f32,
    /// Roughness factor (a texture enters by its mean); α = roughness².
    pub roughness: f32,
    /// KHR_materials_ior; 1.5 by default.
    pub ior: f32,
    /// KHR_materials_specular: strength; 1 by default, 0 makes a dielectric Lambertian.
    pub specular_factor: f32,
    /// KHR_materials_specular: colour; white by default.
    pub specular_color: Rgb,
    /// Emitted radiance: factor × KHR_materials_emissive_strength, in the file's unit.
    pub emission: Rgb,
    /// Emission texture; multiplies [`Material::emission`].
    pub emission_texture: Option<TextureSlot>,
    /// Whether the back reflects and emits too. The back of a one-sided material is black and
    /// opaque to light, and invisible to cameras.
    pub double_sided: bool,
    /// KHR_materials_transmission: the share of a dielectric that is clear instead of as
    /// [`Material::reflectance`] says; 0 by default. Rays know it, patches don't.
    pub transmission: f32,
    /// KHR_materials_volume: what a body bounded by the surface is filled with; without it, the
    /// surface is a sheet that light passes straight through.
    pub volume: Option<Volume>,
}

/// The inside of a clear body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// What is left of white light after [`Volume::attenuation_distance`], in [0, 1].
    pub attenuation_color: Rgb,
    /// Metres, > 0; infinite without absorption.
    pub attenuation_distance: f32,
}

impl Default for Volume {
    fn default() -> Self {
        Self { attenuation_color: Rgb::ONE, attenuation_distance: f32::INFINITY }
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Rgb::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            ior: 1.5,
            specular_factor: 1.0,
            specular_color: Rgb::ONE,
            emission: Rgb::ZERO,
            emission_texture: None,
            double_sided: false,
            transmission: 0.0,
            volume: None,
        }
    }
}

impl Material {
    /// A Lambertian, one-sided material (`specularFactor` 0).
    pub fn lambertian(name: &str, albedo: Rgb) -> Self {
        Self { name: name.into(), base_color: albedo, specular_factor: 0.0, ..Self::default() }
    }

    /// A dielectric whose [`Material::reflectance`] is the given diffuse albedo plus a grey Phong
    /// lobe of albedo `specular` and exponent `exponent`.
    ///
    /// The lobe is authored by index of refraction and roughness alone, as a glTF file can:
    /// α = (2n + 1)^(−½), roughness = √α; F0 = (21 ks − 1)/20, ior = (1 + √F0)/(1 − √F0).
    /// `specular` is clamped to what that can say, [1/21, 0.99]; `exponent` to [0, 10⁵];
    /// `diffuse` to 1 − ks.
    pub fn phong(name: &str, diffuse: Rgb, specular: f32, exponent: f32) -> Self {
        let specular = specular.clamp(1.0 / 21.0, 0.99);
        let alpha = (2.0 * exponent.clamp(0.0, 1e5) + 1.0).sqrt().recip();
        let amplitude = ((21.0 * specular - 1.0) / 20.0).max(0.0).sqrt();
        Self {
            name: name.into(),
            base_color: (diffuse / (1.0 - specular)).clamp(Rgb::ZERO, Rgb::ONE),
            roughness: alpha.sqrt(),
            ior: (1.0 + amplitude) / (1.0 - amplitude),
            ..Self::default()
        }
    }

    /// A clear body of glass, its surface polished, without absorption.
    pub fn glass(name: &str, ior: f32) -> Self {
        Self {
            name: name.into(),
            roughness: 0.0,
            ior,
            transmission: 1.0,
            volume: Some(Volume::default()),
            ..Self::default()
        }
    }

    /// A mirror of polished metal: all that it reflects is in a Phong lobe of the given exponent.
    pub fn metal(name: &str, color: Rgb, exponent: f32) -> Self {
        let alpha = (2.0 * exponent.clamp(0.0, 1e5) + 1.0).sqrt().recip();
        Self {
            name: name.into(),
            base_color: color,
            metallic: 1.0,
            roughness: alpha.sqrt(),
            ..Self::default()
        }
    }

    /// The share of light that meets the material as a clear surface: transmission of what is not
    /// metal.
    pub fn clear_share(&self) -> f32 {
        self.transmission.clamp(0.0, 1.0) * (1.0 - self.metallic.clamp(0.0, 1.0))
    }

    /// Whether light that it reflects or lets through makes caustics, which patches can't show: it
    /// is clear, or its lobe is sharp.
    pub fn casts_caustics(&self) -> bool {
        self.clear_share() > 0.0 || self.reflectance(self.base_color).is_sharp()
    }

    /// Whether any point of the material can emit.
    pub fn emits(&self) -> bool {
        self.emission.max_element() > 0.0
    }

    /// Diffuse + modified-Phong reflectance for the given (textured) base colour.
    ///
    /// α = roughness², n = (1/α² − 1)/2 clamped to [0, 10⁵];
    /// F0 = lerp(((ior−1)/(ior+1))²·specularColor·specularFactor, baseColor, metallic),
    /// F90 = lerp(specularFactor, 1, metallic), ks = F0 + (F90 − F0)/21 (the cosine-weighted
    /// mean of Schlick's term), kd = baseColor·(1 − metallic)·(1 − ks).
    pub fn reflectance(&self, base_color: Rgb) -> Reflectance {
        let base_color = base_color.clamp(Rgb::ZERO, Rgb::ONE);
        let metallic = self.metallic.clamp(0.0, 1.0);
        let alpha = self.roughness.clamp(0.0, 1.0).powi(2).max(1e-3);
        let exponent = (0.5 * (1.0 / (alpha * alpha) - 1.0)).clamp(0.0, 1e5);
        let normal_incidence = ((self.ior - 1.0) / (self.ior + 1.0)).powi(2);
        let dielectric = (normal_incidence * self.specular_color * self.specular_factor)
            .clamp(Rgb::ZERO, Rgb::ONE);
        let f0 = dielectric.lerp(base_color, metallic);
        let f90 = Rgb::splat(self.specular_factor.clamp(0.0, 1.0)).lerp(Rgb::ONE, metallic);
        let specular = (f0 + (f90 - f0) / 21.0).clamp(Rgb::ZERO, Rgb::ONE);
        let diffuse = base_color * (1.0 - metallic) * (Rgb::ONE - specular);
        Reflectance { diffuse, specular, exponent }
    }
}

/// A perspective or orthographic camera looking along −Z of its own frame, +Y up.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Name in the file, or a made-up one.
    pub name: String,
    /// Camera-to-world transform without scale.
    pub to_world: Mat4,
    /// Field of view or extent.
    pub projection: Projection,
}

/// Projection of a camera. The picture's aspect ratio, not the file's, sets the width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians.
    Perspective {
        /// Full vertical angle in radians, in (0, π).
        yfov: f32,
    },
    /// Half the visible height in metres.
    Orthographic {
        /// Half height in metres, > 0.
        ymag: f32,
    },
}

impl Camera {
    /// A perspective camera at `eye` looking at `target`; `yfov` in radians.
    pub fn look_at(name: &str, eye: Vec3, target: Vec3, up: Vec3, yfov: f32) -> Self {
        let backward = (eye - target).normalize();
        let right = up.cross(backward).normalize();
        let up = backward.cross(right);
        Self {
            name: name.into(),
            to_world: Mat4::from_cols(
                right.extend(0.0),
                up.extend(0.0),
                backward.extend(0.0),
                eye.extend(1.0),
            ),
            projection: Projection::Perspective { yfov },
        }
    }
}

/// Something of the input that the picture will not show as authored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Where: a path into the file (`materials[3].normalTexture`) or a stage of the job.
    pub at: String,
    /// What was approximated or ignored, and how to avoid it.
    pub what: String,
}

impl Warning {
    /// A warning about `at`.
    pub fn new(at: impl Into<String>, what: impl Into<String>) -> Self {
        Self { at: at.into(), what: what.into() }
    }
}

/// Why a scene cannot be used: where, what, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{at}: {what}; {fix}")]
pub struct SceneError {
    /// Where: a path into the file, or the file itself.
    pub at: String,
    /// What is wrong.
    pub what: String,
    /// What the sender can do.
    pub fix: String,
    /// Whether the input is well formed but exceeds a limit.
    pub too_large: bool,
}

impl SceneError {
    /// A malformed input.
    pub fn malformed(
        at: impl Into<String>,
        what: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self { at: at.into(), what: what.into(), fix: fix.into(), too_large: false }
    }

    /// An input over a limit.
    pub fn too_large(
        at: impl Into<String>,
        what: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self { at: at.into(), what: what.into(), fix: fix.into(), too_large: true }
    }
}

impl Scene {
    /// Smallest box around all vertices that triangles use; `None` without triangles.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut bounds: Option<(Vec3, Vec3)> = None;
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
        self.triangles.iter().filter(|t| self.materials[t.material as usize].emits()).count()
    }

    /// World positions of a triangle's corners.
    pub fn corners(&self, triangle: &Triangle) -> [Vec3; 3] {
        triangle.vertices.map(|v| self.vertices[v as usize].position)
    }

    /// Base colour (factor × texture × vertex colour, linear) at barycentric (u, v) of a triangle.
    pub fn base_color(&self, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        let color = self.interpolate(triangle, u, v, |vertex| vertex.color);
        let texel = self.sample(material.base_color_texture.as_ref(), triangle, u, v);
        (material.base_color * color * texel).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// Emitted radiance at barycentric (u, v) of a triangle.
    pub fn emission(&self, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        let material = &self.materials[triangle.material as usize];
        if !material.emits() {
            return Rgb::ZERO;
        }
        material.emission * self.sample(material.emission_texture.as_ref(), triangle, u, v)
    }

    /// Barycentric interpolation of a vertex attribute: (1−u−v)·a₀ + u·a₁ + v·a₂.
    pub fn interpolate(
        &self,
        triangle: &Triangle,
        u: f32,
        v: f32,
        attribute: impl Fn(&Vertex) -> Vec3,
    ) -> Vec3 {
        let [a, b, c] = triangle.vertices.map(|i| attribute(&self.vertices[i as usize]));
        a * (1.0 - u - v) + b * u + c * v
    }

    fn sample(&self, slot: Option<&TextureSlot>, triangle: &Triangle, u: f32, v: f32) -> Rgb {
        let Some(slot) = slot else { return Rgb::ONE };
        let [a, b, c] =
            triangle.vertices.map(|i| self.vertices[i as usize].uv[slot.uv_set as usize]);
        let uv = a * (1.0 - u - v) + b * u + c * v;
        self.textures[slot.texture as usize].sample(slot, uv)
    }
}
