//! Whether jobs of little time keep to it, and what comes of them.

use super::calibration::told;
use super::study::Study;
use crate::results::{self, Failure};
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Unobserved};
use hemilux_engine::transport::render;

/// Seconds that are asked for.
const SECONDS: [f64; 5] = [0.1, 0.2, 0.5, 1.0, 3.0];
/// By how much a job may be late: a share of its time, and seconds.
const LATE: (f64, f64) = (0.1, 0.05);

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut header: Vec<String> = vec!["view".into()];
    header.extend(SECONDS.map(|seconds| format!("{seconds} s")));
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let mut csv = Table::new(&["view", "seconds_asked", "seconds", "error", "resolution", "draft"]);
    let (mut late, mut all) = (Vec::new(), 0);
    for view in study.views() {
        eprintln!("budgets: {}", view.name);
        let truth = study.truth(&view)?;
        let mut row = vec![view.name.clone()];
        for asked in SECONDS {
            let request = view.request("auto", Limits::seconds(asked), 1, &[]);
            let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
            let taken = rendered.stats.seconds_total;
            let error = truth.error(&rendered);
            all += 1;
            if taken > asked * (1.0 + LATE.0) + LATE.1 {
                late.push(format!("{} ({taken:.2} s of {asked} s)", view.name));
            }
            row.push(format!("{taken:.2} s: {}", told(error, truth.resolution())));
            let draft = rendered.stats.diagnostics.get("draft").copied().unwrap_or(1.0);
            csv.add(vec![
                view.name.clone(),
                asked.to_string(),
                format!("{taken:.3}"),
                format!("{error:.5}"),
                format!("{:.5}", truth.resolution()),
                format!("{draft}"),
            ]);
        }
        table.add(row);
        std::fs::write(study.out.join("budgets.csv"), csv.csv())?;
    }
    let kept = all - late.len();
    let which =
        if late.is_empty() { String::new() } else { format!("; not in {}", late.join(", ")) };
    let text = format!(
        "Kept within a tenth and .05 s in {kept} of {all}{which}.\n\n{}\n{}",
        results::machine(),
        table.markdown()
    );
    Ok(vec![("budgets".into(), text)])
}
