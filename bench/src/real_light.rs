//! `real-light`: the scenes of [`made::real`] by `auto` against path tracing in two halves: error,
//! predicted error, and blocks of pixels, as JSON, as a table of a page, and as pictures beside
//! their references.

use crate::page::percent;
use crate::real_view::RealView;
use crate::results::{self, Failure};
use hemilux_charts::regions::without_emitters;
use hemilux_charts::sheet;
use hemilux_charts::table::Table;
use hemilux_engine::device::{self, Device};
use hemilux_engine::image::{Exposure, Picture};
use hemilux_engine::render::Limits;
use hemilux_engine::scene::made::real::{self, RealScene};
use hemilux_tests::blocks::{block_means, largest_deviation};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Pixels along a side of a block.
const BLOCK: u32 = 16;
/// What differences are multiplied by in pictures.
const MAGNIFIED: f32 = 5.0;

#[derive(clap::Args)]
pub struct Arguments {
    /// Only these scenes; all by default. What the table has of others stays.
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
    /// Seconds of the pictures that are judged, the longest last.
    #[arg(long, value_delimiter = ',', default_values_t = [3.0, 10.0])]
    seconds: Vec<f64>,
    /// Seconds of path tracing for each half of a reference.
    #[arg(long, default_value_t = 60.0)]
    reference_seconds: f64,
    /// Width and height of pictures, pixels.
    #[arg(long, default_value_t = 192)]
    side: u32,
    /// Seed of the scenes that are made by chance.
    #[arg(long, default_value_t = 1)]
    scene_seed: u32,
    /// Figures of all pictures.
    #[arg(long, default_value = "bench/results/real-light.json")]
    json: PathBuf,
    /// Folder for pictures.
    #[arg(long, default_value = "docs/stability")]
    out: PathBuf,
    /// Page whose generated part is rewritten.
    #[arg(long, default_value = "docs/stability.md")]
    page: PathBuf,
    /// Folder where references are kept.
    #[arg(long, default_value = "out/real-light/references")]
    references: PathBuf,
}

/// One picture's figures.
#[derive(Serialize, Deserialize)]
struct Row {
    scene: String,
    why: String,
    /// Seconds that were asked for.
    seconds: f64,
    seconds_solve: f64,
    /// What `auto` took.
    method: String,
    iterations: u64,
    /// rRMSE, free of the reference's noise; below 0 where the picture is as good as the reference.
    error: f64,
    /// What the job said of its own error.
    predicted: f64,
    /// Error below which the reference can't tell pictures apart.
    resolution: f64,
    /// Mean radiance over the reference's.
    mean_ratio: f64,
    /// Largest deviation of a block of pixels, and the same of one half of the reference from the
    /// other: what of it is noise of the reference.
    largest_block: f64,
    largest_block_of_halves: f64,
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    results::prepare(&arguments.out, Some(&arguments.page))?;
    std::fs::create_dir_all(&arguments.references)?;
    let mut device = device::open("cpu")?;
    let all = real::all(arguments.scene_seed);
    if let Some(name) =
        arguments.scenes.iter().find(|name| all.iter().all(|scene| scene.name != **name))
    {
        return Err(format!("there is no scene {name}").into());
    }
    let mut rows = kept(&arguments.json);
    for scene in &all {
        if arguments.scenes.is_empty() || arguments.scenes.contains(&scene.name) {
            rows.retain(|row| row.scene != scene.name);
            rows.extend(measure(scene, arguments, device.as_mut())?);
        }
    }
    let place = |row: &Row| all.iter().position(|scene| scene.name == row.scene);
    rows.sort_by_key(place);
    std::fs::write(&arguments.json, serde_json::to_string_pretty(&rows)? + "\n")?;
    let text = format!("{}\n{}", results::machine(), table(&rows));
    results::publish(Some(&arguments.page), &[("real light".into(), text)])
}

