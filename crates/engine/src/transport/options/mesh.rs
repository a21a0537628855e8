//! Settings of patches and picture.

use super::values::Settings;
use crate::measurement::reconstruction::Smoothness;
use crate::patches::MAX_PATCHES;
use crate::render::RenderError;

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
    /// Reads the settings of patches and picture.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        Ok(Self {
            patches: settings.whole("patches", 1, MAX_PATCHES as u64)? as usize,
            pixel_samples: settings.whole("pixel_samples", 1, 256)? as u32,
            smoothness: settings.choice(
                "reconstruction",
                &[("smooth", Smoothness::Smooth), ("flat", Smoothness::Flat)],
            )?,
        })
    }
}
