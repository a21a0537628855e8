//! Checked settings of illumination maps.

use crate::render::RenderError;
use crate::transport::options::Settings;

/// Most rays from the lights for a pass.
pub const MOST_RAYS: u64 = 1 << 20;

/// Checked settings of illumination maps; see [`crate::transport::OPTIONS`] for their meaning.
#[derive(Clone, Copy, Debug)]
pub struct MapSettings {
    /// Rays from the lights a pass; `None` follows the picture's size.
    pub light_rays: Option<u64>,
    /// Cells of the map.
    pub cells: u64,
}

impl MapSettings {
    /// Reads the settings of illumination maps.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        let light_rays = match settings.values()["light_rays"].as_str() {
            "auto" => None,
            _ => Some(settings.whole("light_rays", 2, MOST_RAYS)?),
        };
        Ok(Self { light_rays, cells: settings.whole("map_texels", 1, 1 << 24)? })
    }
}
