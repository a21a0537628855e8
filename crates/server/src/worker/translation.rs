//! Between the API's words and the engine's, each way in one place: a job's request goes to the
//! engine, its plan, its figures and what its checkpoints are of come back.

use crate::api::environment::{EnvironmentRequest, SkyRequest, SunAtRequest};
use crate::api::jobs::{self as api, CameraRequest, JobRequest, OptionValue};
use crate::api::shown::{BackgroundRequest, UnitsRequest};
use crate::api::solutions::{Begins, Solution};
use hemilux_engine::checkpoint::Header;
use hemilux_engine::image::Units;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    Begin, CameraChoice, ErrorBounds, ErrorSource, ExplicitCamera, Figures, Limits, Plan, Progress,
    RenderRequest, Stats,
};
use hemilux_engine::scene::daylight::PlaceAndTime;
use hemilux_engine::scene::environment::{Environment, PlacedMap, Sky, Sun};
use hemilux_engine::scene::sky_map::SkyMap;
use hemilux_engine::scene::{Background, Scene, SceneError};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A job in the engine's words, what surrounds the scene apart: its limits as it named them, as on the command line, and beside them
/// the longest time of the server, which ends jobs that name only iterations or an accuracy which
/// they may never reach.
pub fn render_request(
    job: &JobRequest,
    scene: Arc<Scene>,
    environment: Option<Arc<Environment>>,
    cap_seconds: Option<f64>,
    begin: Begin,
) -> RenderRequest {
    RenderRequest {
        scene,
        environment,
        background: background(job.background),
        camera: camera(job.camera.as_ref()),
        width: job.width,
        height: job.height,
        method: job.method.clone(),
        limits: Limits {
            seconds: job.time_budget_s,
            iterations: job.max_iterations,
            target_error: job.target_error,
            cap_seconds,
        },
        seed: job.seed,
        options: settings(&job.options),
        begin,
    }
}

/// A job's settings in the engine's words.
pub fn settings(given: &BTreeMap<String, OptionValue>) -> BTreeMap<String, String> {
    given.iter().map(|(name, value)| (name.clone(), value.to_string())).collect()
}

/// A job's camera in the engine's words.
fn camera(request: Option<&CameraRequest>) -> CameraChoice {
    match request {
        None => CameraChoice::First,
        Some(CameraRequest::Index(index)) => CameraChoice::Index(*index),
        Some(CameraRequest::Name(name)) => CameraChoice::Name(name.clone()),
        Some(CameraRequest::Explicit(camera)) => {
            let api::ExplicitCamera { eye, target, up, yfov_degrees } = *camera;
            CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
        }
    }
}

/// A job's background in the engine's words.
fn background(request: BackgroundRequest) -> Background {
    match request {
        BackgroundRequest::Sky => Background::Sky,
        BackgroundRequest::Transparent => Background::Transparent,
        BackgroundRequest::Colour(radiance) => Background::Colour(Rgb::from_array(radiance)),
    }
}

/// What the numbers of a job are, in the engine's words.
pub fn units(request: UnitsRequest) -> Units {
    match request {
        UnitsRequest::Photometric => Units::Photometric,
        UnitsRequest::Radiometric => Units::Radiometric,
    }
}

/// A job's sky and sun in the engine's words; `map` is the stored map that the sky is, where it is
/// one. (Without it such a sky is black, which is enough to check the rest.) The light of a place and a moment is computed here,
/// which takes a good part of a second.
///
/// # Errors
/// Where the model of daylight fails.
pub fn environment(
    request: &EnvironmentRequest,
    map: Option<Arc<SkyMap>>,
) -> Result<Environment, SceneError> {
    let day = request.sun_at.as_ref().map(place_and_time);
    let day = day.map(|at| Environment::of_daylight(&at)).transpose()?;
    let sun = request.sun.map(|sun| {
        let [direction, irradiance] = [sun.direction, sun.irradiance].map(Rgb::from_array);
        Sun::towards(direction, irradiance, 0.5 * sun.angular_diameter_degrees.to_radians())
    });
    let placed = |around: Environment| {
        around.placed(request.rotation_degrees.to_radians(), Rgb::splat(request.scale))
    };
    let around = match &request.sky {
        None => placed(day.unwrap_or_default()),
        Some(sky) => {
            let sky = placed(Environment { sky: sky_of(sky, map), ..Environment::default() }).sky;
            Environment { sky, sun: day.and_then(|day| day.sun), ..Environment::default() }
        }
    };
    Ok(Environment { sun: sun.or(around.sun), light_radius: request.light_radius, ..around })
}