/// The rows of earlier runs.
fn kept(path: &Path) -> Vec<Row> {
    let read = std::fs::read(path).ok();
    read.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

fn measure(
    made: &RealScene,
    arguments: &Arguments,
    device: &mut dyn Device,
) -> Result<Vec<Row>, Failure> {
    let side = arguments.side;
    let view = RealView::new(made, side);
    let reference = view.reference(device, &arguments.references, arguments.reference_seconds)?;
    let seconds = arguments.reference_seconds;
    let (exact, traced) = view.sparse_reference(device, &arguments.references, seconds)?;
    let mut counted = without_emitters(&view.scene, &view.camera()?, (side, side), 16);
    counted.iter_mut().zip(traced).for_each(|(counted, traced)| *counted &= traced);
    let [truth, first, second] =
        [&reference.picture(), reference.halves()[0], reference.halves()[1]]
            .map(|picture| block_means(picture, BLOCK));
    let mut rows = Vec::new();
    for seconds in &arguments.seconds {
        let limits = Limits::seconds(*seconds);
        let rendered = view.render(device, ("auto", limits), 1)?;
        let (stats, figures) = (&rendered.stats, &rendered.stats.figures);
        for warning in &stats.warnings {
            eprintln!("{}: {}: {}", made.name, warning.at, warning.what);
        }
        let judged = exact.judged(&rendered.picture, &counted);
        let row = Row {
            scene: made.name.clone(),
            why: made.why.into(),
            seconds: *seconds,
            seconds_solve: stats.seconds_solve,
            method: stats.method.clone(),
            iterations: figures.iterations,
            error: judged.error(),
            predicted: figures.estimated_error.unwrap_or(f64::NAN),
            resolution: judged.resolution(),
            mean_ratio: exact.energy(&rendered.picture, &counted),
            largest_block: largest_deviation(&block_means(&rendered.picture, BLOCK), &truth),
            largest_block_of_halves: largest_deviation(&first, &second),
        };
        eprintln!("{}", serde_json::to_string(&row)?);
        eprintln!("{:?}", stats.diagnostics);
        rows.push(row);
        if seconds == arguments.seconds.last().unwrap_or(seconds) {
            let pictures = [rendered.picture, reference.picture()];
            let path = arguments.out.join(format!("{}.png", made.name));
            std::fs::write(path, side_by_side(&made.name, pictures)?)?;
            let file = arguments.references.join(format!("{}.glb", made.name));
            std::fs::write(file, &made.glb)?;
        }
    }
    Ok(rows)
}

/// The picture, its reference and what they differ by, at one exposure.
fn side_by_side(name: &str, [own, truth]: [Picture; 2]) -> Result<Vec<u8>, Failure> {
    let differences =
        own.pixels.iter().zip(&truth.pixels).map(|(a, b)| (*a - *b).abs() * MAGNIFIED);
    let difference = Picture::new(own.width, own.height, differences.collect());
    let row = sheet::Row {
        title: name.into(),
        exposure: truth.exposure_factor(Exposure::Auto),
        cells: vec![
            ("hemilux".into(), own),
            ("ray-traced".into(), truth),
            (format!("difference x {MAGNIFIED}"), difference),
        ],
    };
    Ok(sheet::png(&[row], 1)?)
}

fn table(rows: &[Row]) -> String {
    let mut table = Table::new(&[
        "scene",
        "what is hard",
        "seconds",
        "iterations",
        "error",
        "predicted",
        "predicted/actual",
        "mean",
        "largest block",
    ]);
    for row in rows {
        let resolved = row.error >= row.resolution;
        let below = format!("< {}", percent(row.resolution));
        let ratio = format!("{:.2}", row.predicted / row.error);
        table.add(vec![
            row.scene.clone(),
            row.why.clone(),
            format!("{:.1}", row.seconds_solve),
            row.iterations.to_string(),
            if resolved { percent(row.error) } else { below },
            percent(row.predicted),
            if resolved { ratio } else { "–".into() },
            format!("{:.3}", row.mean_ratio),
            format!(
                "{} (noise {})",
                percent(row.largest_block),
                percent(row.largest_block_of_halves)
            ),
        ]);
    }
    table.markdown()
}
