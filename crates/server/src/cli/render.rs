//! `hemilux render`.

mod parts;
mod surroundings;
mod view;

use super::process::Failure;
use super::scene_files;
use crate::panic_text;
use crate::worker::{devices, scenes};
use clap::Args;
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::image::{Exposure, Picture, Units};
use hemilux_engine::render::{
    Begin, ErrorBounds, Figures, Limits, Observer, Plan, Progress, RenderError, RenderRequest,
    Rendered,
};
use hemilux_engine::scene::gltf::ImportOptions;
use hemilux_engine::scene::{Background, Scene, Warning};
use hemilux_engine::transport::render;
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use parts::Parts;
use surroundings::{Surroundings, parse_three};
use view::View;
pub(super) use view::camera_choice;

/// Time between checkpoints.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(10);

/// Arguments of `hemilux render`.
#[derive(Args)]
pub struct Arguments {
    /// A .glb or .gltf file, a .zip or a folder with one, or the name of a built-in scene.
    scene: String,
    /// Where the picture goes; ends in .png or .exr. Can be repeated.
    #[arg(short, long = "output", required = true, value_name = "OUT.{png,exr}")]
    output: Vec<PathBuf>,
    /// The set of materials to show, by its name, where the file has several
    /// (KHR_materials_variants).
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
    #[command(flatten)]
    parts: Parts,
    #[command(flatten)]
    view: View,
    #[command(flatten)]
    surroundings: Surroundings,
    /// What the camera sees beside the surfaces: the `sky`, nothing (`transparent`: pictures get an
    /// alpha channel), or a linear RGB radiance.
    #[arg(long, value_name = "sky|transparent|R,G,B", default_value = "sky", allow_hyphen_values = true, value_parser = parse_background)]
    background: Background,
    /// What the numbers of the scene are, and so those of EXR files, whose header says so.
    #[arg(long, value_name = "photometric|radiometric", default_value = "photometric", value_parser = parse_units)]
    units: Units,
    /// Picture size, pixels.
    #[arg(long, default_value = "512x512", value_parser = parse_size, value_name = "WxH")]
    size: (u32, u32),
    /// How the light is computed.
    #[arg(long, default_value = "auto")]
    method: String,
    /// Stop after so many seconds of solving and measuring.
    #[arg(long, value_parser = parse_positive)]
    seconds: Option<f64>,
    /// Stop after so many iterations.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    iterations: Option<u64>,
    /// Stop at this estimated relative error.
    #[arg(long, value_parser = parse_share, value_name = "E")]
    target_error: Option<f64>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The device: `auto`, `cpu`, or an index from `hemilux devices`.
    #[arg(long, default_value = "auto")]
    device: String,
    /// A setting of the method; `hemilux settings` lists them. Can be repeated.
    #[arg(long = "set", value_parser = parse_setting, value_name = "[METHOD.]KEY=VALUE")]
    settings: Vec<(String, String)>,
    /// Write the figures of the render to this file.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Exposure of PNG files: `auto`, or stops.
    #[arg(long, default_value = "auto", value_parser = parse_exposure, allow_hyphen_values = true, value_name = "auto|STOPS")]
    exposure: Exposure,
    /// Write all that is known to this file, now and then and at the end, to go on from there.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Go on from such a file; seconds and iterations of before count towards the limits.
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Begin with what a picture from another camera has found out about the scene.
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    view_of: Option<PathBuf>,
    /// Show no progress.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || "must read like 640x480, each side at least 1".to_owned();
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    match (width.parse(), height.parse()) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok((width, height)),
        _ => Err(wrong()),
    }
}

pub(super) fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("must be a number above 0".into()),
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x < 1.0 => Ok(x),
        _ => Err("must be a number between 0 and 1".into()),
    }
}

pub(super) fn parse_setting(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
        _ => Err("must read key=value".into()),
    }
}

fn parse_exposure(text: &str) -> Result<Exposure, String> {
    match (text, text.parse::<f32>()) {
        ("auto", _) => Ok(Exposure::Auto),
        (_, Ok(stops)) if stops.abs() <= 60.0 => Ok(Exposure::Stops(stops)),
        _ => Err("must be auto, or a number of stops between -60 and 60".into()),
    }
}

