//! Benchmarks. `shots` measures whole iterations a second on every device side by side; `paper`
//! measures the claims of the paper that the method comes from; `methods` compares all methods,
//! `form-factors` the routes to a form factor, `growth` what more patches cost.
//!
//! Errors, statistics, tables, charts and contact sheets are those of [`hemilux_charts`].

mod form_factors;
mod growth;
mod methods;
mod paper;
mod results;
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
    /// All methods side by side: error against time, pictures, with page and charts.
    Methods(methods::Arguments),
    /// The routes to a form factor against exact values: error against seconds.
    FormFactors(form_factors::Arguments),
    /// Seconds and memory of every method against the number of patches.
    Growth(growth::Arguments),
    /// One point of `growth`, in a process of its own.
    #[command(hide = true)]
    GrowthPoint(growth::PointArguments),
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    match Arguments::parse().benchmark {
        Benchmark::Shots(arguments) => shots::run(&arguments),
        Benchmark::Paper(arguments) => paper::run(&arguments),
        Benchmark::Methods(arguments) => methods::run(&arguments),
        Benchmark::FormFactors(arguments) => form_factors::run(&arguments),
        Benchmark::Growth(arguments) => growth::run(&arguments),
        Benchmark::GrowthPoint(arguments) => growth::point(&arguments),
    }
}
