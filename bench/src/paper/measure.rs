//! Runs variants side by side and says how far off they are, by how much they scatter, and how
//! long they take.

use super::scenes::View;
use super::variants::Variant;
use super::{Bench, Failure};
use hemilux_charts::accuracy::{Repetitions, error};
use hemilux_charts::regions::REGIONS;
use hemilux_charts::statistics::{Estimate, jackknife, log_slope, mean};
use hemilux_engine::image::Picture;

/// A variant after a number of shots, over all seeds.
pub struct Cell {
    /// Shots of one run.
    pub shots: u64,
    /// Iterations of one run.
    pub iterations: u64,
    /// Squared relative error by region and seed.
    squared: [Vec<f64>; 3],
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

fn mean_of(values: &[f64], chosen: &[usize]) -> f64 {
    mean(&chosen.iter().map(|at| values[*at]).collect::<Vec<_>>())
}

/// A variant in one view after increasing numbers of shots.
pub struct Series {
    /// The variant.
    pub variant: Variant,
    /// One entry a number of shots.
    pub cells: Vec<Cell>,
}

impl Series {
    /// Slope of ln error over ln shots in a region, with its standard error over the seeds.
    pub fn slope(&self, region: usize) -> Estimate {
        let seeds = self.cells[0].seconds.len();
        jackknife(seeds, |chosen| {
            let point =
                |cell: &Cell| (cell.shots as f64, error(mean_of(&cell.squared[region], chosen)));
            log_slope(&self.cells.iter().map(point).collect::<Vec<_>>())
        })
    }
}

/// A variant and a base, after the same shots from the same seeds.
pub struct Gain {
    /// Ratio of seconds.
    pub seconds: Estimate,
    /// Ratio of squared errors over all pixels.
    pub squares: Estimate,
    /// By region, what the variant costs against the base for the same error: seconds × error².
    pub cost: [Estimate; 3],
}

impl Gain {
    /// Of `variant` over `base`. The seconds of `starts`, jobs of a single iteration, are taken
    /// off, so that preparing and showing don't hide the shooting; seeds are paired.
    pub fn new([variant, base]: [&Cell; 2], starts: [&Cell; 2]) -> Self {
        let seeds = variant.seconds.len().min(base.seconds.len());
        let shooting = |cell: &Cell, start: &Cell, chosen: &[usize]| {
            mean_of(&cell.seconds, chosen) - start.mean_seconds()
        };
        let time = |chosen: &[usize]| {
            shooting(variant, starts[0], chosen) / shooting(base, starts[1], chosen)
        };
        let error = |region: usize, chosen: &[usize]| {
            let squares = |cell: &Cell| mean_of(&cell.squared[region], chosen);
            squares(variant) / squares(base)
        };
        Self {
            seconds: jackknife(seeds, time),
            squares: jackknife(seeds, |chosen| error(0, chosen)),
            cost: [0, 1, 2]
                .map(|region| jackknife(seeds, |chosen| time(chosen) * error(region, chosen))),
        }
    }
}

/// Runs every variant for every number of shots and every seed 1 … `seeds`. All variants take
/// turns within a seed, so that a noisy machine disturbs all alike.
pub fn measure(
    bench: &mut Bench,
    view: &View,
    variants: &[Variant],
    shots: &[u64],
    seeds: u64,
) -> Result<Vec<Series>, Failure> {
    let mut pending: Vec<Vec<Pending>> = Vec::new();
    for _ in variants {
        pending.push(shots.iter().map(|_| Pending::new(view.side)).collect());
    }
    for seed in 1..=seeds {
        if seed % 4 == 1 {
            let count = variants.len();
            bench.say(&format!("{}: {count} variants, seed {seed} of {seeds}", view.name));
        }
        for (variant, cells) in variants.iter().zip(&mut pending) {
            if seed > view.seeds(variant, seeds, bench.size.slow_seeds) {
                continue;
            }
            for (&shots, cell) in shots.iter().zip(cells) {
                let mut job = bench.job(&view.scene, view.side, view.samples, variant);
                job.seed = seed;
                let iterations = (shots / variant.shots_per_iteration()).max(1);
                let rendered = bench.render(job, iterations)?;
                cell.add(view, variant, rendered);
            }
        }
    }
    let finish = |(variant, cells): (&Variant, Vec<Pending>)| Series {
        cells: cells.into_iter().map(|cell| cell.finish(view, variant)).collect(),
        variant: variant.clone(),
    };
    Ok(variants.iter().zip(pending).map(finish).collect())
}

/// A cell that still collects seeds.
struct Pending {
    cell: Cell,
    repetitions: Repetitions,
}

impl Pending {
    fn new(side: u32) -> Self {
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

    fn add(&mut self, view: &View, variant: &Variant, rendered: hemilux_engine::render::Rendered) {
        let (cell, reference) = (&mut self.cell, view.reference(variant));
        for region in 0..REGIONS.len() {
            let counted = &view.regions.masks[region];
            let squared = reference.squared_error(&rendered.picture, counted);
            cell.squared[region].push(squared);
            cell.energy[region].push(reference.energy(&rendered.picture, counted));
        }
        cell.shots = rendered.stats.shots;
        cell.iterations = rendered.stats.iterations;
        cell.seconds.push(rendered.stats.seconds_solve);
        cell.light.push(rendered.stats.light_source_selection_ratio);
        self.repetitions.add(&rendered.picture);
        if cell.seconds.len() == 1 {
            cell.picture = rendered.picture;
        }
    }

    fn finish(mut self, view: &View, variant: &Variant) -> Cell {
        for region in 0..REGIONS.len() {
            self.cell.squared_bias[region] = self.repetitions.squared_bias(
                view.reference(variant),
                &self.cell.squared[region],
                &view.regions.masks[region],
            );
        }
        self.cell
    }
}
