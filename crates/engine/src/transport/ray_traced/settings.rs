//! Settings of ray tracing.

use crate::emitters::TriangleLights;
use crate::emitters::{DiskPoints, Disks};
use crate::sampling::{SparsePixels, Strata};
use crate::surface::World;
use crate::transport::options::{
    AnySetting, Choice, Number, Preset, Setting, Settings, Switch, Whole,
};

static PRESET: Setting<Choice<()>> =
    Setting::new("preset", "default", Choice(&[("default", ()), ("lange", ())]))
        .means(
            "default, or lange: what is not set otherwise is as Lange's importance sampling has it",
        )
        .formerly("ray_preset");
static PIXEL_SAMPLES: Setting<Whole> =
    Setting::new("pixel_samples", "16", Whole { low: 1, high: 256 }).unit("samples").means(
        "cells of a jittered pixel, one a pass, or most samples of an adaptive one in each pass",
    );
static PIXEL_SAMPLING: Setting<Choice<Way>> = Setting::new(
    "pixel_sampling",
    "jittered",
    Choice(&[
        ("independent", Way::Independent),
        ("jittered", Way::Jittered),
        ("adaptive", Way::Adaptive { fresh: false }),
        ("adaptive_fresh", Way::Adaptive { fresh: true }),
    ]),
)
.means("independent; jittered: stratified; adaptive: Dippé's adaptive rectangular jitter, biased as samples that decide about splits are kept; adaptive_fresh: the same cells with new samples, unbiased");
static ADAPTIVE_CONTRAST: Setting<Number> =
    Setting::new("adaptive_contrast", "0.3", Number { low: 0.0, high: 1.0 })
        .unit("Michelson contrast")
        .means("of adaptive pixel_sampling: a pixel's cells whose samples differ by more than this |a−b|/(a+b) are split");
static RAYS_PER_PIXEL: Setting<Whole> =
    Setting::new("rays_per_pixel", "1", Whole { low: 1, high: 4096 })
        .unit("rays")
        .means("rays N that leave the first surface: kd·N/(kd+ks) by the cosine, ks·N/(kd+ks) by the lobe, and N light samples; each goes on as one path");
static RAY_DEPTH: Setting<Whole> =
    Setting::new("ray_depth", "0", Whole { low: 0, high: 1_000_000 })
        .unit("reflections")
        .means("most reflections of a path: 1 is direct light only; 0 is no limit");
static LIGHT_SAMPLING: Setting<Choice<LightSampling>> = Setting::new(
    "light_sampling",
    "area",
    Choice(&[
        ("area", LightSampling::Area),
        ("disk", LightSampling::Disks(DiskPoints::Area)),
        ("rim", LightSampling::Disks(DiskPoints::Rim)),
    ]),
)
.means("area: points of the emissive triangles; disk, rim: each connected group of them as a disk, sampled over its area or along its edge, its centre weighted by cosⁿθ and the random points by 1 − cosⁿθ (Lange; biased)");
static PATH_STRATA: Setting<Switch> = Setting::new("path_strata", "true", Switch)
    .means("of jittered pixel_sampling with one ray a pixel: the light samples and directions of a pixel's paths at their first two surfaces are spread over as many cells as its samples are")
    .for_studies();
static PIXEL_SQUARES: Setting<Whole> =
    Setting::new("pixel_squares", "1", Whole { low: 1, high: 64 }).unit("pixels").means(
        "side of the squares of which one pixel each, at a random place, is traced; all others stay black. A picture is told how far it is off best by few pixels that have many paths",
    )
    .for_studies();

/// All of them.
pub static SETTINGS: &[&dyn AnySetting] = &[
    &PRESET,
    &PIXEL_SAMPLES,
    &PIXEL_SAMPLING,
    &ADAPTIVE_CONTRAST,
    &RAYS_PER_PIXEL,
    &RAY_DEPTH,
    &LIGHT_SAMPLING,
    &PATH_STRATA,
    &PIXEL_SQUARES,
];

/// Lange's importance sampling, as Rogers describes it.
pub static PRESETS: [Preset; 1] = [Preset {
    setting: "preset",
    value: "lange",
    brings: &[("light_sampling", "disk"), ("rays_per_pixel", "40")],
}];

/// How pixels are sampled, before the number of samples is known.
#[derive(Clone, Copy)]
enum Way {
    Independent,
    Jittered,
    Adaptive { fresh: bool },
}

/// Checked settings of ray tracing.
#[derive(Clone, Debug)]
pub struct RayTracedSettings {
    /// Most reflections of a path; `u32::MAX` without limit.
    pub reflections: u32,
    /// Rays N that leave the first surface of a path.
    pub rays_per_pixel: u32,
    /// How lights are sampled.
    pub light_sampling: LightSampling,
    /// How pixels are sampled.
    pub pixel_sampling: PixelSampling,
    /// Whether choices along paths are spread as the samples of their pixel are.
    pub path_strata: bool,
    /// Which pixels are traced.
    pub traced: SparsePixels,
}

/// How direct light is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightSampling {
    /// The emissive triangles, uniform over each; unbiased.
    Area,
    /// Lange's disks, uniform over each or along its edge; biased.
    Disks(DiskPoints),
}

/// Where in a pixel a pass sends its rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelSampling {
    /// One point, uniform.
    Independent,
    /// One point of another cell in each pass.
    Jittered(Strata),
    /// Dippé's adaptive rectangular jitter.
    Adaptive {
        /// Most levels of splits: 2^levels samples at most.
        levels: u32,
        /// Cells whose samples differ by more than this contrast are split.
        contrast: f32,
        /// Draw new samples for the cells that came out, instead of keeping those that decided
        /// about the splits: unbiased.
        fresh: bool,
    },
}

impl RayTracedSettings {
    /// Those in force.
    pub fn new(settings: &Settings) -> Self {
        let cells = settings.get(&PIXEL_SAMPLES) as u32;
        let limit = settings.get(&RAY_DEPTH) as u32;
        Self {
            reflections: if limit == 0 { u32::MAX } else { limit },
            path_strata: settings.get(&PATH_STRATA),
            traced: SparsePixels::new(settings.get(&PIXEL_SQUARES) as u32),
            rays_per_pixel: settings.get(&RAYS_PER_PIXEL) as u32,
            light_sampling: settings.get(&LIGHT_SAMPLING),
            pixel_sampling: match settings.get(&PIXEL_SAMPLING) {
                Way::Independent => PixelSampling::Independent,
                Way::Jittered => PixelSampling::Jittered(Strata::new(cells)),
                Way::Adaptive { fresh } => {
                    let contrast = settings.get(&ADAPTIVE_CONTRAST) as f32;
                    PixelSampling::Adaptive { levels: cells.ilog2(), contrast, fresh }
                }
            },
        }
    }

    /// What stands for the lights where they are sampled as disks.
    pub fn disks(&self, world: &World, lights: &TriangleLights) -> Option<(Disks, DiskPoints)> {
        match self.light_sampling {
            LightSampling::Area => None,
            LightSampling::Disks(points) => Some((Disks::new(world, lights), points)),
        }
    }

    /// Whether the choices of a pixel's paths are spread; N rays are stratified by themselves.
    pub fn spreads_paths(&self) -> bool {
        self.path_strata && self.rays_per_pixel == 1
    }

    /// Passes after which the sampling of a pixel repeats itself; their means are independent.
    pub fn period(&self) -> u32 {
        match self.pixel_sampling {
            PixelSampling::Jittered(strata) => strata.cells(),
            PixelSampling::Independent | PixelSampling::Adaptive { .. } => 1,
        }
    }
}
