//! Settings of the methods by name, with their defaults and ranges.

use crate::patches::MAX_PATCHES;
use crate::render::RenderError;
use std::collections::BTreeMap;

/// One setting.
#[derive(Clone, Copy, Debug)]
pub struct OptionSpec {
    /// Name in `options` and after `--set`.
    pub name: &'static str,
    /// Default value.
    pub default: &'static str,
    /// What it does, with unit and range.
    pub meaning: &'static str,
}

/// Every setting.
pub const OPTIONS: &[OptionSpec] = &[
    OptionSpec {
        name: "hemicube_resolution",
        default: "256",
        meaning: "pixels along the top of the hemicube, even, 8 to 2048",
    },
    OptionSpec {
        name: "patches",
        default: "16000",
        meaning: "wanted number of surface patches, 1 to 4000000; at least one a triangle side",
    },
    OptionSpec {
        name: "pixel_samples",
        default: "16",
        meaning: "sub-pixel samples of the picture, 1 to 256",
    },
    OptionSpec {
        name: "random_azimuth",
        default: "true",
        meaning: "turn each hemicube about its normal by a random angle",
    },
    OptionSpec {
        name: "shots_per_iteration",
        default: "8",
        meaning: "shots K of one iteration, stratified by power, 1 to 64",
    },
    OptionSpec {
        name: "subpixel_jitter",
        default: "true",
        meaning: "move each hemicube's rays by a random fraction of a pixel",
    },
];

/// Settings in force: the request's over the defaults.
pub struct Settings {
    values: BTreeMap<String, String>,
}

impl Settings {
    /// Overlays `given` on the defaults.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a name that is not in [`OPTIONS`].
    pub fn new(given: &BTreeMap<String, String>) -> Result<Self, RenderError> {
        let mut values: BTreeMap<String, String> =
            OPTIONS.iter().map(|option| (option.name.into(), option.default.into())).collect();
        for (name, value) in given {
            match values.get_mut(name) {
                Some(slot) => slot.clone_from(value),
                None => {
                    let known: Vec<_> = OPTIONS.iter().map(|option| option.name).collect();
                    let what = format!("is not a setting; there are {known:?}");
                    return Err(RenderError::parameter(format!("options.{name}"), what));
                }
            }
        }
        let settings = Self { values };
        settings.stochastic()?;
        Ok(settings)
    }

    /// All settings in force by name.
    pub fn values(&self) -> &BTreeMap<String, String> {
        &self.values
    }

    /// The settings of stochastic iteration, checked.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn stochastic(&self) -> Result<StochasticSettings, RenderError> {
        let settings = StochasticSettings {
            hemicube_resolution: self.whole("hemicube_resolution", 8, 2048)? as u32,
            patches: self.whole("patches", 1, MAX_PATCHES as u64)? as usize,
            pixel_samples: self.whole("pixel_samples", 1, 256)? as u32,
            random_azimuth: self.switch("random_azimuth")?,
            shots_per_iteration: self.whole("shots_per_iteration", 1, 64)? as u32,
            subpixel_jitter: self.switch("subpixel_jitter")?,
        };
        if !settings.hemicube_resolution.is_multiple_of(2) {
            return Err(RenderError::parameter("options.hemicube_resolution", "must be even"));
        }
        Ok(settings)
    }

    fn whole(&self, name: &str, low: u64, high: u64) -> Result<u64, RenderError> {
        let value = &self.values[name];
        value.parse().ok().filter(|number| (low..=high).contains(number)).ok_or_else(|| {
            let what = format!("must be a whole number from {low} to {high}, not {value:?}");
            RenderError::parameter(format!("options.{name}"), what)
        })
    }

    fn switch(&self, name: &str) -> Result<bool, RenderError> {
        let value = &self.values[name];
        match value.as_str() {
            "true" | "on" | "yes" | "1" => Ok(true),
            "false" | "off" | "no" | "0" => Ok(false),
            _ => {
                let what = format!("must be true or false, not {value:?}");
                Err(RenderError::parameter(format!("options.{name}"), what))
            }
        }
    }
}

/// Checked settings of stochastic iteration; see [`OPTIONS`] for their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct StochasticSettings {
    pub hemicube_resolution: u32,
    pub patches: usize,
    pub pixel_samples: u32,
    pub random_azimuth: bool,
    pub shots_per_iteration: u32,
    pub subpixel_jitter: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_settings_are_named() {
        for (name, value) in [
            ("patches", "0"),
            ("patches", "many"),
            ("hemicube_resolution", "33"),
            ("hemicube_resolution", "4096"),
            ("random_azimuth", "perhaps"),
            ("colour", "blue"),
        ] {
            let given = BTreeMap::from([(name.to_string(), value.to_string())]);
            let error = Settings::new(&given).err().expect("must be refused").to_string();
            assert!(error.starts_with(&format!("options.{name}: ")), "{error}");
        }
    }
}
