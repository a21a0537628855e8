//! Benchmarks. `shots` measures whole iterations a second on every device side by side; `paper`
//! measures the claims of the paper that the method comes from.
//!
//! Errors, statistics, tables, charts and contact sheets are those of [`hemilux_charts`].

mod paper;
mod shots;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(about = "Speed of Hemilux, measured side by side in one run")]
struct Arguments {
    #[command(subcommand)]
    benchmark: Benchmark,
}

#[derive(Subcommand)]
enum Benchmark {
    /// Shots per second: triangles × hemicube resolution × device.
    Shots(shots::Arguments),
    /// Claims of the hemicube shooting paper: error and time of every switch, with page and charts.
    Paper(paper::Arguments),
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    match Arguments::parse().benchmark {
        Benchmark::Shots(arguments) => shots::run(&arguments),
        Benchmark::Paper(arguments) => paper::run(&arguments),
    }
}
