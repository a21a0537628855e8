//! Sums of a running solution in batches of equal length, and the error estimate that their
//! scatter gives (batch means).

use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::Sums;
use crate::measurement::{Measurement, PixelWeight, Solution, VertexWeights};
use crate::radiometry::Rgb;

/// Batches before pairs are merged; the estimate has between half of this and this many.
const MOST: usize = 16;
/// Iterations of the first batches.
const FIRST_LENGTH: u64 = 4;
/// Iterations that no run comes to.
const MOST_ITERATIONS: u64 = 1 << 48;
/// Fewer batches give no estimate.
const FEWEST: usize = 4;

/// The batches so far. Their length doubles whenever there are [`MOST`], so the boundaries depend
/// on the iteration count alone and results repeat bit for bit.
pub struct Batches {
    /// Iterations to leave out of the average, and their sums.
    burn_in: u64,
    burnt: Sums,
    length: u64,
    complete: Vec<Sums>,
    open: Sums,
    /// Irradiance that another camera's picture was made of, where that can't be in batches as it
    /// lacks what lobes send to this one.
    earlier: Sums,
}

impl Batches {
    /// No batches yet; the first `burn_in` iterations are left out as soon as there are as many
    /// others. Stochastic iteration starts from L^e and lacks the higher bounces at first.
    pub fn new(burn_in: u64) -> Self {
        Self {
            burn_in,
            burnt: Sums::default(),
            length: FIRST_LENGTH,
            complete: Vec::new(),
            open: Sums::default(),
            earlier: Sums::default(),
        }
    }

    /// Writes them.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.length);
        to.value(self.complete.len() as u64);
        for sums in self.complete.iter().chain([&self.burnt, &self.open, &self.earlier]) {
            to.value(sums.iterations);
            to.slice(&sums.irradiance);
            to.slice(&sums.glossy);
        }
    }

    /// Takes what [`Batches::save`] wrote of the same burn-in and `patches` patches.
    pub fn restore(
        &mut self,
        from: &mut Reader<'_>,
        patches: usize,
    ) -> Result<(), CheckpointError> {
        let (length, count) = (from.count(MOST_ITERATIONS)?, from.count(MOST as u64 - 1)?);
        let mut sums = || -> Result<Sums, CheckpointError> {
            let iterations = from.count(MOST_ITERATIONS)?;
            let (irradiance, glossy) = (from.slice::<Rgb>()?, from.slice::<Rgb>()?);
            let whole = |values: &[Rgb]| values.is_empty() || values.len() == patches;
            if !whole(&irradiance) || !whole(&glossy) || (iterations == 0) != irradiance.is_empty()
            {
                return Err(CheckpointError::damaged("a batch is not of these patches"));
            }
            Ok(Sums { iterations, irradiance, glossy })
        };
        let complete = (0..count).map(|_| sums()).collect::<Result<Vec<_>, _>>()?;
        let (burnt, open, earlier) = (sums()?, sums()?, sums()?);
        let like = complete.first().unwrap_or(&open).glossy.len();
        let alike =
            complete.iter().all(|batch| batch.iterations == length && batch.glossy.len() == like);
        if length < FIRST_LENGTH
            || !alike
            || open.iterations >= length
            || burnt.iterations > self.burn_in
            || (burnt.iterations < self.burn_in && !(complete.is_empty() && open.iterations == 0))
        {
            return Err(CheckpointError::damaged("there can't be such batches"));
        }
        (self.length, self.complete) = (length, complete);
        (self.burnt, self.open, self.earlier) = (burnt, open, earlier);
        Ok(())
    }

    /// Goes over to another camera of a scene with lobes: the irradiance stays, also that of
    /// `settled`, and batches begin anew.
    pub fn turn(&mut self, settled: Sums) {
        let mut earlier = self.all();
        merge(&mut earlier, settled);
        merge(&mut earlier, std::mem::take(&mut self.earlier));
        earlier.glossy = Vec::new();
        *self = Self { earlier, ..Self::new(0) };
    }

    /// Iterations that are in the average or will be.
    fn all(&self) -> Sums {
        let mut total = Sums::default();
        for batch in self.complete.iter().chain([&self.open]) {
            merge(&mut total, batch.clone());
        }
        if total.iterations < self.burnt.iterations {
            merge(&mut total, self.burnt.clone());
        }
        total
    }

    /// Iterations that the burn-in or the open batch still takes.
    pub fn room(&self) -> u64 {
        match self.burn_in - self.burnt.iterations {
            0 => self.length - self.open.iterations,
            left => left,
        }
    }

    /// Whether there is anything to average.
    pub fn any(&self) -> bool {
        self.burnt.iterations + self.open.iterations + self.earlier.iterations > 0
            || !self.complete.is_empty()
    }

    /// Whether there are as many batches as an estimate takes.
    pub fn enough(&self) -> bool {
        self.complete.len() >= FEWEST
    }

    /// Adds sums of at most [`Batches::room`] iterations. Whether a batch was completed.
    pub fn add(&mut self, sums: Sums) -> bool {
        if self.burnt.iterations < self.burn_in {
            merge(&mut self.burnt, sums);
            return false;
        }
        merge(&mut self.open, sums);
        if self.open.iterations < self.length {
            return false;
        }
        self.complete.push(std::mem::take(&mut self.open));
        if self.complete.len() == MOST {
            let mut all = std::mem::take(&mut self.complete).into_iter();
            while let (Some(mut first), Some(second)) = (all.next(), all.next()) {
                merge(&mut first, second);
                self.complete.push(first);
            }
            self.length *= 2;
        }
        true
    }

    /// Mean over the iterations so far.
    pub fn mean(&self) -> Solution {
        let mut total = self.all();
        let mut mean = Solution::mean(&total);
        if self.earlier.iterations > 0 {
            total.glossy = Vec::new();
            merge(&mut total, self.earlier.clone());
            mean.irradiance = Solution::mean(&total).irradiance;
        }
        mean
    }

    /// Estimated rRMSE of the picture of [`Batches::mean`]: the standard error of the batch means
    /// at every vertex, weighted by what the camera sees of it, over the picture's mean radiance.
    /// Knows noise only, not the bias of the patches. `None` with too few batches or a black
    /// picture.
    pub fn relative_error(
        &self,
        measurement: &Measurement,
        weights: &VertexWeights,
    ) -> Option<f64> {
        if !self.enough() || weights.pixels <= 0.0 {
            return None;
        }
        let count = self.complete.len();
        let means: Vec<Solution> = self.complete.iter().map(Solution::mean).collect();
        let at_vertices = |values: fn(&Solution) -> &Vec<Rgb>| -> Vec<Vec<Rgb>> {
            means.iter().map(|mean| measurement.reconstruction().apply(values(mean))).collect()
        };
        let diffuse = scatter(&at_vertices(|mean| &mean.irradiance), &weights.diffuse);
        let glossy = scatter(&at_vertices(|mean| &mean.glossy), &weights.glossy);
        let (noise, brightness) = (diffuse.0 + glossy.0, diffuse.1 + glossy.1);
        let variance = noise / (count * (count - 1)) as f64 / (3.0 * weights.pixels);
        let mean_radiance = brightness / (3.0 * weights.pixels);
        (mean_radiance > 0.0).then(|| variance.sqrt() / mean_radiance)
    }
}

