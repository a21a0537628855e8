//! The other side of what lets light through diffusely (KHR_materials_diffuse_transmission), as light
//! meets it there.
//!
//! A Lambertian lobe to the other side sends towards a viewer what a diffuse surface that lies there
//! would send towards the viewer's mirror image behind the surface, so that no method needs more than
//! reflection: f_t(viewer, source) is f_r(viewer mirrored, source) of the diffuse part alone. What
//! the lobe of the near side takes, it takes of both: Fresnel's term is that of the mirrored
//! directions, as in the extension's reference renderer.

use super::model::Parameters;
use super::point::Surface;
use super::reflection::Reflection;
use super::world::World;
use crate::radiometry::Rgb;
use crate::scene::part::Part;
use crate::scene::pyramid::Pyramids;
use glam::Vec3;

/// The other side of a place, where light comes from that goes through diffusely.
#[derive(Clone, Copy, Debug)]
pub struct FarSide {
    /// The surface there, which reflects diffusely what comes through.
    pub surface: Surface,
    /// Unit vector from there to the viewer's mirror image.
    pub viewer: Vec3,
}

impl FarSide {
    /// What of the light from all around the other side goes to the viewer.
    pub fn albedo(&self) -> Rgb {
        self.surface.reflection().diffuse(self.viewer)
    }
}

impl Surface {
    /// The other side, where that share goes through diffusely of what the lobes leave.
    fn turned(mut self, share: Rgb, cosine: Option<f32>) -> Self {
        self.parameters = self.parameters.passing(share, cosine);
        self.back = !self.back;
        (self.normal, self.shading_normal) = (-self.normal, -self.shading_normal);
        (self.emission, self.clear) = (Rgb::ZERO, None);
        self
    }
}

impl World {
    /// The other side of a translucent surface for light that goes to the unit vector `viewer`.
    #[cold]
    #[inline(never)]
    pub fn far_side(&self, surface: &Surface, viewer: Vec3) -> FarSide {
        let normal = surface.shading_normal;
        let cosine = normal.dot(viewer);
        let far = surface.turned(self.passed(surface), Some(cosine));
        FarSide { surface: far, viewer: viewer - 2.0 * cosine * normal }
    }

    /// The same for light that goes anywhere, with the share of the light from all around the other
    /// side that goes through.
    #[cold]
    #[inline(never)]
    pub fn far_side_on_the_mean(&self, surface: &Surface) -> (Surface, Rgb) {
        let far = surface.turned(self.passed(surface), None);
        (far, far.reflection().mean_diffuse())
    }

    /// The share of what the lobes leave that goes through at a surface's place.
    fn passed(&self, surface: &Surface) -> Rgb {
        let [u, v] = surface.at;
        self.scene.passed(&self.scene.triangle(surface.triangle), u, v)
    }

    /// What a part of a triangle lets through diffusely towards a viewer at an angle of that cosine.
    #[cold]
    #[inline(never)]
    pub fn passed_over(
        &self,
        pyramids: &Pyramids,
        (triangle, part): (u32, &Part),
        cosine: f32,
    ) -> Rgb {
        let share = self.scene.passed_over(pyramids, &self.scene.triangle(triangle), part);
        let parameters = self.unlaid_parameters_over(pyramids, triangle, part);
        match parameters.passing(share, Some(cosine)) {
            Parameters::Phong(reflectance) => reflectance.diffuse,
            Parameters::Ggx(facets) => facets.diffuse_albedo(cosine),
            Parameters::Layered(_) => Rgb::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Layering, Layers, Material, Scene, Translucency, Triangle, Vertex};
    use crate::surface::reflection::direction_about;
    use std::sync::Arc;

    fn world(below: Material, share: f32, color: Rgb) -> World {
        let translucency = Some(Box::new(Translucency::plain(share, color)));
        let material = Material { translucency, double_sided: true, ..below };
        let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|at| Vertex::new(at, Vec3::Z));
        World::new(Arc::new(Scene {
            vertices: vertices.to_vec(),
            triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
            materials: vec![material],
            ..Scene::default()
        }))
    }

    fn materials() -> Vec<Material> {
        let layers = Layers { coat: 0.6, coat_roughness: 0.3, ..Layers::NONE };
        let layering = Some(Box::new(Layering { factors: layers, ..Layering::default() }));
        let polished = Material { roughness: 0.3, ..Material::default() };
        vec![
            Material::lambertian("paper", Rgb::ONE),
            Material { metallic: 0.25, ..polished.clone() },
            Material::phong("phong", Rgb::splat(0.5), 0.1, 20.0),
            Material { layering, ..polished },
        ]
    }

    /// The albedo is the integral of what is let through towards a viewer on either side.
    #[test]
    fn the_albedo_is_the_integral_of_what_is_let_through() {
        let color = Rgb::new(0.9, 0.5, 0.2);
        for material in materials() {
            let world = world(material, 0.6, color);
            for (back, height) in [(false, 0.9f32), (true, 0.4)] {
                let surface = world.at(0, [0.3, 0.3], back);
                let viewer = direction_about(surface.normal, height, 0.3);
                let far = world.far_side(&surface, viewer);
                assert_eq!((far.surface.normal, far.surface.back), (-surface.normal, !back));
                assert!((far.surface.normal.dot(far.viewer) - height).abs() < 1e-5);
                let reflection = far.surface.reflection();
                let count = 20_000;
                let mut sum = Rgb::ZERO;
                for number in 0..count {
                    let xi =
                        [(number as f32 + 0.5) / count as f32, number as f32 * 0.618_034 % 1.0];
                    let found = reflection.sample(far.viewer, 1.0, true, xi);
                    let found = found.expect("it is above the surface");
                    assert!(found.direction.dot(surface.normal) < 0.0, "it comes from behind");
                    assert_eq!(found.factor.lobe, Rgb::ZERO);
                    sum += found.factor.diffuse / count as f32;
                }
                assert!((sum / far.albedo() - 1.0).abs().max_element() < 0.01, "{sum}");
                assert!(sum.cmple(0.6 * color + 1e-3).all(), "{sum}");
            }
        }
    }

    /// As much comes through one way as the other, but for a coat, which dims light on its way out
    /// alone.
    #[test]
    fn what_is_let_through_is_reciprocal() {
        let [above, below] =
            [Vec3::new(0.3, 0.2, 0.8), Vec3::new(-0.5, 0.1, -0.4)].map(Vec3::normalize);
        for material in materials().into_iter().filter(|material| material.layering.is_none()) {
            let world = world(material, 0.6, Rgb::ONE);
            let [one, other] = [(false, above, below), (true, below, above)].map(|(back, v, l)| {
                let far = world.far_side(&world.at(0, [0.3, 0.3], back), v);
                far.surface.reflection().evaluate(far.viewer, l).both()
            });
            assert!(one.abs_diff_eq(other, 1e-6) && one.min_element() > 0.0, "{one} {other}");
        }
    }
}
