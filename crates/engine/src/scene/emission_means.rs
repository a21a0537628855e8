//! Mean emission of a triangle whose texture varies it, of its four parts, of theirs, and so on.

use super::lit_texels::LitTexels;
use super::{Scene, Triangle};
use crate::radiometry::{Rgb, importance};
use glam::{DVec3, Vec2};
use rayon::prelude::*;

/// Samples along a texel, unless there would be too many.
const SAMPLES_PER_TEXEL: f32 = 2.0;
/// Samples that are farther apart, texels, are not put into the middle of their parts: a pattern of
/// the texture could be in step with them.
const IN_STEP: f32 = 0.75;
/// Most levels of means of a triangle: 4⁶ = 4,096 parts.
const MOST_LEVELS: u32 = 6;
/// Most levels by which samples are spread: 4⁹ = 262,144 samples of a triangle.
const MOST_SAMPLE_LEVELS: u32 = 9;
/// Fewest of them: 64 samples.
const LEAST_SAMPLE_LEVELS: u32 = 3;
/// Parts of all triangles together for which means are kept, at most unless it is one a triangle.
const MOST_PARTS: u64 = 1 << 19;
/// Samples of all triangles together, at most unless it is the fewest of each.
const MOST_SAMPLES: u64 = 1 << 23;

/// The means of all triangles of a scene that a texture lets emit.
pub struct TexturedEmission {
    triangles: Vec<u32>,
    means: Vec<EmissionMeans>,
}

impl TexturedEmission {
    /// Averages what these triangles of a scene emit.
    pub fn new(scene: &Scene, triangles: Vec<u32>) -> Self {
        let lit = LitTexels::new(scene);
        let bounds = MeanBounds::new(scene, &triangles);
        let of = |triangle: &u32| EmissionMeans::new(scene, &lit, *triangle, bounds);
        Self { means: triangles.par_iter().map(of).collect(), triangles }
    }

    /// The triangles, in the scene's order.
    pub fn triangles(&self) -> &[u32] {
        &self.triangles
    }

    /// The means of each of them.
    pub fn means(&self) -> &[EmissionMeans] {
        &self.means
    }

    /// Bytes that they take.
    pub fn held_bytes(&self) -> u64 {
        self.means.iter().map(EmissionMeans::held_bytes).sum()
    }
}

/// How many levels the triangles of a scene have.
#[derive(Clone, Copy)]
struct MeanBounds {
    levels: u32,
    sample_levels: u32,
}

impl MeanBounds {
    /// For the given emissive triangles of a scene, so that all together have not too many.
    fn new(scene: &Scene, triangles: &[u32]) -> Self {
        let wanted: Vec<u32> =
            triangles.iter().map(|triangle| wanted_levels(scene, *triangle)).collect();
        let all = |levels: u32| wanted.iter().map(|own| 4u64.pow(levels.min(*own))).sum::<u64>();
        let deepest = |most: u32, least: u32, bound: u64| {
            (least..=most).rev().find(|levels| all(*levels) <= bound).unwrap_or(least)
        };
        Self {
            levels: deepest(MOST_LEVELS, 0, MOST_PARTS),
            sample_levels: deepest(MOST_SAMPLE_LEVELS, LEAST_SAMPLE_LEVELS, MOST_SAMPLES),
        }
    }
}

/// Length of the longest side of a triangle, texels.
fn longest_side(scene: &Scene, triangle: u32) -> f32 {
    let triangle = &scene.triangle(triangle);
    let material = &scene.materials[triangle.material as usize];
    let Some(slot) = &material.emission_texture else { return 0.0 };
    let texture = &scene.textures[slot.texture as usize];
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let [a, b, c] = scene.coordinates(slot, triangle).map(|uv| slot.transformed(uv) * size);
    (b - a).length().max((c - b).length()).max((a - c).length())
}

/// Levels at which samples are about half a texel apart.
fn wanted_levels(scene: &Scene, triangle: u32) -> u32 {
    let levels = (longest_side(scene, triangle) * SAMPLES_PER_TEXEL).max(1.0).log2().ceil();
    // What is not finite is sampled as little as what is small.
    (levels as u32).clamp(LEAST_SAMPLE_LEVELS, MOST_SAMPLE_LEVELS)
}

/// The means of one triangle.
pub struct EmissionMeans {
    /// Means of all 4ˡ parts of level l; those of part k are 4k to 4k + 3 in the next.
    levels: Vec<Vec<Rgb>>,
    /// Least and greatest sample.
    range: [Rgb; 2],
}

/// Samples a triangle's emission.
struct Sampling<'a> {
    scene: &'a Scene,
    lit: &'a LitTexels,
    triangle: &'a Triangle,
    /// Whether samples lie in the middle of their parts.
    centered: bool,
    /// Samples so far, by which the next ones are placed.
    count: u32,
    range: [Rgb; 2],
}

