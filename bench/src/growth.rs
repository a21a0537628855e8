//! `growth`: seconds and memory of every method against the number of patches.
//!
//! Each point runs in a process of its own, whose peak of resident memory (VmHWM) the system
//! counts. A method does what makes its points comparable: those with an end go to it, the others
//! do a fixed number of iterations.

use crate::results::{self, Failure};
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::statistics::log_slope;
use hemilux_charts::table::Table;
use hemilux_engine::device;
use hemilux_engine::render::{Limits, RenderRequest, StopReason, Unobserved};
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::made;
use hemilux_engine::transport::render;
use hemilux_engine::transport::{REGISTRY, relevant};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;

/// Width and height of pictures, pixels.
const SIDE: u32 = 128;
/// Hemicube resolution.
const RESOLUTION: u32 = 128;
/// Points of at least so many patches count for the slope.
const SLOPE_FROM: f64 = 1000.0;

#[derive(clap::Args)]
pub struct Arguments {
    /// Device: `cpu`, `auto` or an id of `hemilux devices`.
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Up to 2,000 patches and 5 seconds a point; writes to out/growth.
    #[arg(long)]
    quick: bool,
    /// Folder for table and chart; `docs/methods`, with --quick `out/growth`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/methods.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Wanted patches; 250 to 16,000 in doublings by default.
    #[arg(long, value_delimiter = ',')]
    patches: Vec<u64>,
    /// Methods; all by default.
    #[arg(long, value_delimiter = ',')]
    methods: Vec<String>,
    /// Seconds after which a point is cut off; 60 by default.
    #[arg(long)]
    limit: Option<f64>,
}

/// One point, for the process that measures it.
#[derive(clap::Args)]
pub struct PointArguments {
    #[arg(long)]
    method: String,
    #[arg(long)]
    patches: u64,
    #[arg(long)]
    limit: f64,
    #[arg(long)]
    device: String,
}

/// What a process found.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Point {
    method: String,
    wanted: u64,
    patches: u64,
    seconds: f64,
    shots: u64,
    iterations: u64,
    stopped: StopReason,
    /// Resident bytes before the job, and at their peak; `None` where the system doesn't tell.
    resident_bytes: Option<u64>,
    peak_bytes: Option<u64>,
    /// Bytes of a matrix that the method counts itself.
    matrix_bytes: Option<f64>,
}

impl Point {
    /// Whether the time limit cut it off.
    fn cut(&self) -> bool {
        self.stopped == StopReason::TimeBudget
    }

    /// Bytes that the job added at its peak.
    fn added(&self) -> Option<f64> {
        Some(self.peak_bytes?.saturating_sub(self.resident_bytes?) as f64)
    }
}

/// A method with its points, and why there are not more.
struct Series {
    method: String,
    points: Vec<Point>,
    remark: Option<String>,
}

/// What a method does in every point: iterations, or its own end, and that in words.
fn work(method: &str) -> (Option<u64>, &'static str) {
    match method {
        "gauss-seidel" => (None, "until converged: every row of the matrix, then sweeps"),
        "progressive" => (None, "until 10⁻⁵ of the emitted power is left"),
        "stochastic" => (Some(128), "128 iterations of 8 shots"),
        "monte-carlo" => (Some(16), "16 passes through all bounces, about 60 shots each"),
        "ray-traced" => (Some(16), "16 paths a pixel; has no patches"),
        "illumination-map" => (Some(16), "16 paths a pixel; its map has cells, not patches"),
        _ => (Some(16), "16 iterations"),
    }
}

