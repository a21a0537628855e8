//! Runs jobs on one device, as many as the size of the study asks for.

use super::variants::Variant;
use crate::results::Failure;
use hemilux_engine::device::Device;
use hemilux_engine::render::{Limits, RenderRequest, Rendered, Unobserved};
use hemilux_engine::scene::Scene;
use hemilux_engine::transport::render;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Size {
    /// Width and height of pictures, pixels.
    pub(super) side: u32,
    /// Sub-pixel samples.
    pub(super) samples: u32,
    /// Wanted patches.
    pub(super) patches: u64,
    /// Hemicube resolution but for the algorithm exactly as printed.
    pub(super) resolution: u32,
    /// Shots of each half of a reference.
    pub(super) reference_shots: u64,
    /// Shots of the table of switches.
    pub(super) shots: &'static [u64],
    /// Seeds of the table of switches and of the studies of variance reduction, in a view of
    /// effort 1.
    pub(super) seeds: u64,
    /// Shots that the study of the slope spends on each of the lengths above, in as many runs as
    /// that needs, in a view of effort 1: errors have rare large parts, and short runs must get
    /// the same chance to meet them.
    pub(super) slope_shots: u64,
    /// Seeds of variants that start slowly, in scenes of many patches.
    pub(super) slow_seeds: u64,
    /// Shots of the efficiency study.
    pub(super) extra_shots: u64,
    /// Its seeds, in a view of effort 1.
    pub(super) extra_seeds: u64,
    /// Run lengths of the study of variance reduction.
    pub(super) reduction_shots: &'static [u64],
    /// Its values of M for runs of another length, …
    pub(super) fixed_m: &'static [u64],
    /// … which is this.
    pub(super) fixed_shots: u64,
    /// Iterations of the algorithm exactly as printed.
    pub(super) printed: &'static [u64],
    /// Its seeds.
    pub(super) printed_seeds: u64,
    /// Shots against the path-traced reference.
    pub(super) true_shots: &'static [u64],
}

impl Size {
    /// Seeds of the table of switches in a view that is worth so much effort.
    pub(super) fn seeds_of(&self, effort: f64) -> u64 {
        scaled(self.seeds, effort)
    }
}

pub(super) fn scaled(seeds: u64, effort: f64) -> u64 {
    ((seeds as f64 * effort).round() as u64).max(2)
}

pub(super) const FULL: Size = Size {
    side: 250,
    samples: 4,
    patches: 4000,
    resolution: 128,
    reference_shots: 16384,
    shots: &[256, 1024, 4096],
    seeds: 4,
    slope_shots: 16384,
    slow_seeds: 2,
    extra_shots: 512,
    extra_seeds: 16,
    reduction_shots: &[64, 256, 1024, 4096],
    fixed_m: &[64, 256, 1024, 4096],
    fixed_shots: 1024,
    printed: &[500, 600],
    printed_seeds: 2,
    true_shots: &[256, 1024, 4096, 16384],
};

pub(super) const QUICK: Size = Size {
    side: 125,
    reference_shots: 4096,
    shots: &[64, 256],
    seeds: 2,
    slope_shots: 1024,
    slow_seeds: 1,
    extra_shots: 256,
    extra_seeds: 4,
    reduction_shots: &[64, 256],
    fixed_m: &[64, 1024],
    fixed_shots: 256,
    printed: &[500],
    true_shots: &[256, 1024],
    ..FULL
};

/// Runs jobs on one device.
pub struct Bench {
    pub(super) device: Box<dyn Device>,
    pub(super) size: Size,
    pub(super) wanted: Vec<String>,
    pub(super) begun: Instant,
    pub(super) jobs: u64,
}

impl Bench {
    pub(super) fn wants_scene(&self, name: &str) -> bool {
        self.wanted.is_empty() || self.wanted.iter().any(|wanted| wanted == name)
    }

    pub(super) fn say(&self, what: &str) {
        eprintln!("{:6.1} s  {what}", self.begun.elapsed().as_secs_f64());
    }

    /// A job without limits, with the variant's options over those of all jobs.
    pub(super) fn job(
        &self,
        scene: &Arc<Scene>,
        side: u32,
        samples: u32,
        variant: &Variant,
    ) -> RenderRequest {
        let mut options = BTreeMap::from([
            ("hemicube_resolution".to_string(), self.size.resolution.to_string()),
            ("patches".into(), self.size.patches.to_string()),
            ("pixel_samples".into(), samples.to_string()),
        ]);
        if variant.is_printed() {
            options.remove("hemicube_resolution");
        }
        options.extend(variant.options.iter().map(|(n, v)| ((*n).to_string(), v.clone())));
        RenderRequest { options, ..RenderRequest::new(scene.clone(), "stochastic", [side; 2]) }
    }

    pub(super) fn render(
        &mut self,
        mut job: RenderRequest,
        iterations: u64,
    ) -> Result<Rendered, Failure> {
        job.limits = Limits::iterations(iterations);
        self.jobs += 1;
        Ok(render(self.device.as_mut(), &job, &mut Unobserved)?)
    }
}
