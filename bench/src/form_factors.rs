//! `form-factors`: every route to a form factor against exact values, error against seconds.

use crate::results::{self, Failure};
use glam::DVec3;
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::form_factors::{
    ClosedForm, Contour, CosineRays, Hemicubes, Lambert, Polygon, Route, Unsuitable,
    parallel_rectangles, perpendicular_rectangles,
};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
pub struct Arguments {
    /// Fewer settings of each route; writes to out/form-factors.
    #[arg(long)]
    quick: bool,
    /// Folder for table and chart; `docs/methods`, with --quick `out/form-factors`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/methods.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
    /// More cases: a JSON list of objects with `name`, `emitter` and `receiver` (corners) and the
    /// exact value as `quadrature`.
    #[arg(long)]
    view_factors: Option<PathBuf>,
}

/// Two polygons and what the form factor between them is.
struct Case {
    name: String,
    from: Polygon,
    to: Polygon,
    exact: f64,
}

/// A route whose accuracy can be chosen.
struct Family {
    name: &'static str,
    routes: Vec<Box<dyn Route>>,
    /// Seeds over which errors are averaged: each route is there once a seed.
    seeds: usize,
}

/// A route on a case.
struct Point {
    family: &'static str,
    setting: String,
    case: usize,
    /// The fastest of several rounds: what disturbs only makes slower.
    seconds: f64,
    /// Root mean square over the seeds of (F − exact)/exact.
    error: f64,
}

/// A route with a setting, over all cases that it can do.
struct Summary {
    family: &'static str,
    setting: String,
    seconds: f64,
    typical: f64,
    worst: f64,
    worst_case: usize,
    cases: usize,
}

/// Seconds that a route is repeated for, at least.
const REPEAT_SECONDS: f64 = 0.02;
/// Errors below this are rounding and are drawn here.
const ROUNDING: f64 = 1e-16;

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let default_out = if arguments.quick { "out/form-factors" } else { "docs/methods" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/methods.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    let mut cases = own_cases()?;
    let own = cases.len();
    if let Some(path) = &arguments.view_factors {
        cases.extend(read_cases(path)?);
    }
    let families = families(arguments.quick);
    let mut points = Vec::new();
    for family in &families {
        eprintln!("{}: {} routes", family.name, family.routes.len());
        for routes in family.routes.chunks(family.seeds) {
            for (at, case) in cases.iter().enumerate() {
                points.extend(measure(family, routes, at, case)?);
            }
        }
    }
    let summaries = summaries(&points);
    std::fs::write(out.join("form-factors.csv"), all(&points, &cases).csv())?;
    std::fs::write(out.join("form-factors.svg"), chart(&points, &summaries, &cases).svg()?)?;
    let parts = [
        ("form factor cases".to_string(), case_table(&cases, own) + "\n" + &results::machine()),
        ("form factors".to_string(), table(&summaries, &cases)),
    ];
    results::publish(page.as_deref(), &parts)
}

fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Result<Polygon, Unsuitable> {
    let [origin, u, v] = [origin, u, v].map(DVec3::from_array);
    Polygon::parallelogram(origin, u, v)
}

