//! The generated parts of the page, and the table of all runs.

use super::measure::{Gain, Series};
use super::study::{Results, Study};
use crate::cell::Cell;
use crate::page::{REGION_WORDS, percent, percent_with, ratio};
use hemilux_charts::regions::REGIONS;
use hemilux_charts::statistics::{Estimate, log_slope_of, mean};
use hemilux_charts::table::Table;

/// Every cell of every study, as figures.
pub fn runs(results: &Results) -> Table {
    let mut header = vec!["study", "scene", "variant", "options", "converges", "shots"];
    header.extend(["iterations", "seeds", "seconds_solve", "light_source_selection_ratio"]);
    let regional: Vec<String> = (REGIONS.iter())
        .flat_map(|region| {
            ["rrmse", "rrmse_standard_error", "noise", "bias", "energy", "energy_standard_error"]
                .map(|figure| format!("{figure}_{region}"))
        })
        .collect();
    header.extend(regional.iter().map(String::as_str));
    let mut table = Table::new(&header);
    for study in &results.studies {
        let scene = &study.view.name;
        for (name, series) in [
            ("switches", &study.switches),
            ("slope", &study.slope),
            ("extras", &study.extras),
            ("starts", &study.starts),
            ("reductions", &study.reductions),
            ("fixed_m", &study.fixed),
            ("printed", &study.printed),
        ] {
            series.iter().for_each(|series| add_runs(&mut table, name, scene, series));
        }
    }
    if let Some((view, series)) = &results.truth {
        series.iter().for_each(|series| add_runs(&mut table, "truth", &view.name, series));
    }
    table
}

fn add_runs(table: &mut Table, study: &str, scene: &str, series: &Series) {
    let variant = &series.variant;
    let options: Vec<String> = variant.options.iter().map(|(n, v)| format!("{n}={v}")).collect();
    for cell in &series.cells {
        let mut row = vec![study.to_string(), scene.into(), variant.name.clone()];
        row.extend([options.join(" "), variant.converges.to_string(), cell.shots.to_string()]);
        row.extend([cell.iterations.to_string(), cell.seconds.len().to_string()]);
        row.extend([format!("{:.4}", cell.mean_seconds()), format!("{:.4}", cell.light_ratio())]);
        for region in 0..REGIONS.len() {
            let (error, energy) = (cell.error(region), cell.energy(region));
            let figures = [
                error.value,
                error.error,
                cell.noise(region),
                cell.bias(region),
                energy.value,
                energy.error,
            ];
            row.extend(figures.map(|figure| format!("{figure:.5}")));
        }
        table.add(row);
    }
}

/// Names and Markdown of the generated parts.
pub fn parts(results: &Results) -> Vec<(String, String)> {
    let mut parts = vec![("conditions".into(), conditions(results))];
    for study in &results.studies {
        parts.push((format!("switches {}", study.view.name), switches(study)));
    }
    parts.push(("slopes".into(), slopes(results)));
    parts.push(("light".into(), light(results)));
    parts.push(("gains".into(), gains(results)));
    parts.push(("reductions".into(), reductions(results)));
    parts.push(("fixed m".into(), fixed_m(results)));
    parts.push(("printed".into(), printed(results)));
    if results.truth.is_some() {
        parts.push(("truth".into(), truth(results)));
    }
    parts
}

