//! Charts and contact sheets of the measurements.

use super::measure::Series;
use super::study::{Results, Study};
use super::variants;
use crate::cell::Cell;
use crate::results::Failure;
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::sheet::{Row, Window, png};
use hemilux_engine::image::{Exposure, Picture};
use hemilux_engine::radiometry::Rgb;

/// Side of a crop as a share of the picture's.
const CROP: f64 = 0.26;

/// File names and contents of all charts.
pub fn charts(results: &Results) -> Result<Vec<(String, String)>, Failure> {
    let mut files = Vec::new();
    for group in variants::switches() {
        let names: Vec<String> = std::iter::once(variants::plain().name)
            .chain(group.variants.into_iter().map(|variant| variant.name))
            .collect();
        let chosen = |study: &Study| -> Vec<Line> {
            let series = study.switches.iter();
            series.filter(|s| names.contains(&s.variant.name)).map(|s| by_shots(s, 0)).collect()
        };
        let timed = |study: &Study| -> Vec<Line> {
            let series = study.switches.iter();
            series.filter(|s| names.contains(&s.variant.name)).map(by_seconds).collect()
        };
        let mut panels: Vec<Panel> = (results.studies.iter())
            .map(|study| shots_panel(&study.view.name, "rRMSE", chosen(study), results.size.shots))
            .collect();
        panels.extend(
            results.studies.iter().map(|study| seconds_panel(&study.view.name, timed(study))),
        );
        let columns = results.studies.len();
        files.push((format!("noise-{}.svg", group.name), Chart::new(panels, columns).svg()?));
    }

    let mut panels = Vec::new();
    for (region, words) in [(1, "rRMSE near edges"), (2, "rRMSE elsewhere")] {
        for study in &results.studies {
            let lines = study.reductions.iter().map(|s| by_shots(s, region)).collect();
            let name = &study.view.name;
            panels.push(shots_panel(name, words, lines, results.size.reduction_shots));
        }
    }
    files.push(("reduction.svg".into(), Chart::new(panels, results.studies.len()).svg()?));

    if let Some((view, series)) = &results.truth {
        let lines = series.iter().map(|s| by_shots(s, 0)).collect();
        let shots = shots_panel(&view.name, "true rRMSE", lines, results.size.true_shots);
        let mut seconds = seconds_panel(&view.name, series.iter().map(by_seconds).collect());
        seconds.y_label = "true rRMSE".into();
        files.push(("truth.svg".into(), Chart::new(vec![shots, seconds], 2).svg()?));
    }
    Ok(files)
}

fn by_shots(series: &Series, region: usize) -> Line {
    let point = |cell: &Cell| (cell.shots as f64, cell.error(region).value);
    Line {
        name: series.variant.name.clone(),
        points: series.cells.iter().map(point).collect(),
        ..Line::default()
    }
}

fn by_seconds(series: &Series) -> Line {
    let point = |cell: &Cell| (cell.mean_seconds(), cell.error(0).value);
    Line {
        name: series.variant.name.clone(),
        points: series.cells.iter().map(point).collect(),
        ..Line::default()
    }
}

fn shots_panel(title: &str, y_label: &str, lines: Vec<Line>, ticks: &[u64]) -> Panel {
    Panel {
        title: title.into(),
        x_label: "shots (dashed: slope -1/2)".into(),
        y_label: y_label.into(),
        lines,
        guide_slopes: vec![-0.5],
        x_ticks: ticks.iter().map(|shots| *shots as f64).collect(),
        ..Panel::default()
    }
}

fn seconds_panel(title: &str, lines: Vec<Line>) -> Panel {
    Panel {
        title: title.into(),
        x_label: "seconds".into(),
        y_label: "rRMSE".into(),
        lines,
        ..Panel::default()
    }
}

/// File names and contents of all contact sheets.
pub fn sheets(results: &Results) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let mut corners = Vec::new();
    let mut constant = Vec::new();
    let mut regions = Vec::new();
    for study in &results.studies {
        corners.extend(corner_rows(study));
        constant.push(constant_row(study));
        regions.push(regions_cell(study));
    }
    let regions = Row { title: "near edges: red".into(), exposure: 1.0, cells: regions };
    Ok(vec![
        ("corners.png".into(), png(&corners, 2)?),
        ("constant.png".into(), png(&constant, 1)?),
        ("regions.png".into(), png(&[regions], 1)?),
    ])
}

/// The converged picture, with red where a pixel is near an edge and black at emitters.
fn regions_cell(study: &Study) -> (String, Picture) {
    let mut picture = study.view.smooth.picture();
    let factor = picture.exposure_factor(Exposure::Auto);
    let [counted, near_edge, _] = &study.view.regions.masks;
    for ((pixel, counted), near_edge) in picture.pixels.iter_mut().zip(counted).zip(near_edge) {
        *pixel *= factor * f32::from(u8::from(*counted));
        if *near_edge {
            *pixel = pixel.lerp(Rgb::new(0.8, 0.0, 0.0), 0.6);
        }
    }
    (study.view.name.clone(), picture)
}

/// Crops where the bare method is worst: a row for each rule, converged and after each length.
fn corner_rows(study: &Study) -> impl Iterator<Item = Row> {
    let view = &study.view;
    let reference = view.flat.picture();
    let bare = &study.reductions[0];
    let middle = &bare.cells[bare.cells.len() / 2];
    let window = worst_window(&middle.picture, &reference, view);
    let exposure = reference.exposure_factor(Exposure::Auto);
    study.reductions.iter().map(move |series| {
        let converged = ("converged".to_string(), window.crop(&reference));
        let lengths = series.cells.iter();
        let crops =
            lengths.map(|cell| (format!("{} shots", cell.shots), window.crop(&cell.picture)));
        let title = format!("{}: {}", view.name, series.variant.name);
        Row { title, exposure, cells: std::iter::once(converged).chain(crops).collect() }
    })
}

fn worst_window(picture: &Picture, reference: &Picture, view: &super::View) -> Window {
    let pairs = picture.pixels.iter().zip(&reference.pixels).zip(&view.regions.masks[0]);
    let weights: Vec<f64> = pairs
        .map(|((x, exact), counted)| {
            // Square roots, so that a single pixel doesn't decide.
            if *counted { f64::from((*x - *exact).length()).sqrt() } else { 0.0 }
        })
        .collect();
    let side = (CROP * f64::from(view.side)).round() as u32;
    Window::heaviest(&weights, view.side, view.side, side)
}

/// Whole pictures after the longest run: converged, without the constant term, and with the
/// printed and the corrected one.
fn constant_row(study: &Study) -> Row {
    let reference = study.view.smooth.picture();
    let mut cells = vec![("converged".to_string(), reference.clone())];
    let mut shots = 0;
    for wanted in ["plain", "constant: printed", "constant: corrected"] {
        let found = study.switches.iter().find(|series| series.variant.name == wanted);
        if let Some(cell) = found.and_then(|series| series.cells.last()) {
            shots = cell.shots;
            cells.push((
                format!("{wanted}\n{:.2} x energy", cell.energy(0).value),
                cell.picture.clone(),
            ));
        }
    }
    let title = format!("{}, {shots} shots", study.view.name);
    Row { title, exposure: reference.exposure_factor(Exposure::Auto), cells }
}
