//! Well-spread points: additive recurrences with irrational steps (Roberts 2018, "The unreasonable
//! effectiveness of quasirandom sequences"), shifted at random, so that any stretch of a sequence
//! is spread and its mean unbiased.

use crate::random::{Numbers, Stream, pcg};
use crate::sampling::frame;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_4, PI};

/// Steps of the recurrence in two dimensions (plastic number) and in three.
const TWO: [u32; 2] = [3_242_174_889, 2_447_445_414];
const THREE: [u32; 3] = [3_518_319_155, 2_882_110_345, 2_360_945_575];
/// Two of those in five dimensions.
const FIVE: [u32; 2] = [3_785_032_107, 3_335_640_777];

/// Order in which the pixels of a tile of 4 × 4 take the points of a sequence (Bayer 1973).
pub const BAYER: [u32; 16] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

/// Random numbers to find light out afresh with.
#[derive(Clone, Copy)]
pub struct Afresh {
    /// A point on a light.
    pub light: Vec3,
    /// A direction.
    pub bounce: [f32; 2],
    /// Those of the next bounce; the last one has none.
    pub next: Option<Next>,
}

/// Seed of the numbers of a next bounce: plain random ones, points of so many dimensions would not
/// be well spread.
#[derive(Clone, Copy)]
pub struct Next(u32);

impl Next {
    /// Those of the bounce behind.
    pub fn after(self) -> Self {
        Self(pcg(self.0 ^ 0x9e37_79b9))
    }

