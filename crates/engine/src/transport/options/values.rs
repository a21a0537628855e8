//! The settings in force.

use super::specs::{OPTIONS, PRESETS};
use crate::render::RenderError;
use std::collections::BTreeMap;

/// Settings in force: the request's over the preset's over the defaults.
pub struct Settings {
    values: BTreeMap<String, String>,
}

impl Settings {
    /// Overlays `given` on the preset that it names and on the defaults.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a name that is not in [`OPTIONS`]. Values are checked where
    /// they are read, and all of them by [`crate::transport::settings`].
    pub fn new(given: &BTreeMap<String, String>) -> Result<Self, RenderError> {
        let mut values: BTreeMap<String, String> =
            OPTIONS.iter().map(|option| (option.name.into(), option.default.into())).collect();
        for (setting, choice, brings) in PRESETS {
            if given.get(*setting).is_some_and(|value| value == choice) {
                values.extend(brings.iter().map(|(name, value)| ((*name).into(), (*value).into())));
            }
        }
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
        Ok(Self { values })
    }

    /// All settings in force by name.
    pub fn values(&self) -> &BTreeMap<String, String> {
        &self.values
    }

    /// A whole number in a range.
    pub(crate) fn whole(&self, name: &str, low: u64, high: u64) -> Result<u64, RenderError> {
        let value = &self.values[name];
        value.parse().ok().filter(|number| (low..=high).contains(number)).ok_or_else(|| {
            let what = format!("must be a whole number from {low} to {high}, not {value:?}");
            RenderError::parameter(format!("options.{name}"), what)
        })
    }

    /// A switch.
    pub(crate) fn switch(&self, name: &str) -> Result<bool, RenderError> {
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

    /// A number in a range.
    pub(crate) fn number(&self, name: &str, low: f64, high: f64) -> Result<f64, RenderError> {
        let value = &self.values[name];
        value.parse().ok().filter(|number| (low..=high).contains(number)).ok_or_else(|| {
            let what = format!("must be a number from {low} to {high}, not {value:?}");
            RenderError::parameter(format!("options.{name}"), what)
        })
    }

    /// What a word stands for.
    pub(crate) fn choice<T: Copy>(
        &self,
        name: &str,
        choices: &[(&str, T)],
    ) -> Result<T, RenderError> {
        let value = &self.values[name];
        let found = choices.iter().find(|(word, _)| word == value);
        found.map(|(_, meaning)| *meaning).ok_or_else(|| {
            let words: Vec<_> = choices.iter().map(|(word, _)| *word).collect();
            let what = format!("must be one of {words:?}, not {value:?}");
            RenderError::parameter(format!("options.{name}"), what)
        })
    }
}