impl EmissionMeans {
    /// Averages the emission of a triangle.
    fn new(scene: &Scene, lit: &LitTexels, triangle: u32, bounds: MeanBounds) -> Self {
        let wanted = wanted_levels(scene, triangle);
        let (levels, sample_levels) = (bounds.levels.min(wanted), bounds.sample_levels.min(wanted));
        let apart = longest_side(scene, triangle) / 2f32.powi(sample_levels as i32);
        let mut sampling = Sampling {
            scene,
            lit,
            triangle: &scene.triangle(triangle),
            centered: apart <= IN_STEP,
            count: 0,
            range: [Rgb::INFINITY, Rgb::ZERO],
        };
        let mut means: Vec<Vec<Rgb>> =
            (0..=levels).map(|level| vec![Rgb::ZERO; 4usize.pow(level)]).collect();
        let whole = [Vec2::ZERO, Vec2::X, Vec2::Y];
        sampling.mean(whole, [0, sample_levels], 0, &mut means);
        Self { levels: means, range: sampling.range }
    }

    fn held_bytes(&self) -> u64 {
        let of = |level: &Vec<Rgb>| size_of_val(&**level) + size_of::<Vec<Rgb>>();
        (self.levels.iter().map(of).sum::<usize>() + size_of::<Self>()) as u64
    }

    /// Mean of a part.
    pub fn at(&self, level: u32, index: u32) -> Rgb {
        self.levels[level as usize][index as usize]
    }

    /// Whether it emits the same everywhere.
    pub fn is_even(&self) -> bool {
        self.range[0] == self.range[1]
    }

    /// How much the parts of a part differ from its mean, as a share of the triangle's area: the
    /// sum over its four parts, and over theirs with the weight `fine`, and so on.
    pub fn difference(&self, level: u32, index: u32, fine: f64) -> f64 {
        if level as usize + 1 >= self.levels.len() {
            return 0.0;
        }
        let (mean, share) = (self.at(level, index), 0.25f64.powi(level as i32 + 1));
        (4 * index..4 * index + 4)
            .map(|part| {
                let off = f64::from(importance((self.at(level + 1, part) - mean).abs()));
                share * off + fine * self.difference(level + 1, part, fine)
            })
            .sum()
    }
}

impl Sampling<'_> {
    /// Mean over a part at a level, which is noted in `means` as far as those go; `last` is the
    /// level of samples.
    fn mean(
        &mut self,
        corners: [Vec2; 3],
        [level, last]: [u32; 2],
        index: usize,
        means: &mut [Vec<Rgb>],
    ) -> DVec3 {
        let mean = if !self.may_shine(corners) {
            self.note(Rgb::ZERO);
            DVec3::ZERO
        } else if level == last {
            self.sample(corners).as_dvec3()
        } else {
            let part = |part: u32| {
                let corners = part_of(corners, part);
                self.mean(corners, [level + 1, last], 4 * index + part as usize, means)
            };
            (0..4).map(part).sum::<DVec3>() / 4.0
        };
        if let Some(means) = means.get_mut(level as usize) {
            means[index] = mean.as_vec3();
        }
        mean
    }

    fn may_shine(&self, corners: [Vec2; 3]) -> bool {
        let material = &self.scene.materials[self.triangle.material as usize];
        let Some(slot) = &material.emission_texture else { return true };
        let [a, b, c] = self.scene.coordinates(slot, self.triangle);
        let corners = corners.map(|at| a * (1.0 - at.x - at.y) + b * at.x + c * at.y);
        self.lit.may_shine(self.scene, slot, corners)
    }

    /// Emission at a point of a part, in its middle or at another place each time.
    fn sample(&mut self, [a, b, c]: [Vec2; 3]) -> Rgb {
        if self.centered {
            let at = (a + b + c) / 3.0;
            let value = self.scene.emission(self.triangle, at.x, at.y);
            self.note(value);
            return value;
        }
        self.count += 1;
        let step = Vec2::new(0.754_877_7, 0.569_840_3);
        let mut at = (step * (self.count % (1 << 14)) as f32).fract();
        if at.x + at.y > 1.0 {
            at = 1.0 - at;
        }
        let at = a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
        let value = self.scene.emission(self.triangle, at.x, at.y);
        self.note(value);
        value
    }

    fn note(&mut self, value: Rgb) {
        self.range = [self.range[0].min(value), self.range[1].max(value)];
    }
}

/// The corners of one of the four parts of a triangle: three at its corners, the last between
/// them, turned by half a turn.
pub fn part_of([a, b, c]: [Vec2; 3], part: u32) -> [Vec2; 3] {
    let (ab, bc, ca) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a));
    match part {
        0 => [a, ab, ca],
        1 => [ab, b, bc],
        2 => [ca, bc, c],
        _ => [bc, ca, ab],
    }
}
