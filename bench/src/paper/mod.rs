//! `paper`: the claims of Antal's paper on hemicube shooting, measured: every switch of the
//! algorithm on three scenes, error against shots and seconds, as tables (CSV), charts (SVG),
//! crops (PNG) and the generated parts of a page.
//!
//! Errors are those of noise and of the algorithm's own bias: the reference of a scene is a long
//! unbiased run on the same patches, so what patches can't show cancels. Where a path-traced
//! reference is given, the true error is measured as well.

mod figures;
mod measure;
mod page;
pub mod scenes;
mod variants;

use crate::results::{self, Failure};
use hemilux_engine::device::{self, Device};
use hemilux_engine::render::{CameraChoice, Limits, RenderRequest, Rendered, Unobserved};
use hemilux_engine::scene::Scene;
use hemilux_engine::transport::render;
use measure::{Series, measure};
use scenes::View;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use variants::Variant;

#[derive(clap::Args)]
pub struct Arguments {
    /// Device: `cpu`, `auto` or an id of `hemilux devices`.
    #[arg(long, default_value = "cpu")]
    device: String,
    /// About three minutes instead of fifteen: fewer shots, fewer seeds; writes to out/paper.
    #[arg(long)]
    quick: bool,
    /// Folder for tables, charts and crops; `docs/paper`, with --quick `out/paper`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/paper.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Folder with the halves of a path-traced Cornell box, `cornell-half-a.exr` and
    /// `cornell-half-b.exr`, for true errors.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// The scene of that reference; `../scenes/cornell.glb` seen from its folder.
    #[arg(long)]
    reference_scene: Option<PathBuf>,
    /// Only these scenes: cornell, cornell_phong, office.
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
struct Size {
    /// Width and height of pictures, pixels.
    side: u32,
    /// Sub-pixel samples.
    samples: u32,
    /// Wanted patches.
    patches: u64,
    /// Hemicube resolution but for the algorithm exactly as printed.
    resolution: u32,
    /// Shots of each half of a reference.
    reference_shots: u64,
    /// Shots of the table of switches.
    shots: &'static [u64],
    /// Seeds of the table of switches and of the studies of variance reduction, in a view of
    /// effort 1.
    seeds: u64,
    /// Shots that the study of the slope spends on each of the lengths above, in as many runs as
    /// that needs, in a view of effort 1: errors have rare large parts, and short runs must get
    /// the same chance to meet them.
    slope_shots: u64,
    /// Seeds of variants that start slowly, in scenes of many patches.
    slow_seeds: u64,
    /// Shots of the efficiency study.
    extra_shots: u64,
    /// Its seeds, in a view of effort 1.
    extra_seeds: u64,
    /// Run lengths of the study of variance reduction.
    reduction_shots: &'static [u64],
    /// Its values of M for runs of another length, …
    fixed_m: &'static [u64],
    /// … which is this.
    fixed_shots: u64,
    /// Iterations of the algorithm exactly as printed.
    printed: &'static [u64],
    /// Its seeds.
    printed_seeds: u64,
    /// Shots against the path-traced reference.
    true_shots: &'static [u64],
}

impl Size {
    /// Seeds of the table of switches in a view.
    fn seeds_of(&self, view: &View) -> u64 {
        scaled(self.seeds, view)
    }
}

fn scaled(seeds: u64, view: &View) -> u64 {
    ((seeds as f64 * view.effort).round() as u64).max(2)
}

const FULL: Size = Size {
    side: 250,
    samples: 4,
    patches: 4000,
    resolution: 128,
    reference_shots: 16384,
    shots: &[256, 1024, 4096],
    seeds: 4,
    slope_shots: 16384,
    slow_seeds: 2,
    extra_shots: 512,
    extra_seeds: 16,
    reduction_shots: &[64, 256, 1024, 4096],
    fixed_m: &[64, 256, 1024, 4096],
    fixed_shots: 1024,
    printed: &[500, 600],
    printed_seeds: 2,
    true_shots: &[256, 1024, 4096, 16384],
};

const QUICK: Size = Size {
    side: 125,
    reference_shots: 4096,
    shots: &[64, 256],
    seeds: 2,
    slope_shots: 1024,
    slow_seeds: 1,
    extra_shots: 256,
    extra_seeds: 4,
    reduction_shots: &[64, 256],
    fixed_m: &[64, 1024],
    fixed_shots: 256,
    printed: &[500],
    true_shots: &[256, 1024],
    ..FULL
};

/// Runs jobs on one device.
pub struct Bench {
    device: Box<dyn Device>,
    size: Size,
    wanted: Vec<String>,
    begun: Instant,
    jobs: u64,
}

impl Bench {
    fn wants_scene(&self, name: &str) -> bool {
        self.wanted.is_empty() || self.wanted.iter().any(|wanted| wanted == name)
    }

    fn say(&self, what: &str) {
        eprintln!("{:6.1} s  {what}", self.begun.elapsed().as_secs_f64());
    }

