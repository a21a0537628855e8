//! Runs variants side by side and says how far off they are, by how much they scatter, and how
//! long they take.

use super::bench::Bench;
use super::scenes::View;
use super::variants::Variant;
use crate::cell::{Cell, Pending, mean_of};
use crate::results::Failure;
use hemilux_charts::accuracy::error;
use hemilux_charts::statistics::{Estimate, jackknife, log_slope};

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
                cell.add(view.reference(variant), &view.regions, rendered);
            }
        }
    }
    let finish = |(variant, cells): (&Variant, Vec<Pending>)| Series {
        cells: cells
            .into_iter()
            .map(|cell| cell.finish(view.reference(variant), &view.regions))
            .collect(),
        variant: variant.clone(),
    };
    Ok(variants.iter().zip(pending).map(finish).collect())
}