fn conditions(results: &Results) -> String {
    let size = &results.size;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mode = if results.quick { " (`--quick`)" } else { "" };
    let reference_error = |study: &Study| {
        let own = study.view.smooth.own_error(&study.view.regions.masks[0]);
        format!("{} {}", study.view.name, percent(own))
    };
    let seeds: Vec<String> = (results.studies.iter())
        .map(|study| format!("{} {}", study.view.name, size.seeds_of(study.view.effort)))
        .collect();
    let references: Vec<String> = results.studies.iter().map(reference_error).collect();
    let edges: Vec<String> = (results.studies.iter())
        .map(|s| format!("{} {}", s.view.name, percent(s.view.regions.edge_share())))
        .collect();
    let loads: Vec<String> = results.loads.iter().map(|load| format!("{load:.1}")).collect();
    let mut lines = vec![
        format!("{}, {threads} hardware threads; {} jobs{mode}", results.device, results.jobs),
        format!("{:.0} seconds for everything", results.seconds),
        format!(
            "pictures of {side} × {side} pixels, {} samples each; {} patches asked for; hemicubes of \
             R = {} where nothing else is said",
            size.samples,
            size.patches,
            size.resolution,
            side = size.side
        ),
        format!("seeds: {}", seeds.join(", ")),
        format!(
            "references: two halves of {} shots; rRMSE of their mean: {}",
            size.reference_shots,
            references.join(", ")
        ),
        format!("pixels near an edge: {}", edges.join(", ")),
    ];
    if !loads.is_empty() {
        let loads = loads.join(", ");
        lines.push(format!("load average (5 minutes) after each scene: {loads}"));
    }
    lines.iter().map(|line| format!("- {line}\n")).collect()
}

fn switches(study: &Study) -> String {
    let shots: Vec<u64> = study.switches[0].cells.iter().map(|cell| cell.shots).collect();
    let last = shots.last().copied().unwrap_or(0);
    let mut header = vec!["variant".to_string()];
    header.extend(shots.iter().map(|shots| format!("{shots} shots")));
    header.push(format!("of that bias, {last}"));
    header.push(format!("energy, {last}"));
    header.push(format!("seconds, {last}"));
    header.extend(["lights selected".into(), "slope".into()]);
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for series in &study.switches {
        let mut row = vec![series.variant.name.clone()];
        row.extend(series.cells.iter().map(|cell| percent_with(cell.error(0))));
        let Some(cell) = series.cells.last() else { continue };
        row.push(percent(cell.bias(0)));
        row.push(format!("{:.3}", cell.energy(0).value));
        row.push(format!("{:.2}", cell.mean_seconds()));
        row.push(percent(cell.light_ratio()));
        row.push(if series.variant.converges { ratio(series.slope(0)) } else { String::new() });
        table.add(row);
    }
    table.markdown()
}

fn slopes(results: &Results) -> String {
    let mut header = vec!["scene".to_string(), "region".into()];
    header.extend(results.size.shots.iter().map(|shots| format!("{shots} shots")));
    header.extend(["slope of plain".into(), "mean slope of all switches".into()]);
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for study in &results.studies {
        for (region, words) in REGION_WORDS.iter().enumerate() {
            let cells: Vec<&Cell> = study.slope.iter().flat_map(|series| &series.cells).collect();
            let points: Vec<(f64, Estimate)> =
                cells.iter().map(|cell| (cell.shots as f64, cell.error(region))).collect();
            let converging = study.switches.iter().filter(|series| series.variant.converges);
            let others: Vec<f64> = converging.map(|series| series.slope(region).value).collect();
            let mut row = vec![study.view.name.clone(), (*words).into()];
            row.extend(points.iter().map(|(_, error)| percent_with(*error)));
            row.extend([ratio(log_slope_of(&points)), format!("{:.2}", mean(&others))]);
            table.add(row);
        }
    }
    table.markdown()
}

/// A figure of every series: a row a variant, a column a scene.
fn by_scene(
    results: &Results,
    series: impl Fn(&Study) -> &Vec<Series>,
    figure: impl Fn(&Series) -> String,
) -> String {
    let mut header = vec!["variant"];
    header.extend(results.studies.iter().map(|study| study.view.name.as_str()));
    let mut table = Table::new(&header);
    let Some(first) = results.studies.first() else { return String::new() };
    for (at, variant) in series(first).iter().map(|series| &series.variant).enumerate() {
        let mut row = vec![variant.name.clone()];
        row.extend(results.studies.iter().map(|study| figure(&series(study)[at])));
        table.add(row);
    }
    table.markdown()
}

