//! What surfaces reflect and emit on the mean over a part of a triangle, such as a pixel sees.

use super::model::Parameters;
use super::point::Surface;
use super::world::World;
use crate::radiometry::Rgb;
use crate::rays::Spot;
use crate::scene::part::Part;
use crate::scene::pyramid::Pyramids;
use glam::Vec3;

impl World {
    /// Texels that a part of a triangle is long, of the texture of which it is longest.
    pub fn texels_along(&self, triangle: u32, part: &Part) -> f32 {
        self.scene.texels_along(&self.scene.triangle(triangle), part)
    }

    /// What a part of a triangle reflects, with layers as they lie in its middle on the side on
    /// which `normal` is the geometric one; `side` is −1 for the back.
    pub fn parameters_over(
        &self,
        pyramids: &Pyramids,
        (triangle, part): (u32, &Part),
        normal: Vec3,
        side: f32,
    ) -> Parameters {
        let mut parameters = self.unlaid_parameters_over(pyramids, triangle, part);
        if let Parameters::Layered(layered) = &mut parameters {
            self.lay(layered, (triangle, part.at), normal, side);
        }
        parameters
    }

    /// The same with layers that lie as on a smooth surface.
    pub(super) fn unlaid_parameters_over(
        &self,
        pyramids: &Pyramids,
        triangle: u32,
        part: &Part,
    ) -> Parameters {
        let finish = self.finish(triangle);
        if !finish.varies {
            return finish.parameters;
        }
        let triangle = &self.scene.triangle(triangle);
        let material = &self.scene.materials[triangle.material as usize];
        Parameters::new(material, &self.scene.appearance_over(pyramids, triangle, part))
    }

    /// Radiance that a camera sees of a part of a triangle, of light that did not come from
    /// elsewhere; see [`World::shine`].
    pub fn shine_over(&self, pyramids: &Pyramids, triangle: u32, part: &Part) -> Rgb {
        let finish = self.finish(triangle);
        if !finish.varies {
            return self.shine(triangle, part.at);
        }
        let triangle = &self.scene.triangle(triangle);
        let emission = self.scene.emission_over(pyramids, triangle, part);
        if !finish.is_unlit {
            return emission;
        }
        emission + self.scene.appearance_over(pyramids, triangle, part).base_color
    }

    /// Unit shading normal of a part of a triangle; see [`World::shading_normal`].
    pub fn shading_normal_over(
        &self,
        pyramids: &Pyramids,
        (triangle, part): (u32, &Part),
        normal: Vec3,
        side: f32,
    ) -> Vec3 {
        if !self.finish(triangle).is_bent {
            return normal;
        }
        let triangle = &self.scene.triangle(triangle);
        let given = self.scene.shading_normal_over(pyramids, triangle, part);
        given.map(|given| given * side).filter(|given| given.dot(normal) > 0.0).unwrap_or(normal)
    }

    /// The surface in the middle of a part of a triangle, which lies at `spot`, reflecting as the
    /// part does on the mean; `side` is −1 for the back.
    pub fn surface_over(
        &self,
        pyramids: &Pyramids,
        (triangle, part): (u32, &Part),
        spot: Spot,
        side: f32,
    ) -> Surface {
        let mut surface = self.surface_at(triangle, part.at, spot, side);
        if self.finish(triangle).varies && surface.parameters != Parameters::BLACK {
            let normal = surface.normal;
            surface.parameters = self.parameters_over(pyramids, (triangle, part), normal, side);
        }
        surface
    }
}
