//! Surfaces as rays meet them: diffuse plus modified Phong with full-detail textures, evaluated
//! and importance sampled.

use super::clear::Clear;
use crate::hemicube::frame;
use crate::radiometry::{LobeAlbedo, Reflectance, Rgb, importance};
use crate::rays::{Eye, Hit, Rays, Spot, unit_normal};
use crate::scene::{Material, Scene};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// A scene for rays, with what its triangles reflect and emit.
pub struct World {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Its triangles.
    pub rays: Rays,
    finishes: Vec<Finish>,
}

/// What a triangle reflects and emits.
pub struct Finish {
    /// At its first corner; everywhere where nothing varies.
    pub reflectance: Reflectance,
    /// Emitted radiance, likewise.
    pub emission: Rgb,
    two_sided: bool,
    /// Whether colour or emission changes over the triangle.
    pub varies: bool,
    clear: Option<Clear>,
}

/// A point of a surface, seen from the side that reflects.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Barycentric (u, v) there.
    pub at: [f32; 2],
    /// Whether the back is seen.
    pub back: bool,
    /// Where.
    pub spot: Spot,
    /// Unit geometric normal of the side that is seen.
    pub normal: Vec3,
    /// Unit shading normal of that side: the lobe is about its mirror direction.
    pub shading_normal: Vec3,
    /// What it reflects.
    pub reflectance: Reflectance,
    /// Radiance that it emits.
    pub emission: Rgb,
    /// How it lets light through, if it does.
    pub clear: Option<Clear>,
}

/// What f_r does, the diffuse part and the lobe by themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// By the diffuse part.
    pub diffuse: Rgb,
    /// By the lobe.
    pub lobe: Rgb,
}

impl Parts {
    /// Both together.
    pub fn both(&self) -> Rgb {
        self.diffuse + self.lobe
    }

    /// Both, weighed.
    pub fn times(&self, weight: Rgb) -> Self {
        Self { diffuse: self.diffuse * weight, lobe: self.lobe * weight }
    }
}

/// A direction that was picked for light to come from.
pub struct Scattered {
    /// Unit direction away from the surface.
    pub direction: Vec3,
    /// f_r·cosθ over the density.
    pub factor: Parts,
    /// Density per solid angle.
    pub density: f32,
}

impl World {
    /// Prepares a scene.
    pub fn new(scene: Arc<Scene>) -> Self {
        let rays = Rays::new(&scene);
        let finish = |triangle: &crate::scene::Triangle| {
            let material = &scene.materials[triangle.material as usize];
            let [a, b, c] = triangle.vertices.map(|v| scene.vertices[v as usize].color);
            Finish {
                reflectance: material.reflectance(scene.base_color(triangle, 0.0, 0.0)),
                emission: scene.emission(triangle, 0.0, 0.0),
                two_sided: material.double_sided,
                varies: material.base_color_texture.is_some()
                    || (material.emits() && material.emission_texture.is_some())
                    || a != b
                    || b != c,
                clear: Clear::new(material, rays.scale())
                    .map(|clear| clear.tinted(scene.base_color(triangle, 0.0, 0.0))),
            }
        };
        let finishes = scene.triangles.iter().map(finish).collect();
        Self { rays, finishes, scene }
    }

    /// Square metres of a square ray unit.
    pub fn square_metre(&self) -> f32 {
        (self.rays.scale() * self.rays.scale()).recip() as f32
    }

    /// Bytes that [`World::new`] and the scene's lights take at their peak for so many triangles.
    pub fn needed_bytes(triangles: u64) -> u64 {
        // Finishes; emitters with their densities, picks and groups, if all shine.
        Rays::needed_bytes(triangles) + triangles * 300
    }

    /// Whether a triangle's back reflects and emits too.
    pub fn is_two_sided(&self, triangle: u32) -> bool {
        self.finishes[triangle as usize].two_sided
    }

    /// Whether what a triangle reflects and emits varies over it.
    pub fn varies(&self, triangle: u32) -> bool {
        self.finishes[triangle as usize].varies
    }

    /// Radiance that a triangle emits at barycentric (u, v).
    pub fn emission(&self, triangle: u32, u: f32, v: f32) -> Rgb {
        let finish = &self.finishes[triangle as usize];
        if finish.varies {
            self.scene.emission(&self.scene.triangles[triangle as usize], u, v)
        } else {
            finish.emission
        }
    }

