//! How errors fall with time: whether any view has a floor.

use super::calibration::told;
use super::study::Study;
use crate::page::percent;
use crate::results::{self, Failure};
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Unobserved};
use hemilux_engine::transport::render;

/// Seconds of the jobs, each four times the one before.
const SECONDS: [f64; 3] = [4.0, 16.0, 64.0];
/// Error after four times the time: without a floor it is at most this share of what it was.
const BAR: f64 = 0.6;

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut header: Vec<String> = vec!["view".into()];
    header.extend(SECONDS.map(|seconds| format!("after {seconds} s")));
    header.extend(SECONDS.map(|seconds| format!("blurred, {seconds} s")));
    header.extend(["64 s over 16 s".into(), "mean radiance".into(), "predicted, 64 s".into()]);
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let mut csv = Table::new(&[
        "view",
        "seconds_solve",
        "iterations",
        "error",
        "blurred",
        "resolution",
        "predicted",
        "mean_ratio",
    ]);
    let (mut judged, mut falling) = (0, 0);
    for view in study.views() {
        eprintln!("slopes: {}", view.name);
        let truth = study.sparse_truth(&view)?;
        let (mut errors, mut blurred, mut last) = (Vec::new(), Vec::new(), Vec::new());
        for seconds in SECONDS {
            let request = view.request("auto", Limits::seconds(seconds), 1, &[]);
            let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
            let figures = &rendered.stats.figures;
            let predicted = figures.estimated_error.unwrap_or(f64::NAN);
            let judged = truth.judged(&rendered);
            let (error, from_afar) = (judged.error(), truth.blurred_error(&rendered));
            errors.push(judged);
            blurred.push(from_afar);
            last = vec![format!("{:.4}", truth.energy(&rendered)), percent(predicted)];
            csv.add(vec![
                view.name.clone(),
                format!("{:.3}", rendered.stats.seconds_solve),
                figures.iterations.to_string(),
                format!("{error:.5}"),
                format!("{from_afar:.5}"),
                format!("{:.5}", judged.resolution()),
                format!("{predicted:.5}"),
                last[0].clone(),
            ]);
            std::fs::write(study.out.join("slopes.csv"), csv.csv())?;
        }
        let share = errors[2].error() / errors[1].error();
        let is_judged = errors[2].is_resolved();
        judged += usize::from(is_judged);
        falling += usize::from(is_judged && share <= BAR);
        let mut row = vec![view.name.clone()];
        row.extend(errors.iter().map(|own| told(own.error(), own.resolution())));
        row.extend(blurred.iter().map(|error| percent(*error)));
        row.push(if is_judged { format!("{share:.2}") } else { "–".into() });
        row.extend(last);
        table.add(row);
    }
    let text = format!(
        "One seed. Errors fall to {BAR} or less in {falling} of {judged} views whose references can \
         judge the longest job.\n\n{}\n{}",
        results::machine(),
        table.markdown()
    );
    Ok(vec![("slopes".into(), text)])
}
