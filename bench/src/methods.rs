//! `methods`: all methods side by side on the project's own scenes, as `hemilux compare` does it,
//! with the generated parts of a page.

use crate::results::{self, Failure};
use hemilux_charts::comparison::{
    Bench, Contender, Outcome, Task, TruthError, View, compare, report, trace,
};
use hemilux_engine::device;
use hemilux_engine::render::CameraChoice;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::made;
use hemilux_engine::transport::REGISTRY;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

#[derive(clap::Args)]
pub struct Arguments {
    /// Device: `cpu`, `auto` or an id of `hemilux devices`.
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Less than two minutes instead of eight; writes to out/methods.
    #[arg(long)]
    quick: bool,
    /// Folder for tables, charts and pictures; `docs/methods`, with --quick `out/methods`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/methods.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Only these scenes: cornell, cornell_phong.
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
}

/// How much is measured of a scene.
struct Size {
    /// Width and height of pictures, pixels.
    side: u32,
    /// Seconds that each method is given.
    budgets: &'static [f64],
    seeds: u64,
    /// Seconds of path tracing for the reference.
    reference_seconds: f64,
    /// Patches of gauss-seidel: so many that its matrix is whole within the larger budgets.
    matrix_patches: &'static str,
}

const FULL: [Size; 2] = [
    Size {
        side: 250,
        budgets: &[0.5, 1.0, 2.0, 4.0, 8.0],
        seeds: 3,
        reference_seconds: 90.0,
        matrix_patches: "4000",
    },
    Size {
        side: 250,
        budgets: &[1.0, 4.0],
        seeds: 2,
        reference_seconds: 60.0,
        matrix_patches: "2000",
    },
];
const QUICK: [Size; 2] = [
    Size {
        side: 125,
        budgets: &[0.25, 0.5, 1.0],
        seeds: 2,
        reference_seconds: 12.0,
        matrix_patches: "500",
    },
    Size {
        side: 125,
        budgets: &[0.5, 1.0],
        seeds: 2,
        reference_seconds: 12.0,
        matrix_patches: "500",
    },
];

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let default_out = if arguments.quick { "out/methods" } else { "docs/methods" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/methods.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    let scenes = [("cornell", made::cornell()), ("cornell_phong", made::phong_cornell())];
    let mut parts = Vec::new();
    for ((name, glb), size) in scenes.iter().zip(if arguments.quick { QUICK } else { FULL }) {
        if !(arguments.scenes.is_empty() || arguments.scenes.iter().any(|wanted| wanted == name)) {
            continue;
        }
        let outcome = one(arguments, name, glb, &size)?;
        for (file, bytes) in report::files(&outcome)? {
            // The page has the tables, and charts as SVG.
            if !matches!(file, "comparison.md" | "chart.png") {
                std::fs::write(out.join(format!("{name}-{file}")), bytes)?;
            }
        }
        parts.extend(parts_of(name, &outcome));
    }
    results::publish(page.as_deref(), &parts)
}

fn one(arguments: &Arguments, name: &str, glb: &[u8], size: &Size) -> Result<Outcome, Failure> {
    let scene = Arc::new(import(glb, &Resources::new(), &ImportLimits::default())?);
    let begun = Instant::now();
    let mut open = || device::open(&arguments.device).map_err(|error| error.to_string());
    let mut say = |what: &str, share: f64| {
        let (seconds, percent) = (begun.elapsed().as_secs_f64(), 100.0 * share);
        eprintln!("{seconds:6.1} s {percent:3.0} %  {name}: {what}");
    };
    let interrupted = AtomicBool::new(false);
    let mut bench = Bench::new(&mut open, &mut say, &interrupted);
    let size_of_picture = (size.side, size.side);
    let view =
        View { name: name.into(), scene, camera: CameraChoice::First, size: size_of_picture };
    let truth = trace(&view, size.reference_seconds, &mut bench);
    let truth = truth.map_err(|error| match error {
        TruthError::Request(what) | TruthError::Failed(what) => what,
    })?;
    let contender = |method: &str| {
        let mut options = BTreeMap::new();
        if method == "gauss-seidel" {
            options.insert("patches".into(), size.matrix_patches.into());
        }
        Contender { method: method.into(), options }
    };
    let task = Task {
        view,
        contenders: REGISTRY.iter().map(|method| contender(method.name())).collect(),
        budgets: size.budgets.to_vec(),
        seeds: size.seeds,
    };
    Ok(compare(task, truth, &mut bench)?)
}

fn parts_of(name: &str, outcome: &Outcome) -> Vec<(String, String)> {
    let conditions = report::conditions(outcome) + &results::busy();
    let text = [
        ("conditions", conditions),
        ("largest", report::largest(outcome)),
        ("budgets", report::by_budget(outcome)),
        ("diagnostics", report::diagnostics(outcome)),
        ("remarks", report::remarks(outcome)),
    ];
    text.map(|(part, text)| (format!("{name} {part}"), text)).into()
}
