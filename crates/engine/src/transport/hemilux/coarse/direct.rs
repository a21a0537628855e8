//! Tier 1's direct light: what shines on points of a patch.

use super::elements::{ElementIndex, Elements};
use crate::emitters::{PolygonLights, ShadowSample};
use crate::patches::PatchedScene;
use crate::radiometry::{Rgb, importance};
use crate::random::Stream;
use crate::rays::Eye;
use crate::sampling::{Seed, Shifted, cosine_direction};
use crate::surface::World;
use bytemuck::{Pod, Zeroable};

/// Share of a patch's side up to which a point of it sees something nearby: it is seen by that
/// rather than by what is farther away, for which the patch's light stands.
const CREVICE: f32 = 0.25;

/// Direct light on a patch.
#[derive(Clone, Copy)]
pub struct DirectLight {
    /// Mean irradiance of the points that are not inside a body.
    pub irradiance: Rgb,
    /// Share of the emitters' light that gets there, about.
    pub share: f32,
    /// Share of points that are not inside a body.
    pub open: f32,
}

/// Sums over points of a patch.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SampledLight {
    /// Of the points that others see.
    visible: Lit,
    /// Of those in crevices.
    hidden: Lit,
    points: u32,
    /// Points that are not inside a body.
    open: u32,
    /// Whether a ray left the scene.
    escaped: u32,
}

/// Direct light at points.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Lit {
    count: u32,
    unoccluded: Rgb,
    cast: Rgb,
    seen: Rgb,
}

/// What elements are lit in.
#[derive(Clone, Copy)]
pub struct Lighting<'a> {
    /// The scene as rays meet it.
    pub world: &'a World,
    /// Its emitters.
    pub lights: &'a PolygonLights,
    /// The scene in patches.
    pub scene: &'a PatchedScene,
    /// The elements.
    pub elements: &'a Elements,
}

impl SampledLight {
    /// Looks at more points of an element.
    pub fn add(&mut self, lit: &Lighting<'_>, element: ElementIndex, points: u32, seed: Seed) {
        let Lighting { world, lights, scene, elements } = *lit;
        let sequence = Shifted::new(seed, Stream::PatchLight, u64::from(element.0));
        let mut sequence = sequence.at(self.points);
        let crevice = CREVICE * elements.area[element.at()].sqrt() * world.rays.scale() as f32;
        self.points += points;
        for _ in 0..points {
            let xi = sequence.next_pair();
            let from = elements.points(world, scene, element, sequence.afresh().bounce[0]);
            let (start, normal) = from.point(xi);
            let direction = cosine_direction(normal, sequence.second_pair());
            let mut hidden = false;
            match world.rays.closest(Eye::Light, start, direction) {
                None => self.escaped = 1,
                // Seeing a black back: inside a body, or behind a one-sided wall; light never
                // comes here.
                Some(hit) if hit.back && !world.is_two_sided(hit.triangle) => continue,
                Some(hit) => hidden = hit.distance < crevice,
            }
            self.open += 1;
            let lit = if hidden { &mut self.hidden } else { &mut self.visible };
            lit.add(lights.once(&world.rays, start, normal, sequence.triple()));
        }
    }

    /// What the points say of the patch: those that others see, if there are such.
    pub fn mean(&self) -> DirectLight {
        let lit = if self.visible.count > 0 { self.visible } else { self.hidden };
        let open = self.open as f32 / self.points.max(1) as f32;
        DirectLight { irradiance: lit.irradiance(), share: lit.share(), open }
    }
}

impl Lit {
    fn add(&mut self, once: ShadowSample) {
        self.count += 1;
        self.unoccluded += once.unoccluded;
        self.cast += once.cast;
        if once.seen {
            self.seen += once.cast;
        }
    }

    /// Mean irradiance: that without occlusion times the share that is seen of what was cast.
    fn irradiance(&self) -> Rgb {
        let share = Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO);
        self.unoccluded * share / self.count.max(1) as f32
    }

    fn share(&self) -> f32 {
        importance(self.seen) / importance(self.cast).max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen, is_near};
    use std::f32::consts::PI;

    /// In a furnace the walls shine from everywhere: E = π L^e, and nothing is in between.
    #[test]
    fn light_from_everywhere_is_known_exactly() {
        let specimen = Specimen::furnace();
        let lit = Lighting {
            world: &specimen.world,
            lights: &specimen.lights,
            scene: &specimen.scene,
            elements: &specimen.coarse.mesh.elements,
        };
        for element in specimen.coarse.mesh.elements.all() {
            let mut sampled = SampledLight::default();
            sampled.add(&lit, element, 8, SEED);
            let mean = sampled.mean();
            assert!(is_near(mean.irradiance, PI * EMISSION, 0.02), "{}", mean.irradiance);
            assert_eq!((mean.share, mean.open), (1.0, 1.0));
        }
    }
}
