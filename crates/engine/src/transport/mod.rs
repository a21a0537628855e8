//! Methods: who decides which shots to run, and when the picture is good enough. One trait, one
//! registry, one toolbox, so that a comparison of methods is fair.

mod bake;
mod batches;
mod budget;
mod checkpoints;
mod driver;
mod hemilux;
mod illumination_map;
mod job;
pub mod known;
pub mod options;
mod radiosity;
mod ray_traced;
mod run;
mod solver;
mod stochastic;
mod unseen;

use crate::device::Device;
use crate::render::{Begin, Observer, RenderError, RenderRequest, Rendered};
use hemilux::HemiluxSettings;
use illumination_map::MapSettings;
use options::{MeshSettings, Settings};
use radiosity::RadiositySettings;
use ray_traced::RayTracedSettings;
use solver::Extent;
use std::collections::BTreeMap;
use stochastic::StochasticSettings;

pub use options::OPTIONS;
pub use solver::Method;

/// All methods by name.
pub const REGISTRY: &[&dyn Method] = &[
    &stochastic::Stochastic,
    &radiosity::MonteCarlo,
    &radiosity::Progressive,
    &radiosity::GaussSeidel,
    &ray_traced::RayTraced,
    &illumination_map::IlluminationMap,
    &hemilux::Hemilux,
];

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

/// The settings in force where these are given, all of them checked.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting that there is not or whose value is out of range.
pub fn settings(given: &BTreeMap<String, String>) -> Result<Settings, RenderError> {
    let settings = Settings::new(given)?;
    MeshSettings::new(&settings)?;
    StochasticSettings::new(&settings)?;
    RadiositySettings::new(&settings)?;
    RayTracedSettings::new(&settings)?;
    MapSettings::new(&settings)?;
    HemiluxSettings::new(&settings)?;
    Ok(settings)
}

/// Checks everything of a request that needs neither the scene nor the device. What passes may still
/// name a camera that the scene does not have; nothing else of the request is refused later.
///
/// # Errors
/// [`RenderError::Parameter`] names the first parameter that is out of range.
pub fn check(request: &RenderRequest) -> Result<(), RenderError> {
    request.check()?;
    if !METHODS.contains(&request.method.as_str()) {
        let what = format!("there is no method {:?}; there are {METHODS:?}", request.method);
        return Err(RenderError::parameter("method", what));
    }
    settings(&request.options)?;
    Ok(())
}

/// Memory that a job takes at its peak by a method with these settings, bytes, of a scene of so
/// many triangles and a picture of that size; `None` for names of no method. Of `auto`, which picks
/// a method by the scene and the memory that is free, it is that of the most modest one that it may
/// pick.
///
/// # Errors
/// [`RenderError::Parameter`] for a setting that there is not or whose value is out of range.
pub fn needed_bytes(
    method: &str,
    options: &BTreeMap<String, String>,
    triangles: u64,
    size: [u32; 2],
) -> Result<Option<u64>, RenderError> {
    let settings = settings(options)?;
    let extent = Extent { triangles, size, settings: &settings };
    let candidates = match method {
        "auto" => AUTO.as_slice(),
        _ => &[method],
    };
    let candidates = REGISTRY.iter().filter(|known| candidates.contains(&known.name()));
    let bytes = candidates.map(|method| method.needed_bytes(&extent));
    Ok(bytes.collect::<Result<Vec<_>, _>>()?.into_iter().min())
}

/// The methods that `auto` may stand for.
const AUTO: [&str; 3] = ["hemilux", "stochastic", "illumination-map"];

/// The method that `auto` stands for, and why.
fn pick(request: &RenderRequest) -> Result<(&'static str, Vec<String>), RenderError> {
    if unseen::lets_light_through(&request.scene) {
        let why = "illumination-map, because something lets light through, which only rays show";
        return Ok(("illumination-map", vec![why.into()]));
    }
    let triangles = request.scene.triangles.len() as u64;
    let size = [request.width, request.height];
    let needed = needed_bytes("hemilux", &request.options, triangles, size)?;
    if needed.is_none_or(|needed| needed > crate::device::free_memory() / 2) {
        let why =
            "stochastic, because scene and picture are too large for the memory that hemilux takes";
        return Ok(("stochastic", vec![why.into()]));
    }
    let why = "hemilux, which reached every accuracy first in the scenes that were compared";
    Ok(("hemilux", vec![why.into()]))
}

