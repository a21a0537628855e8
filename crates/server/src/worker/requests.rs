//! What the engine says of jobs before they run: what they can ask for, what it would refuse, what
//! memory they need.

use super::translation::{environment, render_request, settings};
use crate::api::FieldError;
use crate::api::environment::EnvironmentRequest;
use crate::api::jobs::{JobRequest, OptionValue};
use crate::api::limits::{MAX_OPTIONS, shorten};
use crate::api::settings::{Setting, Values};
use hemilux_engine::render::{Begin, RenderError};
use hemilux_engine::transport::options::{Form, Kind};
use hemilux_engine::transport::{self, Listed, TriangleCount};
use std::collections::BTreeMap;
use std::sync::Arc;

pub use hemilux_engine::transport::METHODS;

/// Every setting of every method, in the API's words.
pub fn listed_settings() -> impl Iterator<Item = Setting> {
    transport::listed().into_iter().map(|setting| {
        let Listed { method, name, default, form, unit, meaning, public } = setting;
        let range = form.to_string();
        let values = match form.kind {
            Kind::Whole { low, high, even } => {
                Values::Whole { low, high, step: 1 + u64::from(even) }
            }
            Kind::Number { low, high } => Values::Number { low, high },
            Kind::Switch => Values::Switch,
            Kind::Words => Values::Words,
        };
        Setting { method, name, default, values, words: form.words, range, unit, meaning, public }
    })
}

/// Those that the API takes.
pub fn public_settings() -> impl Iterator<Item = Setting> {
    listed_settings().filter(|setting| setting.public)
}

/// The settings in force that a job's own stand for, by name and as text: presets and defaults
/// filled in. Jobs that say the same in other words have the same; `None` where they say something
/// that is refused.
pub fn settings_in_force(job: &JobRequest) -> Option<BTreeMap<String, String>> {
    transport::settings(&job.method, &settings(&job.options)).ok()
}

/// The request of an earlier job without settings that its method does not have: earlier releases
/// took them and left them without effect.
pub fn without_idle_settings(mut job: JobRequest) -> JobRequest {
    let relevant = transport::relevant(&job.method, &settings(&job.options));
    job.options.retain(|name, _| relevant.contains_key(name));
    job
}

/// What is wrong with the method of a new job, or with each of its settings: names that the method
/// does not have, values that are out of range or of another type, and what is for studies only.
pub fn method_problems(job: &JobRequest) -> Vec<FieldError> {
    if !METHODS.contains(&job.method.as_str()) {
        let detail = format!("no method {:?}; there are {METHODS:?}", job.method);
        return vec![FieldError::new("method", detail)];
    }
    let wrong = |(key, value): (&String, &OptionValue)| {
        let detail = option_problem(&job.method, key, value)?;
        Some(FieldError::new(format!("options.{}", shorten(key)), detail))
    };
    job.options.iter().take(MAX_OPTIONS).filter_map(wrong).collect()
}

fn option_problem(method: &str, key: &str, value: &OptionValue) -> Option<String> {
    let given = BTreeMap::from([(key.to_owned(), value.to_string())]);
    match transport::find(method, key) {
        Some(setting) if !setting.public => {
            Some("is for studies of the method; the command line takes it, the API does not".into())
        }
        Some(setting) if !is_of(&setting.form, value) => {
            let given = serde_json::to_string(value).unwrap_or_default();
            Some(format!("must be {}, not {given}", setting.form))
        }
        _ => match transport::check_settings(method, &given) {
            Err(RenderError::Parameter { what, .. }) => Some(what),
            _ => None,
        },
    }
}

/// Whether a value is of the type that the form says.
fn is_of(form: &Form, value: &OptionValue) -> bool {
    match value {
        OptionValue::Switch(_) => form.kind == Kind::Switch,
        OptionValue::Number(_) => matches!(form.kind, Kind::Whole { .. } | Kind::Number { .. }),
        OptionValue::Word(_) => !form.words.is_empty(),
    }
}

/// What the engine would refuse of a job, whatever its scene: the engine's own check, asked before
/// the job is accepted.
pub fn request_problem(job: &JobRequest) -> Option<FieldError> {
    // What the model of daylight gives needs no check, and takes time.
    let around =
        job.environment.clone().map(|around| EnvironmentRequest { sun_at: None, ..around });
    let around = match around.map(|around| environment(&around, None)).transpose() {
        Ok(around) => around.map(Arc::new),
        Err(error) => return Some(FieldError::new("environment", error.to_string())),
    };
    let request = render_request(job, Arc::default(), around, None, Begin::Afresh);
    match transport::check(&request).err()? {
        RenderError::Parameter { parameter, what } => {
            let field = match parameter.as_str() {
                "seconds" => "time_budget_s",
                "iterations" => "max_iterations",
                _ => &parameter,
            };
            Some(FieldError::new(field, what))
        }
        error => Some(FieldError::new("options", error.to_string())),
    }
}

