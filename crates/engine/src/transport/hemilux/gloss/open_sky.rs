//! What a lobe would reflect of the sky if nothing were in the way, found without a ray being
//! traced: by directions of the lobe's own and others by the sky's light. (Means of the sky over the
//! solid angle that a direction stands for, Křivánek and Colbert 2008, were too bright by 2.5 %
//! beside a lamp of 5°: where directions are dense they had its light, and where they are few the
//! means had it again. Nor was their noise lower, given directions of both kinds.)

use crate::emitters::DirectLights;
use crate::radiometry::Rgb;
use crate::random::pcg;
use crate::sampling::Shifted;
use crate::surface::{Reflection, Surface, World};
use crate::transport::hemilux::fragments::{Lobe, VisibleSurfaces};
use glam::Vec3;

/// Places of a pixel that batches start from, at most: more than there are samples.
const MOST_PLACES: u32 = 4096;
/// Directions in a batch.
const BATCH: u32 = 8;
/// Those of them that are picked by the sky's light, where the lobe is wide.
const BY_SKY: f32 = 3.0;
/// An exponent from which on fewer are: a sharp lobe finds the sky by itself.
const SHARP_FROM: f32 = 20.0;

/// The lobe of a surface, and how its directions are picked.
struct Picks<'a> {
    lights: &'a DirectLights,
    surface: Surface,
    viewer: Vec3,
    /// Directions of a batch by the lobe, and by the sky.
    counts: [u32; 2],
}

/// Radiance that the lobe reflects of an open sky by the batch of that number, and its albedo where
/// that starts. What is clear has no such lobe: nothing, as its rays say.
pub fn batch(
    (world, lights): (&World, &DirectLights),
    visible: &VisibleSurfaces,
    (lobe, batch): (&Lobe, u32),
    numbers: &Shifted,
) -> (Rgb, Rgb) {
    // At random, not in turn, so that few batches are no more likely to be of one side of the pixel.
    let place = pcg(lobe.fragment ^ pcg(batch)) % MOST_PLACES;
    let surface = visible.surface(world, lobe, (place, batch));
    if world.is_clear(surface.triangle) {
        return (Rgb::ZERO, Rgb::ONE);
    }
    let surface = surface.lobe_only();
    let viewer = visible.frame.towards_eye(surface.spot.point);
    let reflection = surface.reflection();
    let sharpness = (SHARP_FROM / (reflection.widest_exponent() + 1.0)).min(1.0);
    let by_sky = (BY_SKY * sharpness).round() as u32;
    let picks = Picks { lights, surface, viewer, counts: [BATCH - by_sky, by_sky] };
    let mut sum = Rgb::ZERO;
    for (count, is_by_sky) in picks.counts.into_iter().zip([false, true]) {
        for sample in 0..count {
            let at = numbers.at(batch.wrapping_mul(count).wrapping_add(sample));
            let direction = match is_by_sky {
                true => picks.by_sky(at.second_pair()),
                false => Some(picks.by_lobe(at.pair())),
            };
            sum += direction.map_or(Rgb::ZERO, |direction| picks.along(direction));
        }
    }
    (sum, reflection.albedo(viewer))
}

impl Picks<'_> {
    fn by_lobe(&self, xi: [f32; 2]) -> Vec3 {
        self.surface.reflection().lobe_direction(self.viewer, xi)
    }

    fn by_sky(&self, xi: [f32; 2]) -> Option<Vec3> {
        self.lights.sky_direction(self.surface.shading_normal, xi)
    }

    /// What a direction adds to a batch's mean: the sky's radiance times f_r cosθ over the density
    /// of both kinds together (balance heuristic, Veach and Guibas 1995); nothing below either
    /// horizon.
    fn along(&self, direction: Vec3) -> Rgb {
        let normal = self.surface.shading_normal;
        let cosine = normal.dot(direction);
        if cosine <= 0.0 || self.surface.normal.dot(direction) <= 0.0 {
            return Rgb::ZERO;
        }
        let (value, pdf) = self.surface.reflection().evaluate_with_pdf(self.viewer, direction, 0.0);
        let (radiance, sky_pdf) = self.lights.sky(normal, direction);
        let density = self.counts[0] as f32 * pdf + self.counts[1] as f32 * sky_pdf;
        if density > 0.0 { value.both() * radiance * (cosine / density) } else { Rgb::ZERO }
    }
}
