//! Benchmarks. `shots` measures whole iterations a second on every device side by side.

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
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    match Arguments::parse().benchmark {
        Benchmark::Shots(arguments) => shots::run(&arguments),
    }
}
