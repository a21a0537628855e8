//! What elements send beside what they reflect of each other's light: part of that is their glow, what
//! they emit without being lights.

use super::direct::DirectLight;
use super::elements::ElementIndex;
use super::far_sides::FarSides;
use super::mesh::CoarseMesh;
use crate::emitters::DirectLights;
use crate::radiometry::Rgb;
use crate::surface::World;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Places of an element at which it is asked what it emits.
const PLACES: u32 = 16;
/// Elements that a thread looks at together.
const CHUNK: usize = 256;

/// What elements send that has not come by links.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    /// Direct light on each, of which it reflects a part.
    pub direct: &'a [DirectLight],
    /// What they let through of what arrives at their other sides.
    pub far: Option<&'a FarSides>,
    /// π × radiance that each emits without being a light; empty where none does.
    pub glow: &'a [Rgb],
}

/// π × radiance that each element emits without being a light, in the mean over places of it; empty
/// where none does.
pub fn of_elements(world: &World, lights: &DirectLights, mesh: &CoarseMesh) -> Vec<Rgb> {
    if !lights.has_glow() {
        return Vec::new();
    }
    let of_element = |element: usize| {
        let at_place = |number: u32| {
            let x = (number as f32 + 0.5) / PLACES as f32;
            let member = mesh.elements.member(ElementIndex(element as u32), x);
            let place = mesh.cut.place_in(member, number, PLACES);
            place.map_or(Rgb::ZERO, |(triangle, at, back)| {
                lights.glow(world, &world.at(triangle, at.to_array(), back))
            })
        };
        (0..PLACES).map(at_place).sum::<Rgb>() * (PI / PLACES as f32)
    };
    (0..mesh.elements.len()).into_par_iter().with_min_len(CHUNK).map(of_element).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::rays::Eye;
    use crate::sampling::{Shifted, cosine_direction};
    use crate::scene::made::revolved::hollow_ball;
    use crate::scene::{Environment, Material};
    use crate::transport::hemilux::gloss::{AtTheEnd, arriving};
    use crate::transport::hemilux::specimen::{ALBEDO, EMISSION, SEED, Specimen, is_near};
    use glam::Vec3;

    /// In a ball whose wall glows the radiance is L^e/(1 − a) everywhere, and no light is sampled.
    #[test]
    fn a_glowing_furnace_is_solved_without_lights() {
        let material = Material::lambertian("inside", Rgb::splat(ALBEDO));
        let material = Material { emission: Rgb::splat(EMISSION), ..material };
        let ball = hollow_ball(24, material);
        let specimen = Specimen::of(ball, Environment::none(), 1000);
        let Specimen { world, lights, coarse, .. } = &specimen;
        assert!(lights.has_glow() && lights.count() == 0);
        let exact = EMISSION / (1.0 - ALBEDO);
        // At the poles triangles are without area.
        let irradiances = coarse.irradiances();
        let off = irradiances.iter().filter(|found| !is_near(**found, PI * exact, 0.02)).count();
        assert!(off < irradiances.len() / 20, "{off} of {}", irradiances.len());
        let middle = world.rays.place(Vec3::ZERO);
        let mut sequence = Shifted::new(SEED, Stream::Gather, 0);
        for ray in 0..64 {
            let direction = cosine_direction(Vec3::Y, sequence.next_pair());
            let hit = world.rays.closest(Eye::Light, middle, direction).expect("it is closed");
            assert!(!hit.back, "its inside is the front");
            let passage = world.look(middle, direction);
            let afresh = AtTheEnd { numbers: sequence.afresh(), asks_mesh: true };
            let found = arriving(coarse, &passage, (ray % 2 == 0).then_some(afresh));
            assert!(is_near(found.by_mesh, exact, 0.03), "{}", found.by_mesh);
            assert!(is_near(found.radiance, exact, 0.03), "{}", found.radiance);
        }
    }
}
