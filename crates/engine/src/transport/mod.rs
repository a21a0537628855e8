//! Methods: who decides which shots to run, and when the picture is good enough. One trait, one
//! registry, one toolbox, so that a comparison of methods is fair.

mod bake;
mod batches;
mod budget;
mod caustics;
mod checkpoints;
mod driver;
mod hemilux;
mod illumination_map;
mod job;
pub mod known;
mod light_sums;
pub mod options;
mod own_light;
mod patch_points;
mod patchless;
mod prepared;
mod radiosity;
mod ray_traced;
mod registry;
mod run;
mod settled;
mod silhouette;
mod solver;
mod stochastic;
mod surroundings;
mod unseen;

use crate::device::Device;
use crate::render::{Begin, Observer, RenderError, RenderRequest, Rendered};
use crate::scene::Warning;
use crate::scene::pyramid::Pyramids;
use std::sync::Arc;

use job::Chosen;
pub use prepared::Prepared;
pub use registry::{
    Given, Listed, METHODS, REGISTRY, check_settings, find, listed, needed_bytes, relevant,
    settings,
};
use solver::Extent;
pub use solver::{Method, TriangleCount};

/// Checks everything of a request that needs neither the scene nor the device. What passes may still
/// name a camera that the scene does not have; nothing else of the request is refused later.
///
/// # Errors
/// [`RenderError::Parameter`] names the first parameter that is out of range.
pub fn check(request: &RenderRequest) -> Result<(), RenderError> {
    request.check()?;
    check_settings(&request.method, &request.options)
}

/// The method that `auto` stands for, and why.
fn pick(request: &RenderRequest) -> Result<(&'static str, Vec<String>), RenderError> {
    let triangles = TriangleCount::of(&request.scene);
    let size = [request.width, request.height];
    let (settings, _) = registry::in_force(&hemilux::Hemilux, "auto", &request.options)?;
    let pyramid_bytes = Pyramids::needed_bytes(&request.scene);
    let extent = Extent { triangles, pyramid_bytes, size, patchless: false, settings: &settings };
    let needed = hemilux::Hemilux.needed_bytes(&extent);
    if needed > crate::device::free_memory() / 2 {
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
    let prepared = Prepared::new(request.scene.clone());
    render_prepared(device, request, &prepared, observer)
}

/// The same picture, with what earlier jobs have made of the request's scene; what this one makes of it
/// stays there for the next.
///
/// # Errors
/// See [`render`].
///
/// # Panics
/// Where it is of another scene.
pub fn render_prepared(
    device: &mut dyn Device,
    request: &RenderRequest,
    prepared: &Prepared,
    observer: &mut dyn Observer,
) -> Result<Rendered, RenderError> {
    assert!(Arc::ptr_eq(prepared.scene(), &request.scene), "prepared for another scene");
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
    let method = registry::method(name)?;
    let (settings, unused) = registry::in_force(method, &request.method, &request.options)?;
    let unused = unused.into_iter().map(|key| {
        let what = format!("has no effect: {name}, which auto picked, has no such setting");
        Warning::new(format!("options.{key}"), what)
    });
    let chosen = Chosen {
        scope: method.scope(),
        checkpoint_format: method.checkpoint_format(),
        reasons,
        settings,
        warnings: unused.collect(),
    };
    driver::drive(method, chosen, device, (request, prepared), observer)
}
