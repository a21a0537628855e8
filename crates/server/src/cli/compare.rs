//! `hemilux compare`.

use super::files::read_file;
use super::process::{self, Failure};
use super::render::{
    camera_choice, listen_for_interrupt, parse_positive, parse_setting, parse_size, read_scene,
};
use crate::worker::devices;
use clap::Args;
use hemilux_charts::comparison::{
    Bench, Contender, Outcome, Task, Truth, TruthError, View, check_memory, compare, from_files,
    report, trace,
};
use hemilux_engine::render::{CameraChoice, RenderRequest, choose_camera};
use hemilux_engine::scene::Scene;
use hemilux_engine::scene::gltf::ImportOptions;
use hemilux_engine::transport::{METHODS, REGISTRY, check, check_settings, find};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Seconds of a traced reference, in times of the largest budget.
const REFERENCE_BUDGETS: f64 = 8.0;
/// Most runs of one comparison.
const MOST_RUNS: u64 = 100_000;

/// Arguments of `hemilux compare`.
#[derive(Args)]
pub struct Arguments {
    /// A .glb or .gltf file, a .zip or a folder with one, or the name of a built-in scene.
    scene: String,
    /// Folder for the table, charts and pictures; made where it is not there.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// The picture to judge by (EXR, linear). Given twice, the files are independent halves of
    /// one reference, and its noise is subtracted. Without it the scene is path traced.
    #[arg(long, value_name = "REF.exr")]
    reference: Vec<PathBuf>,
    /// Seconds of path tracing for the reference, where none is given; eight times the largest
    /// budget by default.
    #[arg(long, value_parser = parse_positive, conflicts_with = "reference")]
    reference_seconds: Option<f64>,
    /// Methods, separated by commas; all by default.
    #[arg(long, value_delimiter = ',', value_name = "A,B,…")]
    methods: Vec<String>,
    /// Time budgets, seconds, separated by commas; 0.5,1,2,4,8 by default, 0.25,0.5,1 with
    /// --quick.
    #[arg(long, value_delimiter = ',', value_parser = parse_positive, value_name = "S,T,…")]
    seconds: Vec<f64>,
    /// Runs of each method within each budget; 3 by default, 2 with --quick.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: Option<u64>,
    /// Picture size, pixels; the reference's by default, without one 256x256 (--quick: 128x128).
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<(u32, u32)>,
    /// The camera, by name or index; the scene's first by default.
    #[arg(long, value_name = "NAME|INDEX")]
    camera: Option<String>,
    /// The device: `auto`, `cpu`, or an index from `hemilux devices`.
    #[arg(long, default_value = "auto")]
    device: String,
    /// A setting of all methods that have it, or of one: `patches=4000`,
    /// `gauss-seidel.patches=2000`; `hemilux settings` lists them. Can be repeated.
    #[arg(long = "set", value_parser = parse_setting, value_name = "[METHOD.]KEY=VALUE")]
    settings: Vec<(String, String)>,
    /// Less than a minute: smaller pictures, shorter budgets, fewer seeds, where not given.
    #[arg(long)]
    quick: bool,
    /// Show no progress.
    #[arg(short, long)]
    quiet: bool,
}

/// Compares methods on one scene.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let contenders = contenders(arguments)?;
    let (budgets, seeds) = (budgets(arguments), seeds(arguments));
    if (contenders.len() * budgets.len()) as u64 * seeds > MOST_RUNS {
        return Err(Failure::usage(format!("more than {MOST_RUNS} runs; ask for fewer seeds")));
    }
    let scene = Arc::new(read_scene(&arguments.scene, &ImportOptions::default())?);
    let camera = camera_choice(arguments.camera.as_deref(), &scene);
    choose_camera(&scene, &camera, [1, 1]).map_err(Failure::usage)?;
    if let Some(size) = arguments.size {
        check_size(&scene, &camera, size)?;
    }
    let device_ids = devices::candidates(&arguments.device).map_err(Failure::usage)?;
    // What can't be written should be known before the minutes of measuring.
    std::fs::create_dir_all(&arguments.out).map_err(|error| {
        Failure::failed(format!("cannot make the folder {:?}: {error}", arguments.out))
    })?;

    let interrupted = Arc::new(AtomicBool::new(false));
    listen_for_interrupt(interrupted.clone());
    let begun = Instant::now();
    let mut open = || devices::open_first(&device_ids);
    let mut say = |what: &str, share: f64| {
        if !arguments.quiet {
            let (seconds, percent) = (begun.elapsed().as_secs_f64(), 100.0 * share);
            let _ = writeln!(std::io::stderr(), "{seconds:7.1} s {percent:3.0} %  {what}");
        }
    };
    let mut bench = Bench::new(&mut open, &mut say, &interrupted);
    let side = if arguments.quick { 128 } else { 256 };
    let size = arguments.size.unwrap_or((side, side));
    let mut view = View { name: scene_name(&arguments.scene), scene, camera, size };
    let truth = truth(arguments, &view, (contenders.len(), &budgets), &mut bench)?;
    let half = truth.reference.halves()[0];
    view.size = (half.width, half.height);
    let task = Task { view, contenders, budgets, seeds };
    let outcome = compare(task, truth, &mut bench).map_err(Failure::failed)?;
    write(arguments, &outcome)?;
    if outcome.contestants.iter().all(|contestant| contestant.cells.is_empty()) {
        let reasons = report::remarks(&outcome);
        return Err(Failure::failed(format!("no method could be run:\n{reasons}")));
    }
    if !arguments.quiet {
        let table = report::largest(&outcome);
        process::print(&format!("{table}{}", report::remarks(&outcome)))?;
    }
    Ok(())
}