/// Memory that a job needs at least, bytes, by the estimate of its method; `None` where the request
/// cannot be understood.
pub fn needed_bytes(job: &JobRequest, triangles: impl Into<TriangleCount>) -> Option<u64> {
    let size = [job.width, job.height];
    transport::needed_bytes(&job.method, &settings(&job.options), triangles, size).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needed(method: &str, triangles: u64, patches: u64, side: u32) -> u64 {
        let mut job = serde_json::json!({"method": method, "width": side, "height": side});
        if transport::find(method, "patches").is_some() {
            job["options"] = serde_json::json!({"patches": patches});
        }
        let job = serde_json::from_value(job).unwrap();
        needed_bytes(&job, triangles).unwrap_or_else(|| panic!("{method} does not say"))
    }

    #[test]
    fn every_method_says_what_it_needs_and_more_for_more() {
        for method in METHODS {
            let little = needed(method, 1000, 2000, 100);
            assert!((1 << 20..1 << 30).contains(&little), "{method}: {little}");
            assert!(needed(method, 1_000_000, 2000, 100) > little, "{method}");
            assert!(needed(method, 1000, 2000, 4000) > little, "{method}");
            // Methods without patches do not care for them.
            assert!(needed(method, 1000, 200_000, 100) >= little, "{method}");
        }
        assert!(needed("stochastic", 1000, 2_000_000, 100) > 500_000_000);
        // The matrix of form factors, with at least a patch a triangle.
        assert!(needed("gauss-seidel", 1000, 20_000, 100) > 1_600_000_000);
        assert!(needed("gauss-seidel", 20_000, 1, 100) > 1_600_000_000);
        assert!(needed("auto", 1000, 2000, 4000) <= needed("hemilux", 1000, 2000, 4000));
    }
    #[test]
    fn settings_are_checked_one_by_one() {
        let problems = |method: &str, options: serde_json::Value| {
            let job = serde_json::json!({"method": method, "options": options});
            let problems = method_problems(&serde_json::from_value(job).unwrap());
            problems.into_iter().map(|error| (error.field, error.detail)).collect::<Vec<_>>()
        };
        let fine = serde_json::json!({"gather_rays": 64, "hemilux.coarse_patches": "auto", "pixel_samples": 1e1});
        assert_eq!(problems("hemilux", fine), []);
        let several = serde_json::json!({"patches": 1, "gather_rays": "64", "gather": false, "coarse_patches": 0});
        let fields: Vec<_> =
            problems("hemilux", several).into_iter().map(|(field, _)| field).collect();
        let expected =
            ["options.coarse_patches", "options.gather", "options.gather_rays", "options.patches"];
        assert_eq!(fields, expected);
        for (method, options, told) in [
            (
                "hemilux",
                serde_json::json!({"gather_rays": true}),
                "must be a whole number from 4 to 65536, not true",
            ),
            ("hemilux", serde_json::json!({"gather": false}), "studies"),
            ("stochastic", serde_json::json!({"first_shot": 1}), "must be true or false, not 1"),
            (
                "stochastic",
                serde_json::json!({"hemilux.gather_rays": 64}),
                "stochastic has no such setting",
            ),
            ("ray-traced", serde_json::json!({"pixel_sampling": 3}), "\"jittered\""),
            (
                "auto",
                serde_json::json!({"ambient": true}),
                "none of the methods that auto may pick has it",
            ),
        ] {
            let found = problems(method, options.clone());
            assert!(found.len() == 1 && found[0].1.contains(told), "{options}: {found:?}");
        }
        let unknown = problems("magic", serde_json::json!({"gather_rays": true}));
        assert!(unknown.len() == 1 && unknown[0].0 == "method", "{unknown:?}");
    }

    #[test]
    fn jobs_of_earlier_releases_lose_what_had_no_effect() {
        let job =
            serde_json::json!({"method": "hemilux", "options": {"patches": 60, "gather_rays": 8}});
        let job = without_idle_settings(serde_json::from_value(job).unwrap());
        assert_eq!(job.options.into_keys().collect::<Vec<_>>(), ["gather_rays"]);
    }
}
