//! Who shoots, from where, and through which faces (Antal §2.3, §2.4).

use super::iterate::{CpuShooting, NOT_GLOSSY};
use crate::device::{Faces, MIRROR_FACE_PROBABILITY, OTHER_FACE_PROBABILITY, Selection};
use crate::hemicube::{FACES, Face, Shot};
use crate::patches::PatchIndex;
use crate::radiometry::{LobeAlbedo, Rgb, importance};
use crate::random::{Stream, uniform};
use crate::sampling::frame;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// The Phong lobe that a shooter sends.
struct Lobe {
    /// Radiance at its peak.
    peak: Rgb,
    /// Unit mirror direction.
    axis: Vec3,
    /// Importance of the power per area that it carries.
    power: f32,
}

const NO_LOBE: Lobe = Lobe { peak: Rgb::ZERO, axis: Vec3::ZERO, power: 0.0 };

impl CpuShooting<'_> {
    /// Picks this iteration's shooters. `None` where there is no power at all.
    ///
    /// By power: where the cumulative power passes a share ξ_k of the total. Stratified,
    /// ξ_k = (k + ξ)/K with one ξ for all (systematic sampling).
    pub fn select(&mut self) -> Option<Vec<Shot>> {
        let mut total = 0f64;
        for (sum, power) in self.state.cumulative.iter_mut().zip(&self.state.power) {
            total += f64::from(*power);
            *sum = total;
        }
        if total <= 0.0 || !total.is_finite() {
            return None;
        }
        let count = self.settings.shots_per_iteration;
        let patches = self.state.cumulative.len();
        let shots = (0..count)
            .map(|k| {
                let (place, strata) = self.place_of_pick(k);
                let (patch, probability) = match self.settings.selection {
                    Selection::Power => {
                        let at = place / f64::from(strata) * total;
                        let sums = &self.state.cumulative;
                        let patch = sums.partition_point(|sum| *sum <= at).min(patches - 1);
                        (patch, (f64::from(self.state.power[patch]) / total) as f32)
                    }
                    Selection::Uniform => {
                        // Whole numbers, so that every device picks the same: ξ has 24 bits.
                        const UNIT: u64 = 1 << 24;
                        let place = (place * UNIT as f64) as u128;
                        let whole = u128::from(strata) * u128::from(UNIT);
                        let patch = (place * patches as u128 / whole) as usize;
                        (patch, (patches as f32).recip())
                    }
                };
                self.shot_from(patch as u32, probability, k)
            })
            .collect();
        Some(shots)
    }

    /// Where pick k of this iteration falls, and the end of the range from 0 that it is picked
    /// from: K strata, or one.
    fn place_of_pick(&self, k: u32) -> (f64, u32) {
        let seed = self.settings.seed;
        if self.settings.stratified {
            let offset = uniform(seed, Stream::Shooter, self.state.iteration);
            (f64::from(k) + f64::from(offset), self.settings.shots_per_iteration)
        } else {
            (f64::from(uniform(seed, Stream::Shooter, self.counter(k))), 1)
        }
    }

    /// Number of shot k of this iteration among all shots.
    fn counter(&self, k: u32) -> u64 {
        self.state.iteration * u64::from(self.settings.shots_per_iteration) + u64::from(k)
    }

    /// Shot k of this iteration from a patch that was picked with the given probability.
    fn shot_from(&self, patch: u32, probability: f32, k: u32) -> Shot {
        let patches = &self.scene.patches;
        let settings = &self.settings;
        let counter = self.counter(k);
        let draw = |stream| uniform(settings.seed, stream, counter);
        let i = patch as usize;
        let normal = patches.normal[i];
        let azimuth = if settings.random_azimuth { TAU * draw(Stream::Azimuth) } else { 0.0 };
        let (tangent, bitangent) = frame(normal, azimuth);
        let jitter = if settings.jitter {
            Vec2::new(draw(Stream::JitterX), draw(Stream::JitterY)) - 0.5
        } else {
            Vec2::ZERO
        };
        let position = if settings.random_point {
            let xi = Vec2::new(draw(Stream::PointU), draw(Stream::PointV));
            self.scene.point_on_patch(PatchIndex(patch), xi)
        } else {
            patches.centroid[i]
        };
        let diffuse = self.source[i] + self.state.irradiance[i] * patches.diffuse[i] / PI;
        let lobe = self.reflected_lobe(i, draw(Stream::Lobe));
        let mut shot = Shot {
            patch,
            position,
            tangent,
            bitangent,
            normal,
            jitter,
            face_weights: [1.0; FACES],
            diffuse,
            known: settings.known.as_ref().map_or(Rgb::ZERO, |known| known.radiance[i]),
            lobe: lobe.peak,
            lobe_axis: lobe.axis,
            exponent: patches.exponent[i],
            probability,
            scale: patches.area[i] / (probability * settings.shots_per_iteration as f32),
        };
        let specular = lobe.power > importance(PI * diffuse);
        shot.face_weights =
            face_weights(settings.faces, specular, shot.to_frame(lobe.axis), draw(Stream::Face));
        shot
    }

    /// The Phong lobe that a patch sends: that of one of its K incoming directions, picked by
    /// reflected power and divided by that probability.
    fn reflected_lobe(&self, patch: usize, xi: f32) -> Lobe {
        let row = self.glossy_row[patch];
        if row == NOT_GLOSSY {
            return NO_LOBE;
        }
        let patches = &self.scene.patches;
        let exponent = patches.exponent[patch];
        let shots = self.settings.shots_per_iteration as usize;
        let incoming = &self.state.incoming[row as usize * shots..][..shots];
        let direction =
            |k: usize| (self.state.sources[k] - patches.centroid[patch]).normalize_or_zero();
        let weight = |k: usize| {
            let cosine = patches.normal[patch].dot(direction(k));
            importance(patches.specular[patch] * incoming[k])
                * LobeAlbedo::shared().at(exponent, cosine)
        };
        let total: f32 = (0..shots).map(weight).sum();
        if total <= 0.0 {
            return NO_LOBE;
        }
        let (mut left, mut picked, mut picked_weight) = (xi * total, 0, 0.0);
        for k in 0..shots {
            let weight = weight(k);
            if weight > 0.0 {
                (picked, picked_weight) = (k, weight);
                if left < weight {
                    break;
                }
            }
            left -= weight;
        }
        let normal = patches.normal[patch];
        let to_source = direction(picked);
        let scale = (exponent + 2.0) / TAU * total / picked_weight;
        Lobe {
            peak: patches.specular[patch] * incoming[picked] * scale,
            axis: 2.0 * normal.dot(to_source) * normal - to_source,
            power: total,
        }
    }
}

