//! Methods side by side: every method of a list on one view, for several time budgets and seeds,
//! judged against one reference. [`report`] writes what came out.
//!
//! Methods take turns within each seed and budget, so that a machine that is busy with other
//! things disturbs all alike. A method that refuses the scene is left out with its reason.

mod bench;
mod difference;
mod reference;
pub mod report;

pub use bench::{Bench, Contender, View};
pub use reference::{Truth, TruthError, from_files, trace};

use crate::accuracy::{Repetitions, error};
use crate::statistics::median;
use hemilux_engine::device::free_memory;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{Limits, Rendered, StopReason};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// What is compared.
#[derive(Clone, Debug)]
pub struct Task {
    /// What all pictures show.
    pub view: View,
    /// The methods.
    pub contenders: Vec<Contender>,
    /// Time budgets, seconds, ascending.
    pub budgets: Vec<f64>,
    /// Seeds 1 … this.
    pub seeds: u64,
}

impl Task {
    /// Seconds that all runs take together, if each uses its budget.
    pub fn seconds(&self) -> f64 {
        let runs = self.contenders.len() as f64 * self.seeds as f64;
        runs * self.budgets.iter().sum::<f64>()
    }
}

/// Bytes that a comparison of so many methods within so many budgets holds in pictures.
pub fn needed_bytes((width, height): (u32, u32), methods: usize, budgets: usize) -> u64 {
    // One picture a cell to tell bias from noise; a shown and a converged one a method; those of
    // the reference, of the run under way and of the report.
    let pictures = methods as u64 * (budgets as u64 + 2) + 12;
    let pixels = u64::from(width) * u64::from(height);
    pixels.saturating_mul(std::mem::size_of::<Rgb>() as u64).saturating_mul(pictures)
}

/// Refuses what would not fit into memory, before anything is allocated.
///
/// # Errors
/// Says what is needed and what there is.
pub fn check_memory(size: (u32, u32), methods: usize, budgets: usize) -> Result<(), String> {
    let (needed, free) = (needed_bytes(size, methods, budgets), free_memory());
    if needed <= free {
        return Ok(());
    }
    Err(format!(
        "{methods} methods within {budgets} budgets at {} × {} pixels need {needed} bytes, {free} \
         are available; ask for smaller pictures, or fewer methods or budgets",
        size.0, size.1
    ))
}

/// One run of a method, judged.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its seed.
    pub seed: u64,
    /// Seconds of preparing, solving and measuring.
    pub seconds: f64,
    /// Squared relative error, free of the reference's noise where that has halves.
    pub squared_error: f64,
    /// Median relative error.
    pub median_error: f64,
    /// The method's own estimate of its rRMSE.
    pub predicted_error: Option<f64>,
    /// Mean radiance over the reference's.
    pub mean_ratio: f64,
    /// Whole iterations.
    pub iterations: u64,
    /// Hemicube shots, or rays.
    pub shots: u64,
    /// Share of shots whose shooter emits; of rays, the share cast at or from a light.
    pub light_ratio: f64,
    /// Why it stopped.
    pub stopped: StopReason,
    /// Surface patches.
    pub patches: u64,
    /// Figures of the method's own by name.
    pub diagnostics: BTreeMap<String, f64>,
    /// Whether it had converged within a smaller budget and was not run again.
    pub repeated: bool,
}

impl Run {
    fn new(seed: u64, rendered: &Rendered, truth: &Truth) -> Self {
        let Rendered { picture, stats } = rendered;
        let (reference, counted) = (&truth.reference, &truth.counted);
        Self {
            seed,
            seconds: stats.seconds_solve,
            squared_error: reference.squared_error(picture, counted),
            median_error: reference.median_error(picture, counted),
            predicted_error: stats.figures.estimated_error,
            mean_ratio: reference.energy(picture, counted),
            iterations: stats.figures.iterations,
            shots: stats.figures.shots,
            light_ratio: stats.figures.light_source_selection_ratio,
            stopped: stats.stopped,
            patches: stats.patches,
            diagnostics: stats.diagnostics.clone(),
            repeated: false,
        }
    }

    /// Whether anything was solved in time; else the picture shows only what emits.
    pub fn has_solution(&self) -> bool {
        self.iterations > 0 || self.stopped != StopReason::TimeBudget
    }

    /// rRMSE; negative where the estimate of its square is.
    pub fn error(&self) -> f64 {
        error(self.squared_error)
    }
}

/// A method within one budget, over all seeds.
pub struct Cell {
    /// Seconds that each run was given.
    pub budget: f64,
    /// One entry a seed.
    pub runs: Vec<Run>,
    /// The part of the error that is the same for every seed; NaN with fewer than two.
    pub bias: f64,
    /// The picture of the first seed; kept for the largest budget that has one.
    pub picture: Picture,
    repetitions: Repetitions,
}

impl MeasuredMethod {
    /// Adds a run to the cell number `at`; smaller budgets' pictures are not needed any more.
    fn add(&mut self, at: usize, run: Run, picture: &Picture) {
        let first = self.cells[at].runs.is_empty();
        self.cells[at].add(run, picture);
        if let Some(smaller) = at.checked_sub(1).filter(|_| first) {
            self.cells[smaller].picture = Picture::black(1, 1);
        }
    }
}

impl Cell {
    fn new(budget: f64, (width, height): (u32, u32)) -> Self {
        let repetitions = Repetitions::new(width, height);
        let picture = Picture::black(1, 1);
        Self { budget, runs: Vec::new(), bias: f64::NAN, picture, repetitions }
    }