/// Renders one picture on `device`, with the method that the request names; `auto` picks one and
/// says why.
///
/// # Errors
/// [`RenderError::Parameter`] where the request cannot be met as asked, [`RenderError::Device`]
/// where the device failed or the job needs more memory than is free, [`RenderError::Checkpoint`]
/// where the job can't begin with what it names.
pub fn render(
    device: &mut dyn Device,
    request: &RenderRequest,
    observer: &mut dyn Observer,
) -> Result<Rendered, RenderError> {
    check(request)?;
    let (name, mut reasons) = match (request.method.as_str(), &request.begin) {
        ("auto", Begin::Continue(past) | Begin::View(past)) => {
            (past.header().method.as_str(), vec!["the method is the one of before".into()])
        }
        ("auto", Begin::Afresh) => pick(request)?,
        (name, _) => (name, vec![format!("{name} was asked for")]),
    };
    match &request.begin {
        Begin::Afresh => {}
        Begin::Continue(past) => {
            reasons.push(format!("goes on after {} iterations", past.header().iterations));
        }
        Begin::View(past) => reasons.push(format!(
            "begins with what another picture of the scene found out in {} iterations",
            past.header().iterations
        )),
    }
    let method = REGISTRY.iter().find(|method| method.name() == name).ok_or_else(|| {
        RenderError::parameter(
            "method",
            format!("there is no method {name:?}; there are {METHODS:?}"),
        )
    })?;
    driver::drive(*method, reasons, device, request, observer)
}

#[cfg(test)]
mod tests {
    use super::known::ConstantRadiance;
    use super::options::PRESETS;
    use super::*;

    fn given(given: &[(&str, &str)]) -> Result<Settings, RenderError> {
        settings(&given.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect())
    }

    #[test]
    fn names_and_registry_agree() {
        let registered = REGISTRY.iter().map(|method| method.name());
        assert!(std::iter::once("auto").chain(registered).eq(METHODS.iter().copied()));
    }

    #[test]
    fn bad_settings_are_named() {
        for (name, value) in [
            ("patches", "0"),
            ("patches", "many"),
            ("hemicube_resolution", "33"),
            ("hemicube_resolution", "4096"),
            ("hemicube_faces", "six"),
            ("random_azimuth", "perhaps"),
            ("variance_reduction_shots", "0"),
            ("preset", "Paper"),
            ("ray_depth", "-1"),
            ("adaptive_contrast", "NaN"),
            ("pixel_sampling", "Jittered"),
            ("rays_per_pixel", "0"),
            ("light_rays", "none"),
            ("map_texels", "0"),
            ("colour", "blue"),
        ] {
            let error = given(&[(name, value)]).err().expect("must be refused").to_string();
            assert!(error.starts_with(&format!("options.{name}: ")), "{error}");
        }
    }

    #[test]
    fn the_paper_is_a_preset_that_can_be_overridden() {
        let names: Vec<_> = OPTIONS.iter().map(|option| option.name).collect();
        assert!(names.is_sorted());
        for (setting, _, brings) in PRESETS {
            assert!(names.contains(setting));
            assert!(brings.iter().all(|(name, _)| names.contains(name)));
        }
        let paper = given(&[("preset", "paper")]).unwrap();
        let paper = StochasticSettings::new(&paper).unwrap();
        assert_eq!((paper.shooting.resolution, paper.shooting.shots_per_iteration), (600, 1));
        assert_eq!(paper.constant, ConstantRadiance::Printed);
        let mixed = given(&[("preset", "paper"), ("hemicube_resolution", "64")]).unwrap();
        assert_eq!(StochasticSettings::new(&mixed).unwrap().shooting.resolution, 64);
    }
}