fn light(results: &Results) -> String {
    by_scene(results, |study| &study.extras, |series| percent(series.cells[0].light_ratio()))
}

fn gains(results: &Results) -> String {
    let mut table = Table::new(&[
        "scene",
        "variant",
        "rRMSE",
        "elsewhere",
        "time",
        "error²",
        "time × error²",
        "time × error², elsewhere",
    ]);
    for study in &results.studies {
        let base = [&study.extras[0].cells[0], &study.starts[0].cells[0]];
        for (series, start) in study.extras.iter().zip(&study.starts) {
            let cell = &series.cells[0];
            let gain = Gain::new([cell, base[0]], [&start.cells[0], base[1]]);
            let mut row = vec![study.view.name.clone(), series.variant.name.clone()];
            row.extend([percent_with(cell.error(0)), percent_with(cell.error(2))]);
            row.extend([gain.seconds, gain.squares, gain.cost[0], gain.cost[2]].map(ratio));
            table.add(row);
        }
    }
    table.markdown()
}

fn reduction_row(scene: &str, name: &str, cell: &Cell) -> Vec<String> {
    let mut row = vec![scene.to_string(), cell.shots.to_string(), name.into()];
    row.extend((0..REGIONS.len()).map(|region| percent_with(cell.error(region))));
    row.extend((0..REGIONS.len()).map(|region| format!("{:.3}", cell.energy(region).value)));
    row
}

fn reductions(results: &Results) -> String {
    let mut table = Table::new(&[
        "scene",
        "shots = M",
        "rule",
        "rRMSE",
        "near edges",
        "elsewhere",
        "energy",
        "near edges",
        "elsewhere",
    ]);
    for study in &results.studies {
        for at in 0..study.reductions[0].cells.len() {
            for series in &study.reductions {
                let name = &series.variant.name;
                table.add(reduction_row(&study.view.name, name, &series.cells[at]));
            }
        }
    }
    table.markdown()
}

fn fixed_m(results: &Results) -> String {
    by_scene(
        results,
        |study| &study.fixed,
        |series| {
            let cell = &series.cells[0];
            format!("{}, {:.3}", percent_with(cell.error(0)), cell.energy(0).value)
        },
    )
}

fn printed(results: &Results) -> String {
    let mut table = Table::new(&[
        "scene",
        "variant",
        "iterations",
        "rRMSE",
        "noise",
        "bias",
        "energy",
        "lights selected",
        "seconds",
    ]);
    for study in &results.studies {
        for series in &study.printed {
            for cell in &series.cells {
                table.add(vec![
                    study.view.name.clone(),
                    series.variant.name.clone(),
                    cell.iterations.to_string(),
                    percent_with(cell.error(0)),
                    percent(cell.noise(0)),
                    percent(cell.bias(0)),
                    format!("{:.3}", cell.energy(0).value),
                    percent(cell.light_ratio()),
                    format!("{:.1}", cell.mean_seconds()),
                ]);
            }
        }
    }
    table.markdown()
}

fn truth(results: &Results) -> String {
    let Some((_, series)) = &results.truth else { return String::new() };
    let shots: Vec<u64> = series[0].cells.iter().map(|cell| cell.shots).collect();
    let mut header = vec!["variant".to_string()];
    header.extend(shots.iter().map(|shots| format!("{shots} shots")));
    header.extend(["near edges".into(), "elsewhere".into(), "energy".into(), "seconds".into()]);
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for series in series {
        let mut row = vec![series.variant.name.clone()];
        row.extend(series.cells.iter().map(|cell| percent(cell.error(0).value)));
        let Some(cell) = series.cells.last() else { continue };
        row.extend([percent(cell.error(1).value), percent(cell.error(2).value)]);
        row.extend([format!("{:.3}", cell.energy(0).value), format!("{:.2}", cell.mean_seconds())]);
        table.add(row);
    }
    table.markdown()
}
