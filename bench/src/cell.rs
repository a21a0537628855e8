//! What the seeds of one way to run a method add up to: how far off they are, by how much they
//! scatter, and how long they take.

use hemilux_charts::accuracy::{Reference, Repetitions, error};
use hemilux_charts::regions::{REGIONS, Regions};
use hemilux_charts::statistics::{Estimate, jackknife, mean};
use hemilux_engine::image::Picture;
use hemilux_engine::render::Rendered;

/// A variant after a number of shots, over all seeds.
pub struct Cell {
    /// Shots or rays of one run, mean over the seeds.
    pub shots: u64,
    /// Iterations of one run.
    pub iterations: u64,
    /// Squared relative error by region and seed.
    pub squared: [Vec<f64>; 3],
    /// Squared relative bias by region.
    squared_bias: [f64; 3],
    /// Mean radiance over the reference's by region and seed.
    energy: [Vec<f64>; 3],
    /// `seconds_solve` by seed.
    pub seconds: Vec<f64>,
    /// Light-source selection ratio by seed.
    pub light: Vec<f64>,
    /// The picture of the first seed.
    pub picture: Picture,
}

impl Cell {
    /// rRMSE over a region: root mean square over the seeds, with its standard error.
    pub fn error(&self, region: usize) -> Estimate {
        let squared = &self.squared[region];
        jackknife(squared.len(), |chosen| error(mean_of(squared, chosen)))
    }

    /// The part of the error that doesn't average out over seeds.
    pub fn bias(&self, region: usize) -> f64 {
        error(self.squared_bias[region])
    }

    /// The part that does.
    pub fn noise(&self, region: usize) -> f64 {
        error(mean(&self.squared[region]) - self.squared_bias[region])
    }

    /// Mean radiance over the reference's.
    pub fn energy(&self, region: usize) -> Estimate {
        let energy = &self.energy[region];
        jackknife(energy.len(), |chosen| mean_of(energy, chosen))
    }

    /// Mean seconds of a run.
    pub fn mean_seconds(&self) -> f64 {
        mean(&self.seconds)
    }

    /// Mean light-source selection ratio.
    pub fn light_ratio(&self) -> f64 {
        mean(&self.light)
    }
}

/// Mean of the chosen repetitions.
pub fn mean_of(values: &[f64], chosen: &[usize]) -> f64 {
    mean(&chosen.iter().map(|at| values[*at]).collect::<Vec<_>>())
}

/// A cell that still collects seeds.
pub struct Pending {
    cell: Cell,
    repetitions: Repetitions,
}

impl Pending {
    /// None yet, of pictures with `side` × `side` pixels.
    pub fn new(side: u32) -> Self {
        let cell = Cell {
            shots: 0,
            iterations: 0,
            squared: Default::default(),
            squared_bias: [f64::NAN; 3],
            energy: Default::default(),
            seconds: Vec::new(),
            light: Vec::new(),
            picture: Picture::black(1, 1),
        };
        Self { cell, repetitions: Repetitions::new(side, side) }
    }

    /// One more seed.
    pub fn add(&mut self, reference: &Reference, regions: &Regions, rendered: Rendered) {
        let cell = &mut self.cell;
        for region in 0..REGIONS.len() {
            let counted = &regions.masks[region];
            let squared = reference.squared_error(&rendered.picture, counted);
            cell.squared[region].push(squared);
            cell.energy[region].push(reference.energy(&rendered.picture, counted));
        }
        cell.shots += rendered.stats.figures.shots;
        cell.iterations = rendered.stats.figures.iterations;
        cell.seconds.push(rendered.stats.seconds_solve);
        cell.light.push(rendered.stats.figures.light_source_selection_ratio);
        self.repetitions.add(&rendered.picture);
        if cell.seconds.len() == 1 {
            cell.picture = rendered.picture;
        }
    }

    /// The figures of all seeds.
    pub fn finish(mut self, reference: &Reference, regions: &Regions) -> Cell {
        self.cell.shots /= self.cell.seconds.len().max(1) as u64;
        for region in 0..REGIONS.len() {
            self.cell.squared_bias[region] = self.repetitions.squared_bias(
                reference,
                &self.cell.squared[region],
                &regions.masks[region],
            );
        }
        self.cell
    }
}
