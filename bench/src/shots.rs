//! Shots per second on rooms of 1k, 10k and 100k triangles at several hemicube resolutions.
//!
//! Devices take turns within each round, so that a noisy machine disturbs all alike; the table
//! gives the median of the rounds and its ratio to the first device in the same round.

use hemilux_charts::statistics::median;
use hemilux_engine::device::{self, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::made;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

#[derive(clap::Args)]
pub struct Arguments {
    /// Devices by id, separated by commas; all by default.
    #[arg(long, value_delimiter = ',')]
    devices: Vec<String>,
    /// Triangles of the rooms.
    #[arg(long, value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000])]
    triangles: Vec<usize>,
    /// Hemicube resolutions.
    #[arg(long, value_delimiter = ',', default_values_t = [128, 256, 512])]
    resolutions: Vec<u32>,
    /// Shots of one iteration.
    #[arg(long, default_value_t = 8)]
    shots_per_iteration: u32,
    /// Rounds; the median counts.
    #[arg(long, default_value_t = 3)]
    rounds: usize,
    /// Seconds that a device shoots in a round.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// Also write the rows here as JSON.
    #[arg(long)]
    json: Option<std::path::PathBuf>,
}

#[derive(Serialize)]
struct Row {
    triangles: usize,
    patches: usize,
    resolution: u32,
    shots_per_iteration: u32,
    device: String,
    /// The device in words, with driver or instruction set.
    device_name: String,
    /// Median over the rounds.
    shots_per_second: f64,
    /// Median over the rounds of this device's rate over the first device's.
    ratio_to_first: f64,
}

pub fn run(arguments: &Arguments) -> Result<(), Box<dyn std::error::Error>> {
    let listed = device::list();
    let ids: Vec<String> = if arguments.devices.is_empty() {
        listed.iter().map(|device| device.id.clone()).collect()
    } else {
        arguments.devices.clone()
    };
    for device in listed.iter().filter(|device| ids.contains(&device.id)) {
        println!("{}: {} ({})", device.id, device.name, device.driver);
    }
    println!("triangles patches    R  K device  shots/s  ratio to {}", ids[0]);
    let mut rows = Vec::new();
    for &triangles in &arguments.triangles {
        let glb = made::tessellated_room(triangles);
        let scene = Arc::new(import(&glb, &Resources::new(), &ImportLimits::default())?);
        // One patch a triangle: the rasteriser's load, not the tessellation's.
        let patched = Arc::new(PatchedScene::new(scene.clone(), scene.triangles.len()));
        for &resolution in &arguments.resolutions {
            rows.extend(measure(arguments, &ids, &patched, resolution)?);
        }
    }
    if let Some(path) = &arguments.json {
        std::fs::write(path, serde_json::to_string_pretty(&rows)?)?;
    }
    Ok(())
}

fn measure(
    arguments: &Arguments,
    ids: &[String],
    scene: &Arc<PatchedScene>,
    resolution: u32,
) -> Result<Vec<Row>, Box<dyn std::error::Error>> {
    let settings = ShootingSettings {
        resolution,
        shots_per_iteration: arguments.shots_per_iteration,
        seed: 1,
        ..ShootingSettings::default()
    };
    let mut rates = vec![Vec::new(); ids.len()];
    let mut names = vec![String::new(); ids.len()];
    for _ in 0..arguments.rounds {
        for ((id, rates), name) in ids.iter().zip(&mut rates).zip(&mut names) {
            let mut device = device::open(id)?;
            let description = device.description();
            *name = format!("{} ({})", description.name, description.driver);
            let mut shooting = device.begin(scene.clone(), &settings)?;
            // Warm: pipelines compile, buffers are touched.
            shooting.iterate(2)?;
            shooting.drain()?;
            let begin = Instant::now();
            let mut shots = 0;
            while begin.elapsed().as_secs_f64() < arguments.seconds {
                shots += shooting.iterate(4)?.shots;
            }
            shooting.drain()?;
            rates.push(shots as f64 / begin.elapsed().as_secs_f64());
        }
    }
    let mut rows = Vec::new();
    for ((id, own), name) in ids.iter().zip(&rates).zip(names) {
        let ratios = own.iter().zip(&rates[0]).map(|(own, first)| own / first).collect();
        let row = Row {
            triangles: scene.scene.triangles.len(),
            patches: scene.patches.len(),
            resolution,
            shots_per_iteration: arguments.shots_per_iteration,
            device: id.clone(),
            device_name: name,
            shots_per_second: median(own.clone()),
            ratio_to_first: median(ratios),
        };
        println!(
            "{:9} {:7} {:4} {:2} {:6} {:8.0}  {:.3}",
            row.triangles,
            row.patches,
            row.resolution,
            row.shots_per_iteration,
            row.device,
            row.shots_per_second,
            row.ratio_to_first
        );
        rows.push(row);
    }
    Ok(rows)
}
