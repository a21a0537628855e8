//! What a comparison says: a table of all runs, a chart, a contact sheet, a page of tables.

use super::difference;
use super::{Cell, MeasuredMethod, Outcome, Run, spread};
use crate::chart::{Chart, Line, Panel};
use crate::sheet::{self, Row};
use crate::table::Table;
use hemilux_engine::image::{Exposure, Picture};
use hemilux_engine::render::StopReason;
use std::collections::BTreeMap;

/// Width and height of a panel of the chart, pixels.
const PANEL: (u32, u32) = (520, 420);
/// Pictures of the contact sheet are made smaller, or are shown larger, to be about this wide.
const WIDEST: u32 = 260;
/// Pictures in a row of the contact sheet.
const COLUMNS: usize = 4;
/// Width of the scale of differences, pixels.
const KEY_WIDTH: u32 = 24;

/// A file of a report: its name and content.
pub type File = (&'static str, Vec<u8>);

/// All files: `comparison.csv`, `comparison.md`, `chart.svg`, `chart.png` and `sheet.png`.
///
/// # Errors
/// Where drawing or encoding fails, in words.
pub fn files(outcome: &Outcome) -> Result<Vec<File>, String> {
    let chart = chart(outcome);
    Ok(vec![
        ("comparison.csv", runs(outcome).csv().into_bytes()),
        ("comparison.md", page(outcome).into_bytes()),
        ("chart.svg", chart.svg()?.into_bytes()),
        ("chart.png", chart.png(2)?),
        ("sheet.png", sheet(outcome)?),
    ])
}

/// Contestants that have something to show.
fn shown(outcome: &Outcome) -> impl Iterator<Item = (&MeasuredMethod, &Cell)> {
    outcome.contestants.iter().filter_map(|c| Some((c, c.cells.last()?)))
}

/// Every run, as figures.
pub fn runs(outcome: &Outcome) -> Table {
    let mut table = Table::new(&[
        "scene",
        "method",
        "options",
        "budget_seconds",
        "seed",
        "seconds_solve",
        "rrmse",
        "squared_error",
        "median_relative_error",
        "predicted_error",
        "mean_ratio",
        "iterations",
        "shots",
        "light_source_selection_ratio",
        "patches",
        "stopped",
        "repeated",
        "diagnostics",
        "refused",
    ]);
    for contestant in &outcome.contestants {
        let mut start = vec![outcome.task.view.name.clone(), contestant.contender.method.clone()];
        start.push(pairs(&contestant.contender.options));
        for (cell, run) in contestant.cells.iter().flat_map(|c| c.runs.iter().map(move |r| (c, r)))
        {
            let mut row = start.clone();
            row.extend([cell.budget.to_string(), run.seed.to_string()]);
            row.push(format!("{:.4}", run.seconds));
            row.extend([run.error(), run.squared_error, run.median_error].map(scientific));
            row.push(run.predicted_error.map(scientific).unwrap_or_default());
            row.push(format!("{:.5}", run.mean_ratio));
            row.extend([run.iterations, run.shots].map(|count| count.to_string()));
            row.push(format!("{:.5}", run.light_ratio));
            row.extend([run.patches.to_string(), stop_word(run.stopped).into()]);
            row.extend([run.repeated.to_string(), pairs(&run.diagnostics), String::new()]);
            table.add(row);
        }
        if let Some(reason) = &contestant.refusal {
            let mut row = start;
            row.resize(18, String::new());
            row.push(reason.clone());
            table.add(row);
        }
    }
    table
}

fn pairs<T: std::fmt::Display>(values: &BTreeMap<String, T>) -> String {
    values.iter().map(|(name, value)| format!("{name}={value}")).collect::<Vec<_>>().join(" ")
}

fn scientific(value: f64) -> String {
    format!("{value:.4e}")
}

fn stop_word(reason: StopReason) -> &'static str {
    match reason {
        StopReason::TimeBudget => "time budget",
        StopReason::ServerLimit => "longest time allowed",
        StopReason::Iterations => "iterations",
        StopReason::TargetError => "target error",
        StopReason::Cancelled => "cancelled",
        StopReason::Converged => "converged",
        StopReason::NoLight => "no light",
    }
}

/// Error against seconds, each method a line (median over the seeds) in its spread.
pub fn chart(outcome: &Outcome) -> Chart {
    let line = |contestant: &MeasuredMethod, figure: &dyn Fn(&Run) -> f64| {
        let mut line = Line { name: contestant.contender.method.clone(), ..Line::default() };
        for cell in &contestant.cells {
            // A run that solved nothing yet has no place on the way of the error.
            let solved: Vec<&Run> = cell.runs.iter().filter(|run| run.has_solution()).collect();
            if solved.is_empty() {
                continue;
            }
            let seconds = spread(&solved, &|run| run.seconds).0;
            let (middle, low, high) = spread(&solved, figure);
            line.points.push((seconds, middle));
            line.band.push((seconds, low, high));
        }
        line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        line.band.sort_by(|a, b| a.0.total_cmp(&b.0));
        line
    };
    let panel = |title: &str, figure: &dyn Fn(&Run) -> f64| Panel {
        title: format!("{}: {title}", outcome.task.view.name),
        x_label: "seconds of solving".into(),
        y_label: title.into(),
        lines: outcome
            .contestants
            .iter()
            .filter(|contestant| !contestant.cells.is_empty())
            .map(|contestant| line(contestant, figure))
            .collect(),
        y_percent: true,
        empty: "no method has a picture".into(),
        ..Panel::default()
    };
    let panels =
        vec![panel("rRMSE", &Run::error), panel("median relative error", &|run| run.median_error)];
    Chart { panels, columns: 2, panel_size: PANEL, legend: true }
}

