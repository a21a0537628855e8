//! `rooms`: predicted against actual error in rooms that a generator makes by chance
//! ([`random_room`], [`sunny_room`], [`odd_room`]), so that nothing was tuned to them: each room after several numbers of
//! iterations against path tracing in two halves. Figures go to a JSON file as they come.

use crate::page::percent;
use crate::real_view::RealView;
use crate::results::{self, Failure};
use crate::tiers::GOOD;
use hemilux_charts::regions::Regions;
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::device::{self, Device};
use hemilux_engine::render::{Limits, Rendered};
use hemilux_engine::scene::made::real::{odd_room, random_room, sunny_room};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Ratio below which a prediction is wrong.
const WRONG: f64 = 0.5;
/// Rooms that are named for the lowest and for the highest ratio.
const NAMED: usize = 5;

#[derive(clap::Args)]
pub struct Arguments {
    /// Seed of the first room.
    #[arg(long, default_value_t = 1)]
    first_seed: u32,
    /// What is in them.
    #[arg(long, value_enum, default_value_t)]
    kind: Kind,
    /// Number of rooms; their seeds follow each other.
    #[arg(long, default_value_t = 20)]
    count: u32,
    /// Numbers of iterations after which a picture is judged.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 4, 16])]
    iterations: Vec<u64>,
    /// Time budgets after which one is judged, seconds.
    #[arg(long, value_delimiter = ',')]
    seconds: Vec<f64>,
    /// Seconds of path tracing for each half of a reference.
    #[arg(long, default_value_t = 20.0)]
    reference_seconds: f64,
    /// Width and height of pictures, pixels.
    #[arg(long, default_value_t = 128)]
    side: u32,
    /// Figures of all pictures.
    #[arg(long, default_value = "out/rooms/rooms.json")]
    json: PathBuf,
    /// Page whose generated part is rewritten; the table is printed without one.
    #[arg(long)]
    page: Option<PathBuf>,
    /// Folder where references are kept.
    #[arg(long, default_value = "out/rooms/references")]
    references: PathBuf,
}

/// What rooms are made of.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum Kind {
    /// Furniture, lamps, windows, textures.
    #[default]
    Furnished,
    /// The same in the sun.
    Sunny,
    /// One-sided plates, hollow things, glass and what is half there, through each other.
    Odd,
}

/// One picture's figures.
#[derive(Serialize, Deserialize)]
struct Row {
    room: u32,
    side: u32,
    /// As many as were asked for, or were done in the time.
    iterations: u64,
    /// The time budget, where that ended it.
    seconds_asked: Option<f64>,
    seconds_solve: f64,
    /// rRMSE, free of the reference's noise; below 0 where the picture is as good as the reference.
    error: f64,
    /// What the job said of its own error.
    predicted: f64,
    /// Error below which the reference can't tell pictures apart.
    resolution: f64,
    /// Mean radiance over the reference's.
    mean_ratio: f64,
    /// What the job says of itself: errors by cause among it.
    diagnostics: BTreeMap<String, f64>,
}

impl Row {
    fn is_resolved(&self) -> bool {
        self.error >= self.resolution
    }

    fn ratio(&self) -> f64 {
        self.predicted / self.error
    }

    /// After what it was judged.
    fn after(&self) -> String {
        after(match self.seconds_asked {
            Some(seconds) => by_time(seconds),
            None => by_iterations(self.iterations),
        })
    }
}

fn by_iterations(iterations: u64) -> Limits {
    Limits::iterations(iterations)
}

fn by_time(seconds: f64) -> Limits {
    Limits::seconds(seconds)
}

/// What ends a job, in words.
fn after(limits: Limits) -> String {
    match (limits.iterations, limits.seconds) {
        (Some(iterations), _) => iterations.to_string(),
        (None, seconds) => format!("{} s", seconds.unwrap_or(f64::INFINITY)),
    }
}

impl Arguments {
    /// After what pictures are judged.
    fn limits(&self) -> impl Iterator<Item = Limits> {
        let iterations = self.iterations.iter().map(|iterations| by_iterations(*iterations));
        iterations.chain(self.seconds.iter().map(|seconds| by_time(*seconds)))
    }
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(folder) = arguments.json.parent() {
        results::prepare(folder, arguments.page.as_deref())?;
    }
    std::fs::create_dir_all(&arguments.references)?;
    let mut device = device::open("cpu")?;
    let mut rows = Vec::new();
    for room in (arguments.first_seed..).take(arguments.count as usize) {
        rows.extend(measure(room, arguments, device.as_mut())?);
        std::fs::write(&arguments.json, serde_json::to_string_pretty(&rows)? + "\n")?;
    }
    let text = format!("{}\n{}", summary(&rows), table(&rows, arguments));
    results::publish(arguments.page.as_deref(), &[("random rooms".into(), text)])
}