/// Squares and rectangles with closed forms, and a strip by view-factor algebra.
fn own_cases() -> Result<Vec<Case>, Failure> {
    let floor = || rectangle([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let wall =
        |low: f64, high: f64| rectangle([0.0, 0.0, low], [0.0, 1.0, 0.0], [0.0, 0.0, high - low]);
    let mut cases = Vec::new();
    for gap in [0.1, 0.5, 1.0, 2.0, 10.0] {
        cases.push(Case {
            name: format!("parallel squares, gap {gap}"),
            from: floor()?,
            to: rectangle([0.0, 0.0, gap], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])?,
            exact: parallel_rectangles(1.0, 1.0, gap),
        });
    }
    for height in [1.0, 2.0] {
        cases.push(Case {
            name: format!("perpendicular, common edge, height {height}"),
            from: floor()?,
            to: wall(0.0, height)?,
            exact: perpendicular_rectangles(1.0, 1.0, height),
        });
    }
    let up_to = |height: f64| perpendicular_rectangles(1.0, 1.0, height);
    cases.push(Case {
        name: "perpendicular, strip .5 to 1.5 up".into(),
        from: floor()?,
        to: wall(0.5, 1.5)?,
        exact: up_to(1.5) - up_to(0.5),
    });
    Ok(cases)
}

/// A case of a file.
#[derive(Deserialize)]
struct Listed {
    name: String,
    emitter: Vec<[f64; 3]>,
    receiver: Vec<[f64; 3]>,
    #[serde(default)]
    closed_form: Option<String>,
    quadrature: f64,
}

/// The cases of a file that are not closed forms, which there are already.
fn read_cases(path: &Path) -> Result<Vec<Case>, Failure> {
    let wrong = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = std::fs::read_to_string(path).map_err(|error| wrong(&error))?;
    let listed: Vec<Listed> = serde_json::from_str(&text).map_err(|error| wrong(&error))?;
    let polygon = |corners: &[[f64; 3]]| {
        Polygon::new(corners.iter().map(|corner| DVec3::from_array(*corner)).collect())
    };
    let mut cases = Vec::new();
    for case in listed.into_iter().filter(|case| case.closed_form.is_none()) {
        let [from, to] = [&case.emitter, &case.receiver].map(|corners| polygon(corners));
        let from = from.map_err(|error| wrong(&format!("{}: {error}", case.name)))?;
        let to = to.map_err(|error| wrong(&format!("{}: {error}", case.name)))?;
        if !(case.quadrature > 0.0 && case.quadrature <= 1.0) {
            return Err(
                wrong(&format!("{}: {} is no form factor", case.name, case.quadrature)).into()
            );
        }
        cases.push(Case { name: case.name, from, to, exact: case.quadrature });
    }
    Ok(cases)
}

fn families(quick: bool) -> Vec<Family> {
    let fewer = |all: &[u32]| -> Vec<u32> {
        all.iter().copied().step_by(if quick { 2 } else { 1 }).collect()
    };
    let boxed = |route: &dyn Fn(u32) -> Box<dyn Route>, settings: &[u32]| {
        fewer(settings).into_iter().map(route).collect::<Vec<_>>()
    };
    let orders = [1, 2, 4, 8, 16, 32, 64];
    let rays = [64, 256, 1024, 4096, 16384, 65536];
    let seeds: usize = if quick { 3 } else { 8 };
    let cast = fewer(&rays).into_iter().flat_map(|rays| {
        (1..=seeds as u64).map(move |seed| Box::new(CosineRays { rays, seed }) as Box<dyn Route>)
    });
    let family = |name, routes| Family { name, routes, seeds: 1 };
    vec![
        family("closed form", vec![Box::new(ClosedForm)]),
        family(
            "Lambert's formula",
            boxed(&|order| Box::new(Lambert { order: order as usize }), &orders),
        ),
        family(
            "contour integral",
            boxed(&|order| Box::new(Contour { order: order as usize }), &orders),
        ),
        Family { name: "rays", routes: cast.collect(), seeds },
        family(
            "single hemicube",
            boxed(
                &|resolution| Box::new(Hemicubes { resolution, points: 1 }),
                &[16, 32, 64, 128, 256, 512],
            ),
        ),
        family(
            "hemicubes, R = 128",
            boxed(
                &|points| Box::new(Hemicubes { resolution: 128, points }),
                &[1, 4, 16, 64, 256, 1024],
            ),
        ),
    ]
}

/// One route, in all its seeds, on one case; `None` where it has no formula for the case.
fn measure(
    family: &Family,
    routes: &[Box<dyn Route>],
    at: usize,
    case: &Case,
) -> Result<Option<Point>, Failure> {
    let mut squares = 0.0;
    for route in routes {
        let value = match route.form_factor(&case.from, &case.to, &[]) {
            Err(Unsuitable::Configuration(_)) => return Ok(None),
            result => result.map_err(|error| format!("{}: {error}", case.name))?,
        };
        squares += (value / case.exact - 1.0).powi(2);
    }
    let mut rounds = Vec::new();
    let begun = Instant::now();
    while rounds.len() < 3 || begun.elapsed().as_secs_f64() < REPEAT_SECONDS {
        // A closed form takes less than the clock can tell: many at once.
        let (start, mut count) = (Instant::now(), 0u32);
        while count == 0 || start.elapsed().as_secs_f64() < 0.05 * REPEAT_SECONDS {
            let route = &routes[count as usize % routes.len()];
            std::hint::black_box(route.form_factor(&case.from, &case.to, &[]))?;
            count += 1;
        }
        rounds.push(start.elapsed().as_secs_f64() / f64::from(count));
    }
    let error = (squares / routes.len() as f64).sqrt();
    let setting = routes[0].name();
    let seconds = rounds.into_iter().fold(f64::INFINITY, f64::min);
    Ok(Some(Point { family: family.name, setting, case: at, seconds, error }))
}

fn summaries(points: &[Point]) -> Vec<Summary> {
    let mut summaries: Vec<Summary> = Vec::new();
    for point in points {
        let same = |s: &&Summary| s.family == point.family && s.setting == point.setting;
        if summaries.iter().any(|s| same(&s)) {
            continue;
        }
        let own: Vec<&Point> = (points.iter())
            .filter(|p| p.family == point.family && p.setting == point.setting)
            .collect();
        let squares: f64 = own.iter().map(|p| p.error.powi(2)).sum();
        let worst = own.iter().max_by(|a, b| a.error.total_cmp(&b.error)).map_or(point, |p| p);
        summaries.push(Summary {
            family: point.family,
            setting: point.setting.clone(),
            seconds: median(own.iter().map(|p| p.seconds).collect()),
            typical: (squares / own.len() as f64).sqrt(),
            worst: worst.error,
            worst_case: worst.case,
            cases: own.len(),
        });
    }
    summaries
}

fn all(points: &[Point], cases: &[Case]) -> Table {
    let mut table = Table::new(&["route", "setting", "case", "exact", "seconds", "relative_error"]);
    for point in points {
        let case = &cases[point.case];
        table.add(vec![
            point.family.into(),
            point.setting.clone(),
            case.name.clone(),
            format!("{:.15}", case.exact),
            format!("{:.3e}", point.seconds),
            format!("{:.3e}", point.error),
        ]);
    }
    table
}

fn case_table(cases: &[Case], own: usize) -> String {
    let mut table = Table::new(&["case", "exact F", "from"]);
    for (at, case) in cases.iter().enumerate() {
        let origin = if at < own { "closed form" } else { "file" };
        table.add(vec![case.name.clone(), format!("{:.12}", case.exact), origin.into()]);
    }
    table.markdown()
}

fn table(summaries: &[Summary], cases: &[Case]) -> String {
    let mut table = Table::new(&[
        "route",
        "setting",
        "µs a form factor",
        "relative error, rms of the cases",
        "worst",
        "worst case",
        "cases",
    ]);
    for summary in summaries {
        table.add(vec![
            summary.family.into(),
            summary.setting.clone(),
            format!("{:.3}", 1e6 * summary.seconds),
            format!("{:.1e}", summary.typical),
            format!("{:.1e}", summary.worst),
            cases[summary.worst_case].name.clone(),
            summary.cases.to_string(),
        ]);
    }
    table.markdown()
}

fn chart(points: &[Point], summaries: &[Summary], cases: &[Case]) -> Chart {
    let mut names: Vec<&str> = Vec::new();
    for point in points {
        if !names.contains(&point.family) {
            names.push(point.family);
        }
    }
    let panel = |title: String, of: &dyn Fn(&str) -> Vec<(f64, f64)>| Panel {
        title,
        x_label: "seconds a form factor".into(),
        y_label: "relative error".into(),
        lines: names
            .iter()
            .map(|name| {
                let points = of(name).into_iter().map(|(x, y)| (x, y.max(ROUNDING))).collect();
                Line { name: (*name).into(), points, ..Line::default() }
            })
            .collect(),
        ..Panel::default()
    };
    let mut panels = vec![panel("all cases, root mean square".into(), &|name| {
        let own = summaries.iter().filter(|s| s.family == name);
        own.map(|s| (s.seconds, s.typical)).collect()
    })];
    for chosen in [
        "parallel squares, gap 0.1",
        "parallel squares, gap 10",
        "perpendicular, common edge, height 1",
    ] {
        let at = cases.iter().position(|case| case.name == chosen);
        panels.push(panel(chosen.into(), &|name| {
            let own = points.iter().filter(|p| p.family == name && Some(p.case) == at);
            own.map(|p| (p.seconds, p.error)).collect()
        }));
    }
    Chart { panels, columns: 2, panel_size: (480, 340), legend: true }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cases_are_exact_and_routes_get_closer_to_them() {
        let cases = own_cases().unwrap();
        assert!(cases.iter().any(|case| (case.exact - 0.826_994_522_397_257).abs() < 1e-12));
        assert!(cases.iter().any(|case| (case.exact - 0.076_136_640_422_678).abs() < 1e-12));
        for family in families(true).iter().filter(|f| f.name.contains("contour")) {
            let errors: Vec<f64> = family
                .routes
                .iter()
                .map(|route| {
                    let one = std::slice::from_ref(route);
                    measure(family, one, 5, &cases[5]).unwrap().expect("has a formula").error
                })
                .collect();
            assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{errors:?}");
        }
        let strip = cases.len() - 1;
        let closed = &families(true)[0];
        assert!(measure(closed, &closed.routes, strip, &cases[strip]).unwrap().is_none());
    }
}
