//! Settings of hemicubes that several methods share.

use super::setting::Setting;
use super::values::{Even, Whole};

/// R, of all methods that look through hemicubes.
pub static HEMICUBE_RESOLUTION: Setting<Even> =
    Setting::new("hemicube_resolution", "256", Even { low: 8, high: 2048 })
        .unit("pixels")
        .means("R along the top of the hemicube");
/// K, of the methods that shoot several hemicubes at once.
pub static SHOTS_PER_ITERATION: Setting<Whole> =
    Setting::new("shots_per_iteration", "8", Whole { low: 1, high: 64 })
        .unit("shots")
        .means("shots K of one iteration");
