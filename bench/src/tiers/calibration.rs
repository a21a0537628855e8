//! Predicted against actual error: after every number of iterations, on every view, over seeds;
//! and what comes of asking for an accuracy.

use super::study::Study;
use super::views::{Truth, View};
use crate::page::percent;
use crate::results::{self, Failure};
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Rendered, Unobserved};
use hemilux_engine::transport::render;

/// Iterations after which errors are compared.
const ITERATIONS: [u64; 6] = [1, 2, 4, 8, 16, 32];
const SEEDS: u64 = 2;
/// Accuracies that are asked for.
const TARGETS: [f64; 3] = [0.05, 0.02, 0.01];
/// What a prediction may be off by: predicted over actual.
pub const GOOD: std::ops::RangeInclusive<f64> = 0.7..=1.5;
/// Seconds after which a job for an accuracy gives up.
const PATIENCE: f64 = 20.0;

/// One picture's errors.
struct Point {
    view: String,
    iterations: u64,
    seed: u64,
    predicted: f64,
    actual: f64,
    /// What the reference can tell.
    resolution: f64,
    energy: f64,
    seconds: f64,
    /// Of the prediction, by cause.
    parts: Vec<f64>,
}

/// What the engine calls the causes of errors.
const CAUSES: [&str; 9] = [
    "error_noise",
    "error_bent",
    "error_shadows",
    "error_lobes",
    "error_edges",
    "error_links",
    "error_textures",
    "error_audit",
    "error_draft",
];

impl Point {
    fn new(view: &View, truth: &Truth, rendered: &Rendered, seed: u64) -> Self {
        let judged = truth.judged(rendered);
        Self {
            view: view.name.clone(),
            iterations: rendered.stats.figures.iterations,
            seed,
            predicted: rendered.stats.figures.estimated_error.unwrap_or(f64::NAN),
            actual: judged.error(),
            resolution: judged.resolution(),
            energy: truth.energy(rendered),
            seconds: rendered.stats.seconds_solve,
            parts: CAUSES
                .iter()
                .map(|cause| rendered.stats.diagnostics.get(*cause).copied().unwrap_or(f64::NAN))
                .collect(),
        }
    }

    /// Whether the reference is good enough to judge the prediction.
    fn is_resolved(&self) -> bool {
        self.actual >= self.resolution
    }

    fn ratio(&self) -> f64 {
        self.predicted / self.actual
    }
}

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let views = study.views();
    let mut points = Vec::new();
    for view in &views {
        eprintln!("calibration: {}", view.name);
        let truth = study.sparse_truth(view)?;
        for seed in 1..=SEEDS {
            for iterations in ITERATIONS {
                let limits = Limits::iterations(iterations);
                let request = view.request("hemilux", limits, seed, &[]);
                let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
                points.push(Point::new(view, &truth, &rendered, seed));
            }
        }
    }
    std::fs::write(study.out.join("calibration.csv"), csv(&points).csv())?;
    std::fs::write(study.out.join("calibration.svg"), chart(&points).svg()?)?;
    Ok(vec![
        ("calibration summary".into(), summary(&points)),
        ("calibration views".into(), by_view(&views, &points)),
    ])
}

/// What comes of asking for an accuracy.
pub fn ask(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut asked = Vec::new();
    // The first views stand for the rest.
    for view in study.views().iter().take(5) {
        let truth = study.sparse_truth(view)?;
        for target in TARGETS {
            let limits =
                Limits { target_error: Some(target), seconds: Some(PATIENCE), ..Limits::default() };
            let request = view.request("auto", limits, 1, &[]);
            let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
            asked.push((target, Point::new(view, &truth, &rendered, 1)));
        }
    }
    Ok(vec![("calibration targets".into(), targets(&asked))])
}

fn csv(points: &[Point]) -> Table {
    let mut header = vec![
        "view",
        "iterations",
        "seed",
        "predicted",
        "actual",
        "resolution",
        "mean_ratio",
        "seconds_solve",
    ];
    header.extend(CAUSES);
    let mut table = Table::new(&header);
    for point in points {
        let mut row = vec![
            point.view.clone(),
            point.iterations.to_string(),
            point.seed.to_string(),
            format!("{:.5}", point.predicted),
            format!("{:.5}", point.actual),
            format!("{:.5}", point.resolution),
            format!("{:.4}", point.energy),
            format!("{:.3}", point.seconds),
        ];
        row.extend(point.parts.iter().map(|part| format!("{part:.5}")));
        table.add(row);
    }
    table
}