/// Weight of each face: 0 to leave it out, else the inverse of its probability. `mirror` is the
/// mirror direction in the hemicube frame, `xi` one uniform number.
fn face_weights(faces: Faces, specular: bool, mirror: Vec3, xi: f32) -> [f32; FACES] {
    match (faces, specular) {
        (Faces::All, _) | (Faces::Specular, false) => [1.0; FACES],
        (Faces::Specular | Faces::Randomised, true) => {
            let hit = Face::hit_by(mirror) as usize;
            let mut weights = [0.0; FACES];
            if xi < MIRROR_FACE_PROBABILITY {
                weights[hit] = MIRROR_FACE_PROBABILITY.recip();
            } else {
                let other = ((xi - MIRROR_FACE_PROBABILITY) / OTHER_FACE_PROBABILITY) as usize;
                let other = other.min(FACES - 2);
                weights[other + usize::from(other >= hit)] = OTHER_FACE_PROBABILITY.recip();
            }
            weights
        }
        (Faces::TopAndSide, _) | (Faces::Randomised, false) => {
            let sides = FACES - 1;
            let mut weights = [0.0; FACES];
            weights[0] = 1.0;
            weights[1 + ((xi * sides as f32) as usize).min(sides - 1)] = sides as f32;
            weights
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_choice_of_faces_has_weight_one_on_average() {
        const DRAWS: usize = 40_000;
        for faces in [Faces::All, Faces::Specular, Faces::TopAndSide, Faces::Randomised] {
            for specular in [false, true] {
                for hit in Face::ALL {
                    let mut sums = [0f64; FACES];
                    for draw in 0..DRAWS {
                        let xi = (draw as f32 + 0.5) / DRAWS as f32;
                        let weights = face_weights(faces, specular, hit.axes().0, xi);
                        for (sum, weight) in sums.iter_mut().zip(weights) {
                            *sum += f64::from(weight) / DRAWS as f64;
                        }
                    }
                    let worst = sums.iter().map(|sum| (sum - 1.0).abs()).fold(0.0, f64::max);
                    assert!(worst < 1e-3, "{faces:?} {specular} {hit:?}: {sums:?}");
                }
            }
        }
    }
}