    fn add(&mut self, run: Run, picture: &Picture) {
        self.repetitions.add(picture);
        if self.runs.is_empty() {
            self.picture = picture.clone();
        }
        self.runs.push(run);
    }

    fn finish(&mut self, truth: &Truth) {
        let squared: Vec<f64> = self.runs.iter().map(|run| run.squared_error).collect();
        let counted = &truth.counted;
        self.bias = error(self.repetitions.squared_bias(&truth.reference, &squared, counted));
    }

    /// Median over the seeds, and the smallest and largest.
    pub fn spread(&self, figure: impl Fn(&Run) -> f64) -> (f64, f64, f64) {
        spread(&self.runs.iter().collect::<Vec<_>>(), &figure)
    }

    /// Runs that had nothing solved when their time was over.
    pub fn unfinished(&self) -> usize {
        self.runs.iter().filter(|run| !run.has_solution()).count()
    }

    /// Median over the seeds.
    pub fn median(&self, figure: impl Fn(&Run) -> f64) -> f64 {
        self.spread(figure).0
    }
}

/// Median of a figure over runs, and the smallest and largest.
fn spread(runs: &[&Run], figure: &dyn Fn(&Run) -> f64) -> (f64, f64, f64) {
    let values: Vec<f64> = runs.iter().map(|run| figure(run)).collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (median(values), low, high)
}

/// A method with everything that was measured.
pub struct MeasuredMethod {
    /// The method.
    pub contender: Contender,
    /// One entry a budget that has runs, ascending.
    pub cells: Vec<Cell>,
    /// Why it was left out, if it was.
    pub refusal: Option<String>,
    /// What its pictures don't show as authored.
    pub warnings: Vec<String>,
    /// Last run and picture of the present seed, where nothing was left to do.
    converged: Option<(Run, Picture)>,
}

/// A whole comparison.
pub struct Outcome {
    /// What was asked.
    pub task: Task,
    /// What it was judged by.
    pub truth: Truth,
    /// The methods, in the order of the task.
    pub contestants: Vec<MeasuredMethod>,
    /// The device in words.
    pub device: String,
    /// Seconds for all runs.
    pub seconds: f64,
    /// Whether it was ended early.
    pub interrupted: bool,
}

/// Runs every method for every seed and budget.
///
/// # Errors
/// Where the device does not open or the pictures don't fit into memory. Methods that fail are part of the outcome.
pub fn compare(task: Task, truth: Truth, bench: &mut Bench<'_>) -> Result<Outcome, String> {
    check_memory(task.view.size, task.contenders.len(), task.budgets.len())?;
    let begun = Instant::now();
    let description = bench.device()?;
    let mut contestants: Vec<MeasuredMethod> = (task.contenders.iter())
        .map(|contender| MeasuredMethod {
            contender: contender.clone(),
            cells: task.budgets.iter().map(|budget| Cell::new(*budget, task.view.size)).collect(),
            refusal: None,
            warnings: Vec::new(),
            converged: None,
        })
        .collect();
    let mut done = 0.0;
    'all: for seed in 1..=task.seeds {
        contestants.iter_mut().for_each(|contestant| contestant.converged = None);
        for (at, budget) in task.budgets.iter().enumerate() {
            for contestant in &mut contestants {
                if bench.interrupted.load(Ordering::Relaxed) {
                    break 'all;
                }
                let method = &contestant.contender.method;
                let what = format!("seed {seed} of {}, {budget} s: {method}", task.seeds);
                (bench.say)(&what, done / task.seconds());
                done += budget;
                run_one(contestant, &task, &truth, bench, (seed, at));
            }
        }
    }
    for contestant in &mut contestants {
        contestant.cells.retain(|cell| !cell.runs.is_empty());
        contestant.cells.iter_mut().for_each(|cell| cell.finish(&truth));
        if contestant.cells.is_empty() && contestant.refusal.is_none() {
            contestant.refusal = Some("ended before its first run".into());
        }
    }
    Ok(Outcome {
        device: format!("{} ({})", description.name, description.driver),
        seconds: begun.elapsed().as_secs_f64(),
        interrupted: bench.interrupted.load(Ordering::Relaxed),
        task,
        truth,
        contestants,
    })
}

/// The run of a method for a seed and the budget number `at`.
fn run_one(
    contestant: &mut MeasuredMethod,
    task: &Task,
    truth: &Truth,
    bench: &mut Bench<'_>,
    (seed, at): (u64, usize),
) {
    if contestant.refusal.is_some() {
        return;
    }
    if let Some((run, picture)) = &contestant.converged {
        let (run, picture) = (Run { repeated: true, ..run.clone() }, picture.clone());
        contestant.add(at, run, &picture);
        return;
    }
    let limits = Limits::seconds(task.budgets[at]);
    match bench.render(&task.view.request(&contestant.contender, limits, seed)) {
        // Cut short by the user: no run of that budget.
        Ok(rendered) if rendered.stats.stopped == StopReason::Cancelled => {}
        Ok(rendered) => {
            let run = Run::new(seed, &rendered, truth);
            for warning in &rendered.stats.warnings {
                let text = format!("{}: {}", warning.at, warning.what);
                if !contestant.warnings.contains(&text) {
                    contestant.warnings.push(text);
                }
            }
            let finished =
                matches!(rendered.stats.stopped, StopReason::Converged | StopReason::NoLight);
            if finished {
                contestant.converged = Some((run.clone(), rendered.picture.clone()));
            }
            contestant.add(at, run, &rendered.picture);
        }
        Err(reason) => contestant.refusal = Some(reason),
    }
}