fn sky_of(request: &SkyRequest, map: Option<Arc<SkyMap>>) -> Sky {
    match request {
        SkyRequest::None => Sky::None,
        SkyRequest::Uniform(radiance) => Sky::Uniform(Rgb::from_array(*radiance)),
        SkyRequest::Studio => Environment::studio().sky,
        SkyRequest::Map(_) => {
            map.map_or(Sky::None, |map| Sky::Map(PlacedMap { map, rotation: 0.0, scale: Rgb::ONE }))
        }
    }
}

/// A place and a moment in the engine's words.
fn place_and_time(at: &SunAtRequest) -> PlaceAndTime {
    /// Julian day of the beginning of 1970.
    const UNIX_EPOCH: f64 = 2_440_587.5;
    let SunAtRequest { latitude, longitude, time } = *at;
    let days = time.as_millisecond() as f64 / 86_400_000.0;
    PlaceAndTime { latitude, longitude, julian_day: UNIX_EPOCH + days }
}

/// JSON has no NaN; a figure that is none reads 0.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// What a picture took, in the API's words.
fn to_figures(figures: &Figures) -> api::Figures {
    api::Figures {
        iterations: figures.iterations,
        shots: figures.shots,
        light_source_selection_ratio: finite(figures.light_source_selection_ratio),
        estimated_error: figures.estimated_error.filter(|error| error.is_finite()),
        error_bounds: figures.error_bounds.and_then(to_bounds),
    }
}

/// Bounds of an error that JSON can say.
fn to_bounds(bounds: ErrorBounds) -> Option<api::ErrorBounds> {
    let ErrorBounds { low, high, by } = bounds;
    let by = match by {
        ErrorSource::Scatter => api::ErrorSource::Scatter,
        ErrorSource::Audit => api::ErrorSource::Audit,
    };
    (low.is_finite() && high.is_finite()).then_some(api::ErrorBounds { low, high, by })
}

/// Where a job stands, in the API's words.
pub fn to_progress(progress: &Progress) -> api::Progress {
    api::Progress {
        figures: to_figures(&progress.figures),
        seconds: finite(progress.seconds),
        seconds_remaining: progress.seconds_remaining.filter(|seconds| seconds.is_finite()),
        fraction: finite(progress.fraction),
    }
}

/// What the engine decided, in the API's words.
pub fn to_plan(plan: &Plan) -> api::Plan {
    api::Plan {
        method: plan.method.clone(),
        reasons: plan.reasons.clone(),
        settings: plan.settings.clone(),
        patches: plan.patches,
        triangles: plan.triangles,
    }
}

/// The engine's figures in the API's words; the server adds the time that it saw itself.
pub fn to_stats(stats: &Stats) -> api::Stats {
    let stopped = serde_json::to_value(stats.stopped).ok();
    api::Stats {
        method: stats.method.clone(),
        stopped: stopped.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default(),
        figures: to_figures(&stats.figures),
        seconds_solve: finite(stats.seconds_solve),
        seconds_total: finite(stats.seconds_total),
        patches: stats.patches,
        triangles: stats.triangles,
        device: stats.device.clone(),
        diagnostics: stats.diagnostics.iter().map(|(k, v)| (k.clone(), finite(*v))).collect(),
    }
}