/// Measures one point in this process and prints it.
pub fn point(arguments: &PointArguments) -> Result<(), Failure> {
    let scene = import(&made::cornell(), &Resources::new(), &ImportLimits::default())?;
    let mut device = device::open(&arguments.device)?;
    let options = [
        ("patches", arguments.patches.to_string()),
        ("coarse_patches", arguments.patches.to_string()),
        ("hemicube_resolution", RESOLUTION.to_string()),
        ("pixel_samples", "4".into()),
    ];
    let request = RenderRequest {
        limits: Limits {
            seconds: Some(arguments.limit),
            iterations: work(&arguments.method).0,
            ..Limits::default()
        },
        options: relevant(
            &arguments.method,
            &options.map(|(name, value)| (name.into(), value)).into(),
        ),
        ..RenderRequest::new(Arc::new(scene), &arguments.method, [SIDE; 2])
    };
    let resident_bytes = results::status_bytes("VmRSS");
    let stats = render(device.as_mut(), &request, &mut Unobserved)?.stats;
    let point = Point {
        method: arguments.method.clone(),
        wanted: arguments.patches,
        patches: stats.patches,
        seconds: stats.seconds_solve,
        shots: stats.figures.shots,
        iterations: stats.figures.iterations,
        stopped: stats.stopped,
        resident_bytes,
        peak_bytes: results::status_bytes("VmHWM"),
        matrix_bytes: stats.diagnostics.get("matrix_bytes").copied(),
    };
    println!("{}", serde_json::to_string(&point)?);
    Ok(())
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let default_out = if arguments.quick { "out/growth" } else { "docs/methods" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/methods.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    let limit = arguments.limit.unwrap_or(if arguments.quick { 5.0 } else { 60.0 });
    let doublings = if arguments.quick { 4 } else { 7 };
    let mut wanted = arguments.patches.clone();
    if wanted.is_empty() {
        wanted = (0..doublings).map(|k| 250 << k).collect();
    }
    wanted.sort_unstable();
    let known: Vec<&str> = REGISTRY.iter().map(|method| method.name()).collect();
    let mut methods = arguments.methods.clone();
    if methods.is_empty() {
        methods = known.iter().map(|name| (*name).to_string()).collect();
    }
    if let Some(unknown) = methods.iter().find(|method| !known.contains(&method.as_str())) {
        return Err(format!("there is no method {unknown:?}; there are {known:?}").into());
    }
    let mut all: Vec<Series> = methods
        .into_iter()
        .map(|method| Series { method, points: Vec::new(), remark: None })
        .collect();
    // Size by size, so that a disturbance hits all methods alike.
    for patches in &wanted {
        for series in all.iter_mut().filter(|series| series.remark.is_none()) {
            eprintln!("{patches} patches: {}", series.method);
            extend(series, *patches, limit, &arguments.device)?;
        }
    }
    std::fs::write(out.join("growth.csv"), csv(&all).csv())?;
    std::fs::write(out.join("growth.svg"), chart(&all, &wanted).svg()?)?;
    let parts = [
        ("growth conditions".to_string(), conditions(&all, limit)),
        ("growth seconds".to_string(), table(&all, &wanted, &|p| Some(p.seconds), &seconds)),
        ("growth memory".to_string(), table(&all, &wanted, &Point::added, &mebibytes)),
    ];
    results::publish(page.as_deref(), &parts)
}

/// Measures the next point; a method that is cut off or fails has no further ones.
fn extend(series: &mut Series, patches: u64, limit: f64, device: &str) -> Result<(), Failure> {
    let output = Command::new(std::env::current_exe()?)
        .args(["growth-point", "--method", &series.method, "--device", device])
        .args(["--patches", &patches.to_string(), "--limit", &limit.to_string()])
        .stdin(Stdio::null())
        .output()?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let reason = said.trim().lines().last().unwrap_or("no message").to_string();
        series.remark = Some(format!("failed at {patches} patches: {reason}"));
        return Ok(());
    }
    let point: Point = serde_json::from_slice(&output.stdout)?;
    if point.cut() {
        series.remark = Some(format!(
            "cut off at {patches} patches after {limit} s; larger ones were not tried"
        ));
    }
    series.points.push(point);
    Ok(())
}

