//! One setting of a method: its name, its values, what it does and whom it is for. It is said here
//! and nowhere else; the documents and forms that list settings are made from it.

use super::values::{Form, Values};

/// Whom a setting is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// Everyone: the API, the dashboard and the command line take it.
    Everyone,
    /// Studies of what a part of a method is worth: the command line and the benchmarks take it, the
    /// API does not.
    Studies,
}

/// A setting whose values are of the type `V`.
pub struct Setting<V> {
    entry: Entry,
    values: V,
}

/// What there is to say of a setting.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name within its method: the API's `options` and `--set` call it `METHOD.NAME`, or `NAME`
    /// where the job names its method.
    pub name: &'static str,
    /// Its default value.
    pub default: &'static str,
    /// What its numbers count or measure; empty where it has none.
    pub unit: &'static str,
    /// What it does.
    pub meaning: &'static str,
    /// Whom it is for.
    pub audience: Audience,
    /// The name that it had in earlier releases; it is still understood.
    pub former_name: Option<&'static str>,
    /// The default that it had in earlier releases, where that meant what the present one means.
    pub former_default: Option<&'static str>,
}

impl<V> Setting<V> {
    /// A setting for everyone.
    pub const fn new(name: &'static str, default: &'static str, values: V) -> Self {
        let entry = Entry {
            name,
            default,
            unit: "",
            meaning: "",
            audience: Audience::Everyone,
            former_name: None,
            former_default: None,
        };
        Self { entry, values }
    }

    /// What its numbers count or measure.
    pub const fn unit(mut self, unit: &'static str) -> Self {
        self.entry.unit = unit;
        self
    }

    /// What it does.
    pub const fn means(mut self, meaning: &'static str) -> Self {
        self.entry.meaning = meaning;
        self
    }

    /// The same for studies only.
    pub const fn for_studies(mut self) -> Self {
        self.entry.audience = Audience::Studies;
        self
    }

    /// What it was called.
    pub const fn formerly(mut self, name: &'static str) -> Self {
        self.entry.former_name = Some(name);
        self
    }

    /// What its default was called.
    pub const fn default_was(mut self, default: &'static str) -> Self {
        self.entry.former_default = Some(default);
        self
    }

    /// What its values are.
    pub fn values(&self) -> &V {
        &self.values
    }
}

/// A setting, whatever the type of its values.
pub trait AnySetting: Sync {
    /// What there is to say of it.
    fn entry(&self) -> Entry;

    /// What its values look like.
    fn form(&self) -> Form;

    /// Whether `text` is one of its values.
    fn takes(&self, text: &str) -> bool;
}

impl<V: Values> AnySetting for Setting<V> {
    fn entry(&self) -> Entry {
        self.entry
    }

    fn form(&self) -> Form {
        self.values.form()
    }

    fn takes(&self, text: &str) -> bool {
        self.values.read(text).is_some()
    }
}

/// Values that one value of a setting brings with it, for whatever is not set otherwise.
pub struct Preset {
    /// The setting.
    pub setting: &'static str,
    /// Its value.
    pub value: &'static str,
    /// Names and values of what that sets.
    pub brings: &'static [(&'static str, &'static str)],
}

/// All that a method can be set to.
pub struct Scope {
    /// The method's name.
    pub method: &'static str,
    /// Its settings, in the order in which they are listed.
    pub settings: Vec<&'static dyn AnySetting>,
    /// Its presets.
    pub presets: &'static [Preset],
}

impl Scope {
    /// The setting that a job of this method means by `key`: `NAME` or `METHOD.NAME`, or a name from
    /// earlier releases.
    pub fn find(&self, key: &str) -> Option<&'static dyn AnySetting> {
        let name = match key.split_once('.') {
            Some((method, name)) if method == self.method => name,
            Some(_) => return None,
            None => key,
        };
        let entry = |setting: &&'static dyn AnySetting| setting.entry();
        let by_name = self.settings.iter().find(|setting| entry(setting).name == name);
        let formerly =
            || self.settings.iter().find(|setting| entry(setting).former_name == Some(name));
        by_name.or_else(formerly).copied()
    }
}
