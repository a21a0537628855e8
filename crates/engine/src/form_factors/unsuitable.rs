//! Why a route can't tell a form factor.

/// Why a route can't tell a form factor.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unsuitable {
    /// The polygon has no area, is not convex, not flat or not finite.
    #[error("a polygon needs three or more finite corners, flat and convex, with an area")]
    Polygon,
    /// There is no formula for this configuration.
    #[error("{0} has no formula for this configuration")]
    Configuration(&'static str),
    /// The route knows nothing of blockers.
    #[error("{0} knows no occlusion")]
    Occlusion(&'static str),
    /// The device that rasterises failed.
    #[error("the device failed: {0}")]
    Device(String),
}