fn csv(all: &[Series]) -> Table {
    let mut table = Table::new(&[
        "method",
        "wanted_patches",
        "patches",
        "seconds_solve",
        "shots",
        "iterations",
        "cut_off",
        "resident_bytes_before",
        "peak_bytes",
        "added_bytes",
        "matrix_bytes",
    ]);
    let bytes = |value: Option<f64>| value.map(|bytes| format!("{bytes:.0}")).unwrap_or_default();
    for point in all.iter().flat_map(|series| &series.points) {
        table.add(vec![
            point.method.clone(),
            point.wanted.to_string(),
            point.patches.to_string(),
            format!("{:.4}", point.seconds),
            point.shots.to_string(),
            point.iterations.to_string(),
            point.cut().to_string(),
            bytes(point.resident_bytes.map(|bytes| bytes as f64)),
            bytes(point.peak_bytes.map(|bytes| bytes as f64)),
            bytes(point.added()),
            bytes(point.matrix_bytes),
        ]);
    }
    table
}

fn seconds(value: f64) -> String {
    if value < 10.0 { format!("{value:.2} s") } else { format!("{value:.1} s") }
}

fn mebibytes(value: f64) -> String {
    format!("{:.1} MiB", value / f64::from(1 << 20))
}

/// Slope of ln y over ln patches, of the points that were not cut off.
fn slope(series: &Series, figure: &dyn Fn(&Point) -> Option<f64>) -> String {
    let points: Vec<(f64, f64)> = (series.points.iter())
        .filter(|point| !point.cut() && point.wanted as f64 >= SLOPE_FROM)
        .filter_map(|point| Some((point.wanted as f64, figure(point)?)))
        .collect();
    let slope = log_slope(&points);
    if slope.is_nan() || points.len() < 3 { "–".into() } else { format!("{slope:.2}") }
}

fn table(
    all: &[Series],
    wanted: &[u64],
    figure: &dyn Fn(&Point) -> Option<f64>,
    words: &dyn Fn(f64) -> String,
) -> String {
    let mut header = vec!["method".to_string()];
    header.extend(wanted.iter().map(u64::to_string));
    header.push(format!("slope from {SLOPE_FROM} patches"));
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for series in all {
        let mut row = vec![series.method.clone()];
        row.extend(wanted.iter().map(|patches| {
            let point = series.points.iter().find(|point| point.wanted == *patches);
            match point.and_then(|point| Some((point, figure(point)?))) {
                Some((point, value)) if point.cut() => format!("> {}", words(value)),
                Some((_, value)) => words(value),
                None => "–".into(),
            }
        }));
        row.push(slope(series, figure));
        table.add(row);
    }
    table.markdown()
}

fn conditions(all: &[Series], limit: f64) -> String {
    let mut text = results::machine();
    text += &format!(
        "- the Cornell box, {SIDE} × {SIDE} pixels, hemicubes of R = {RESOLUTION}, {limit} s a \
         point at most\n"
    );
    let mut done: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for series in all {
        done.entry(work(&series.method).1).or_default().push(&series.method);
    }
    for (what, methods) in done {
        text += &format!("- {}: {what}\n", methods.join(", "));
    }
    for series in all {
        if let Some(remark) = &series.remark {
            text += &format!("- **{}** {remark}\n", series.method);
        }
    }
    text
}

fn chart(all: &[Series], wanted: &[u64]) -> Chart {
    let panel = |title: &str, label: &str, figure: &dyn Fn(&Point) -> Option<f64>| Panel {
        title: title.into(),
        x_label: "patches (dashed: slopes 1 and 2)".into(),
        y_label: label.into(),
        lines: all
            .iter()
            .map(|series| {
                let whole = series.points.iter().filter(|point| !point.cut());
                let points = whole.filter_map(|p| Some((p.wanted as f64, figure(p)?))).collect();
                Line { name: series.method.clone(), points, ..Line::default() }
            })
            .collect(),
        guide_slopes: vec![1.0, 2.0],
        x_ticks: wanted.iter().map(|patches| *patches as f64).collect(),
        empty: "the system does not tell".into(),
        ..Panel::default()
    };
    let mib = |point: &Point| Some(point.added()? / f64::from(1 << 20));
    let panels = vec![
        panel("time", "seconds", &|point| Some(point.seconds)),
        panel("memory that the job adds", "MiB", &mib),
    ];
    Chart { panels, columns: 2, panel_size: (480, 380), legend: true }
}