fn parse_background(text: &str) -> Result<Background, String> {
    let background = match text {
        "sky" => Background::Sky,
        "transparent" => Background::Transparent,
        _ => parse_three(text).map(Background::Colour).map_err(|error| {
            format!("must be sky, transparent or three radiances; these {error}")
        })?,
    };
    background.check().map(|()| background).map_err(|error| error.to_string())
}

fn parse_units(text: &str) -> Result<Units, String> {
    match text {
        "photometric" => Ok(Units::Photometric),
        "radiometric" => Ok(Units::Radiometric),
        _ => Err("must be photometric or radiometric".into()),
    }
}

/// Refuses files that could not be written, before the work rather than after it.
fn check_outputs(output: &[PathBuf]) -> Result<(), Failure> {
    for path in output {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if !matches!(ending.as_deref(), Some("png" | "exr")) {
            return Err(Failure::usage(format!("output {path:?} must end in .png or .exr")));
        }
        if path.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            return Err(Failure::failed(format!("the folder of {path:?} is not there")));
        }
    }
    Ok(())
}

/// Renders one picture.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let started = Instant::now();
    check_outputs(&arguments.output)?;
    if arguments.units == Units::Radiometric && arguments.surroundings.has_day() {
        let what = "--sun-at gives light in lux, which is photometric; leave --units out";
        return Err(Failure::usage(what));
    }
    let options = arguments.parts.options(arguments.variant.clone());
    let scene = read_scene(&arguments.scene, &options)?;
    let device_ids = devices::candidates(&arguments.device).map_err(Failure::usage)?;
    let camera = arguments.view.camera(&scene);
    let request = RenderRequest {
        environment: arguments.surroundings.read()?,
        background: arguments.background,
        camera,
        limits: Limits {
            seconds: arguments.seconds,
            iterations: arguments.iterations,
            target_error: arguments.target_error,
            cap_seconds: None,
        },
        seed: arguments.seed,
        options: arguments.settings.iter().cloned().collect::<BTreeMap<_, _>>(),
        begin: begin(arguments)?,
        ..RenderRequest::new(Arc::new(scene), arguments.method.clone(), arguments.size.into())
    };
    let mut device = devices::open_first(&device_ids).map_err(Failure::failed)?;
    let mut console = Console::new(arguments.quiet, arguments.checkpoint.clone());
    let rendered =
        catch_unwind(AssertUnwindSafe(|| render(device.as_mut(), &request, &mut console))).map_err(
            |panic| {
                Failure::failed(format!(
                    "unexpected fault in the renderer: {}",
                    panic_text(&*panic)
                ))
            },
        );
    console.finish();
    if let Some(error) = &console.checkpoint_trouble {
        return Err(Failure::failed(format!("cannot write the checkpoint: {error}")));
    }
    let Rendered { picture, mut stats } = rendered?.map_err(|error| match error {
        RenderError::Parameter { .. } | RenderError::Checkpoint(_) => Failure::usage(error),
        RenderError::Device(_) => Failure::failed(error),
    })?;
    for warning in stats.warnings.iter().filter(|_| !arguments.quiet) {
        eprintln!("warning: {}: {}", warning.at, warning.what);
    }
    write_outputs(arguments, &picture)?;
    stats.seconds_total = started.elapsed().as_secs_f64();
    if let Some(path) = &arguments.stats {
        let json = serde_json::to_string_pretty(&stats).map_err(Failure::failed)?;
        std::fs::write(path, json + "\n")
            .map_err(|error| Failure::failed(format!("cannot write {path:?}: {error}")))?;
    }
    Ok(())
}

fn begin(arguments: &Arguments) -> Result<Begin, Failure> {
    let read = |path: &Path| {
        let bytes = std::fs::read(path)
            .map_err(|error| Failure::failed(format!("cannot read {path:?}: {error}")))?;
        let checkpoint = Checkpoint::from_bytes(&bytes);
        let refuse = |error| Failure::failed(format!("{}: {error}", path.display()));
        checkpoint.map(Arc::new).map_err(refuse)
    };
    Ok(match (&arguments.resume, &arguments.view_of) {
        (Some(path), _) => Begin::Continue(read(path)?),
        (None, Some(path)) => Begin::View(read(path)?),
        (None, None) => Begin::Afresh,
    })
}

