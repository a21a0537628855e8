//! Settings of the radiosity methods.

use crate::device::ShootingSettings;
use crate::transport::options::{
    AnySetting, HEMICUBE_RESOLUTION, SHOTS_PER_ITERATION, Setting, Settings, Switch, Whole,
};

static AMBIENT: Setting<Switch> = Setting::new("ambient", "true", Switch)
    .means("show unshot light as an ambient term, π ΔL_mean/(1 − ρ_mean), where no sky or sun shines into the scene");
static FORM_FACTOR_POINTS: Setting<Whole> =
    Setting::new("form_factor_points", "1", Whole { low: 1, high: 64 }).unit("hemicubes").means(
        "hemicubes a patch whose mean is its row of form factors; one stands on the centroid",
    );

/// Those of `monte-carlo`.
pub static MONTE_CARLO: &[&dyn AnySetting] = &[&HEMICUBE_RESOLUTION, &SHOTS_PER_ITERATION];
/// Those of `progressive`.
pub static PROGRESSIVE: &[&dyn AnySetting] =
    &[&HEMICUBE_RESOLUTION, &SHOTS_PER_ITERATION, &AMBIENT];
/// Those of `gauss-seidel`.
pub static GAUSS_SEIDEL: &[&dyn AnySetting] = &[&HEMICUBE_RESOLUTION, &FORM_FACTOR_POINTS];

/// How a method shoots its hemicubes several at a time.
pub fn shooting(settings: &Settings, seed: u64) -> ShootingSettings {
    ShootingSettings {
        resolution: settings.get(&HEMICUBE_RESOLUTION) as u32,
        shots_per_iteration: settings.get(&SHOTS_PER_ITERATION) as u32,
        seed,
        ..ShootingSettings::default()
    }
}

/// How a method takes its form factors, one hemicube at a time.
pub fn looking(settings: &Settings, seed: u64) -> ShootingSettings {
    let resolution = settings.get(&HEMICUBE_RESOLUTION) as u32;
    ShootingSettings { resolution, seed, ..ShootingSettings::default() }
}

/// Whether unshot light is shown.
pub fn ambient(settings: &Settings) -> bool {
    settings.get(&AMBIENT)
}

/// Hemicubes of a row of form factors.
pub fn form_factor_points(settings: &Settings) -> usize {
    settings.get(&FORM_FACTOR_POINTS) as usize
}