/// The asked methods, each with what it has of the settings.
fn contenders(arguments: &Arguments) -> Result<Vec<Contender>, Failure> {
    let all: Vec<String> = REGISTRY.iter().map(|method| method.name().to_owned()).collect();
    let mut methods = Vec::new();
    for method in if arguments.methods.is_empty() { &all } else { &arguments.methods } {
        if !METHODS.contains(&method.as_str()) {
            let what = format!("there is no method {method:?}; there are {METHODS:?}");
            return Err(Failure::usage(what));
        }
        if methods.contains(method) {
            return Err(Failure::usage(format!("--methods names {method} twice")));
        }
        methods.push(method.clone());
    }
    let mut contenders: Vec<Contender> =
        methods.into_iter().map(|method| Contender { method, options: BTreeMap::new() }).collect();
    // A method's own come last, over those for all.
    let mut settings: Vec<_> = arguments.settings.iter().collect();
    settings.sort_by_key(|(key, _)| key.contains('.'));
    for (key, value) in settings {
        let mut anyone = false;
        for contender in &mut contenders {
            if let Some(setting) = find(&contender.method, key) {
                contender.options.insert(setting.name.to_owned(), value.clone());
                anyone = true;
            }
        }
        if !anyone {
            let what = format!("--set {key}: none of the methods that are compared has it");
            return Err(Failure::usage(what));
        }
    }
    for Contender { method, options } in &contenders {
        let wrong = |error| Failure::usage(format!("{method}: {error}"));
        check_settings(method, options).map_err(wrong)?;
    }
    Ok(contenders)
}

/// Ascending, each once.
fn budgets(arguments: &Arguments) -> Vec<f64> {
    let mut budgets = match (arguments.seconds.is_empty(), arguments.quick) {
        (false, _) => arguments.seconds.clone(),
        (true, false) => vec![0.5, 1.0, 2.0, 4.0, 8.0],
        (true, true) => vec![0.25, 0.5, 1.0],
    };
    budgets.sort_by(f64::total_cmp);
    budgets.dedup();
    budgets
}

fn seeds(arguments: &Arguments) -> u64 {
    arguments.seeds.unwrap_or(if arguments.quick { 2 } else { 3 })
}

fn check_size(scene: &Arc<Scene>, camera: &CameraChoice, size: (u32, u32)) -> Result<(), Failure> {
    let request = RenderRequest {
        camera: camera.clone(),
        seed: 0,
        ..RenderRequest::new(scene.clone(), "auto", size.into())
    };
    check(&request).map_err(Failure::usage)
}

fn scene_name(scene: &str) -> String {
    let stem = Path::new(scene).file_stem().and_then(|stem| stem.to_str());
    stem.unwrap_or(scene).to_owned()
}

/// The given reference, or a traced one, which is kept beside the results.
fn truth(
    arguments: &Arguments,
    view: &View,
    (methods, budgets): (usize, &[f64]),
    bench: &mut Bench<'_>,
) -> Result<Truth, Failure> {
    let failed = |error| match error {
        TruthError::Request(what) => Failure::usage(what),
        TruthError::Failed(what) => Failure::failed(what),
    };
    if !arguments.reference.is_empty() {
        let mut files = Vec::new();
        for path in &arguments.reference {
            let bytes = read_file(path)
                .map_err(|error| Failure::failed(format!("cannot read {path:?}: {error}")))?;
            files.push((path.display().to_string(), bytes));
        }
        return from_files(&files, arguments.size, &view.scene, &view.camera).map_err(failed);
    }
    check_memory(view.size, methods, budgets.len()).map_err(Failure::usage)?;
    let largest = budgets.last().copied().unwrap_or(1.0);
    let seconds = arguments.reference_seconds.unwrap_or(REFERENCE_BUDGETS * largest);
    let truth = trace(view, seconds, bench).map_err(failed)?;
    for (half, name) in truth.reference.halves().into_iter().zip(["a", "b"]) {
        let path = arguments.out.join(format!("reference-{name}.exr"));
        write_file(&path, &half.to_exr().map_err(Failure::failed)?)?;
    }
    Ok(truth)
}

fn write(arguments: &Arguments, outcome: &Outcome) -> Result<(), Failure> {
    for (name, bytes) in report::files(outcome).map_err(Failure::failed)? {
        write_file(&arguments.out.join(name), &bytes)?;
    }
    Ok(())
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes)
        .map_err(|error| Failure::failed(format!("cannot write {path:?}: {error}")))
}