    /// What a triangle reflects and emits.
    pub fn finish(&self, triangle: u32) -> &Finish {
        &self.finishes[triangle as usize]
    }

    /// Material of a triangle.
    pub fn material(&self, triangle: u32) -> &Material {
        &self.scene.materials[self.scene.triangles[triangle as usize].material as usize]
    }

    /// Base colour and emission at barycentric coordinates of a triangle.
    pub fn colors_at(&self, triangle: u32, u: f32, v: f32) -> (Rgb, Rgb) {
        let triangle = &self.scene.triangles[triangle as usize];
        (self.scene.base_color(triangle, u, v), self.scene.emission(triangle, u, v))
    }

    /// The surface at a hit; `None` at a black back.
    pub fn surface(&self, hit: &Hit) -> Option<Surface> {
        let finish = &self.finishes[hit.triangle as usize];
        (!hit.back || finish.two_sided).then(|| self.surface_of(hit))
    }

    /// The surface that a ray along the unit `direction` meets first; `None` where there is
    /// nothing or a black back.
    pub fn meet(&self, eye: Eye, origin: Vec3, direction: Vec3) -> Option<(Surface, f32)> {
        let hit = self.rays.closest(eye, origin, direction)?;
        let finish = &self.finishes[hit.triangle as usize];
        let black = hit.back && !finish.two_sided && finish.clear.is_none();
        (!black).then(|| (self.surface_of(&hit), hit.distance))
    }

    /// The surface of a side of a triangle at barycentric (u, v).
    pub fn at(&self, triangle: u32, [u, v]: [f32; 2], back: bool) -> Surface {
        let (corners, _) = self.rays.corners(&self.scene, triangle);
        let spot = Spot::new(corners, unit_normal(corners), u, v);
        self.surface_at(triangle, Vec2::new(u, v), spot, if back { -1.0 } else { 1.0 })
    }

    fn surface_of(&self, hit: &Hit) -> Surface {
        let side = if hit.back { -1.0 } else { 1.0 };
        self.surface_at(hit.triangle, Vec2::new(hit.u, hit.v), self.rays.spot(hit), side)
    }

    /// The surface at barycentric coordinates of a triangle, which lie at `spot`; `side` is −1
    /// for its back.
    pub fn surface_at(&self, index: u32, at: Vec2, spot: Spot, side: f32) -> Surface {
        let (finish, back) = (&self.finishes[index as usize], side < 0.0);
        let triangle = &self.scene.triangles[index as usize];
        let normal = spot.normal * side;
        let (mut reflectance, mut emission, mut clear) =
            (finish.reflectance, finish.emission, finish.clear);
        if finish.varies {
            let material = &self.scene.materials[triangle.material as usize];
            let color = self.scene.base_color(triangle, at.x, at.y);
            (reflectance, emission) =
                (material.reflectance(color), self.scene.emission(triangle, at.x, at.y));
            clear = clear.map(|clear| clear.tinted(color));
        }
        let all_clear = clear.is_some_and(|clear| clear.share >= 1.0);
        if all_clear || (back && !finish.two_sided) {
            // Of a back that light gets out of, what is not clear is black.
            reflectance = Reflectance::lambertian(Rgb::ZERO);
        }
        if back && !finish.two_sided {
            emission = Rgb::ZERO;
        }
        let mut shading_normal = normal;
        if reflectance.is_glossy() || clear.is_some() {
            let given = self.scene.interpolate(triangle, at.x, at.y, |vertex| vertex.normal);
            let given = (given * side).normalize_or(normal);
            if given.dot(normal) > 0.0 {
                shading_normal = given;
            }
        }
        let at = at.to_array();
        Surface {
            triangle: index,
            at,
            back,
            spot,
            normal,
            shading_normal,
            reflectance,
            emission,
            clear,
        }
    }
}

impl Surface {
    /// Where rays that leave start.
    pub fn start(&self) -> Vec3 {
        self.spot.off_surface(self.normal)
    }

    /// Where rays that go on behind it start.
    pub fn start_behind(&self) -> Vec3 {
        self.spot.off_surface(-self.normal)
    }