/// The pictures within the largest budget, and under each how it differs from the reference.
///
/// # Errors
/// Where the encoder fails, in words.
pub fn sheet(outcome: &Outcome) -> Result<Vec<u8>, String> {
    let (width, height) = outcome.task.view.size;
    let shrink = width.max(height).div_ceil(WIDEST);
    let enlarge = (WIDEST / width.max(height).max(1)).clamp(1, 8);
    let reference = outcome.truth.reference.picture();
    let entries: Vec<(&MeasuredMethod, &Cell)> = shown(outcome).collect();
    let differences: Vec<Vec<f32>> = entries
        .iter()
        .map(|(_, cell)| difference::relative(&cell.picture, &reference, &outcome.truth.counted))
        .collect();
    let scale = difference::scale(&differences);
    let small = |picture: &Picture| sheet::shrunk(picture, shrink);
    let percent = (100.0 * scale).round();

    let mut pictures = vec![("reference".to_string(), small(&reference))];
    let key_height = small(&reference).height;
    let key = difference::key(KEY_WIDTH.div_ceil(enlarge), key_height);
    let legend = format!("+{percent} % (red, brighter)\n-{percent} % (blue, darker)");
    let mut below = vec![(legend, key)];
    for ((contestant, cell), differences) in entries.iter().zip(&differences) {
        let first = cell.runs.first();
        let name = format!(
            "{}\n{} s, rRMSE {}",
            contestant.contender.method,
            first.map_or_else(String::new, |run| format!("{:.2}", run.seconds)),
            first.map_or_else(String::new, |run| percent_of(run.error())),
        );
        pictures.push((name, small(&cell.picture)));
        let ratio = first.map_or(f64::NAN, |run| run.mean_ratio);
        let label = format!("difference\nmean x {ratio:.3}");
        below.push((label, small(&difference::picture(differences, width, height, scale))));
    }
    let budget = outcome.task.budgets.last().copied().unwrap_or(0.0);
    let exposure = reference.exposure_factor(Exposure::Auto);
    let mut rows = Vec::new();
    for (above, below) in pictures.chunks(COLUMNS).zip(below.chunks(COLUMNS)) {
        let first = rows.is_empty();
        let title = format!("{}, {budget} s for each method, seed 1", outcome.task.view.name);
        rows.push(Row {
            title: if first { title } else { String::new() },
            exposure,
            cells: above.to_vec(),
        });
        let title = "(picture - reference) / reference, luminance; grey: sees a light".to_string();
        rows.push(Row {
            title: if first { title } else { String::new() },
            exposure: 1.0,
            cells: below.to_vec(),
        });
    }
    sheet::png(&rows, enlarge).map_err(|error| error.to_string())
}

/// 12.3 %; two digits after the point below one percent.
fn percent_of(value: f64) -> String {
    let percent = 100.0 * value;
    match percent.abs() {
        _ if value.is_nan() => "–".into(),
        small if small < 1.0 => format!("{percent:.2} %"),
        _ => format!("{percent:.1} %"),
    }
}

/// The page: conditions, tables, remarks.
pub fn page(outcome: &Outcome) -> String {
    let mut parts = vec![
        format!("# {}: methods side by side\n", outcome.task.view.name),
        conditions(outcome),
        "![Error against time](chart.svg)\n".into(),
        "## Within the largest budget\n".into(),
        largest(outcome),
        "## rRMSE by budget\n".into(),
        by_budget(outcome),
    ];
    let diagnostics = diagnostics(outcome);
    if !diagnostics.is_empty() {
        parts.extend(["## Figures of the methods' own\n".into(), diagnostics]);
    }
    let remarks = remarks(outcome);
    if !remarks.is_empty() {
        parts.extend(["## Remarks\n".into(), remarks]);
    }
    parts.push("![Pictures and differences](sheet.png)\n".into());
    parts.join("\n")
}

