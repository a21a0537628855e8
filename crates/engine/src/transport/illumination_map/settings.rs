//! Settings of illumination maps, beside those of the rays that read them.

use crate::transport::options::{AnySetting, Setting, Settings, Whole, WholeOr};

/// Most rays from the lights for a pass.
pub const MOST_RAYS: u64 = 1 << 20;

static LIGHT_RAYS: Setting<WholeOr<Option<u64>>> = Setting::new(
    "light_rays",
    "auto",
    WholeOr { low: 2, high: MOST_RAYS, number: Some, words: &[("auto", None)] },
)
.unit("rays")
.means("rays from the lights for a pass; auto: as many as the picture has pixels, 4096 to 1048576. For small pictures they are shot for up to 16 passes at once");
static MAP_TEXELS: Setting<Whole> =
    Setting::new("map_texels", "1000000", Whole { low: 1, high: 1 << 24 })
        .unit("cells")
        .means("wanted number of cells of the map; at least one a diffuse triangle side, more where caustics are");

/// Those of the map.
pub static SETTINGS: &[&dyn AnySetting] = &[&LIGHT_RAYS, &MAP_TEXELS];

/// Checked settings of illumination maps.
#[derive(Clone, Copy, Debug)]
pub struct MapSettings {
    /// Rays from the lights a pass; `None` follows the picture's size.
    pub light_rays: Option<u64>,
    /// Cells of the map.
    pub cells: u64,
}

impl MapSettings {
    /// Those in force.
    pub fn new(settings: &Settings) -> Self {
        Self { light_rays: settings.get(&LIGHT_RAYS), cells: settings.get(&MAP_TEXELS) }
    }
}
