//! Illumination maps (Arvo 1986, as Rogers prints them): rays from the lights, through mirrors and
//! clear bodies onto diffuse surfaces, are collected in maps on those; then a picture is traced
//! from the camera that reads them. It shows the caustics that patches miss.
//!
//! What is in the map ([`crate::transport::caustics`]), walks from the camera leave out after a
//! diffuse reflection, and bring all other light themselves. So nothing counts twice, and nothing is missing.
//!
//! Light rays come in showers, and camera passes in between; a pass reads the light of all showers
//! before it. The scatter of the passes says how far off the camera's walks are, and the difference
//! of two halves of the showers how far off the map is.

mod settings;

use super::checkpoints::Parts;
use super::job::{Announcement, Job};
use super::options::{AnySetting, Preset};
use super::run::Run;
use super::solver::{Estimate, Extent, Method, Solver, TargetChecks};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceError, Tally};
use crate::emitters::SceneLights;
use crate::image::Picture;
use crate::render::{RenderError, StopReason};
use crate::scene::Warning;
use crate::transport::caustics::{BLOCK, Casters, Charts, Lit, Maker};
use crate::transport::ray_traced::{
    self, Caustics, Film, RayTracedSettings, Steps, View, ray_figures, warnings,
};
use settings::{MOST_RAYS, MapSettings};
use std::collections::BTreeMap;

/// Rays of a shower, for one pass, in checkpoints.
const LIGHT_RAYS: &str = "light_rays";

/// Light rays into maps, and a camera pass that reads them.
pub struct IlluminationMap;

impl Method for IlluminationMap {
    fn name(&self) -> &'static str {
        "illumination-map"
    }

    fn checkpoint_format(&self) -> u32 {
        2
    }

    fn summary(&self) -> &'static str {
        "light rays through mirrors and glass into maps on diffuse surfaces, and path tracing from the camera that reads them: caustics"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        [settings::SETTINGS, ray_traced::SETTINGS].concat()
    }

    fn presets(&self) -> &'static [Preset] {
        &ray_traced::PRESETS
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        let cells = MapSettings::new(extent.settings).cells;
        ray_traced::needed_bytes(extent) + Charts::needed_bytes(2 * extent.triangles.all, cells)
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        let options = RayTracedSettings::new(&job.settings);
        let own = MapSettings::new(&job.settings);
        let world = job.world();
        let lights = SceneLights::new(&world);
        let casts = |lights: &SceneLights| Lit { world: &world, lights }.casts();
        let casts = lights.as_ref().is_some_and(casts);
        let casters = Casters::new(&world).filter(|_| casts);
        let mut warnings = warnings(&world, &options, &device.description());
        if casters.is_none() {
            warnings.push(Warning::new(
                "scene",
                "no light but the sky shines on what mirrors sharply or lets light through, so there are no caustics to map; ray-traced shows the same",
            ));
        }
        job.announce(Announcement {
            device: format!("{} (rays)", CpuDevice::describe_here().name),
            patches: 0,
            triangles: job.request.scene.triangle_count(),
            shines: lights.is_some(),
            warnings,
        });
        let Some(lights) = lights else { return Ok(None) };
        let view = View::new(job, world, lights, options);
        let pixels = u64::from(job.request.width) * u64::from(job.request.height);
        let count = own.light_rays.unwrap_or(pixels.clamp(BLOCK, MOST_RAYS));
        // Showers of another length than before would shoot some rays twice.
        let count = job.decide(LIGHT_RAYS, count)?.clamp(2, MOST_RAYS);
        let seed = job.request.seed;
        let mut maker =
            casters.map(|casters| Maker::new(lit(&view), casters, count, own.cells, seed));
        let mut film = view.film();
        if let Some(mut past) = job.past.take() {
            if let Some(maker) = &mut maker {
                maker.restore(&mut past.shared, past.bound.is_none())?;
            }
            past.shared.end()?;
            if let Some(mut bound) = past.bound {
                film.restore(&mut bound)?;
                bound.end()?;
            }
        }
        let steps = Steps::new(film.height());
        let checks = TargetChecks::after(film.passes());
        Ok(Some(Box::new(Showers { view, maker, film, steps, checks })))
    }
}

/// The scene of a view and its lights.
fn lit(view: &View) -> Lit<'_> {
    Lit { world: &view.world, lights: &view.lights }
}

/// Showers and passes at work.
struct Showers {
    view: View,
    /// What makes the map; `None` where there are no caustics.
    maker: Option<Maker>,
    film: Film,
    steps: Steps,
    checks: TargetChecks,
}

impl Solver for Showers {
    /// A block of light rays, where the next pass lacks some, or else rows of that pass.
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let pass = self.film.passes();
        match self.maker.as_mut().filter(|maker| maker.is_behind(pass)) {
            Some(maker) => {
                maker.advance(lit(&self.view));
            }
            None => {
                let map = self.maker.as_ref().map(|maker| &maker.map as &dyn Caustics);
                self.steps.advance(&mut self.film, &self.view.pixels(map), 1);
            }
        }
        let light_rays = self.maker.as_ref().map_or(0, |maker| maker.rays);
        run.standing.tally = Tally {
            iterations: self.film.passes(),
            shots: self.film.rays() + light_rays,
            light_shots: self.film.light_rays() + light_rays,
        };
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        self.film.passes() > 0
    }

    fn checks_target(&mut self, passes: u64) -> bool {
        self.checks.are_due(passes)
    }

    fn estimate(&mut self) -> Estimate {
        Estimate::of_batches(self.film.relative_error(), self.film.enough())
    }

    fn picture(&mut self) -> Picture {
        self.film.picture()
    }

    /// The map is for any camera, the film for its own.
    fn save(&mut self, parts: &mut Parts) -> Result<(), DeviceError> {
        if let Some(maker) = &self.maker {
            maker.save(&mut parts.shared);
        }
        self.film.save(&mut parts.bound);
        Ok(())
    }

    fn diagnostics(&self, run: &Run<'_>) -> BTreeMap<String, f64> {
        let mut figures = ray_figures(run);
        if let Some(maker) = &self.maker {
            maker.describe(&mut figures);
        }
        figures
    }
}
