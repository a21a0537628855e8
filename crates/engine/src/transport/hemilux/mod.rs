//! The three tiers: solve coarsely, gather smoothly, light exactly.
//!
//! 1. *Solve*: links between the patches of a coarse mesh carry the light of the scene.
//! 2. *Gather*: at records on what the camera sees, rays over the hemisphere turn that solution
//!    into smooth indirect irradiance.
//! 3. *Light*: the emitters' own light is found per pixel, in closed form but for the share that
//!    shadow rays find blocked.
//!
//! Each iteration makes all three better. What an iteration does depends on its number alone, so
//! the same iterations give the same bits, whatever the number of threads.

mod audit;
mod balance;
mod beginning;
mod clock;
mod coarse;
mod crowd_bake;
mod direct;
mod draft;
mod effort;
mod estimate;
mod focus;
mod fragments;
mod gather;
mod gloss;
mod instance_pixels;
mod link_noise;
mod pace;
mod places;
mod plan;
mod settings;
mod solver;

use super::job::Job;
use super::options::AnySetting;
use super::solver::{Extent, Method, Solver};
use crate::checkpoint::CheckpointError;
use crate::device::Device;
use crate::device::cpu::CpuDevice;
use crate::patches::{Cut, Focus};
use crate::rays::Rays;
use crate::render::RenderError;
use crate::sampling::Seed;
use crate::surface::World;
use beginning::{Begun, EarlierRuns, Foundations};
use clock::Clock;
use coarse::MOST_TRIANGLES;
use draft::Draft;
use effort::Effort;
use fragments::VisibleSurfaces;
use settings::HemiluxSettings;
use solver::{FIRST_RAYS_DECISION, TierInputs, TierOptions, Tiers};
use std::sync::Arc;

/// Name in checkpoints of a decision of the first run: wanted patches of the coarse mesh.
const PATCHES_DECISION: &str = "coarse_patches";
/// Name in checkpoints of a decision of the first run: what the patches are finest about.
const FOCUS_DECISION: &str = "focus";
/// Name in checkpoints of a decision of the first run: whether its coarse solution had better come soon.
const HASTE_DECISION: &str = "hasty";
/// Name in checkpoints of a decision of the first run: sub-pixel samples.
const SAMPLES_DECISION: &str = "pixel_samples";

/// The rendering method `hemilux`: solve coarsely, gather smoothly, light exactly.
pub struct Hemilux;

