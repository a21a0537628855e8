//! Direct light of an element of the coarse mesh (tier 1): shadow rays from random points of it.

use super::crevices::is_hidden;
use super::elements::{ElementIndex, Elements};
use super::inside::{Place, is_inside};
use crate::emitters::DirectLights;
use crate::patches::Cut;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::rays::{Eye, Hit};
use crate::sampling::{Seed, Shifted, cosine_direction};
use crate::surface::World;
use crate::transport::light_sums::LightSums;
use crate::transport::patch_points::LitPoint;
use bytemuck::{Pod, Zeroable};

/// A point of an element of several patches lies in a crevice if its random ray ends within this
/// share of the element's side. Such points are seen from inside the crevice rather than from the
/// room, so they do not count for the element's light (docs/decisions/0005).
const CREVICE: f32 = 0.25;

/// Most by which the reflected light of an element may differ from what its mean albedo says, as a share of
/// that.
const MOST_BEYOND: f32 = 0.75;

/// Direct light on an element.
#[derive(Clone, Copy)]
pub struct DirectLight {
    /// Mean irradiance of the points that are not inside a body.
    pub irradiance: Rgb,
    /// Irradiance from all around, for which the mean albedo holds, of which as much is reflected: lobes
    /// reflect more of light that grazes the surface than of what a lamp sends.
    pub reflected_as: Rgb,
    /// Estimated share of the direct light that arrives, of that without occlusion.
    pub share: f32,
    /// Share of points that are not inside a body.
    pub open: f32,
}

/// Sums over sampled points of an element. Checkpoints store them as they are: the order of the
/// fields is part of the format.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SampledLight {
    /// Of points that are not in crevices.
    visible: LightSums,
    /// Of points in crevices.
    hidden: LightSums,
    points: u32,
    /// Points that are not inside a body.
    open: u32,
    /// 1 once a ray has left the scene.
    escaped: u32,
    /// Σ irradiance that rays saw arrive.
    arrived: Rgb,
    /// What of it is reflected beyond what the mean albedo says.
    beyond: Rgb,
}

/// The scene in which elements are lit.
#[derive(Clone, Copy)]
pub struct Lighting<'a> {
    /// The scene as rays meet it.
    pub world: &'a World,
    /// Its emitters.
    pub lights: &'a DirectLights,
    /// The scene in patches.
    pub cut: &'a Cut,
    /// The elements.
    pub elements: &'a Elements,
    /// Whether their albedos are without what is mirrored sharply.
    pub follows_mirrors: bool,
}

impl SampledLight {
    /// Samples direct light at more points of an element, by a shadow ray each.
    pub fn add(&mut self, lighting: &Lighting<'_>, element: ElementIndex, points: u32, seed: Seed) {
        let Lighting { world, lights, cut, elements, .. } = *lighting;
        let sequence = Shifted::new(seed, Stream::PatchLight, u64::from(element.0));
        let mut sequence = sequence.at(self.points);
        let side = elements.side(world, element);
        let (is_flat, is_part) = (elements.is_one_patch(cut, element), elements.is_part(element));
        let first = self.points + element.0;
        self.points += points;
        for n in first..first + points {
            let xi = sequence.next_pair();
            let from = elements.points(world, cut, element, sequence.apart().light.x);
            let LitPoint { start, normal, lit_normal } =
                elements.lit_point(world, element, &from, xi, sequence.beside());
            let finish = &world.finish(from.triangle()).parameters;
            let direction = cosine_direction(normal, sequence.afresh().bounce);
            let met = world.rays.closest(Eye::Light, start, direction);
            let place = Place { start, normal, side };
            let is_black = |hit: &Hit| world.is_black(hit) && is_inside(world, cut, &place, hit);
            if met.as_ref().is_some_and(is_black) {
                continue;
            }
            self.escaped |= u32::from(met.is_none());
            let hidden = match is_flat {
                true => !is_part && is_hidden(world, side, start, normal),
                false => met.is_some_and(|hit| hit.distance < CREVICE * side),
            };
            self.open += 1;
            let sums = if hidden { &mut self.hidden } else { &mut self.visible };
            let xi = lights.in_turn(sequence.triple(), n);
            let sample = lights.sample_by_shadow_ray(world, start, lit_normal, xi);
            sums.add(sample);
            self.arrived += sample.arrived();
            if finish.is_glossy() && !lighting.follows_mirrors {
                let beyond = finish.albedo(lit_normal.dot(sample.direction)) - finish.mean_albedo();
                self.beyond += sample.arrived() * beyond;
            }
        }
    }

