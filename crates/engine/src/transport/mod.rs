//! Methods: who decides which shots to run, and when the picture is good enough. One trait, one
//! registry, one toolbox, so that a comparison of methods is fair.

mod bake;
mod batches;
mod hemilux;
mod illumination_map;
mod kept;
pub mod known;
pub mod options;
mod radiosity;
mod ray_traced;
mod run;
mod stage;
mod stochastic;
mod unseen;

use crate::device::Device;
use crate::render::{Begin, Observer, RenderError, RenderRequest, Rendered};

pub use options::OPTIONS;

/// A way to solve the light transport of a scene and take a picture of it.
pub trait Method: Sync {
    /// The name that requests use.
    fn name(&self) -> &'static str;

    /// The format of its checkpoints. One more whenever what it keeps is laid out otherwise or means
    /// something else, and whenever it would go on from it to other bits than before: with other
    /// random numbers, another order of sums, another default. Versions of the program with the
    /// same number read each other's checkpoints.
    fn checkpoint_format(&self) -> u32;

    /// One sentence on what it is.
    fn summary(&self) -> &'static str;

    /// Solves and measures until a limit is reached.
    ///
    /// # Errors
    /// See [`crate::render::render`].
    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError>;
}

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

/// Memory that a method takes at least, bytes, for so many triangles, wanted patches and a picture
/// of that size; `None` for names of no method. Of `auto`, which picks a method by the scene and the
/// memory that is free, it is that of the most modest one that it may pick.
pub fn needed_bytes(
    method: &str,
    triangles: u64,
    patches: u64,
    [width, height]: [u32; 2],
) -> Option<u64> {
    let of = |method| needed_bytes(method, triangles, patches, [width, height]);
    match method {
        "hemilux" => Some(hemilux::needed_bytes_for(triangles, width, height)),
        "ray-traced" | "illumination-map" => {
            Some(ray_traced::needed_bytes(triangles, width, height))
        }
        "stochastic" | "monte-carlo" | "progressive" => {
            Some(stage::needed_bytes(triangles, patches, width, height))
        }
        "gauss-seidel" => {
            let rest = stage::needed_bytes(triangles, patches, width, height);
            Some(rest.saturating_add(radiosity::matrix_bytes(patches.max(triangles))))
        }
        "auto" => ["hemilux", "stochastic", "illumination-map"].into_iter().filter_map(of).min(),
        _ => None,
    }
}

/// The method that `auto` stands for, and why.
fn pick(request: &RenderRequest) -> (&'static str, Vec<String>) {
    if unseen::lets_light_through(&request.scene) {
        let why = "illumination-map, because something lets light through, which only rays show";
        return ("illumination-map", vec![why.into()]);
    }
    let needed = hemilux::needed_bytes(&request.scene, request.width, request.height);
    if needed > crate::device::free_memory() / 2 {
        let why =
            "stochastic, because scene and picture are too large for the memory that hemilux takes";
        return ("stochastic", vec![why.into()]);
    }
    let why = "hemilux, which reached every accuracy first in the scenes that were compared";
    ("hemilux", vec![why.into()])
}

/// Runs a request with the method that it names; `auto` picks one and says why.
///
/// # Errors
/// See [`crate::render::render`].
pub fn run(
    device: &mut dyn Device,
    request: &RenderRequest,
    observer: &mut dyn Observer,
) -> Result<Rendered, RenderError> {
    request.check()?;
    let (name, mut reasons) = match (request.method.as_str(), &request.begin) {
        ("auto", Begin::Continue(past) | Begin::View(past)) => {
            (past.header().method.as_str(), vec!["the method is the one of before".into()])
        }
        ("auto", Begin::Afresh) => pick(request),
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
    method.render(device, request, reasons, observer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_registry_agree() {
        let registered = REGISTRY.iter().map(|method| method.name());
        assert!(std::iter::once("auto").chain(registered).eq(METHODS.iter().copied()));
    }
}
