//! Checked settings of the radiosity methods.

use crate::device::ShootingSettings;
use crate::render::RenderError;
use crate::transport::options::{Settings, hemicubes};

/// Checked settings of the radiosity methods.
#[derive(Clone, Debug)]
pub struct RadiositySettings {
    /// Hemicube resolution and shots that are made together.
    pub shooting: ShootingSettings,
    /// Whether unshot light is shown.
    pub ambient: bool,
    /// Hemicubes of a row of form factors.
    pub points: u32,
}

impl RadiositySettings {
    /// Reads the settings of the radiosity methods.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        Ok(Self {
            shooting: hemicubes(settings)?,
            ambient: settings.switch("ambient")?,
            points: settings.whole("form_factor_points", 1, 64)? as u32,
        })
    }
}
