//! All methods, and what they can be set to. A job names a method, whose settings it may then call
//! by their names alone; or `auto`, which stands for one of several: then a setting counts if the
//! method that is picked has it, and must be one of at least one that may be picked.

use super::hemilux::Hemilux;
use super::illumination_map::IlluminationMap;
use super::options::{AnySetting, Audience, Entry, Form, Scope, Settings, check};
use super::radiosity::{GaussSeidel, MonteCarlo, Progressive};
use super::ray_traced::RayTraced;
use super::solver::{Extent, Method, TriangleCount};
use super::stochastic::Stochastic;
use crate::render::RenderError;
use std::collections::BTreeMap;

/// All methods by name.
pub const REGISTRY: &[&dyn Method] =
    &[&Stochastic, &MonteCarlo, &Progressive, &GaussSeidel, &RayTraced, &IlluminationMap, &Hemilux];

/// Names that a request may use for its method.
pub const METHODS: &[&str] = &[
    "auto",
    "stochastic",
    "monte-carlo",
    "progressive",
    "gauss-seidel",
    "ray-traced",
    "illumination-map",
    "hemilux",
];

/// The methods that `auto` may stand for.
const AUTO: [&str; 2] = ["hemilux", "stochastic"];

/// Settings as they are given: values by `NAME` or `METHOD.NAME`.
pub type Given = BTreeMap<String, String>;

/// The method of that name.
///
/// # Errors
/// [`RenderError::Parameter`] where there is none.
pub fn method(name: &str) -> Result<&'static dyn Method, RenderError> {
    REGISTRY.iter().find(|method| method.name() == name).copied().ok_or_else(|| {
        let what = format!("there is no method {name:?}; there are {METHODS:?}");
        RenderError::parameter("method", what)
    })
}

/// The methods that a job may get which asks for `name`.
fn candidates(name: &str) -> Result<Vec<&'static dyn Method>, RenderError> {
    let names = if name == "auto" { AUTO.as_slice() } else { &[name] };
    names.iter().map(|name| method(name)).collect()
}

/// One setting of one method, as documents and forms list it.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// The method.
    pub method: &'static str,
    /// What it is called within the method.
    pub name: &'static str,
    /// Its default value.
    pub default: &'static str,
    /// What its values look like.
    pub form: Form,
    /// What its numbers count or measure; empty where it has none.
    pub unit: &'static str,
    /// What it does.
    pub meaning: &'static str,
    /// Whether the API takes it; the command line takes those for studies, too.
    pub public: bool,
}

impl Listed {
    fn new(method: &'static str, setting: &dyn AnySetting) -> Self {
        let Entry { name, default, unit, meaning, audience, .. } = setting.entry();
        let public = audience == Audience::Everyone;
        Self { method, name, default, form: setting.form(), unit, meaning, public }
    }
}

/// Every setting of every method.
pub fn listed() -> Vec<Listed> {
    let of = |method: &&'static dyn Method| {
        let name = method.name();
        method.settings().into_iter().map(move |setting| Listed::new(name, setting))
    };
    REGISTRY.iter().flat_map(of).collect()
}

/// The setting that a job means by `key` which asks for that method; `None` where there is none.
pub fn find(asked: &str, key: &str) -> Option<Listed> {
    let found = |method: &&dyn Method| {
        let setting = method.scope().find(key)?;
        Some(Listed::new(method.name(), setting))
    };
    candidates(asked).ok()?.iter().find_map(found)
}

/// Puts a job's settings in force, which asked for `asked` and got this method; and says what it
/// gave that this method does not have, which only `auto` lets pass.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting that there is not or whose value is out of range.
pub fn in_force<'a>(
    method: &dyn Method,
    asked: &str,
    given: &'a Given,
) -> Result<(Settings, Vec<&'a str>), RenderError> {
    let scope = method.scope();
    if asked != "auto" {
        return Ok((Settings::new(&scope, given)?, Vec::new()));
    }
    check_settings(asked, given)?;
    let has = |key: &str, value: &str| scope.find(key).is_some_and(|setting| setting.takes(value));
    let (own, other): (Vec<_>, Vec<_>) = given.iter().partition(|(key, value)| has(key, value));
    let own = own.into_iter().map(|(key, value)| (key.clone(), value.clone())).collect();
    let other = other.into_iter().map(|(key, _)| key.as_str()).collect();
    Ok((Settings::new(&scope, &own)?, other))
}

