//! Settings of patches and picture, of all methods that solve on patches.

use super::in_force::Settings;
use super::setting::{AnySetting, Setting};
use super::values::{Choice, Whole};
use crate::measurement::reconstruction::Smoothness;
use crate::patches::MAX_PATCHES;

static PATCHES: Setting<Whole> =
    Setting::new("patches", "16000", Whole { low: 1, high: MAX_PATCHES as u64 })
        .unit("patches")
        .means("wanted number of surface patches; at least one a triangle side");
static PIXEL_SAMPLES: Setting<Whole> =
    Setting::new("pixel_samples", "16", Whole { low: 1, high: 256 })
        .unit("samples")
        .means("sub-pixel samples of the picture");
static RECONSTRUCTION: Setting<Choice<Smoothness>> = Setting::new(
    "reconstruction",
    "smooth",
    Choice(&[("smooth", Smoothness::Smooth), ("flat", Smoothness::Flat)]),
)
.means("smooth: local linear fits through the patches' values; flat: each patch shows its value");

/// All of them.
pub static MESH: &[&dyn AnySetting] = &[&PATCHES, &PIXEL_SAMPLES, &RECONSTRUCTION];

/// Checked settings of patches and picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSettings {
    /// Wanted number of patches.
    pub patches: usize,
    /// Sub-pixel samples of the picture.
    pub pixel_samples: u32,
    /// How patch values become a picture.
    pub smoothness: Smoothness,
}

impl MeshSettings {
    /// Those in force.
    pub fn new(settings: &Settings) -> Self {
        Self {
            patches: settings.get(&PATCHES) as usize,
            pixel_samples: settings.get(&PIXEL_SAMPLES) as u32,
            smoothness: settings.get(&RECONSTRUCTION),
        }
    }
}
