//! Holes in surfaces, by alpha: which rays pass a triangle where its material covers only a part.
//!
//! A part is covered at random, one ray at a time (Enderton et al. 2010, "Stochastic transparency"),
//! so that what is behind shows through by its right share on average, for shadows, gather rays and
//! cameras alike. The random number is a function of the ray and the triangle: the same ray always
//! does the same.

use crate::scene::Scene;
use std::sync::Arc;

/// What light passes.
pub struct Holes {
    scene: Arc<Scene>,
    /// Whether each material has holes.
    materials: Vec<bool>,
}

impl Holes {
    /// The holes of a scene; `None` without any.
    pub fn new(scene: &Arc<Scene>) -> Option<Self> {
        let materials: Vec<bool> =
            scene.materials.iter().map(|material| material.has_holes()).collect();
        let any = materials.contains(&true);
        any.then(|| Self { scene: scene.clone(), materials })
    }

    /// Whether a material has holes.
    pub fn are_in(&self, triangle: u32) -> bool {
        self.materials[self.scene.triangle(triangle).material as usize]
    }

    /// Whether a ray passes a triangle at barycentric (u, v).
    pub fn pass(&self, index: u32, [u, v]: [f32; 2], chance: Chance) -> bool {
        let triangle = &self.scene.triangle(index);
        let coverage = self.scene.coverage(triangle, u, v);
        // By chance only where that decides anything.
        coverage < 1.0 && coverage <= chance.number(index)
    }
}

/// What decides whether a ray passes.
#[derive(Clone, Copy)]
pub enum Chance {
    /// Bits that tell the ray from others.
    Ray(u32),
    /// A number in [0, 1), which rays of the same pixel have well spread, and bits of the pixel.
    Spread(f32, u32),
}

impl Chance {
    /// A number in [0, 1) for a triangle.
    fn number(self, triangle: u32) -> f32 {
        let triangle = triangle.wrapping_mul(0x9e37_79b9);
        match self {
            Self::Ray(key) => uniform(key ^ triangle),
            Self::Spread(number, pixel) => (number + uniform(pixel ^ triangle)).fract(),
        }
    }
}

/// A number in [0, 1) that looks random (the finalizer of MurmurHash3).
fn uniform(mut bits: u32) -> f32 {
    bits ^= bits >> 16;
    bits = bits.wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0xc2b2_ae35);
    bits ^= bits >> 16;
    (bits >> 8) as f32 / (1 << 24) as f32
}

#[cfg(test)]
mod tests {
    use crate::radiometry::Rgb;
    use crate::rays::{Eye, Rays};
    use crate::scene::{Alpha, Material, Scene, Triangle, Vertex};
    use glam::Vec3;
    use std::sync::Arc;

    /// A triangle across the z axis that covers so much of what is behind it.
    fn curtain(alpha: Alpha, opacity: f32) -> Arc<Scene> {
        let material = Material { alpha, opacity, ..Material::lambertian("curtain", Rgb::ONE) };
        let corner = |x, y| Vertex::new(Vec3::new(x, y, 0.0), Vec3::Z);
        Arc::new(Scene {
            vertices: vec![corner(-4.0, -4.0), corner(4.0, -4.0), corner(0.0, 4.0)],
            triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
            materials: vec![material],
            ..Scene::default()
        })
    }

    /// Shares of many rays that meet the curtain, and of segments that it blocks.
    fn met(scene: &Arc<Scene>) -> [f32; 2] {
        const RAYS: u32 = 20_000;
        let rays = Rays::of(scene);
        let mut met = [0; 2];
        for k in 0..RAYS {
            let x = k as f32 / RAYS as f32 - 0.5;
            let [from, to] = [5.0, -5.0].map(|z| rays.place(Vec3::new(x, 0.1, z)));
            met[0] += u32::from(rays.closest(Eye::Light, from, -Vec3::Z).is_some());
            met[1] += u32::from(rays.blocked(from, to, |_| false));
        }
        met.map(|met| met as f32 / RAYS as f32)
    }

    #[test]
    fn half_a_curtain_lets_half_of_the_light_through() {
        for share in met(&curtain(Alpha::Blend, 0.5)) {
            assert!((share - 0.5).abs() < 0.01, "{share}");
        }
        assert_eq!(met(&curtain(Alpha::Opaque, 0.5)), [1.0; 2]);
        assert_eq!(met(&curtain(Alpha::Mask { cutoff: 0.4 }, 0.5)), [1.0; 2]);
        assert_eq!(met(&curtain(Alpha::Mask { cutoff: 0.6 }, 0.5)), [0.0; 2]);
        assert_eq!(met(&curtain(Alpha::Blend, 0.0)), [0.0; 2]);
        assert_eq!(met(&curtain(Alpha::Blend, 1.0)), [1.0; 2]);
    }

    #[test]
    fn the_same_ray_does_the_same() {
        let rays = Rays::of(&curtain(Alpha::Blend, 0.5));
        for k in 0..100 {
            let from = rays.place(Vec3::new(0.01 * k as f32, 0.1, 5.0));
            let [one, other] = [(); 2].map(|()| rays.closest(Eye::Light, from, -Vec3::Z).is_some());
            assert_eq!(one, other);
        }
    }
}
