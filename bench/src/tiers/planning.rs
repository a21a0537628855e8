//! What `auto` picks against what the best hand would: error at equal time on every view.

use super::study::Study;
use crate::page::percent;
use crate::results::Failure;
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Unobserved};
use hemilux_engine::transport::render;

/// Seconds of a render.
const SECONDS: f64 = 2.0;
const SEEDS: u64 = 1;
/// Time for the same error over the time of the best hand: the bar. Errors fall at most with the
/// square root of time.
const BAR: f64 = 1.3;

/// Method and settings that a hand would try.
const HANDS: [(&str, &[(&str, &str)]); 11] = [
    ("auto", &[]),
    ("hemilux", &[("coarse_patches", "4000")]),
    ("hemilux", &[("coarse_patches", "40000")]),
    ("hemilux", &[("coarse_rays", "64")]),
    ("hemilux", &[("gather_rays", "32")]),
    ("hemilux", &[("gather_rays", "128")]),
    ("hemilux", &[("gather_fit", "false")]),
    ("hemilux", &[("shadow_filter", "false")]),
    ("hemilux", &[("pixel_samples", "16")]),
    ("hemilux", &[("pixel_samples", "64")]),
    ("ray-traced", &[]),
];

fn words((method, options): &(&str, &[(&str, &str)])) -> String {
    let mut text = (*method).to_string();
    for (name, value) in *options {
        text += &format!(", {name} {value}");
    }
    text
}

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut table = Table::new(&[
        "view",
        "auto",
        "best hand",
        "its settings",
        "error ratio",
        "time ratio at most",
    ]);
    let mut csv = Table::new(&["view", "settings", "seed", "error", "seconds_solve"]);
    let (mut within, mut views) = (0, 0);
    for view in study.views() {
        eprintln!("planning: {}", view.name);
        let truth = study.truth(&view)?;
        let mut errors = vec![Vec::new(); HANDS.len()];
        for seed in 1..=SEEDS {
            for (hand, errors) in HANDS.iter().zip(&mut errors) {
                let limits = Limits::seconds(SECONDS);
                let request = view.request(hand.0, limits, seed, hand.1);
                let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
                let error = truth.error(&rendered);
                errors.push(error.max(truth.resolution()));
                csv.add(vec![
                    view.name.clone(),
                    words(hand),
                    seed.to_string(),
                    format!("{error:.5}"),
                    format!("{:.3}", rendered.stats.seconds_solve),
                ]);
            }
        }
        let errors: Vec<f64> = errors.into_iter().map(median).collect();
        let best = (0..HANDS.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or(0);
        let ratio = errors[0] / errors[best];
        views += 1;
        within += usize::from(ratio * ratio <= BAR);
        table.add(vec![
            view.name.clone(),
            percent(errors[0]),
            percent(errors[best]),
            words(&HANDS[best]),
            format!("{ratio:.2}"),
            format!("{:.2}", ratio * ratio),
        ]);
    }
    std::fs::write(study.out.join("planning.csv"), csv.csv())?;
    let text = format!(
        "Seeds: {SEEDS}, {SECONDS} s each; within {BAR} × of the best hand's time on \
         {within} of {views} views.\n\n{}",
        table.markdown()
    );
    Ok(vec![("planning".into(), text)])
}