/// How it was measured, as a list.
pub fn conditions(outcome: &Outcome) -> String {
    let task = &outcome.task;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let (counted, all) = outcome.truth.counted_pixels();
    let left_out = 100.0 * (all - counted) as f64 / all.max(1) as f64;
    let budgets: Vec<String> = task.budgets.iter().map(f64::to_string).collect();
    let mut lines = vec![
        format!(
            "{}: {} triangles, {} × {} pixels",
            task.view.name,
            task.view.scene.triangle_count(),
            task.view.size.0,
            task.view.size.1
        ),
        format!("{}, {threads} hardware threads", outcome.device),
        format!(
            "budgets of {} s, seeds 1 to {}; methods take turns within each; {:.0} s for all runs",
            budgets.join(", "),
            task.seeds,
            outcome.seconds
        ),
        format!("reference: {}", outcome.truth.words),
        format!("pixels that see a light are left out ({left_out:.1} %)"),
    ];
    for contestant in &outcome.contestants {
        let options = pairs(&contestant.contender.options);
        if !options.is_empty() {
            lines.push(format!("{} with {options}", contestant.contender.method));
        }
    }
    if outcome.interrupted {
        lines.push("ended early: not all runs were done".into());
    }
    lines.iter().map(|line| format!("- {line}\n")).collect()
}

/// The methods within the largest budget that each has.
pub fn largest(outcome: &Outcome) -> String {
    let mut table = Table::new(&[
        "method",
        "seconds",
        "rRMSE",
        "smallest to largest",
        "same for every seed",
        "median relative error",
        "predicted error",
        "mean ratio",
        "shots or rays",
        "lights selected",
        "patches",
        "stopped by",
    ]);
    for (contestant, cell) in shown(outcome) {
        let (error, low, high) = cell.spread(Run::error);
        let predicted = cell.median(|run| run.predicted_error.unwrap_or(f64::NAN));
        let last = &cell.runs[cell.runs.len() - 1];
        let patches = if last.patches == 0 { "–".into() } else { last.patches.to_string() };
        let lights = cell.median(|run| run.light_ratio);
        table.add(vec![
            contestant.contender.method.clone(),
            format!("{:.2}", cell.median(|run| run.seconds)),
            percent_of(error),
            format!("{} to {}", percent_of(low), percent_of(high)),
            if cell.bias < 0.0 { "none found".into() } else { percent_of(cell.bias) },
            percent_of(cell.median(|run| run.median_error)),
            percent_of(predicted),
            format!("{:.3}", cell.median(|run| run.mean_ratio)),
            format!("{:.0}", cell.median(|run| run.shots as f64)),
            // Rays leave the camera, nobody selects.
            if patches == "–" { "–".into() } else { percent_of(lights) },
            patches,
            stop_word(last.stopped).into(),
        ]);
    }
    table.markdown()
}

/// Median rRMSE of every method within every budget.
pub fn by_budget(outcome: &Outcome) -> String {
    let mut header = vec!["method".to_string()];
    header.extend(outcome.task.budgets.iter().map(|budget| format!("{budget} s")));
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for contestant in outcome.contestants.iter().filter(|c| !c.cells.is_empty()) {
        let mut row = vec![contestant.contender.method.clone()];
        row.extend(outcome.task.budgets.iter().map(|budget| {
            let cell = contestant.cells.iter().find(|cell| cell.budget == *budget);
            cell.map_or_else(|| "–".into(), |cell| percent_of(cell.median(Run::error)))
        }));
        table.add(row);
    }
    table.markdown()
}

/// Figures of the methods' own, such as the closure of form factors; empty where there are none.
pub fn diagnostics(outcome: &Outcome) -> String {
    let mut table = Table::new(&["method", "figure", "value"]);
    let mut any = false;
    for (contestant, cell) in shown(outcome) {
        let last = &cell.runs[cell.runs.len() - 1];
        for (name, value) in &last.diagnostics {
            let value = match value.abs() {
                huge if huge >= 1e4 => format!("{value:.3e}"),
                _ => format!("{value:.5}"),
            };
            table.add(vec![contestant.contender.method.clone(), name.replace('_', " "), value]);
            any = true;
        }
    }
    if any { table.markdown() } else { String::new() }
}

/// Methods that were left out, and what pictures don't show as authored; empty where there is
/// nothing to say.
pub fn remarks(outcome: &Outcome) -> String {
    let mut text = String::new();
    for MeasuredMethod { contender, refusal, warnings, cells, .. } in &outcome.contestants {
        let method = &contender.method;
        if let Some(reason) = refusal {
            let when = if cells.is_empty() { "left out" } else { "gave up on the way" };
            text += &format!("- **{method}** {when}: {reason}\n");
        }
        for warning in warnings {
            text += &format!("- {method}: {warning}\n");
        }
        let unfinished = |cell: &Cell| {
            let (all, open) = (cell.runs.len(), cell.unfinished());
            (open > 0).then(|| match open < all {
                true => format!("{} s ({open} of {all} seeds)", cell.budget),
                false => format!("{} s", cell.budget),
            })
        };
        let cut: Vec<String> = cells.iter().filter_map(unfinished).collect();
        if !cut.is_empty() {
            text += &format!(
                "- {method}: nothing solved yet within {}: the picture shows only what emits, and \
                 is not in the chart\n",
                cut.join(", ")
            );
        }
    }
    text
}