impl Method for Hemilux {
    fn name(&self) -> &'static str {
        "hemilux"
    }

    fn checkpoint_format(&self) -> u32 {
        29
    }

    fn summary(&self) -> &'static str {
        "a coarse solution over ray links, smooth final gathering, exact direct light"
    }

    fn settings(&self) -> Vec<&'static dyn AnySetting> {
        settings::SETTINGS.to_vec()
    }

    fn needed_bytes(&self, extent: &Extent<'_>) -> u64 {
        const PER_PIXEL: u64 = 440;
        const PER_TRIANGLE: u64 = 1500;
        // If all of them are seen and far apart.
        const PER_TRIANGLE_OF_CROWD: u64 = 600;
        // If all of it receives caustics on both sides.
        const PER_MAPPED_TRIANGLE: u64 = 1600;
        let [width, height] = extent.size.map(u64::from);
        let triangles = extent.triangles.kept;
        let asked = HemiluxSettings::new(extent.settings, 1).coarse_patches;
        let patches = asked.unwrap_or(Effort::MOST_PATCHES);
        let each = match Cut::is_crowd(triangles as usize, patches) {
            true => PER_TRIANGLE_OF_CROWD,
            false => PER_TRIANGLE,
        };
        let caustics = triangles.min(MOST_TRIANGLES as u64) * PER_MAPPED_TRIANGLE;
        let scene = Rays::needed_bytes(triangles) + triangles * each + caustics;
        scene + width * height * PER_PIXEL + extent.pyramid_bytes
    }

    fn begin<'a>(
        &self,
        job: &mut Job<'a>,
        _device: &'a mut dyn Device,
    ) -> Result<Option<Box<dyn Solver + 'a>>, RenderError> {
        let effort = Effort::new(job.request);
        let mut options = HemiluxSettings::new(&job.settings, effort.samples);
        decide(job, &mut options, effort)?;
        let in_haste = job.decide(HASTE_DECISION, effort.hasty)?;
        let first_rays = job.decide(FIRST_RAYS_DECISION, options.gather_rays)?;
        job.explain(plan::reasons(&job.request.scene, &options));
        let patches = options.coarse_patches.unwrap_or(effort.patches);
        let mut clock = Clock::default();
        let world = Arc::new(job.world());
        clock.lap("seconds_prepare");
        let size = [job.request.width, job.request.height];
        let focus = decide_focus(job, &world, size)?;
        // All of it is work for the processor, whatever the device.
        let computes = CpuDevice::describe_here().to_string();
        let cut = job.cut_with_all((patches, focus), computes, MOST_TRIANGLES);
        clock.lap("seconds_cut");
        let seed = Seed { number: job.request.seed, well_spread: options.well_spread };
        let mut past = job.past.take();
        let found = Foundations {
            world: &world,
            cut: &cut,
            patches,
            seed,
            options: &options,
            hasty: in_haste,
        };
        let (begun, earlier) = match &mut past {
            Some(past) => found.go_on(past, &mut clock)?,
            None => (found.begin(job, &mut clock), EarlierRuns::default()),
        };
        let Some(Begun { lights, coarse }) = begun else { return Ok(None) };
        let draft = Draft::of(job.request, job.run.seconds()).filter(|_| past.is_none());
        let size = draft.map_or(size, |draft| draft.size());
        let visible = VisibleSurfaces::new(&world, cut, &job.camera, size, options.samples);
        clock.lap("seconds_fragments");
        let inputs = TierInputs { world, lights, visible, coarse, camera: job.camera.clone() };
        let done = job.run.standing.tally.iterations;
        let hasty = effort.hasty;
        let tier_options = TierOptions { options, first_rays, seed, hasty, draft, done };
        let mut tiers = Tiers::new(inputs, tier_options, clock);
        tiers.reused_iterations = earlier.reused_iterations;
        if let Some(past) = past {
            tiers.restore_shared(past.shared)?;
            let goes_on = match past.bound {
                Some(bound) => tiers.restore_bound(bound)?,
                None => false,
            };
            if !goes_on {
                tiers.change_camera(earlier.iterations);
                job.run.standing.tally.iterations = 0;
            }
        }
        Ok(Some(Box::new(tiers)))
    }
}

/// How many patches and sub-pixel samples there are to be: as many as before, as were asked for, or
/// as are worth their time.
fn decide(
    job: &mut Job<'_>,
    options: &mut HemiluxSettings,
    effort: Effort,
) -> Result<(), RenderError> {
    let patches = job.decide(PATCHES_DECISION, effort.patches)?;
    options.coarse_patches = options.coarse_patches.or(Some(patches));
    // Another camera's picture has samples of its own.
    if let Some(past) = job.past.as_ref().filter(|past| past.bound.is_some()) {
        options.samples = past.decided(SAMPLES_DECISION)?;
    }
    job.run.owner.decide(SAMPLES_DECISION, &options.samples);
    Ok(())
}

/// What the patches are finest about: as before, or as the camera looks at it.
fn decide_focus(
    job: &mut Job<'_>,
    world: &World,
    size: [u32; 2],
) -> Result<Option<Focus>, RenderError> {
    let afresh = match &job.past {
        Some(_) => String::new(),
        None => focus::told(focus::find(world, &job.camera, size)),
    };
    let decided = job.decide(FOCUS_DECISION, afresh)?;
    let damaged = || CheckpointError::damaged("what its patches are finest about is no place");
    Ok(focus::parsed(&decided).ok_or_else(damaged)?)
}

#[cfg(test)]
mod specimen;
#[cfg(test)]
mod tests;
