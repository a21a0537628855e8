//! Checked settings of ray tracing.

use crate::emitters::TriangleLights;
use crate::emitters::{DiskPoints, Disks};
use crate::render::RenderError;
use crate::sampling::Strata;
use crate::surface::World;
use crate::transport::options::Settings;

/// Checked settings of ray tracing; see [`crate::transport::OPTIONS`] for their meaning.
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
    /// Reads the settings of ray tracing.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        settings.choice("ray_preset", &[("default", ()), ("lange", ())])?;
        let cells = settings.whole("pixel_samples", 1, 256)? as u32;
        let adaptive = |fresh| -> Result<_, RenderError> {
            let contrast = settings.number("adaptive_contrast", 0.0, 1.0)? as f32;
            Ok(PixelSampling::Adaptive { levels: cells.ilog2(), contrast, fresh })
        };
        let (printed, fresh) = (adaptive(false)?, adaptive(true)?);
        let limit = settings.whole("ray_depth", 0, 1_000_000)? as u32;
        Ok(Self {
            reflections: if limit == 0 { u32::MAX } else { limit },
            path_strata: settings.switch("path_strata")?,
            rays_per_pixel: settings.whole("rays_per_pixel", 1, 4096)? as u32,
            light_sampling: settings.choice(
                "light_sampling",
                &[
                    ("area", LightSampling::Area),
                    ("disk", LightSampling::Disks(DiskPoints::Area)),
                    ("rim", LightSampling::Disks(DiskPoints::Rim)),
                ],
            )?,
            pixel_sampling: settings.choice(
                "pixel_sampling",
                &[
                    ("independent", PixelSampling::Independent),
                    ("jittered", PixelSampling::Jittered(Strata::new(cells))),
                    ("adaptive", printed),
                    ("adaptive_fresh", fresh),
                ],
            )?,
        })
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