fn summary(points: &[Point]) -> String {
    let (judged, unresolved): (Vec<&Point>, Vec<&Point>) =
        points.iter().partition(|point| point.is_resolved());
    let ratios: Vec<f64> = judged.iter().map(|point| point.ratio()).collect();
    let share = |is: &dyn Fn(f64) -> bool| {
        100.0 * ratios.iter().filter(|ratio| is(**ratio)).count() as f64 / ratios.len() as f64
    };
    let mut views: Vec<&str> = unresolved.iter().map(|point| point.view.as_str()).collect();
    views.dedup();
    format!(
        "- {} pictures that their references can judge; predicted/actual between {} and {} in \
         {:.0} % of them, below in {:.0} %; median {:.2}\n- {} pictures nearer to the truth than \
         their references can tell: {}\n{}",
        ratios.len(),
        GOOD.start(),
        GOOD.end(),
        share(&|ratio| GOOD.contains(&ratio)),
        share(&|ratio| ratio < *GOOD.start()),
        median(ratios.clone()),
        unresolved.len(),
        if views.is_empty() { "none".into() } else { views.join(", ") },
        results::machine(),
    )
}

fn by_view(views: &[View], points: &[Point]) -> String {
    let mut header = vec!["view".to_string(), "what is hard".into()];
    header.extend(ITERATIONS.iter().map(|count| format!("after {count}")));
    header.push("mean radiance".into());
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for view in views {
        let of = |iterations: u64, figure: &dyn Fn(&Point) -> f64| -> f64 {
            let own = points.iter().filter(|p| p.view == view.name && p.iterations == iterations);
            median(own.map(figure).collect())
        };
        let mut row = vec![view.name.clone(), view.why.into()];
        row.extend(ITERATIONS.iter().map(|count| {
            let (predicted, actual) = (of(*count, &|p| p.predicted), of(*count, &|p| p.actual));
            let resolution = of(*count, &|p| p.resolution);
            format!("{} / {}", percent(predicted), told(actual, resolution))
        }));
        row.push(format!("{:.3}", of(ITERATIONS[ITERATIONS.len() - 1], &|p| p.energy)));
        table.add(row);
    }
    table.markdown()
}

/// An error, as far as a reference can tell.
pub fn told(actual: f64, resolution: f64) -> String {
    if actual >= resolution { percent(actual) } else { format!("< {}", percent(resolution)) }
}

fn targets(asked: &[(f64, Point)]) -> String {
    let mut table = Table::new(&["view", "asked", "predicted", "actual", "seconds"]);
    for (target, point) in asked {
        table.add(vec![
            point.view.clone(),
            percent(*target),
            percent(point.predicted),
            told(point.actual, point.resolution),
            format!("{:.2}", point.seconds),
        ]);
    }
    table.markdown()
}

fn chart(points: &[Point]) -> Chart {
    let mut lines: Vec<Line> = Vec::new();
    for point in points.iter().filter(|point| point.seed == 1 && point.is_resolved()) {
        match lines.iter_mut().find(|line| line.name == point.view) {
            Some(line) => line.points.push((point.actual, point.predicted)),
            None => lines.push(Line {
                name: point.view.clone(),
                points: vec![(point.actual, point.predicted)],
                ..Line::default()
            }),
        }
    }
    for line in &mut lines {
        line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    // What a perfect prediction and the limits of a good one would be.
    for (name, factor) in [("exact", 1.0), ("1.5 ×", 1.5), (".7 ×", 0.7)] {
        let points = [0.003, 0.3].map(|x| (x, factor * x)).to_vec();
        lines.insert(0, Line { name: name.into(), points, ..Line::default() });
    }
    let panel = Panel {
        title: "predicted against actual rRMSE".into(),
        x_label: "actual".into(),
        y_label: "predicted".into(),
        lines,
        y_percent: true,
        ..Panel::default()
    };
    Chart { panels: vec![panel], columns: 1, panel_size: (620, 520), legend: true }
}