    /// The same without its diffuse part.
    pub fn lobe_only(mut self) -> Self {
        self.reflectance.diffuse = Rgb::ZERO;
        self
    }

    /// Share of the light from all around that it reflects.
    pub fn albedo(&self) -> Rgb {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        if !self.reflectance.is_glossy() {
            return diffuse;
        }
        diffuse + specular * LobeAlbedo::shared().mean(exponent)
    }

    /// The mirror direction of `viewer`.
    pub fn mirrored(&self, viewer: Vec3) -> Vec3 {
        2.0 * self.shading_normal.dot(viewer) * self.shading_normal - viewer
    }

    /// Whether it reflects anything.
    pub fn reflects(&self) -> bool {
        self.reflectance.diffuse != Rgb::ZERO || self.reflectance.is_glossy()
    }

    /// The share of rays that are to sample the diffuse part: its share of what is reflected
    /// towards `viewer`.
    pub fn diffuse_share(&self, viewer: Vec3) -> f32 {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.shading_normal.dot(viewer);
        if !self.reflectance.is_glossy() || cosine <= 0.0 {
            return 1.0;
        }
        let diffuse = importance(diffuse);
        let lobe = importance(specular) * LobeAlbedo::shared().at(exponent, cosine).max(1e-3);
        let both = diffuse + lobe;
        // Reflectances that are almost nothing may vanish in the products.
        if both > 0.0 { diffuse / both } else { 1.0 }
    }

    /// f_r and, for directions picked diffusely with probability `diffuse_share`, their density.
    pub fn evaluate(&self, viewer: Vec3, source: Vec3, diffuse_share: f32) -> (Parts, f32) {
        let Reflectance { diffuse, specular, exponent } = self.reflectance;
        let cosine = self.normal.dot(source).max(0.0);
        let mut value = Parts { diffuse: diffuse / PI, lobe: Rgb::ZERO };
        let mut density = diffuse_share * cosine / PI;
        if self.reflectance.is_glossy() {
            let power = self.lobe(viewer, source);
            value.lobe = specular * ((exponent + 2.0) / TAU * power);
            density += (1.0 - diffuse_share) * ((exponent + 1.0) / TAU * power);
        }
        (value, density)
    }

    /// Picks a direction for light that leaves towards `viewer`: by the cosine if `diffusely`,
    /// which must be so with probability `diffuse_share`, or else by the lobe. `None` where the
    /// pick lies below the horizon, of the shading normal, too, where the lobe was sampled: there the
    /// lobe reflects nothing.
    pub fn scatter(
        &self,
        viewer: Vec3,
        diffuse_share: f32,
        diffusely: bool,
        xi: [f32; 2],
    ) -> Option<Scattered> {
        let (cosine, axis) = if diffusely {
            ((1.0 - xi[0]).sqrt(), self.normal)
        } else {
            let mirror = self.mirrored(viewer);
            let power = 1.0 / (self.reflectance.exponent + 1.0);
            ((1.0 - xi[0]).powf(power), mirror.normalize_or(self.shading_normal))
        };
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (tangent, bitangent) = frame(axis, 0.0);
        let (sin, cos) = (TAU * xi[1]).sin_cos();
        let direction = axis * cosine + (tangent * cos + bitangent * sin) * sine;
        let cosine = self.normal.dot(direction);
        if cosine <= 0.0 || !(diffusely || self.shading_normal.dot(direction) > 0.0) {
            return None;
        }
        let (value, density) = self.evaluate(viewer, direction, diffuse_share);
        (density > 0.0).then(|| Scattered {
            direction,
            factor: value.times(Rgb::splat(cosine / density)),
            density,
        })
    }

    /// cosⁿα between the mirror of `viewer` and `source`; 0 where either is below the horizon.
    fn lobe(&self, viewer: Vec3, source: Vec3) -> f32 {
        let (to_viewer, to_source) =
            (self.shading_normal.dot(viewer), self.shading_normal.dot(source));
        if to_viewer <= 0.0 || to_source <= 0.0 {
            return 0.0;
        }
        let cosine = 2.0 * to_viewer * to_source - viewer.dot(source);
        if cosine <= 0.0 { 0.0 } else { cosine.min(1.0).powf(self.reflectance.exponent) }
    }
}