/// What a checkpoint is of, with figures that JSON can say.
pub fn finite_header(checkpoint: &Header) -> Header {
    Header {
        seconds: finite(checkpoint.seconds),
        estimated_error: checkpoint.estimated_error.filter(|error| error.is_finite()),
        ..checkpoint.clone()
    }
}

/// The record of a checkpoint that is kept as that file of so many bytes.
pub fn to_solution(checkpoint: Header, file: String, size: u64) -> Solution {
    Solution {
        file,
        size,
        begins: Begins::Continue,
        method: checkpoint.method,
        iterations: checkpoint.iterations,
        seconds: checkpoint.seconds,
        estimated_error: checkpoint.estimated_error,
        baked: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skies_and_suns_reach_the_engine() {
        let read = |text: &str| environment(&serde_json::from_str(text).unwrap(), None).unwrap();
        assert!(read("{}").is_dark());
        let uniform = read(r#"{"sky": [1, 2, 3], "scale": 0.5}"#);
        assert_eq!(uniform.radiance(Rgb::X), Rgb::new(0.5, 1.0, 1.5));
        let studio = read(r#"{"sky": "studio", "rotation_degrees": 180, "scale": 2}"#);
        let Sky::Map(placed) = &studio.sky else { panic!("a map") };
        assert_eq!((placed.rotation, placed.scale), (std::f32::consts::PI, Rgb::splat(2.0)));
        assert_eq!(read(r#"{"light_radius": 0.25}"#).light_radius, 0.25);
        let lit = read(r#"{"sun": {"direction": [0, 2, 0], "irradiance": [3, 2, 1]}}"#);
        let sun = lit.sun.unwrap();
        assert_eq!((sun.direction, sun.irradiance), (Rgb::Y, Rgb::new(3.0, 2.0, 1.0)));
        assert!((sun.angular_radius - 0.00465).abs() < 1e-5);
        let map = Arc::new(SkyMap::new(1, 1, vec![Rgb::new(3.0, 2.0, 1.0)]).unwrap());
        let request = serde_json::from_str(r#"{"sky": {"environment": "x"}, "scale": 2}"#).unwrap();
        let stored = super::environment(&request, Some(map)).unwrap();
        assert_eq!(stored.radiance(Rgb::Z), Rgb::new(6.0, 4.0, 2.0));
        for environment in [uniform, studio, lit] {
            assert_eq!(environment.check(), Ok(()));
        }
    }
    #[test]
    fn the_day_of_a_place_gives_the_sun_and_where_none_is_named_the_sky() {
        let read = |request: serde_json::Value| {
            environment(&serde_json::from_value(request).unwrap(), None).unwrap()
        };
        let place = "48.1,11.6,2026-06-21T13:00:00Z".parse().unwrap();
        let day = Environment::of_daylight(&place).unwrap();
        let at = serde_json::json!({"latitude": 48.1, "longitude": 11.6,
                                    "time": "2026-06-21T15:00:00+02:00"});
        let whole = read(serde_json::json!({"sun_at": at, "scale": 2.0}));
        let sun = (whole.sun.unwrap(), day.sun.unwrap());
        assert!((sun.0.direction - sun.1.direction).length() < 1e-6);
        assert!((sun.0.irradiance / sun.1.irradiance - Rgb::ONE).length() < 1e-4);
        let seen = whole.radiance(Rgb::Y) / day.radiance(Rgb::Y);
        assert!((seen - Rgb::splat(2.0)).length() < 1e-3, "{seen}");
        // A quarter turn takes the sun along, but only with its own sky.
        let turned = read(serde_json::json!({"sun_at": at, "rotation_degrees": 90}));
        let direction = turned.sun.unwrap().direction;
        assert!((direction.x - sun.1.direction.z).abs() < 1e-6, "{direction}");
        let other =
            read(serde_json::json!({"sky": [1, 1, 1], "sun_at": at, "rotation_degrees": 90}));
        assert!((other.sun.unwrap().direction - sun.1.direction).length() < 1e-6);
        assert_eq!(other.radiance(Rgb::Y), Rgb::ONE);
    }
}
