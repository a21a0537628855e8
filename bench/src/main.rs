//! Benchmarks. `shots` measures whole iterations a second on every device side by side; `paper`
//! measures the claims of the paper that the method comes from; `methods` compares all methods,
//! `form-factors` the routes to a form factor, `growth` what more patches cost, `crowds` what more
//! triangles do; `pixels` measures
//! ways to sample the pixels of a ray-traced picture, `views` what a solved scene saves its next
//! picture, `limits` how far the processor device is from what the machine can do; `real-light`
//! judges scenes with real light on real materials, `rooms` predictions in rooms made by chance, and `export` writes them out for others.
//!
//! Errors, statistics, tables, charts and contact sheets are those of [`hemilux_charts`]; what
//! benchmarks share beyond that: [`views`] (scenes), [`cell`] (errors over seeds), [`page`] (how
//! figures are written) and [`results`] (where they go).

#![cfg_attr(not(test), warn(clippy::too_many_lines))]

mod cell;
mod crowds;
mod export;
mod form_factors;
mod growth;
mod limits;
mod load;
mod methods;
mod page;
mod paper;
mod pixels;
mod real_light;
mod real_view;
mod results;
mod rooms;
mod second_views;
mod shots;
mod tiers;
mod views;

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
    /// Seconds and memory of the first picture against the number of triangles.
    Crowds(crowds::Arguments),
    /// One point of `crowds`, in a process of its own.
    #[command(hide = true)]
    CrowdsPoint(crowds::PointArguments),
    /// A second camera of a solved scene against one by itself, and what checkpoints take.
    Views(second_views::Arguments),
    /// The service under load: streams, posts against a full queue, memory, end.
    Load(load::Arguments),
    /// Rays, pixels and triangles a second beside the machine's memory and arithmetic.
    Limits(limits::Arguments),
    /// Error against rays for every way to sample a pixel, with page and charts.
    Pixels(pixels::Arguments),
    /// How good the three-tier method is and why: ablation, calibration, growth, planning.
    Tiers(tiers::Arguments),
    /// Scenes with skies, mirrors, glass, leaves and screens against path tracing, with pictures.
    RealLight(real_light::Arguments),
    /// Predicted against actual error in furnished rooms made by chance.
    Rooms(rooms::Arguments),
    /// One of these scenes with its sky and sun, as files for other renderers.
    Export(export::Arguments),
}

fn main() -> Result<(), results::Failure> {
    match Arguments::parse().benchmark {
        Benchmark::Shots(arguments) => shots::run(&arguments),
        Benchmark::Paper(arguments) => paper::run(&arguments),
        Benchmark::Methods(arguments) => methods::run(&arguments),
        Benchmark::FormFactors(arguments) => form_factors::run(&arguments),
        Benchmark::Growth(arguments) => growth::run(&arguments),
        Benchmark::GrowthPoint(arguments) => growth::point(&arguments),
        Benchmark::Crowds(arguments) => crowds::run(&arguments),
        Benchmark::CrowdsPoint(arguments) => crowds::point(&arguments),
        Benchmark::Views(arguments) => second_views::run(&arguments),
        Benchmark::Load(arguments) => load::run(&arguments),
        Benchmark::Limits(arguments) => limits::run(&arguments),
        Benchmark::Pixels(arguments) => pixels::run(&arguments),
        Benchmark::Tiers(arguments) => tiers::run(&arguments),
        Benchmark::RealLight(arguments) => real_light::run(&arguments),
        Benchmark::Rooms(arguments) => rooms::run(&arguments),
        Benchmark::Export(arguments) => export::run(&arguments),
    }
}
