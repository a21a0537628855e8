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
    /// It is one of a pixel's.
    OfPixel(RayOfPixel),
}

/// One of the rays of a pixel. They have the numbers by which they pass a triangle well spread among
/// them, and those of two triangles independent of each other: what two curtains cover is the product.
#[derive(Clone, Copy)]
pub struct RayOfPixel {
    /// Which of them.
    pub index: u32,
    /// Bits that tell the pixel from others.
    pub pixel: u32,
}

/// Steps of the sequences that triangles have, as fractions of 2³²: quadratic irrationals (continued
/// fractions that end in ones), which spread points well, any two of them also over the square.
const STEPS: [u32; 8] = [
    0x9e37_79b9,
    0xbaf3_d047,
    0xc9f1_42bf,
    0x9100_759d,
    0xb193_7757,
    0x971d_e27b,
    0x5c07_f72d,
    0xc42d_66dd,
];
/// Rays after which a sequence goes on from elsewhere, so that two triangles with the same step become
/// independent, too.
const RAYS_OF_START: u32 = 32;

impl Chance {
    /// A number in [0, 1) for a triangle.
    fn number(self, triangle: u32) -> f32 {
        let triangle = triangle.wrapping_mul(0x9e37_79b9);
        let bits = match self {
            Self::Ray(key) => mixed(key ^ triangle),
            Self::OfPixel(ray) => ray.bits(mixed(ray.pixel ^ triangle)),
        };
        (bits >> 8) as f32 / (1 << 24) as f32
    }
}

impl RayOfPixel {
    fn bits(self, sequence: u32) -> u32 {
        let step = STEPS[sequence as usize % STEPS.len()];
        let start = mixed(sequence ^ (self.index / RAYS_OF_START).wrapping_mul(0x85eb_ca77));
        start.wrapping_add(step.wrapping_mul(self.index))
    }
}

/// Bits that look random (the finalizer of MurmurHash3).
fn mixed(mut bits: u32) -> u32 {
    bits ^= bits >> 16;
    bits = bits.wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

#[cfg(test)]
mod tests {
    use super::{Chance, RayOfPixel, STEPS, mixed};
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

    /// Over many pixels, how far the share of a pixel's rays that pass both of two triangles is from the
    /// product of the shares, and that of one from its own: root mean squares. `number` is that of a
    /// triangle for a ray.
    fn off(number: impl Fn(RayOfPixel, u32) -> f32) -> [f32; 2] {
        const PIXELS: u32 = 500;
        const RAYS: u32 = 256;
        let mut squares = [0.0; 2];
        for pixel in 0..PIXELS {
            let mut passed = [0u32; 2];
            for index in 0..RAYS {
                let [first, second] = [3, 8].map(|of| number(RayOfPixel { index, pixel }, of));
                passed[0] += u32::from(first < 0.5 && second < 0.4);
                passed[1] += u32::from(first < 0.5);
            }
            let [both, first] = passed.map(|passed| passed as f32 / RAYS as f32);
            squares[0] += (both - 0.2).powi(2);
            squares[1] += (first - 0.5).powi(2);
        }
        squares.map(|sum| (sum / PIXELS as f32).sqrt())
    }

    #[test]
    fn two_curtains_cover_the_product_in_each_pixel() {
        let [both, one] = off(|ray, triangle| Chance::OfPixel(ray).number(triangle));
        println!("both {both}, one {one}");
        // By chance alone .025 and .031.
        assert!(both < 0.024 && one < 0.012, "{both} {one}");
        // Planted: the same sequence for both, shifted.
        let [both, one] = off(|RayOfPixel { index, pixel }, triangle| {
            let shift = mixed(pixel ^ triangle.wrapping_mul(0x9e37_79b9));
            shift.wrapping_add(STEPS[0].wrapping_mul(index)) as f32 / u32::MAX as f32
        });
        println!("planted: both {both}, one {one}");
        assert!(both > 0.1 && one < 0.01, "{both} {one}");
    }
}
