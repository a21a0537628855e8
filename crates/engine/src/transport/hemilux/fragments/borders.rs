//! How long the borders between surfaces are within a pixel. A share of a pixel by samples is the more
//! uncertain the longer the border of what takes it: leaves, wires and holes have several times that of
//! one straight edge. Samples next to each other that see different things tell.

use super::samples::MOST_SAMPLES;
use glam::Vec2;

/// Samples that are no farther apart than this, in mean distances, are next to each other.
const NEXT: f32 = 1.6;
/// Straight lines by which these are told what one crosses in the mean: directions, and places of each.
const LINES: [u32; 2] = [16, 8];
/// What a sample sees that meets no surface.
pub const BESIDE: u8 = u8::MAX;

/// What each sample of a pixel sees, by a number for each thing.
pub type Things = [u8; MOST_SAMPLES as usize];

/// Pairs of samples that are next to each other.
pub struct Borders {
    pairs: Vec<[u8; 2]>,
    /// How many of them a straight line through the pixel divides, in the mean.
    by_a_line: f32,
}

impl Borders {
    /// Of a pattern of samples.
    pub fn new(samples: &[Vec2]) -> Self {
        let reach = NEXT / (samples.len() as f32).sqrt();
        let others = |one: usize| (0..one).map(move |other| [one, other]);
        let is_next = |pair: &[usize; 2]| samples[pair[0]].distance(samples[pair[1]]) < reach;
        let pairs = (0..samples.len()).flat_map(others).filter(is_next);
        let mut this =
            Self { pairs: pairs.map(|pair| pair.map(|at| at as u8)).collect(), by_a_line: 1.0 };
        let [mut crossed, mut lines] = [0, 0];
        for line in 0..LINES[0] * LINES[1] {
            let angle = std::f32::consts::PI * (line / LINES[1]) as f32 / LINES[0] as f32;
            let offset = ((line % LINES[1]) as f32 + 0.5) / LINES[1] as f32 - 0.5;
            let mut things = [BESIDE; MOST_SAMPLES as usize];
            for (sample, thing) in samples.iter().zip(&mut things) {
                *thing = u8::from(sample.dot(Vec2::from_angle(angle)) > offset);
            }
            let own = this.crossed(&things);
            (crossed, lines) = (crossed + u32::from(own), lines + u32::from(own > 0));
        }
        if lines > 0 {
            this.by_a_line = crossed as f32 / lines as f32;
        }
        this
    }

    /// Pairs whose samples see different things.
    pub fn crossed(&self, things: &Things) -> u8 {
        let differ = |pair: &&[u8; 2]| things[usize::from(pair[0])] != things[usize::from(pair[1])];
        self.pairs.iter().filter(differ).count().min(usize::from(u8::MAX)) as u8
    }

    /// How long the borders in a pixel are where so many pairs see different things, in those of straight lines:
    /// one at least.
    pub fn length(&self, crossed: u8) -> f32 {
        (f32::from(crossed) / self.by_a_line).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::sample_pattern;

    /// Lines are as long as they are, whatever the number of samples, in the mean over their places.
    #[test]
    fn borders_are_as_long_as_they_are() {
        for count in [8, 16, 33, 64] {
            let samples = sample_pattern(count);
            let borders = Borders::new(&samples);
            let length = |number: &dyn Fn(Vec2) -> u8| {
                let mut things = [BESIDE; MOST_SAMPLES as usize];
                samples.iter().zip(&mut things).for_each(|(at, thing)| *thing = number(*at));
                borders.length(borders.crossed(&things))
            };
            assert_eq!(length(&|_| 7), 1.0);
            let one = length(&|at| u8::from(at.x > 0.1));
            assert!((1.0..1.6).contains(&one), "{count}: {one}");
            // Four stripes have three borders.
            let three = length(&|at| (4.0 * (at.x + 0.5)) as u8);
            assert!((2.2..4.4).contains(&three), "{count}: {three}");
        }
        let alone = Borders::new(&sample_pattern(1));
        assert_eq!(alone.length(alone.crossed(&[0; MOST_SAMPLES as usize])), 1.0);
    }
}