    /// One number beside them.
    pub fn number(self) -> f32 {
        (pcg(self.0 ^ 0x85eb_ca6b) >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// The numbers.
    pub fn afresh(self) -> Afresh {
        let mut state = self.0;
        let mut number = || {
            state = pcg(state);
            (state >> 8) as f32 * (1.0 / 16_777_216.0)
        };
        let light = Vec3::new(number(), number(), number());
        Afresh { light, bounce: [number(), number()], next: None }
    }
}

/// What numbers are drawn by.
#[derive(Clone, Copy, PartialEq)]
pub struct Seed {
    /// Of the job.
    pub number: u64,
    /// Whether points are well spread, rather than plainly random.
    pub well_spread: bool,
}

/// A shifted sequence.
#[derive(Clone, Copy)]
pub struct Shifted {
    shift: [u32; 7],
    index: u32,
    well_spread: bool,
}

impl Shifted {
    /// The sequence of a purpose and a thing.
    pub fn new(seed: Seed, stream: Stream, thing: u64) -> Self {
        let mut numbers = Numbers::new(seed.number, stream, thing);
        let shift = std::array::from_fn(|_| (numbers.fine() * 4_294_967_296.0) as u32);
        Self { shift, index: 0, well_spread: seed.well_spread }
    }

    /// The same sequence from another place on.
    pub fn at(self, index: u32) -> Self {
        Self { index, ..self }
    }

    /// The number of the `k`-th shift in steps of `step`: the fraction of shift + index·step, exact
    /// however large the index.
    #[inline]
    fn number(&self, k: usize, step: u32) -> f32 {
        let bits = if self.well_spread {
            self.shift[k].wrapping_add(step.wrapping_mul(self.index))
        } else {
            pcg(self.shift[k] ^ pcg(self.index))
        };
        (bits >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// The next point of the square.
    #[inline]
    pub fn next_pair(&mut self) -> [f32; 2] {
        self.index = self.index.wrapping_add(1);
        self.pair()
    }

    /// The point of the square at the present place.
    #[inline]
    pub fn pair(&self) -> [f32; 2] {
        [self.number(0, TWO[0]), self.number(1, TWO[1])]
    }

    /// Another point of the square at the same place.
    #[inline]
    pub fn second_pair(&self) -> [f32; 2] {
        [self.number(3, THREE[1]), self.number(4, THREE[2])]
    }

    /// Numbers to find light out afresh with, at the same place.
    #[inline]
    pub fn afresh(&self) -> Afresh {
        let bounce = [0, 1].map(|k| self.number(5 + k, FIVE[k]));
        Afresh { light: self.triple(), bounce, next: Some(Next(pcg(self.shift[5] ^ self.index))) }
    }

    /// The same, when the point of the cube was taken: plain random numbers.
    pub fn apart(&self) -> Afresh {
        let first = Next(pcg(self.shift[5] ^ self.index));
        Afresh { next: Some(Next(pcg(first.0))), ..first.afresh() }
    }

    /// The present place, and bits that tell the sequence from others.
    #[inline]
    pub fn place(&self) -> (u32, u32) {
        (self.index, self.shift[6])
    }

    /// A point of the cube at the same place.
    #[inline]
    pub fn triple(&self) -> Vec3 {
        Vec3::new(self.number(2, THREE[0]), self.number(3, THREE[1]), self.number(4, THREE[2]))
    }
}

/// A direction about `normal` with density cosθ/π, from the square by way of the disk with little
/// distortion (Shirley and Chiu 1997).
#[inline]
pub fn cosine_direction(normal: Vec3, xi: [f32; 2]) -> Vec3 {
    let (tangent, bitangent) = frame(normal, 0.0);
    let (local, height) = cosine_local(xi);
    (tangent * local.x + bitangent * local.y + normal * height).normalize()
}

/// The same in the frame of the normal: along tangent and bitangent, and the height.
#[inline]
pub fn cosine_local(xi: [f32; 2]) -> (Vec2, f32) {
    let (x, y) = (2.0 * xi[0] - 1.0, 2.0 * xi[1] - 1.0);
    if x == 0.0 && y == 0.0 {
        return (Vec2::ZERO, 1.0);
    }
    let (radius, angle) = if x.abs() > y.abs() {
        (x, FRAC_PI_4 * (y / x))
    } else {
        (y, 0.5 * PI - FRAC_PI_4 * (x / y))
    };
    let (sin, cos) = angle.sin_cos();
    let height = (1.0 - radius * radius).max(0.0).sqrt();
    (Vec2::new(radius * cos, radius * sin), height)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEED: Seed = Seed { number: 3, well_spread: true };

    #[test]
    fn plain_numbers_are_spread_as_random_ones_are() {
        let mut sequence = Shifted::new(Seed { well_spread: false, ..SEED }, Stream::Gather, 5);
        let mut cells = [0i32; 16];
        const COUNT: i32 = 16_000;
        for _ in 0..COUNT {
            let [x, y] = sequence.next_pair();
            cells[(x * 4.0) as usize * 4 + (y * 4.0) as usize] += 1;
        }
        // χ² with 15 degrees of freedom: far below it is as wrong as far above.
        let mean = COUNT / 16;
        let chi: f64 = cells.iter().map(|n| f64::from(n - mean).powi(2) / f64::from(mean)).sum();
        assert!((4.0..38.0).contains(&chi), "{chi}");
    }

    #[test]
    fn cosine_directions_have_the_right_moments() {
        let mut sequence = Shifted::new(SEED, Stream::Gather, 5);
        let normal = Vec3::new(0.6, -0.48, 0.64);
        let (mut mean, mut square) = (Vec3::ZERO, 0.0);
        const COUNT: u32 = 4096;
        for _ in 0..COUNT {
            let direction = cosine_direction(normal, sequence.next_pair());
            mean += direction / COUNT as f32;
            square += direction.dot(normal).powi(2) / COUNT as f32;
        }
        // E[ω] = ⅔ n, E[cos²θ] = ½.
        assert!((mean - normal * (2.0 / 3.0)).length() < 3e-3, "{mean}");
        assert!((square - 0.5).abs() < 2e-3, "{square}");
    }

    #[test]
    fn any_stretch_is_spread() {
        for start in [0, 1000, u32::MAX - 30] {
            let mut sequence = Shifted::new(SEED, Stream::Gather, 2).at(start);
            let mut cells = [0; 16];
            for _ in 0..64 {
                let [x, y] = sequence.next_pair();
                cells[(x * 4.0) as usize * 4 + (y * 4.0) as usize] += 1;
            }
            assert!(cells.iter().all(|count| (2..=6).contains(count)), "{cells:?}");
        }
    }
}
