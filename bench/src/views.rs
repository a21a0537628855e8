//! What studies look at: the project's own scenes, and which pixels of them count.

use hemilux_charts::regions::Regions;
use hemilux_engine::scene::Scene;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};

/// How far from an edge between surfaces a pixel is "near" it, as a share of the picture's side.
const EDGE_REACH: f64 = 0.012;

/// One of the project's own scenes.
///
/// # Panics
/// Where it does not load.
pub fn imported(glb: &[u8]) -> Scene {
    import(glb, &Resources::new(), &ImportLimits::default()).expect("the project's own scenes load")
}

/// The regions of a square picture by the scene's first camera.
pub fn regions(scene: &Scene, side: u32, samples: u32) -> Regions {
    let reach = (EDGE_REACH * f64::from(side)).round().max(1.0) as u32;
    Regions::new(scene, &scene.cameras[0], (side, side), samples, reach)
}