/// Checks the settings of a job that asks for that method.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting that there is not or whose value is out of range.
pub fn check_settings(asked: &str, given: &Given) -> Result<(), RenderError> {
    let candidates = candidates(asked)?;
    if let [only] = candidates[..] {
        return Settings::new(&only.scope(), given).map(|_| ());
    }
    let scopes: Vec<Scope> = candidates.iter().map(|method| method.scope()).collect();
    for (key, value) in given {
        let found: Vec<&dyn AnySetting> =
            scopes.iter().filter_map(|scope| scope.find(key)).collect();
        let Some(first) = found.first() else {
            let what = format!("none of the methods that auto may pick has it; they are {AUTO:?}");
            return Err(RenderError::parameter(format!("options.{key}"), what));
        };
        if !found.iter().any(|setting| setting.takes(value)) {
            check(*first, key, value)?;
        }
    }
    Ok(())
}

/// The settings in force of a job that asks for that method, by name; of `auto`, of all methods
/// that it may pick, each as `METHOD.NAME`. Jobs that say the same in other words have the same.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting that there is not or whose value is out of range.
pub fn settings(asked: &str, given: &Given) -> Result<Given, RenderError> {
    let mut all = Given::new();
    for method in candidates(asked)? {
        let (settings, _) = in_force(method, asked, given)?;
        let values = settings.values().into_iter();
        all.extend(values.map(|(name, value)| match asked {
            "auto" => (format!("{}.{name}", method.name()), value),
            _ => (name, value),
        }));
    }
    Ok(all)
}

/// What of `given` a job has that asks for that method. Earlier releases took settings that the
/// method does not read, and left them without effect; jobs of theirs that are still to be done are
/// done without them.
pub fn relevant(asked: &str, given: &Given) -> Given {
    let Ok(candidates) = candidates(asked) else { return given.clone() };
    let scopes: Vec<Scope> = candidates.iter().map(|method| method.scope()).collect();
    let has = |key: &str| scopes.iter().any(|scope| scope.find(key).is_some());
    let relevant = given.iter().filter(|(key, _)| has(key));
    relevant.map(|(key, value)| (key.clone(), value.clone())).collect()
}

/// Memory that a job takes at its peak by a method with these settings, bytes, of a scene of so
/// many triangles without textures that surfaces light and a picture of that size. Of `auto`, which picks a method by the scene and the
/// memory that is free, it is that of the most modest one that it may pick.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting or a method that there is not, or a value out of range.
pub fn needed_bytes(
    asked: &str,
    given: &Given,
    triangles: impl Into<TriangleCount>,
    size: [u32; 2],
) -> Result<u64, RenderError> {
    let (mut least, triangles) = (u64::MAX, triangles.into());
    for method in candidates(asked)? {
        let (settings, _) = in_force(method, asked, given)?;
        let settings = &settings;
        let extent = Extent { triangles, pyramid_bytes: 0, size, patchless: false, settings };
        least = least.min(method.needed_bytes(&extent));
    }
    Ok(least)
}

#[cfg(test)]
mod tests {
    use super::super::options::Kind;
    use super::*;

    fn given(given: &[(&str, &str)]) -> Given {
        given.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
    }

    #[test]
    fn names_and_registry_agree() {
        let registered = REGISTRY.iter().map(|method| method.name());
        assert!(std::iter::once("auto").chain(registered).eq(METHODS.iter().copied()));
        assert!(AUTO.iter().all(|name| method(name).is_ok()));
    }

    #[test]
    fn settings_are_said_in_full() {
        for setting in listed() {
            let name = format!("{}.{}", setting.method, setting.name);
            assert!(!setting.meaning.is_empty(), "{name}");
            let counts = !matches!(setting.form.kind, Kind::Switch | Kind::Words);
            assert_eq!(counts, !setting.unit.is_empty(), "{name}");
            let same =
                |other: &&Listed| (other.method, other.name) == (setting.method, setting.name);
            assert_eq!(listed().iter().filter(same).count(), 1, "{name}");
        }
        for method in REGISTRY {
            let scope = method.scope();
            for setting in &scope.settings {
                let entry = setting.entry();
                assert!(setting.takes(entry.default), "{}.{}", scope.method, entry.name);
            }
            for preset in scope.presets {
                assert!(scope.find(preset.setting).expect("listed").takes(preset.value));
                for (name, value) in preset.brings {
                    assert!(scope.find(name).expect("listed").takes(value), "{name}");
                }
            }
        }
    }

