//! A scene as rays meet it: its triangles, and what each reflects, emits and lets through.

use super::dielectric::Clear;
use super::point::Surface;
use crate::radiometry::{Reflectance, Rgb};
use crate::rays::{Eye, Hit, Rays, Spot, unit_normal};
use crate::scene::{Material, Scene};
use glam::{Vec2, Vec3};
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
