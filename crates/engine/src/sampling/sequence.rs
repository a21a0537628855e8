//! Well-spread points: additive recurrences with irrational steps (Roberts 2018, "The unreasonable
//! effectiveness of quasirandom sequences"), shifted at random, so that any stretch of a sequence
//! is spread and its mean unbiased.

use crate::random::{Numbers, Stream, pcg};
use crate::sampling::frame;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_4, PI};

/// Steps of the recurrences, of 2³²: of the first pair those by the plastic number, the best of two
/// dimensions; the others are such that none of them go together, as a search for the largest smallest
/// ‖Σ kᵢ stepᵢ‖ Π |kᵢ| over small whole numbers k found them (‖x‖ is how far x is from a whole number).
/// Roberts' steps of two and of three dimensions are good each, and bad together: twice the first, the
/// third and the fourth make almost a whole number, so that a ray's direction, and which light was asked
/// there, were bound to each other through 35,000 rays.
const STEPS: [u32; 9] = [
    3_242_174_889,
    2_447_445_414,
    874_672_414,
    1_099_659_609,
    3_539_870_644,
    805_630_719,
    3_868_009_847,
    978_771_641,
    1_239_892_157,
];
/// From a place of the sequence to that of another pixel's first point: the first points of few pixels are
/// spread like a sequence.
const PIXEL_STEP: u32 = 60_437_771;

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
    shift: [u32; STEPS.len()],
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

    /// The n-th point of one of few pixels that share a sequence. The n-th place within a pixel goes by the
    /// same steps as [`Shifted::pair`], which is not to be used beside it.
    pub fn of_pixel(self, pixel: u32, n: u32) -> Self {
        self.at(pixel.wrapping_mul(PIXEL_STEP).wrapping_add(n))
    }

    /// The `k`-th number: the fraction of shift + index·step, exact however large the index.
    #[inline]
    fn number(&self, k: usize) -> f32 {
        let bits = if self.well_spread {
            self.shift[k].wrapping_add(STEPS[k].wrapping_mul(self.index))
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
        [self.number(0), self.number(1)]
    }

    /// Another point of the square at the same place: two numbers of [`Shifted::triple`].
    #[inline]
    pub fn second_pair(&self) -> [f32; 2] {
        [self.number(3), self.number(4)]
    }

    /// A third one.
    #[inline]
    pub fn third_pair(&self) -> [f32; 2] {
        [self.number(7), self.number(8)]
    }

    /// Numbers to find light out afresh with, at the same place.
    #[inline]
    pub fn afresh(&self) -> Afresh {
        let bounce = [self.number(5), self.number(6)];
        Afresh { light: self.triple(), bounce, next: Some(Next(pcg(self.shift[5] ^ self.index))) }
    }

    /// The same, when the point of the cube was taken: plain random numbers.
    pub fn apart(&self) -> Afresh {
        let first = Next(pcg(self.shift[5] ^ self.index));
        Afresh { next: Some(Next(pcg(first.0))), ..first.afresh() }
    }

    /// Plain random numbers at the same place, beside those of [`Shifted::apart`].
    pub fn beside(&self) -> Next {
        Next(pcg(self.shift[3] ^ pcg(self.index)))
    }

    /// Numbers for another try where those of [`Shifted::triple`] gave nothing: plain random ones. Those of
    /// another place of the sequence would be a fixed step away from the first, and so go by where these
    /// failed.
    pub fn again(&self, tries: u32) -> Vec3 {
        Next(pcg(self.shift[4] ^ pcg(self.index)) ^ pcg(tries)).afresh().light
    }

    /// The present place, and bits that tell the sequence from others.
    #[inline]
    pub fn place(&self) -> (u32, u32) {
        (self.index, self.shift[6])
    }

    /// A point of the cube at the same place.
    #[inline]
    pub fn triple(&self) -> Vec3 {
        Vec3::new(self.number(2), self.number(3), self.number(4))
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

    /// The largest of ‖Σ kᵢ stepᵢ‖ Π |kᵢ| that whole numbers k up to `most` of three steps do not fall below.
    fn least_bond(steps: &[u32], most: i64) -> f64 {
        let of = |k: [i64; 3], [a, b, c]: [u32; 3]| {
            let sum = [a, b, c]
                .iter()
                .zip(k)
                .fold(0u32, |sum, (step, k)| sum.wrapping_add(step.wrapping_mul(k as u32)));
            let off = f64::from(sum.min(sum.wrapping_neg())) / 4_294_967_296.0;
            off * k.map(|k| k.abs().max(1) as f64).iter().product::<f64>()
        };
        let mut least = f64::INFINITY;
        for (i, a) in steps.iter().enumerate() {
            for (j, b) in steps.iter().enumerate().skip(i + 1) {
                for c in &steps[j + 1..] {
                    for k in (0..(2 * most + 1).pow(3)).map(|n| {
                        let side = 2 * most + 1;
                        [n % side - most, n / side % side - most, n / side / side - most]
                    }) {
                        if k != [0; 3] {
                            least = least.min(of(k, [*a, *b, *c]));
                        }
                    }
                }
            }
        }
        least
    }

    /// What is found by any two or three of the numbers does not hang on chance.
    #[test]
    fn no_numbers_go_together() {
        let least = least_bond(&STEPS, 10);
        assert!(least > 3e-4, "{least}");
        let by_dimension = [3_242_174_889, 2_447_445_414, 3_518_319_155, 2_882_110_345];
        let least = least_bond(&by_dimension, 10);
        assert!(least < 1e-4, "{least}: Roberts' steps of two and three dimensions do go together");
    }

    /// The first points of few pixels are spread along each axis, and so are those of each fourth, and of
    /// four that are tried in turn.
    #[test]
    fn pixels_of_a_tile_share_a_sequence() {
        let sequence = Shifted::new(SEED, Stream::Gather, 2);
        for axis in 0..3 {
            let widest = |of: &dyn Fn(u32) -> u32, count: u32| {
                let number = |pixel| sequence.of_pixel(of(pixel), 0).triple()[axis];
                let mut all: Vec<f32> = (0..count).map(number).collect();
                all.sort_by(f32::total_cmp);
                let around = 1.0 - all[all.len() - 1] + all[0];
                all.windows(2).map(|pair| pair[1] - pair[0]).fold(around, f32::max) * count as f32
            };
            let all =
                [widest(&|pixel| pixel, 16), widest(&|pixel| 4 * pixel, 16), widest(&|n| n, 4)];
            assert!(all.iter().all(|widest| *widest < 2.0), "{axis}: {all:?}");
        }
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
