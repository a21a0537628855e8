//! `paper`: the claims of Antal's paper on hemicube shooting, measured: every switch of the
//! algorithm on three scenes, error against shots and seconds, as tables (CSV), charts (SVG),
//! crops (PNG) and the generated parts of a page.
//!
//! Errors are those of noise and of the algorithm's own bias: the reference of a scene is a long
//! unbiased run on the same patches, so what patches can't show cancels. Where a path-traced
//! reference is given, the true error is measured as well.

mod bench;
mod figures;
mod measure;
mod page;
pub mod scenes;
mod study;
mod variants;

use crate::results::{self, Failure};
use bench::{Bench, FULL, QUICK, scaled};
use hemilux_engine::device;
use measure::{Series, measure};
use scenes::View;
use std::path::{Path, PathBuf};
use std::time::Instant;
use study::{Results, Study};
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
    let seeds = size.seeds_of(view.effort);
    let switches = run(&switches, size.shots, seeds)?;
    let mut slope = Vec::new();
    for shots in size.shots {
        let runs = scaled(size.slope_shots / shots, view.effort);
        slope.append(&mut run(&[variants::plain()], &[*shots], runs)?);
    }
    let extra_seeds = scaled(size.extra_seeds, view.effort);
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
