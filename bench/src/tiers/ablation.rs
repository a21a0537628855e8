//! Each part of the method switched off in turn: error at equal time, as it is and from afar.

use super::study::Study;
use super::views::View;
use crate::page::percent;
use crate::results::Failure;
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::render::{Limits, Unobserved};
use hemilux_engine::transport::render;

/// Seconds of a render.
const SECONDS: f64 = 2.0;
const SEEDS: u64 = 3;

/// What is switched off, and how.
const VARIANTS: [(&str, &[(&str, &str)]); 12] = [
    ("nothing", &[]),
    ("tier 2: indirect light as the coarse mesh has it", &[("gather", "false")]),
    ("tier 3: direct light as the coarse mesh has it", &[("light", "false")]),
    ("fine patches: a quarter of them", &[("coarse_patches", "4000")]),
    ("fresh direct light where gather rays end", &[("gather_direct", "false")]),
    ("the near field: hits close by take the patch's mean", &[("near_field", "false")]),
    ("records hear their neighbours", &[("gather_fit", "false")]),
    ("pixels share shadow rays", &[("shadow_filter", "false")]),
    ("pixels share lobe rays", &[("lobe_filter", "false")]),
    ("well-spread points: plain random numbers", &[("well_spread", "false")]),
    ("adaptivity: records evenly, shadow rays everywhere", &[("adaptive", "false")]),
    ("sub-pixel samples: 4 instead of 32", &[("pixel_samples", "4")]),
];

pub fn run(study: &mut Study) -> Result<Vec<(String, String)>, Failure> {
    let mut views = study.views();
    views.truncate(5);
    let mut csv =
        Table::new(&["view", "switched_off", "seed", "error", "blurred", "seconds_solve"]);
    let mut medians = Vec::new();
    for view in &views {
        eprintln!("ablation: {}", view.name);
        let truth = study.truth(view)?;
        let mut errors = vec![[Vec::new(), Vec::new()]; VARIANTS.len()];
        // In turn, so that a disturbance hits all alike.
        for seed in 1..=SEEDS {
            for ((name, options), errors) in VARIANTS.iter().zip(&mut errors) {
                let limits = Limits::seconds(SECONDS);
                let request = view.request("hemilux", limits, seed, options);
                let rendered = render(study.device.as_mut(), &request, &mut Unobserved)?;
                let own = [truth.error(&rendered), truth.blurred_error(&rendered)];
                errors.iter_mut().zip(own).for_each(|(errors, error)| errors.push(error));
                csv.add(vec![
                    view.name.clone(),
                    (*name).into(),
                    seed.to_string(),
                    format!("{:.5}", own[0]),
                    format!("{:.5}", own[1]),
                    format!("{:.3}", rendered.stats.seconds_solve),
                ]);
            }
        }
        medians.push(errors.into_iter().map(|errors| errors.map(median)).collect::<Vec<_>>());
    }
    std::fs::write(study.out.join("ablation.csv"), csv.csv())?;
    let text = format!(
        "Median of {SEEDS} seeds, {SECONDS} s each.\n\n{}\nAfter a Gaussian of six pixels:\n\n{}",
        table(&views, &medians, 0),
        table(&views, &medians, 1),
    );
    Ok(vec![("ablation".into(), text)])
}

/// One of the measures of every variant on every view, and over that of the whole method.
fn table(views: &[View], medians: &[Vec<[f64; 2]>], measure: usize) -> String {
    let mut header = vec!["switched off".to_string()];
    header.extend(views.iter().map(|view| view.name.clone()));
    let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for (at, (name, _)) in VARIANTS.iter().enumerate() {
        let mut row = vec![(*name).to_string()];
        row.extend(medians.iter().map(|of_view| {
            let (error, whole) = (of_view[at][measure], of_view[0][measure]);
            match at {
                0 => percent(error),
                _ => format!("{} (× {:.2})", percent(error), error / whole),
            }
        }));
        table.add(row);
    }
    table.markdown()
}
