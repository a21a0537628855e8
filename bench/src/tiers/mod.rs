//! `tiers`: how good `hemilux` is and why. Every part switched off in turn ([`ablation`]), predicted
//! against actual errors ([`calibration`]), how errors fall with time ([`slopes`]), whether short jobs keep
//! to their time ([`budgets`]), time against what a scene has more of ([`growth`]), and what `auto` picks against what the best hand would ([`planning`]); on [`views`] that differ
//! in what makes light hard.

mod ablation;
mod budgets;
mod calibration;
mod growth;
mod planning;
mod slopes;
mod study;
mod views;

use crate::results::{self, Failure};
pub use calibration::GOOD;
use hemilux_engine::device;
use std::path::PathBuf;
use study::Study;

#[derive(clap::Args)]
pub struct Arguments {
    /// Device: `cpu`, `auto` or an id of `hemilux devices`.
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Only these parts; all by default.
    #[arg(long, value_delimiter = ',')]
    parts: Vec<Part>,
    /// Only these views; all by default.
    #[arg(long, value_delimiter = ',')]
    views: Vec<String>,
    /// Few views and seconds; writes to out/tiers.
    #[arg(long)]
    quick: bool,
    /// Folder for tables and charts; `docs/tiers`, with --quick `out/tiers`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/tiers.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Folder where references are kept.
    #[arg(long, default_value = "out/tiers/references")]
    references: PathBuf,
    /// Seconds of path tracing for each half of a reference, three times that where paths find light
    /// with difficulty; 60 by default.
    #[arg(long)]
    reference_seconds: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// Only makes the references.
    References,
    Ablation,
    Calibration,
    Targets,
    Slopes,
    Budgets,
    Growth,
    Planning,
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let default_out = if arguments.quick { "out/tiers" } else { "docs/tiers" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/tiers.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    std::fs::create_dir_all(&arguments.references)?;
    let seconds = if arguments.quick { 10.0 } else { 60.0 };
    let mut study = Study {
        device: device::open(&arguments.device)?,
        out,
        references: arguments.references.clone(),
        reference_seconds: arguments.reference_seconds.unwrap_or(seconds),
        quick: arguments.quick,
        only: arguments.views.clone(),
    };
    let wanted = |part| arguments.parts.is_empty() || arguments.parts.contains(&part);
    let mut parts = Vec::new();
    if arguments.parts.contains(&Part::References) {
        for view in study.views().into_iter().chain(growth::views(study.quick)) {
            let truth = study.truth(&view)?;
            let (own, resolution) = (truth.own_error(), truth.resolution());
            eprintln!(
                "{} {}: the reference's own error is {own:.4}, it resolves {resolution:.4}",
                view.name, view.side,
            );
        }
    }
    if wanted(Part::Calibration) {
        parts.extend(calibration::run(&mut study)?);
    }
    if wanted(Part::Targets) {
        parts.extend(calibration::ask(&mut study)?);
    }
    if wanted(Part::Slopes) {
        parts.extend(slopes::run(&mut study)?);
    }
    if wanted(Part::Budgets) {
        parts.extend(budgets::run(&mut study)?);
    }
    if wanted(Part::Ablation) {
        parts.extend(ablation::run(&mut study)?);
    }
    if wanted(Part::Growth) {
        parts.extend(growth::run(&mut study)?);
    }
    if wanted(Part::Planning) {
        parts.extend(planning::run(&mut study)?);
    }
    results::publish(page.as_deref(), &parts)
}