    /// Direct light of the element, which has that albedo, by its points outside crevices, or by all
    /// others if there are none.
    pub fn mean(&self, albedo: Rgb) -> DirectLight {
        let sums = if self.visible.count() > 0 { self.visible } else { self.hidden };
        let open = self.open as f32 / self.points.max(1) as f32;
        let irradiance = sums.irradiance();
        let all = self.arrived * albedo;
        let relative = Rgb::select(all.cmpgt(Rgb::ZERO), self.beyond / all, Rgb::ZERO);
        let relative = relative.clamp(Rgb::splat(-MOST_BEYOND), Rgb::splat(MOST_BEYOND));
        let reflected_as = irradiance * (Rgb::ONE + relative);
        DirectLight { irradiance, reflected_as, share: sums.share(), open }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::importance;
    use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen, is_near};
    use std::f32::consts::PI;

    fn lighting(specimen: &Specimen) -> Lighting<'_> {
        Lighting {
            world: &specimen.world,
            lights: &specimen.lights,
            cut: &specimen.coarse.mesh.cut,
            elements: &specimen.coarse.mesh.elements,
            follows_mirrors: false,
        }
    }

    /// Of lamp, sun and sky through a window few points know what each brings to a room's elements.
    #[test]
    fn few_points_know_lamp_sun_and_sky() {
        let room = crate::scene::made::real::lamp_beside_window();
        let specimen = Specimen::surrounded(&room.glb, room.environment, 2000);
        let lighting = lighting(&specimen);
        let after = |points: u32, number: u64, element| {
            let mut sampled = SampledLight::default();
            let seed = Seed { number, well_spread: true };
            sampled.add(&lighting, element, points, seed);
            importance(sampled.mean(Rgb::splat(0.5)).irradiance)
        };
        // What the sun does not reach.
        let (mut squares, mut sum, mut right_sum, mut count) = (0.0, 0.0, 0.0, 0.0);
        for element in specimen.coarse.mesh.elements.all().filter(|element| element.0 % 7 == 0) {
            let right = after(2048, 99, element);
            if !(500.0..20_000.0).contains(&right) {
                continue;
            }
            for seed in 1..=8 {
                let own = after(4, seed, element);
                squares += (own - right).powi(2);
                (sum, right_sum, count) = (sum + own, right_sum + right, count + 1.0);
            }
        }
        let off = (squares / count).sqrt() / (right_sum / count);
        assert!(count >= 1000.0 && off < 0.2, "{off} {count}");
        assert!((sum / right_sum - 1.0).abs() < 0.05, "{}", sum / right_sum);
    }

    /// In a furnace the walls shine from everywhere: E = π L^e, and nothing is in between.
    #[test]
    fn light_from_everywhere_is_known_exactly() {
        let specimen = Specimen::furnace();
        let lighting = lighting(&specimen);
        for element in specimen.coarse.mesh.elements.all() {
            let mut sampled = SampledLight::default();
            sampled.add(&lighting, element, 8, SEED);
            let mean = sampled.mean(Rgb::splat(0.5));
            assert!(is_near(mean.irradiance, PI * EMISSION, 0.02), "{}", mean.irradiance);
            assert_eq!((mean.share, mean.open), (1.0, 1.0));
        }
    }
}