    #[test]
    fn bad_settings_are_named() {
        for (method, name, value) in [
            ("stochastic", "patches", "0"),
            ("stochastic", "patches", "many"),
            ("stochastic", "hemicube_resolution", "33"),
            ("gauss-seidel", "hemicube_resolution", "4096"),
            ("stochastic", "hemicube_faces", "six"),
            ("stochastic", "random_azimuth", "perhaps"),
            ("stochastic", "variance_reduction_shots", "0"),
            ("stochastic", "preset", "Paper"),
            ("ray-traced", "ray_depth", "-1"),
            ("illumination-map", "adaptive_contrast", "NaN"),
            ("ray-traced", "pixel_sampling", "Jittered"),
            ("ray-traced", "rays_per_pixel", "0"),
            ("illumination-map", "light_rays", "none"),
            ("illumination-map", "map_texels", "0"),
            ("hemilux", "colour", "blue"),
            ("hemilux", "patches", "60"),
            ("hemilux", "ray-traced.ray_depth", "1"),
            ("auto", "colour", "blue"),
            ("auto", "ambient", "true"),
            ("auto", "ray-traced.ray_depth", "1"),
            ("auto", "patches", "0"),
            ("auto", "preset", "Paper"),
        ] {
            let error = check_settings(method, &given(&[(name, value)])).expect_err("refused");
            let error = error.to_string();
            assert!(error.starts_with(&format!("options.{name}: ")), "{method}: {error}");
        }
        assert!(check_settings("hemicube", &given(&[])).is_err());
    }

    #[test]
    fn auto_takes_what_one_of_its_methods_has() {
        let asked = given(&[("patches", "60"), ("hemilux.gather_rays", "8"), ("preset", "paper")]);
        check_settings("auto", &asked).expect("each is a setting of one of them");
        let of =
            |name: &str| in_force(method(name).expect("known"), "auto", &asked).expect("right");
        let (settings, others) = of("hemilux");
        assert_eq!(settings.values()["gather_rays"], "8");
        assert_eq!(others, ["patches", "preset"]);
        let (settings, others) = of("stochastic");
        assert_eq!(settings.values()["shots_per_iteration"], "1");
        assert_eq!(others, ["hemilux.gather_rays"]);
        // Lange's is the only preset of rays.
        assert_eq!(of("illumination-map").1, ["hemilux.gather_rays", "patches", "preset"]);
    }

    #[test]
    fn the_same_in_other_words_is_the_same() {
        let same = |method: &str, one: &[(&str, &str)], other: &[(&str, &str)]| {
            let settings = |words| settings(method, &given(words)).expect("right");
            assert_eq!(settings(one), settings(other), "{method}");
        };
        same("hemilux", &[("gather_rays", "64")], &[]);
        same("hemilux", &[("hemilux.gather_rays", "9")], &[("gather_rays", "9")]);
        same("ray-traced", &[("ray_preset", "lange")], &[("preset", "lange")]);
        same("auto", &[("patches", "60")], &[("stochastic.patches", "60")]);
        let auto = settings("auto", &given(&[("patches", "60")])).expect("right");
        assert_ne!(auto, settings("auto", &given(&[])).expect("right"));
        assert_eq!(auto["stochastic.patches"], "60");
    }

    #[test]
    fn what_had_no_effect_before_is_left_out_of_old_jobs() {
        let old = given(&[("patches", "60"), ("gather_rays", "8"), ("ray_preset", "default")]);
        assert_eq!(relevant("hemilux", &old), given(&[("gather_rays", "8")]));
        assert_eq!(relevant("stochastic", &old), given(&[("patches", "60")]));
        assert_eq!(relevant("ray-traced", &old), given(&[("ray_preset", "default")]));
        assert_eq!(relevant("auto", &old), given(&[("patches", "60"), ("gather_rays", "8")]));
    }
}
