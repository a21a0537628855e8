//! Well-spread points: additive recurrences with irrational steps (Roberts 2018, "The unreasonable
//! effectiveness of quasirandom sequences"), shifted at random, so that any stretch of a sequence
//! is spread and its mean unbiased.

use crate::hemicube::frame;
use crate::random::{Numbers, Stream, pcg};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_4, PI};

/// Steps of the recurrence in two dimensions (plastic number) and in three.
const TWO: [u32; 2] = [3_242_174_889, 2_447_445_414];
const THREE: [u32; 3] = [3_518_319_155, 2_882_110_345, 2_360_945_575];
/// Two of those in five dimensions.
const FIVE: [u32; 2] = [3_785_032_107, 3_335_640_777];

/// The fraction of `shift` + `index`·step, exact however large the index.
#[inline]
fn fraction(shift: u32, step: u32, index: u32) -> f32 {
    (shift.wrapping_add(step.wrapping_mul(index)) >> 8) as f32 * (1.0 / 16_777_216.0)
}

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

/// A shifted sequence.
#[derive(Clone, Copy)]
pub struct Shifted {
    shift: [u32; 7],
    index: u32,
}

impl Shifted {
    /// The sequence of a purpose and a thing.
    pub fn new(seed: u64, stream: Stream, thing: u64) -> Self {
        let mut numbers = Numbers::new(seed, stream, thing);
        let shift = std::array::from_fn(|_| (numbers.fine() * 4_294_967_296.0) as u32);
        Self { shift, index: 0 }
    }

    /// The same sequence from another place on.
    pub fn at(self, index: u32) -> Self {
        Self { index, ..self }
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
        [fraction(self.shift[0], TWO[0], self.index), fraction(self.shift[1], TWO[1], self.index)]
    }

    /// Another point of the square at the same place.
    #[inline]
    pub fn second_pair(&self) -> [f32; 2] {
        [
            fraction(self.shift[3], THREE[1], self.index),
            fraction(self.shift[4], THREE[2], self.index),
        ]
    }

    /// Numbers to find light out afresh with, at the same place.
    #[inline]
    pub fn afresh(&self) -> Afresh {
        let bounce = [0, 1].map(|k| fraction(self.shift[5 + k], FIVE[k], self.index));
        Afresh { light: self.triple(), bounce, next: Some(Next(pcg(self.shift[5] ^ self.index))) }
    }

    /// A point of the cube at the same place.
    #[inline]
    pub fn triple(&self) -> Vec3 {
        Vec3::new(
            fraction(self.shift[2], THREE[0], self.index),
            fraction(self.shift[3], THREE[1], self.index),
            fraction(self.shift[4], THREE[2], self.index),
        )
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

    #[test]
    fn cosine_directions_have_the_right_moments() {
        let mut sequence = Shifted::new(3, Stream::Gather, 5);
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
            let mut sequence = Shifted::new(1, Stream::Gather, 2).at(start);
            let mut cells = [0; 16];
            for _ in 0..64 {
                let [x, y] = sequence.next_pair();
                cells[(x * 4.0) as usize * 4 + (y * 4.0) as usize] += 1;
            }
            assert!(cells.iter().all(|count| (2..=6).contains(count)), "{cells:?}");
        }
    }
}