fn measure(room: u32, arguments: &Arguments, device: &mut dyn Device) -> Result<Vec<Row>, Failure> {
    let side = arguments.side;
    let made = match arguments.kind {
        Kind::Furnished => random_room(room),
        Kind::Sunny => sunny_room(room),
        Kind::Odd => odd_room(room),
    };
    std::fs::write(arguments.references.join(format!("{}.glb", made.name)), &made.glb)?;
    let view = RealView::new(&made, side);
    let seconds = arguments.reference_seconds;
    let (reference, traced) = view.sparse_reference(device, &arguments.references, seconds)?;
    // Where an emitter covers a thousandth of a pixel its noise would be that of the picture.
    let regions = Regions::new(&view.scene, &view.camera()?, (side, side), 16, 1);
    let [mut counted, ..] = regions.beside_no_emitter(side).masks;
    counted.iter_mut().zip(traced).for_each(|(counted, traced)| *counted &= traced);
    let mut rows = Vec::new();
    for limits in arguments.limits() {
        let (after, seconds_asked) = (after(limits), limits.seconds);
        let Rendered { picture, stats, .. } = view.render(device, ("hemilux", limits), 1)?;
        let judged = reference.judged(&picture, &counted);
        let row = Row {
            room,
            side,
            iterations: stats.figures.iterations,
            seconds_asked,
            seconds_solve: stats.seconds_solve,
            error: judged.error(),
            predicted: stats.figures.estimated_error.unwrap_or(f64::NAN),
            resolution: judged.resolution(),
            mean_ratio: reference.energy(&picture, &counted),
            diagnostics: stats.diagnostics.iter().map(|(k, v)| (k.to_string(), *v)).collect(),
        };
        eprintln!(
            "{} after {after}: {} ({} predicted), mean {:.3}",
            made.name,
            percent(row.error),
            percent(row.predicted),
            row.mean_ratio
        );
        let file =
            arguments.references.join(format!("{}-{}.exr", made.name, after.replace(' ', "")));
        std::fs::write(file, picture.to_exr()?)?;
        rows.push(row);
    }
    Ok(rows)
}

/// In words: how many predictions are good, and which rooms are worst.
fn summary(rows: &[Row]) -> String {
    let mut judged: Vec<&Row> = rows.iter().filter(|row| row.is_resolved()).collect();
    judged.sort_by(|a, b| a.ratio().total_cmp(&b.ratio()));
    let share = |is: &dyn Fn(f64) -> bool| {
        let count = judged.iter().filter(|row| is(row.ratio())).count();
        100.0 * count as f64 / judged.len().max(1) as f64
    };
    let named = |rows: &mut dyn Iterator<Item = &&Row>| {
        let named = rows
            .take(NAMED)
            .map(|row| format!("{:.2} (room {} after {})", row.ratio(), row.room, row.after()));
        named.collect::<Vec<_>>().join(", ")
    };
    format!(
        "- {} pictures of {} that their references can judge\n- predicted/actual between {} and {} in \
         {:.0} %, below in {:.0} %, below {WRONG} in {:.1} %; median {:.2}\n- lowest: {}\n- highest: {}\n{}",
        judged.len(),
        rows.len(),
        GOOD.start(),
        GOOD.end(),
        share(&|ratio| GOOD.contains(&ratio)),
        share(&|ratio| ratio < *GOOD.start()),
        share(&|ratio| ratio < WRONG),
        if judged.is_empty() {
            f64::NAN
        } else {
            median(judged.iter().map(|row| row.ratio()).collect())
        },
        named(&mut judged.iter()),
        named(&mut judged.iter().rev()),
        results::machine(),
    )
}

/// Medians over rooms by number of iterations, or by time.
fn table(rows: &[Row], arguments: &Arguments) -> String {
    let mut table =
        Table::new(&["iterations", "seconds", "error", "predicted/actual", "off in the mean"]);
    for limits in arguments.limits() {
        let after = after(limits);
        let own: Vec<&Row> = rows.iter().filter(|row| row.after() == after).collect();
        let of = |figure: &dyn Fn(&Row) -> f64| median(own.iter().map(|row| figure(row)).collect());
        table.add(vec![
            after,
            format!("{:.2}", of(&|row| row.seconds_solve)),
            percent(of(&|row| row.error)),
            format!("{:.2}", of(&|row| row.ratio())),
            percent(of(&|row| (row.mean_ratio - 1.0).abs())),
        ]);
    }
    table.markdown()
}