fn write_outputs(arguments: &Arguments, picture: &Picture) -> Result<(), Failure> {
    for path in &arguments.output {
        picture.write(path, arguments.exposure, arguments.units).map_err(Failure::failed)?;
    }
    Ok(())
}

pub(super) fn read_scene(name: &str, options: &ImportOptions) -> Result<Scene, Failure> {
    let (main, resources) = scene_files::read(name)?;
    scenes::load_file(&main, &resources, options)
        .map_err(|refusal| Failure::failed(format!("{name}: {refusal}")))
}

/// Shows progress on the terminal, or as lines now and then where there is none; hears Ctrl-C.
struct Console {
    bar: Option<ProgressBar>,
    lines: bool,
    last_line: Instant,
    interrupted: Arc<AtomicBool>,
    checkpoint: Option<PathBuf>,
    last_checkpoint: Instant,
    checkpoint_trouble: Option<std::io::Error>,
}

impl Console {
    fn new(quiet: bool, checkpoint: Option<PathBuf>) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (!quiet && terminal).then(|| {
            let bar = ProgressBar::new(1000);
            let template = "{bar:32} {percent:>3}% {msg}";
            bar.set_style(
                ProgressStyle::with_template(template)
                    .unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar
        });
        let interrupted = Arc::new(AtomicBool::new(false));
        listen_for_interrupt(interrupted.clone());
        let now = Instant::now();
        Self {
            bar,
            lines: !quiet && !terminal,
            last_line: now,
            interrupted,
            checkpoint,
            last_checkpoint: now,
            checkpoint_trouble: None,
        }
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish();
        }
    }
}

/// The first Ctrl-C ends the render with the picture so far; the second ends the program.
pub(super) fn listen_for_interrupt(interrupted: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let Ok(runtime) = runtime else { return };
        runtime.block_on(async {
            while tokio::signal::ctrl_c().await.is_ok() {
                if interrupted.swap(true, Ordering::Relaxed) {
                    std::process::exit(130);
                }
            }
        });
    });
}

impl Observer for Console {
    fn planned(&mut self, plan: &Plan, _warnings: &[Warning]) {
        if self.lines {
            let Plan { method, patches, triangles, .. } = plan;
            let _ =
                writeln!(std::io::stderr(), "{method}: {triangles} triangles, {patches} patches");
        }
    }

    fn progress(&mut self, progress: &Progress) {
        let Figures { estimated_error, error_bounds, .. } = progress.figures;
        let between = error_bounds.map_or_else(String::new, |ErrorBounds { low, high, .. }| {
            format!(" ({:.2} to {:.2})", 100.0 * low, 100.0 * high)
        });
        let error = estimated_error
            .map_or_else(String::new, |error| format!(", error {:.2}%{between}", 100.0 * error));
        let remaining = progress
            .seconds_remaining
            .map_or_else(String::new, |seconds| format!(", {seconds:.1} s left"));
        let text = format!(
            "{} iterations, lights {:.1}%{error}, {:.1} s{remaining}",
            progress.figures.iterations,
            100.0 * progress.figures.light_source_selection_ratio,
            progress.seconds,
        );
        if let Some(bar) = &self.bar {
            bar.set_position((1000.0 * progress.fraction.clamp(0.0, 1.0)) as u64);
            bar.set_message(text);
        } else if self.lines && self.last_line.elapsed() >= Duration::from_secs(1) {
            self.last_line = Instant::now();
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    }

    fn wants_checkpoint(&mut self, _progress: &Progress) -> bool {
        self.checkpoint.is_some() && self.last_checkpoint.elapsed() >= CHECKPOINT_INTERVAL
    }

    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        self.checkpoint.is_some()
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        let Some(path) = &self.checkpoint else { return };
        // Whenever the power fails, there is a whole file under the name.
        let part = path.with_added_extension("part");
        let written = std::fs::File::create(&part)
            .and_then(|mut file| {
                checkpoint.write(&mut file)?;
                file.sync_all()
            })
            .and_then(|()| std::fs::rename(&part, path));
        self.checkpoint_trouble = written.err();
        self.last_checkpoint = Instant::now();
    }

    fn cancelled(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}
