//! Settings of hemicubes: how they look, and who shoots.

use super::values::Settings;
use crate::device::{Faces, Selection, ShootingSettings};
use crate::render::RenderError;

/// Reads what the device is told of hemicubes; seed, viewer, known light and variance reduction are
/// not yet in.
///
/// # Errors
/// [`RenderError::Parameter`] for a value out of range.
pub fn hemicubes(settings: &Settings) -> Result<ShootingSettings, RenderError> {
    settings.choice("preset", &[("default", ()), ("paper", ())])?;
    let shooting = ShootingSettings {
        resolution: settings.whole("hemicube_resolution", 8, 2048)? as u32,
        shots_per_iteration: settings.whole("shots_per_iteration", 1, 64)? as u32,
        selection: settings.choice(
            "shooter_selection",
            &[("power", Selection::Power), ("uniform", Selection::Uniform)],
        )?,
        stratified: settings.switch("stratified")?,
        random_point: settings.choice("shooter_point", &[("random", true), ("centre", false)])?,
        random_azimuth: settings.switch("random_azimuth")?,
        jitter: settings.switch("subpixel_jitter")?,
        faces: settings.choice(
            "hemicube_faces",
            &[
                ("all", Faces::All),
                ("specular", Faces::Specular),
                ("top_and_side", Faces::TopAndSide),
                ("randomised", Faces::Randomised),
            ],
        )?,
        ..ShootingSettings::default()
    };
    if !shooting.resolution.is_multiple_of(2) {
        return Err(RenderError::parameter("options.hemicube_resolution", "must be even"));
    }
    Ok(shooting)
}
