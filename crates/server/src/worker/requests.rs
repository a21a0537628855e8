//! What the engine says of jobs before they run: what they can ask for, what it would refuse, what
//! memory they need.

use super::translation::{render_request, settings};
use crate::api::FieldError;
use crate::api::jobs::{JobRequest, OptionValue};
use crate::api::limits::{OptionWord, Vocabulary};
use hemilux_engine::render::{Begin, RenderError};
use hemilux_engine::transport::{self, METHODS, OPTIONS};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A setting whose default is only one of the values that it may have where it is not given.
const BY_LIMITS: &str = "pixel_samples";

/// What the engine can be asked for by name.
pub fn vocabulary() -> Vocabulary {
    Vocabulary {
        methods: METHODS.to_vec(),
        options: OPTIONS
            .iter()
            .map(|option| OptionWord {
                name: option.name,
                default: option.default,
                meaning: option.meaning,
            })
            .collect(),
    }
}

/// The settings in force that a job's own stand for, by name and as text: presets and defaults
/// filled in. Jobs that say the same in other words have the same; `None` where they say something
/// that is refused.
pub fn settings_in_force(
    options: &BTreeMap<String, OptionValue>,
) -> Option<BTreeMap<String, String>> {
    let given = settings(options);
    let mut values = transport::settings(&given).ok()?.values().clone();
    // Unless it is given, this one goes by the limits rather than by its default.
    if !given.contains_key(BY_LIMITS) {
        values.remove(BY_LIMITS);
    }
    Some(values)
}

/// What the engine would refuse of a job, whatever its scene: the engine's own check, asked before
/// the job is accepted.
pub fn request_problem(job: &JobRequest) -> Option<FieldError> {
    let request = render_request(job, Arc::default(), None, Begin::Afresh);
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
pub fn needed_bytes(job: &JobRequest, triangles: u64) -> Option<u64> {
    let options = job.options.iter().map(|(name, value)| (name.clone(), value.to_string()));
    let size = [job.width, job.height];
    transport::needed_bytes(&job.method, &options.collect(), triangles, size).ok()?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needed(method: &str, triangles: u64, patches: u64, side: u32) -> u64 {
        let job = serde_json::json!({"method": method, "width": side, "height": side,
                                     "options": {"patches": patches}});
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
}
