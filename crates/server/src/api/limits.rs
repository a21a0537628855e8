//! What a job may ask for, and the check that says so field by field.

use super::FieldError;
use super::jobs::{CameraRequest, JobRequest, OptionValue};

/// Longest picture side that any server accepts, pixels.
pub const HARD_MAX_SIDE: u32 = 16_384;
/// Most pixels that any server accepts.
pub const HARD_MAX_PIXELS: u64 = 64 << 20;
/// Largest integer that JSON clients agree on.
const MAX_SAFE_INTEGER: u64 = (1 << 53) - 1;
const MAX_ITERATIONS: u64 = 1_000_000_000_000;
const MAX_LABELS: usize = 16;
const MAX_LABEL_CHARS: usize = 64;
/// More settings than any method has.
pub const MAX_OPTIONS: usize = 100;
const MAX_OPTION_CHARS: usize = 256;
const MAX_CAMERA_NAME_CHARS: usize = 1024;
/// Longest name of a variant in a request, characters.
const MAX_VARIANT_CHARS: usize = 1024;

/// Limits of this server, at or below the hard ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JobLimits {
    /// Longest picture side, pixels.
    pub max_side: u32,
    /// Most pixels.
    pub max_pixels: u64,
    /// Longest time of a job, seconds, and so the largest time budget.
    pub max_seconds: f64,
    /// Most patches that the `patches` option may ask for.
    pub max_patches: u64,
}

impl JobRequest {
    /// Everything that is beyond this API's limits, apart from the scene; what the engine refuses
    /// besides, methods and settings that there are not among it, is the engine's to say.
    pub fn problems(&self, limits: &JobLimits) -> Vec<FieldError> {
        let mut errors = Vec::new();
        let mut wrong = |field: &str, detail: String| errors.push(FieldError::new(field, detail));

        for (field, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=limits.max_side).contains(&side) {
                wrong(field, format!("must be between 1 and {}, is {side}", limits.max_side));
            }
        }
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels > limits.max_pixels {
            let most = limits.max_pixels;
            wrong("width", format!("width × height must be at most {most} pixels, is {pixels}"));
        }
        self.end_problems(limits, &mut wrong);
        if self.seed > MAX_SAFE_INTEGER {
            wrong("seed", format!("must be at most {MAX_SAFE_INTEGER}"));
        }
        if let Some(snapshots) = &self.snapshots {
            if !(0.1..=3600.0).contains(&snapshots.every_s) {
                let every = snapshots.every_s;
                wrong("snapshots.every_s", format!("must be between 0.1 and 3600, is {every}"));
            }
            if !(1..=2).contains(&snapshots.formats.len()) {
                wrong("snapshots.formats", "must name one or two formats".into());
            }
        }
        if !(-100..=100).contains(&self.priority) {
            wrong("priority", format!("must be between -100 and 100, is {}", self.priority));
        }
        if self.view_of.is_some() {
            wrong("view_of", "POST the view to /v1/jobs/{id}/views instead".into());
        }
        for error in self.webhook.iter().flat_map(|webhook| webhook.problems("webhook")) {
            wrong(&error.field, error.detail);
        }
        self.label_problems(&mut wrong);
        self.option_problems(limits, &mut wrong);
        self.camera_shape_problems(&mut wrong);
        if self.variant.as_ref().is_some_and(|name| name.chars().count() > MAX_VARIANT_CHARS) {
            wrong("variant", format!("at most {MAX_VARIANT_CHARS} characters"));
        }
        self.part_problems(&mut wrong);
        self.background.problems(&mut wrong);
        self.units.problems(self.environment.as_ref(), &mut wrong);
        if let Some(environment) = &self.environment {
            environment.problems(&mut wrong);
        }
        errors
    }

    /// Of what ends the job.
    fn end_problems(&self, limits: &JobLimits, wrong: &mut impl FnMut(&str, String)) {
        if let Some(error) = self.target_error
            && !(error > 0.0 && error < 1.0)
        {
            wrong("target_error", format!("must be between 0 and 1, both excluded, is {error}"));
        }
        if let Some(seconds) = self.time_budget_s
            && !(seconds > 0.0 && seconds <= limits.max_seconds)
        {
            let most = limits.max_seconds;
            wrong("time_budget_s", format!("must be above 0 and at most {most}, is {seconds}"));
        }
        if let Some(iterations) = self.max_iterations
            && !(1..=MAX_ITERATIONS).contains(&iterations)
        {
            let range = format!("must be between 1 and {MAX_ITERATIONS}, is {iterations}");
            wrong("max_iterations", range);
        }
    }

    fn label_problems(&self, wrong: &mut impl FnMut(&str, String)) {
        if self.labels.len() > MAX_LABELS {
            wrong("labels", format!("at most {MAX_LABELS} labels, are {}", self.labels.len()));
        }
        for (key, value) in self.labels.iter().take(MAX_LABELS) {
            let fits = |text: &str| text.chars().count() <= MAX_LABEL_CHARS && !text.contains('\0');
            if key.is_empty() || key.contains(':') || !fits(key) || !fits(value) {
                let rule = format!(
                    "keys have 1 to {MAX_LABEL_CHARS} characters and no colon, values at most {MAX_LABEL_CHARS}; neither has NUL"
                );
                wrong(&format!("labels.{}", shorten(key)), rule);
            }
        }
    }

    fn option_problems(&self, limits: &JobLimits, wrong: &mut impl FnMut(&str, String)) {
        if self.options.len() > MAX_OPTIONS {
            wrong("options", format!("at most {MAX_OPTIONS}, are {}", self.options.len()));
        }
        for (name, value) in self.options.iter().take(MAX_OPTIONS) {
            let field = format!("options.{}", shorten(name));
            let patches = name.rsplit('.').next() == Some("patches");
            if matches!(value, OptionValue::Word(w) if w.chars().count() > MAX_OPTION_CHARS) {
                wrong(&field, format!("at most {MAX_OPTION_CHARS} characters"));
            } else if patches
                && value.to_string().parse::<f64>().is_ok_and(|n| n > limits.max_patches as f64)
            {
                wrong(&field, format!("must be at most {}, is {value}", limits.max_patches));
            }
        }
    }

    fn camera_shape_problems(&self, wrong: &mut impl FnMut(&str, String)) {
        match &self.camera {
            Some(CameraRequest::Name(name)) if name.chars().count() > MAX_CAMERA_NAME_CHARS => {
                wrong("camera", format!("at most {MAX_CAMERA_NAME_CHARS} characters"));
            }
            Some(CameraRequest::Explicit(camera)) => {
                for (name, vector) in
                    [("eye", camera.eye), ("target", camera.target), ("up", camera.up)]
                {
                    if !vector.iter().all(|x| x.abs() <= 1e9) {
                        wrong(
                            &format!("camera.{name}"),
                            "must lie within 1e9 of the origin".into(),
                        );
                    }
                }
            }
            _ => {}
        }
    }
}

