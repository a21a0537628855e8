//! Benchmarks. `shots` measures whole iterations a second on every device side by side; `paper`
//! measures the claims of the paper that the method comes from; `pixels` measures ways to sample
//! the pixels of a ray-traced picture.
//!
//! What benchmarks share: [`views`] (scenes), [`accuracy`], [`regions`] and [`cell`] (errors, over
//! which pixels, over which seeds), [`statistics`], [`table`], [`chart`], [`sheet`] and [`page`]
//! (CSV and Markdown, SVG, PNG, pages with generated parts).

mod accuracy;
mod cell;
mod chart;
mod page;
mod paper;
mod pixels;
mod regions;
mod sheet;
mod shots;
mod statistics;
mod table;
mod views;

use clap::{Parser, Subcommand};

/// Why a benchmark could not be done.
type Failure = Box<dyn std::error::Error>;

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
    /// Error against rays for every way to sample a pixel, with page and charts.
    Pixels(pixels::Arguments),
}

fn main() -> Result<(), Failure> {
    match Arguments::parse().benchmark {
        Benchmark::Shots(arguments) => shots::run(&arguments),
        Benchmark::Paper(arguments) => paper::run(&arguments),
        Benchmark::Pixels(arguments) => pixels::run(&arguments),
    }
}
