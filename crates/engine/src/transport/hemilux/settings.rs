//! Checked settings of the three tiers.

use crate::render::RenderError;
use crate::transport::options::Settings;

/// Checked settings of `hemilux`; see [`crate::transport::OPTIONS`] for their meaning.
#[derive(Clone, Copy, Debug)]
pub struct HemiluxSettings {
    /// Wanted patches of the coarse mesh; `None` to go by the limits.
    pub coarse_patches: Option<usize>,
    /// Rays of a patch in each iteration.
    pub coarse_rays: u32,
    /// Whether indirect light is gathered, rather than shown as the coarse mesh has it.
    pub gather: bool,
    /// Rays of a record in each iteration.
    pub gather_rays: u32,
    /// Whether direct light is found out afresh where gather rays end.
    pub gather_direct: bool,
    /// Whether records hear their neighbours.
    pub gather_fit: bool,
    /// Whether direct light is found per pixel, rather than shown as the coarse mesh has it.
    pub light: bool,
    /// Whether neighbouring pixels share shadow rays while these are few.
    pub shadow_filter: bool,
    /// Whether neighbouring pixels share lobe rays.
    pub lobe_filter: bool,
    /// Whether what gather rays meet nearby is looked at more closely than by its patch's mean.
    pub near_field: bool,
    /// Whether random points are well spread, rather than plainly random.
    pub well_spread: bool,
    /// Whether records and shadow rays follow what they find, rather than being evenly spread.
    pub adaptive: bool,
    /// Sub-pixel samples, where the request names them.
    pub samples: u32,
}

impl HemiluxSettings {
    /// Reads the settings of the three tiers.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        Ok(Self {
            coarse_patches: match settings.values()["coarse_patches"].as_str() {
                "auto" => None,
                _ => Some(settings.whole("coarse_patches", 1, 1_000_000)? as usize),
            },
            coarse_rays: settings.whole("coarse_rays", 4, 4096)? as u32,
            gather: settings.switch("gather")?,
            gather_rays: settings.whole("gather_rays", 4, 65_536)? as u32,
            gather_direct: settings.switch("gather_direct")?,
            gather_fit: settings.switch("gather_fit")?,
            light: settings.switch("light")?,
            shadow_filter: settings.switch("shadow_filter")?,
            lobe_filter: settings.switch("lobe_filter")?,
            near_field: settings.switch("near_field")?,
            well_spread: settings.switch("well_spread")?,
            adaptive: settings.switch("adaptive")?,
            samples: settings.whole("pixel_samples", 1, 256)?.min(64) as u32,
        })
    }
}
