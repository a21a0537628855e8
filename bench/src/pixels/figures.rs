//! Table, charts and the generated parts of the page.

use super::study::{CELLS, KINDS, Results, SAMPLINGS, Series, Study};
use crate::cell::{Cell, mean_of};
use crate::page::{REGION_WORDS, percent, percent_with, ratio};
use crate::results::Failure;
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::regions::REGIONS;
use hemilux_charts::statistics::{Estimate, jackknife};
use hemilux_charts::table::Table;

/// Every run.
pub fn runs(results: &Results) -> Table {
    let mut header = vec!["scene", "samples", "sampling", "samples_per_pixel", "passes"];
    header.extend(["seeds", "rays", "seconds_solve"]);
    let regional: Vec<String> = (REGIONS.iter())
        .flat_map(|region| {
            ["rrmse", "rrmse_standard_error", "noise", "bias", "energy", "energy_standard_error"]
                .map(|figure| format!("{figure}_{region}"))
        })
        .collect();
    header.extend(regional.iter().map(String::as_str));
    let mut table = Table::new(&header);
    for study in &results.studies {
        for series in &study.series {
            for (cell, samples) in series.cells.iter().zip(results.size.samples) {
                let mut row = vec![study.scene.to_string(), KINDS[study.kind].name.into()];
                row.extend([series.sampling.name.into(), samples.to_string()]);
                row.extend([cell.iterations.to_string(), cell.seconds.len().to_string()]);
                row.extend([cell.shots.to_string(), format!("{:.4}", cell.mean_seconds())]);
                for region in 0..REGIONS.len() {
                    let (error, energy) = (cell.error(region), cell.energy(region));
                    let figures = [error.value, error.error, cell.noise(region), cell.bias(region)];
                    row.extend(figures.map(|figure| format!("{figure:.5}")));
                    row.extend([energy.value, energy.error].map(|x| format!("{x:.5}")));
                }
                table.add(row);
            }
        }
    }
    table
}

/// File names and contents of the charts: error against rays near edges and elsewhere.
pub fn charts(results: &Results) -> Result<Vec<(String, String)>, Failure> {
    let mut files = Vec::new();
    for (kind, words) in KINDS.iter().enumerate() {
        let studies = || results.studies.iter().filter(move |study| study.kind == kind);
        let mut panels = Vec::new();
        for region in [1, 2] {
            panels.extend(studies().map(|study| panel(study, region)));
        }
        files.push((format!("{}.svg", words.name), Chart::new(panels, studies().count()).svg()?));
    }
    Ok(files)
}

fn panel(study: &Study, region: usize) -> Panel {
    let line = |series: &Series| {
        let point = |cell: &Cell| (cell.shots as f64 / 1e6, cell.error(region).value);
        let points = series.cells.iter().map(point).collect();
        Line { name: series.sampling.name.into(), points, ..Line::default() }
    };
    Panel {
        title: format!("{}, {}", study.scene, REGION_WORDS[region]),
        x_label: "million rays (dashed: slope -1/2)".into(),
        y_label: "rRMSE".into(),
        lines: study.series.iter().map(line).collect(),
        guide_slopes: vec![-0.5],
        ..Panel::default()
    }
}

/// Names and Markdown of the generated parts.
pub fn parts(results: &Results) -> Vec<(String, String)> {
    let mut parts = vec![("conditions".into(), conditions(results))];
    for (kind, words) in KINDS.iter().enumerate() {
        parts.push((format!("costs {}", words.name), costs(results, kind)));
        parts.push((format!("bias {}", words.name), bias(results, kind)));
    }
    parts
}

fn conditions(results: &Results) -> String {
    let size = &results.size;
    let mode = if results.quick { " (`--quick`)" } else { "" };
    let references: Vec<String> = (results.studies.iter())
        .map(|study| {
            let kind = KINDS[study.kind].name;
            format!("{}, {kind} {}", study.scene, percent(study.reference_error))
        })
        .collect();
    let mut lines = vec![
        format!("{}; {} jobs in {:.0} s{mode}", results.device, results.jobs, results.seconds),
        format!("pictures of {side} × {side} pixels, {} seeds", size.seeds, side = size.side),
        format!("{CELLS} cells of a jittered pixel; an adaptive one has at most {CELLS} in a pass"),
        format!(
            "references: two halves of {} jittered paths or {} direct samples a pixel; rRMSE of \
             their mean: {}",
            size.reference[0],
            size.reference[1],
            references.join(", ")
        ),
    ];
    lines.extend(results.load.map(|load| format!("load average at the end: {load:.1}")));
    lines.iter().map(|line| format!("- {line}\n")).collect()
}

/// Rays that a series needs for the error of the first: rays × error² over the same of independent
/// samples, paired by seed, averaged over the lengths of runs.
fn cost(series: &Series, base: &Series, region: usize) -> Estimate {
    let seeds = series.cells[0].seconds.len();
    jackknife(seeds, |chosen| {
        let product = |cell: &Cell| cell.shots as f64 * mean_of(&cell.squared[region], chosen);
        let ratios = series.cells.iter().zip(&base.cells).map(|(a, b)| product(a) / product(b));
        ratios.sum::<f64>() / series.cells.len() as f64
    })
}

fn costs(results: &Results, kind: usize) -> String {
    let mut header = vec!["sampling".to_string()];
    let studies = || results.studies.iter().filter(move |study| study.kind == kind);
    for study in studies() {
        header.extend([1, 2].map(|region| format!("{}, {}", study.scene, REGION_WORDS[region])));
    }
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for (at, sampling) in SAMPLINGS.iter().enumerate().skip(1) {
        let mut row = vec![sampling.name.to_string()];
        for study in studies() {
            let cell = |region| ratio(cost(&study.series[at], &study.series[0], region));
            row.extend([1, 2].map(cell));
        }
        table.add(row);
    }
    table.markdown()
}

/// Error, its biased part and the light of the longest runs.
fn bias(results: &Results, kind: usize) -> String {
    let mut table = Table::new(&[
        "scene",
        "sampling",
        "million rays",
        "rRMSE",
        "of that bias",
        "bias near edges",
        "energy",
        "near edges",
    ]);
    for study in results.studies.iter().filter(|study| study.kind == kind) {
        for series in &study.series {
            let Some(cell) = series.cells.last() else { continue };
            let energy = |region| {
                let Estimate { value, error } = cell.energy(region);
                format!("{value:.4} ± {error:.4}")
            };
            table.add(vec![
                study.scene.into(),
                series.sampling.name.into(),
                format!("{:.1}", cell.shots as f64 / 1e6),
                percent_with(cell.error(0)),
                percent(cell.bias(0)),
                percent(cell.bias(1)),
                energy(0),
                energy(1),
            ]);
        }
    }
    table.markdown()
}