/// A client's own word, short enough to quote back.
/// The beginning of a name that a client made up.
pub fn shorten(word: &str) -> String {
    word.chars().take(64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> JobLimits {
        JobLimits { max_side: 4096, max_pixels: 4 << 20, max_seconds: 60.0, max_patches: 1000 }
    }

    fn fields(json: serde_json::Value) -> Vec<String> {
        let request: JobRequest = serde_json::from_value(json).unwrap();
        request.problems(&limits()).into_iter().map(|e| e.field).collect()
    }

    #[test]
    fn defaults_pass() {
        assert_eq!(fields(serde_json::json!({})), Vec::<String>::new());
    }

    #[test]
    fn every_limit_names_its_field() {
        let cases = [
            (serde_json::json!({"width": 0}), "width"),
            (serde_json::json!({"height": 4097}), "height"),
            (serde_json::json!({"width": 4096, "height": 4096}), "width"),
            (serde_json::json!({"target_error": 0.0}), "target_error"),
            (serde_json::json!({"target_error": 1.0}), "target_error"),
            (serde_json::json!({"time_budget_s": 0.0}), "time_budget_s"),
            (serde_json::json!({"time_budget_s": 60.5}), "time_budget_s"),
            (serde_json::json!({"max_iterations": 0}), "max_iterations"),
            (serde_json::json!({"seed": u64::MAX}), "seed"),
            (serde_json::json!({"snapshots": {"every_s": 0.0}}), "snapshots.every_s"),
            (serde_json::json!({"snapshots": {"every_s": 1, "formats": []}}), "snapshots.formats"),
            (serde_json::json!({"priority": 101}), "priority"),
            (serde_json::json!({"labels": {"": "x"}}), "labels."),
            (serde_json::json!({"labels": {"k": "x".repeat(65)}}), "labels.k"),
            (serde_json::json!({"options": {"x": "y".repeat(257)}}), "options.x"),
            (
                serde_json::json!({"options": {"stochastic.patches": 1001}}),
                "options.stochastic.patches",
            ),
            (serde_json::json!({"options": {"patches": 1001}}), "options.patches"),
            (serde_json::json!({"options": {"patches": "1e9"}}), "options.patches"),
            (
                serde_json::json!({"camera": {"eye": [0,0,2e9], "target": [0,0,0], "yfov_degrees": 40}}),
                "camera.eye",
            ),
            (serde_json::json!({"camera": "n".repeat(1025)}), "camera"),
            (serde_json::json!({"variant": "n".repeat(1025)}), "variant"),
            (serde_json::json!({"gltf_scene": "n".repeat(1025)}), "gltf_scene"),
            (serde_json::json!({"animation": "n".repeat(1025)}), "animation"),
            (serde_json::json!({"animation": 0, "time": -0.5}), "time"),
            (serde_json::json!({"time": 1}), "time"),
            (serde_json::json!({"environment": {"sky": [0, -1, 0]}}), "environment.sky"),
            (serde_json::json!({"environment": {"scale": -1}}), "environment.scale"),
            (
                serde_json::json!({"environment": {"rotation_degrees": 1e7}}),
                "environment.rotation_degrees",
            ),
            (
                serde_json::json!({"environment": {"sun": {"direction": [0, 1, 0], "irradiance": [1, 2, 1e13]}}}),
                "environment.sun.irradiance",
            ),
            (
                serde_json::json!({"environment": {"sun": {"direction": [0, 1, 0], "irradiance": [1, 2, 3], "angular_diameter_degrees": 21}}}),
                "environment.sun.angular_diameter_degrees",
            ),
        ];
        for (json, field) in cases {
            assert_eq!(fields(json.clone()), [field], "{json}");
        }
    }
}