/// Squared deviations of batch values from their mean, and that mean, both summed over the
/// vertices with their weights in the picture.
fn scatter(batches: &[Vec<Rgb>], weights: &[PixelWeight]) -> (f64, f64) {
    let (mut squares, mut mean) = (0.0, 0.0);
    for (vertex, weight) in weights.iter().enumerate().take(batches[0].len()) {
        if weight.first == Rgb::ZERO {
            continue;
        }
        let center = batches.iter().map(|b| b[vertex]).sum::<Rgb>() / batches.len() as f32;
        let deviations: Rgb =
            batches.iter().map(|b| (b[vertex] - center) * (b[vertex] - center)).sum();
        squares += f64::from((deviations * weight.second).element_sum());
        mean += f64::from((center * weight.first).element_sum());
    }
    (squares, mean)
}

fn merge(into: &mut Sums, other: Sums) {
    if into.iterations == 0 {
        *into = other;
        return;
    }
    if other.iterations == 0 {
        return;
    }
    into.iterations += other.iterations;
    for (a, b) in into.irradiance.iter_mut().zip(other.irradiance) {
        *a += b;
    }
    for (a, b) in into.glossy.iter_mut().zip(other.glossy) {
        *a += b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(iterations: u64, value: f32) -> Sums {
        let irradiance = vec![Rgb::splat(value * iterations as f32)];
        Sums { iterations, irradiance, glossy: Vec::new() }
    }

    #[test]
    fn batches_double_and_keep_the_mean() {
        let mut batches = Batches::new(0);
        for i in 0..1000u64 {
            batches.add(sums(1, i as f32));
        }
        assert_eq!(batches.mean().irradiance[0], Rgb::splat(499.5));
        assert!((MOST / 2..MOST).contains(&batches.complete.len()));
        let lengths: Vec<u64> = batches.complete.iter().map(|b| b.iterations).collect();
        assert!(lengths.iter().all(|length| *length == batches.length), "{lengths:?}");
    }

    #[test]
    fn burn_in_is_left_out_once_there_is_enough_else() {
        let mut batches = Batches::new(3);
        for i in 0..3 {
            assert_eq!(batches.room(), 3 - i);
            batches.add(sums(1, 100.0));
        }
        batches.add(sums(2, 1.0));
        assert_eq!(batches.mean().irradiance[0], Rgb::splat(302.0 / 5.0));
        batches.add(sums(1, 1.0));
        assert_eq!(batches.mean().irradiance[0], Rgb::ONE);
    }
}
