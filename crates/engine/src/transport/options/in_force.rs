//! The settings in force: the job's own over its preset's over the defaults, all of them checked.

use super::setting::{AnySetting, Audience, Scope, Setting};
use super::values::Values;
use crate::render::RenderError;
use std::collections::BTreeMap;

/// Checked settings of one method by name.
pub struct Settings {
    values: BTreeMap<&'static str, String>,
}

impl Settings {
    /// Overlays `given`, by name or by `METHOD.NAME`, on the preset that it names and on the
    /// defaults.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for what is no setting of this method, for a value out of range, and
    /// for a setting that is given twice under two names.
    pub fn new(scope: &Scope, given: &BTreeMap<String, String>) -> Result<Self, RenderError> {
        let mut own: BTreeMap<&'static str, &String> = BTreeMap::new();
        for (key, value) in given {
            let setting = scope.find(key).ok_or_else(|| unknown(scope, key))?;
            check(setting, key, value)?;
            let name = setting.entry().name;
            if own.insert(name, value).is_some_and(|other| other != value) {
                let what = format!("{name} is given twice, with different values");
                return Err(RenderError::parameter(format!("options.{key}"), what));
            }
        }
        let entries = scope.settings.iter().map(|setting| setting.entry());
        let mut values: BTreeMap<&'static str, String> =
            entries.map(|entry| (entry.name, entry.default.into())).collect();
        for preset in scope.presets {
            if own.get(preset.setting).is_some_and(|value| *value == preset.value) {
                values.extend(preset.brings.iter().map(|(name, value)| (*name, (*value).into())));
            }
        }
        values.extend(own.into_iter().map(|(name, value)| (name, value.clone())));
        Ok(Self { values })
    }

    /// The value of a setting.
    ///
    /// # Panics
    /// Where the method does not list the setting as its own.
    pub fn get<V: Values>(&self, setting: &Setting<V>) -> V::Value {
        let text = self.values.get(setting.entry().name).expect("the method lists it");
        setting.values().read(text).expect("checked when the settings were put in force")
    }

    /// All of them, by name.
    pub fn values(&self) -> BTreeMap<String, String> {
        self.values.iter().map(|(name, value)| ((*name).into(), value.clone())).collect()
    }
}

/// Checks one value of a setting that was given under the name `key`.
///
/// # Errors
/// [`RenderError::Parameter`] where it is out of range.
pub fn check(setting: &dyn AnySetting, key: &str, value: &str) -> Result<(), RenderError> {
    if setting.takes(value) {
        return Ok(());
    }
    let what = format!("must be {}, not {value:?}", setting.form());
    Err(RenderError::parameter(format!("options.{key}"), what))
}

fn unknown(scope: &Scope, key: &str) -> RenderError {
    let entries = scope.settings.iter().map(|setting| setting.entry());
    let public = entries.filter(|entry| entry.audience == Audience::Everyone);
    let names: Vec<_> = public.map(|entry| entry.name).collect();
    let what = format!("{} has no such setting; it has {names:?}", scope.method);
    RenderError::parameter(format!("options.{key}"), what)
}

#[cfg(test)]
mod tests {
    use super::super::setting::Preset;
    use super::super::values::{Switch, Whole};
    use super::*;

    static RAYS: Setting<Whole> =
        Setting::new("rays", "16", Whole { low: 1, high: 64 }).formerly("beams");
    static EVEN: Setting<Switch> = Setting::new("even", "true", Switch);

    fn scope() -> Scope {
        let few = Preset { setting: "even", value: "false", brings: &[("rays", "4")] };
        let presets = Box::leak(Box::new([few]));
        Scope { method: "made-up", settings: vec![&RAYS, &EVEN], presets }
    }

    fn settings(given: &[(&str, &str)]) -> Result<Settings, String> {
        let given = given.iter().map(|(name, value)| (name.to_string(), value.to_string()));
        Settings::new(&scope(), &given.collect()).map_err(|error| error.to_string())
    }

    #[test]
    fn the_jobs_own_come_before_the_presets_and_those_before_the_defaults() {
        let read = |given: &[(&str, &str)]| {
            let settings = settings(given).expect("they are right");
            (settings.get(&RAYS), settings.get(&EVEN))
        };
        assert_eq!(read(&[]), (16, true));
        assert_eq!(read(&[("even", "off")]), (16, false));
        assert_eq!(read(&[("even", "false")]), (4, false));
        assert_eq!(read(&[("even", "false"), ("rays", "9")]), (9, false));
        assert_eq!(read(&[("made-up.rays", "9")]), (9, true));
        assert_eq!(read(&[("beams", "9"), ("rays", "9")]), (9, true));
    }

    #[test]
    fn what_the_method_does_not_have_is_refused_by_the_name_that_was_given() {
        for (given, told) in [
            (&[("ray", "4")] as &[_], "options.ray: made-up has no such setting"),
            (&[("other.rays", "4")], "options.other.rays: made-up has no such setting"),
            (&[("rays", "0")], "options.rays: must be a whole number from 1 to 64, not \"0\""),
            (&[("made-up.even", "2")], "options.made-up.even: must be true or false"),
            (&[("beams", "4"), ("rays", "5")], "options.rays: rays is given twice"),
        ] {
            let error = settings(given).err().expect("must be refused");
            assert!(error.starts_with(told), "{error}");
        }
    }
}
