//! `crowds`: seconds and bytes to the first picture of rooms of ten thousand to millions of
//! triangles. Each point runs in a process of its own, so that the system counts its peak of
//! resident memory.

use crate::results::{self, Failure};
use crate::views::imported;
use hemilux_charts::statistics::log_slope;
use hemilux_charts::table::Table;
use hemilux_engine::device;
use hemilux_engine::render::{Limits, RenderRequest, Unobserved};
use hemilux_engine::scene::made;
use hemilux_engine::transport::render;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Width and height of pictures, pixels.
const SIDE: u32 = 256;
/// Error that the first picture may have.
const GOAL: f64 = 0.05;

#[derive(clap::Args)]
pub struct Arguments {
    /// Triangles.
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 100_000, 1_000_000, 3_900_000])]
    triangles: Vec<usize>,
    /// Page whose generated part is rewritten.
    #[arg(long)]
    page: Option<PathBuf>,
}

/// One point, for the process that measures it.
#[derive(clap::Args)]
pub struct PointArguments {
    #[arg(long)]
    triangles: usize,
    /// Whether no two triangles share a vertex.
    #[arg(long)]
    soup: bool,
}

/// What a process found.
#[derive(Serialize, Deserialize)]
struct Point {
    triangles: usize,
    seconds: f64,
    predicted: f64,
    /// Bytes that the job added at its peak; `None` where the system does not tell.
    added: Option<u64>,
}

/// Measures one point in this process and prints it.
pub fn point(arguments: &PointArguments) -> Result<(), Failure> {
    let mut scene = imported(&made::tessellated_room(arguments.triangles));
    if arguments.soup {
        let corners = scene.triangles.iter().flat_map(|triangle| triangle.vertices);
        scene.vertices = corners.map(|vertex| scene.vertices[vertex as usize]).collect();
        for (triangle, first) in scene.triangles.iter_mut().zip((0u32..).step_by(3)) {
            triangle.vertices = [first, first + 1, first + 2];
        }
    }
    let triangles = scene.triangles.len();
    let request = RenderRequest {
        limits: Limits { target_error: Some(GOAL), ..Limits::default() },
        ..RenderRequest::new(scene.into(), "hemilux", [SIDE; 2])
    };
    let mut device = device::open("cpu")?;
    // The peak until now is that of the import.
    let counts = std::fs::write("/proc/self/clear_refs", "5").is_ok();
    let before = results::status_bytes("VmRSS");
    let stats = render(device.as_mut(), &request, &mut Unobserved)?.stats;
    let peak = results::status_bytes("VmHWM").filter(|_| counts);
    let point = Point {
        triangles,
        seconds: stats.seconds_solve,
        predicted: stats.figures.estimated_error.unwrap_or(f64::NAN),
        added: peak.zip(before).map(|(peak, before)| peak.saturating_sub(before)),
    };
    println!("{}", serde_json::to_string(&point)?);
    Ok(())
}

fn measured(triangles: usize, soup: bool) -> Result<Point, Failure> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["crowds-point", "--triangles", &triangles.to_string()]);
    if soup {
        command.arg("--soup");
    }
    let output = command.stdin(Stdio::null()).output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned().into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut table = Table::new(&[
        "triangles",
        "vertices",
        "seconds to the first picture",
        "its predicted error",
        "bytes added",
        "of it a triangle more",
    ]);
    let mut text = results::machine();
    for (soup, vertices) in [(false, "shared"), (true, "three each")] {
        let mut points: Vec<Point> = Vec::new();
        for triangles in &arguments.triangles {
            eprintln!("{triangles} triangles, vertices {vertices}");
            let point = measured(*triangles, soup)?;
            let bytes =
                |bytes: Option<f64>| bytes.map_or("–".into(), |bytes| format!("{bytes:.0}"));
            let more = points.last().and_then(|last| {
                let added = point.added? as f64 - last.added? as f64;
                Some(added / (point.triangles as f64 - last.triangles as f64))
            });
            table.add(vec![
                point.triangles.to_string(),
                vertices.into(),
                format!("{:.2}", point.seconds),
                crate::page::percent(point.predicted),
                bytes(point.added.map(|added| added as f64)),
                bytes(more),
            ]);
            points.push(point);
        }
        let all: Vec<(f64, f64)> =
            points.iter().map(|point| (point.triangles as f64, point.seconds)).collect();
        text += &format!("- vertices {vertices}: slope {:.2} of the seconds\n", log_slope(&all));
    }
    let text = format!("{text}\n{}", table.markdown());
    results::publish(arguments.page.as_deref(), &[("crowds".into(), text)])
}
