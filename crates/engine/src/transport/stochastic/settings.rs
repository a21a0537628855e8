//! Checked settings of stochastic iteration.

use crate::device::{ShootingSettings, Substitute};
use crate::render::RenderError;
use crate::transport::known::ConstantRadiance;
use crate::transport::options::{Settings, hemicubes};

/// Checked settings of stochastic iteration; see [`crate::transport::OPTIONS`] for their meaning.
#[derive(Clone, Debug)]
pub struct StochasticSettings {
    /// What the device is told; seed, viewer, known light and variance reduction are not yet in.
    pub shooting: ShootingSettings,
    /// Variance reduction, if any.
    pub substitute: Option<Substitute>,
    /// Its M.
    pub substitute_shots: ExpectedShots,
    /// The constant radiance term.
    pub constant: ConstantRadiance,
    /// Whether direct light is shot beforehand.
    pub first_shot: bool,
    /// Iterations left out of the average.
    pub burn_in: u64,
}

/// M of the variance reduction, in shots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedShots {
    /// From the iteration limit, else as [`ExpectedShots::Growing`].
    Auto,
    /// The shots so far.
    Growing,
    /// This many.
    Given(u64),
}

impl StochasticSettings {
    /// Reads the settings of stochastic iteration.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        Ok(Self {
            shooting: hemicubes(settings)?,
            substitute: settings.choice(
                "variance_reduction",
                &[
                    ("none", None),
                    ("zero", Some(Substitute::Zero)),
                    ("mean", Some(Substitute::Mean)),
                ],
            )?,
            substitute_shots: match settings.values()["variance_reduction_shots"].as_str() {
                "auto" => ExpectedShots::Auto,
                "growing" => ExpectedShots::Growing,
                _ => ExpectedShots::Given(settings.whole(
                    "variance_reduction_shots",
                    1,
                    1_000_000_000_000,
                )?),
            },
            constant: settings.choice(
                "constant_radiance",
                &[
                    ("off", ConstantRadiance::Off),
                    ("printed", ConstantRadiance::Printed),
                    ("corrected", ConstantRadiance::Corrected),
                ],
            )?,
            first_shot: settings.switch("first_shot")?,
            burn_in: settings.whole("burn_in", 0, 1_000_000)?,
        })
    }
}