    /// A job without limits, with the variant's options over those of all jobs.
    fn job(&self, scene: &Arc<Scene>, side: u32, samples: u32, variant: &Variant) -> RenderRequest {
        let mut options = BTreeMap::from([
            ("hemicube_resolution".to_string(), self.size.resolution.to_string()),
            ("patches".into(), self.size.patches.to_string()),
            ("pixel_samples".into(), samples.to_string()),
        ]);
        if variant.is_printed() {
            options.remove("hemicube_resolution");
        }
        options.extend(variant.options.iter().map(|(n, v)| ((*n).to_string(), v.clone())));
        RenderRequest {
            scene: scene.clone(),
            camera: CameraChoice::First,
            width: side,
            height: side,
            method: "stochastic".into(),
            limits: Limits::default(),
            seed: 1,
            options,
            begin: Default::default(),
        }
    }

    fn render(&mut self, mut job: RenderRequest, iterations: u64) -> Result<Rendered, Failure> {
        job.limits = Limits { iterations: Some(iterations), ..Limits::default() };
        self.jobs += 1;
        Ok(render(self.device.as_mut(), &job, &mut Unobserved)?)
    }
}

/// Everything that was measured in one view.
struct Study {
    view: View,
    /// `plain` first, then the switches by group.
    switches: Vec<Series>,
    /// `plain` once for every length of runs, with as many shots in total.
    slope: Vec<Series>,
    extras: Vec<Series>,
    /// The same for a single shot: seconds of preparing and showing.
    starts: Vec<Series>,
    reductions: Vec<Series>,
    fixed: Vec<Series>,
    printed: Vec<Series>,
}

/// The whole run, for the page.
struct Results {
    studies: Vec<Study>,
    truth: Option<(View, Vec<Series>)>,
    size: Size,
    quick: bool,
    device: String,
    jobs: u64,
    seconds: f64,
    /// Mean number of runnable threads of the machine at the end of each scene, where the system
    /// tells; beyond the number of hardware threads, others were working too.
    loads: Vec<f64>,
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let size = if arguments.quick { QUICK } else { FULL };
    let default_out = if arguments.quick { "out/paper" } else { "docs/paper" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/paper.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    let device = device::open(&arguments.device)?;
    let description = device.description();
    let wanted = arguments.scenes.clone();
    let mut bench = Bench { device, size, wanted, begun: Instant::now(), jobs: 0 };
    bench.say(&format!("{} ({})", description.name, description.driver));

    let (mut studies, mut loads) = (Vec::new(), Vec::new());
    for view in scenes::own(&mut bench)? {
        studies.push(study(&mut bench, view)?);
        loads.extend(results::load());
    }
    let truth = match &arguments.reference {
        Some(folder) => Some(against_path_tracing(&mut bench, arguments, folder)?),
        None => None,
    };
    let results = Results {
        studies,
        truth,
        size,
        quick: arguments.quick,
        device: format!("{} ({})", description.name, description.driver),
        jobs: bench.jobs,
        seconds: bench.begun.elapsed().as_secs_f64(),
        loads,
    };

    std::fs::write(out.join("runs.csv"), page::runs(&results).csv())?;
    for (name, text) in figures::charts(&results)? {
        std::fs::write(out.join(name), text)?;
    }
    for (name, bytes) in figures::sheets(&results)? {
        std::fs::write(out.join(name), bytes)?;
    }
    let parts = page::parts(&results);
    results::publish(page.as_deref(), &parts)?;
    bench.say(&format!("done: {} jobs, results in {}", bench.jobs, out.display()));
    Ok(())
}

fn study(bench: &mut Bench, view: View) -> Result<Study, Failure> {
    let size = bench.size;
    let mut switches = vec![variants::plain()];
    switches.extend(variants::switches().into_iter().flat_map(|group| group.variants));
    let mut run = |variants: &[Variant], shots: &[u64], seeds| -> Result<Vec<Series>, Failure> {
        measure(bench, &view, variants, shots, seeds)
    };
    let seeds = size.seeds_of(&view);
    let switches = run(&switches, size.shots, seeds)?;
    let mut slope = Vec::new();
    for shots in size.shots {
        let runs = scaled(size.slope_shots / shots, &view);
        slope.append(&mut run(&[variants::plain()], &[*shots], runs)?);
    }
    let extra_seeds = scaled(size.extra_seeds, &view);
    let extras = run(&variants::paper_extras(), &[size.extra_shots], extra_seeds)?;
    let starts = run(&variants::paper_extras(), &[1], 2)?;
    let reductions = run(&variants::paper_reductions(), size.reduction_shots, seeds)?;
    let fixed = run(&variants::fixed_m(size.fixed_m), &[size.fixed_shots], seeds)?;
    let printed = run(&variants::printed(), size.printed, size.printed_seeds)?;
    Ok(Study { view, switches, slope, extras, starts, reductions, fixed, printed })
}

fn against_path_tracing(
    bench: &mut Bench,
    arguments: &Arguments,
    folder: &Path,
) -> Result<(View, Vec<Series>), Failure> {
    let scene = arguments.reference_scene.as_deref();
    let view = scenes::path_traced(folder, scene, bench.size.side)?;
    let (shots, seeds) = (bench.size.true_shots, bench.size.seeds.min(2));
    let series = measure(bench, &view, &variants::discretisations(), shots, seeds)?;
    Ok((view, series))
}
