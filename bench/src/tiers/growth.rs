//! Seconds to an error against what a scene has more of: triangles, lights, pixels, bounces.

use super::calibration::{GOOD, told};
use super::study::Study;
use super::views::{View, with_albedo, with_lights};
use crate::page::percent;
use crate::results::Failure;
use crate::views::imported;
use hemilux_charts::chart::{Chart, Line, Panel};
use hemilux_charts::statistics::log_slope;
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Unobserved};
use hemilux_engine::scene::made;
use hemilux_engine::transport::render;

/// The error to reach.
const GOAL: f64 = 0.03;
/// Iterations that are tried, until one reaches it.
const LADDER: [u64; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
const SIDE: u32 = 128;

/// What grows, and the views from little to much of it.
struct Axis {
    name: &'static str,
    steps: Vec<(f64, View)>,
}

fn axes(quick: bool) -> Vec<Axis> {
    let cornell = || imported(&made::cornell());
    let view = |name: String, scene, side| View::new(&name, "", scene, side);
    let cut = |all: &[usize]| all.iter().copied().take(if quick { 2 } else { all.len() }).collect();
    let (triangles, lights, sides): (Vec<usize>, Vec<usize>, Vec<usize>) = (
        cut(&[300, 1_000, 10_000, 100_000]),
        cut(&[1, 8, 64, 500]),
        cut(&[128, 256, 512, 1024, 2048]),
    );
    let albedos = [0.2f32, 0.5, 0.8, 0.95];
    let albedos = &albedos[..if quick { 2 } else { 4 }];
    let room = |n: usize| {
        (n as f64, view(format!("room-{n}"), imported(&made::tessellated_room(n)), SIDE))
    };
    let lit = |n: usize| (n as f64, view(format!("lights-{n}"), with_lights(cornell(), n), SIDE));
    let sized = |n: usize| ((n * n) as f64, view("cornell".into(), cornell(), n as u32));
    let grey = |a: &f32| {
        let name = format!("albedo-{a}");
        (1.0 / (1.0 - f64::from(*a)), view(name, with_albedo(cornell(), *a), SIDE))
    };
    vec![
        Axis { name: "triangles", steps: triangles.into_iter().map(room).collect() },
        Axis { name: "lights", steps: lights.into_iter().map(lit).collect() },
        Axis { name: "pixels", steps: sides.into_iter().map(sized).collect() },
        Axis { name: "mean bounces 1/(1 − albedo)", steps: albedos.iter().map(grey).collect() },
    ]
}

/// All views, for their references.
pub fn views(quick: bool) -> impl Iterator<Item = View> {
    axes(quick).into_iter().flat_map(|axis| axis.steps.into_iter().map(|(_, view)| view))
}

/// A view's way to the goal, or as near as the last number of iterations leads.
struct ViewConvergence {
    /// Iterations that it took.
    iterations: u64,
    /// Seconds of them.
    seconds: f64,
    /// Seconds of the first picture.
    first: f64,
    error: f64,
    predicted: f64,
    /// The least error that the reference can tell.
    resolution: f64,
}

impl ViewConvergence {
    /// Renders with more and more iterations.
    fn of(study: &mut Study, view: &View) -> Result<Self, Failure> {
        let truth = study.truth(view)?;
        let mut first = None;
        let mut climb = None;
        for iterations in LADDER {
            let limits = Limits::iterations(iterations);
            let request = view.request("hemilux", limits, 1, &[]);
            let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
            let seconds = rendered.stats.seconds_solve;
            let reached = climb.insert(Self {
                iterations,
                seconds,
                first: *first.get_or_insert(seconds),
                error: truth.error(&rendered),
                predicted: rendered.stats.figures.estimated_error.unwrap_or(f64::NAN),
                resolution: truth.resolution(),
            });
            if reached.has_reached() {
                break;
            }
        }
        Ok(climb.ok_or("no picture was made")?)
    }

    fn has_reached(&self) -> bool {
        self.error <= GOAL
    }

    /// What the reference can't tell judges no prediction.
    fn judges(&self) -> bool {
        self.error >= self.resolution
    }

    fn is_well_predicted(&self) -> bool {
        GOOD.contains(&(self.predicted / self.error))
    }

    /// A row of the table.
    fn row(&self, axis: &str, x: f64) -> Vec<String> {
        let seconds = self.seconds;
        vec![
            axis.into(),
            format!("{x:.3}").trim_end_matches('0').trim_end_matches('.').into(),
            if self.has_reached() { format!("{seconds:.2}") } else { format!("> {seconds:.2}") },
            self.iterations.to_string(),
            told(self.error, self.resolution),
            percent(self.predicted),
            format!("{:.2}", self.first),
        ]
    }
}

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut table = Table::new(&[
        "",
        "",
        "seconds to 3 %",
        "iterations",
        "error then",
        "predicted",
        "of it, first picture",
    ]);
    let (mut good, mut judged) = (0, 0);
    let mut panels = Vec::new();
    let mut slopes = String::new();
    for axis in axes(study.quick) {
        eprintln!("growth: {}", axis.name);
        let mut points = Vec::new();
        for (x, view) in axis.steps {
            let climb = ViewConvergence::of(study, &view)?;
            if climb.judges() {
                good += usize::from(climb.is_well_predicted());
                judged += 1;
            }
            table.add(climb.row(axis.name, x));
            if climb.has_reached() {
                points.push((x, climb.seconds));
            }
        }
        slopes += &format!("- {}: slope {:.2}\n", axis.name, log_slope(&points));
        panels.push(panel(axis.name, points));
    }
    slopes += &format!(
        "- errors predicted within {} and {} of the actual ones in {good} of {judged} pictures that \
         their references can judge; their scenes and sizes had no part in setting the weights\n",
        GOOD.start(),
        GOOD.end(),
    );
    std::fs::write(study.out.join("growth.csv"), table.csv())?;
    std::fs::write(study.out.join("growth.svg"), Chart::new(panels, 2).svg()?)?;
    Ok(vec![("growth".into(), format!("{slopes}\n{}", table.markdown()))])
}

fn panel(axis: &str, points: Vec<(f64, f64)>) -> Panel {
    Panel {
        title: axis.into(),
        x_label: "(dashed: slopes ½ and 1)".into(),
        y_label: "seconds to 3 %".into(),
        lines: vec![Line { name: "hemilux".into(), points, ..Line::default() }],
        guide_slopes: vec![0.5, 1.0],
        ..Panel::default()
    }
}
