//! Settings of the three tiers.

use super::fragments::MOST_SAMPLES;
use crate::transport::options::{AnySetting, Setting, Settings, Switch, Whole, WholeOr};

static COARSE_PATCHES: Setting<WholeOr<Option<u64>>> = Setting::new(
    "coarse_patches",
    "auto",
    WholeOr { low: 1, high: 1_000_000, number: Some, words: &[("auto", None)] },
)
.unit("patches")
.means("wanted number of patches of the coarse mesh that gathers look at, at least one a triangle side; auto: 10000 to 30000, by the limits");
static GATHER_RAYS: Setting<Whole> =
    Setting::new("gather_rays", "64", Whole { low: 4, high: 65_536 }).unit("rays").means(
        "rays of a record in each iteration; fewer in the first ones where their noise is small",
    );
/// More than [`MOST_SAMPLES`] are taken as that many.
static PIXEL_SAMPLES: Setting<WholeOr<Option<u64>>> = Setting::new(
    "pixel_samples",
    "auto",
    WholeOr { low: 1, high: 256, number: Some, words: &[("auto", None)] },
)
.unit("samples")
.means("sub-pixel samples of the picture, at most 64 of them; auto: 8 to 64, by the limits and the size of the picture")
.default_was("16");

static ADAPTIVE: Setting<Switch> = Setting::new("adaptive", "true", Switch)
    .means(
        "gather where the light changes and cast shadow rays where they disagree; otherwise evenly",
    )
    .for_studies();
static COARSE_RAYS: Setting<Whole> =
    Setting::new("coarse_rays", "16", Whole { low: 4, high: 4096 })
        .unit("rays")
        .means("rays of a patch in each iteration")
        .for_studies();
static GATHER: Setting<Switch> = Setting::new("gather", "true", Switch)
    .means("gather indirect light at records on what the camera sees; otherwise it is shown as the coarse mesh has it")
    .for_studies();
static GATHER_DIRECT: Setting<Switch> = Setting::new("gather_direct", "true", Switch)
    .means("find the direct light afresh where gather rays end; otherwise it is as the coarse mesh has it")
    .for_studies();
static GATHER_FIT: Setting<Switch> = Setting::new("gather_fit", "true", Switch)
    .means("let each record hear its neighbours by a local linear fit")
    .for_studies();
static LIGHT: Setting<Switch> = Setting::new("light", "true", Switch)
    .means("direct light per pixel in closed form and by shadow rays; otherwise it is shown as the coarse mesh has it")
    .for_studies();
static LOBE_FILTER: Setting<Switch> = Setting::new("lobe_filter", "true", Switch)
    .means("neighbouring pixels share the rays of glossy lobes, as far as the lobes blur what they show")
    .for_studies();
static NEAR_FIELD: Setting<Switch> = Setting::new("near_field", "true", Switch)
    .means("where a gather ray ends nearer than two sides of a patch, look on by another ray; otherwise take the patch's mean")
    .for_studies();
static SHADOW_FILTER: Setting<Switch> = Setting::new("shadow_filter", "true", Switch)
    .means("neighbouring pixels share shadow rays while these are few")
    .for_studies();
static WELL_SPREAD: Setting<Switch> = Setting::new("well_spread", "true", Switch)
    .means("draw points from well-spread sequences; otherwise plain random numbers")
    .for_studies();

/// The settings of the method `hemilux`, in the order in which they are listed.
pub static SETTINGS: &[&dyn AnySetting] = &[
    &COARSE_PATCHES,
    &GATHER_RAYS,
    &PIXEL_SAMPLES,
    &ADAPTIVE,
    &COARSE_RAYS,
    &GATHER,
    &GATHER_DIRECT,
    &GATHER_FIT,
    &LIGHT,
    &LOBE_FILTER,
    &NEAR_FIELD,
    &SHADOW_FILTER,
    &WELL_SPREAD,
];

/// Checked settings of the three tiers.
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
    /// Whether direct light is found afresh, by a shadow ray, where gather rays end.
    pub gather_direct: bool,
    /// Whether records are fitted by a plane through their neighbours.
    pub gather_fit: bool,
    /// Whether direct light is found per pixel, rather than shown as the coarse mesh has it.
    pub light: bool,
    /// Whether neighbouring pixels share shadow rays while these are few.
    pub shadow_filter: bool,
    /// Whether neighbouring pixels share lobe rays.
    pub lobe_filter: bool,
    /// Whether a gather ray that ends in the near field finds bounced light by one more ray.
    pub near_field: bool,
    /// Whether random points are well spread, rather than plainly random.
    pub well_spread: bool,
    /// Whether records and shadow rays go where they are needed, rather than being evenly spread.
    pub adaptive: bool,
    /// Sub-pixel samples.
    pub samples: u32,
}

impl HemiluxSettings {
    /// Those in force; `samples` are the sub-pixel samples where the job leaves them to the limits.
    pub fn new(settings: &Settings, samples: u32) -> Self {
        let asked = |wanted: u64| (wanted as u32).min(MOST_SAMPLES);
        Self {
            coarse_patches: settings.get(&COARSE_PATCHES).map(|patches| patches as usize),
            coarse_rays: settings.get(&COARSE_RAYS) as u32,
            gather: settings.get(&GATHER),
            gather_rays: settings.get(&GATHER_RAYS) as u32,
            gather_direct: settings.get(&GATHER_DIRECT),
            gather_fit: settings.get(&GATHER_FIT),
            light: settings.get(&LIGHT),
            shadow_filter: settings.get(&SHADOW_FILTER),
            lobe_filter: settings.get(&LOBE_FILTER),
            near_field: settings.get(&NEAR_FIELD),
            well_spread: settings.get(&WELL_SPREAD),
            adaptive: settings.get(&ADAPTIVE),
            samples: settings.get(&PIXEL_SAMPLES).map_or(samples, asked),
        }
    }
}
