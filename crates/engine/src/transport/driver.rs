//! The course of every job, whatever its method: what fits into memory begins, a solver advances
//! step by step until the budget is used, and who watches hears of it.

use super::job::{Chosen, Job};
use super::options::Settings;
use super::patchless;
use super::prepared::Prepared;
use super::run::Run;
use super::silhouette;
use super::solver::{Estimate, Extent, Method, Solver, TriangleCount};
use super::surroundings::most_around;
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceError, free_memory};
use crate::emitters::SkyLight;
use crate::image::Picture;
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::scene::pyramid::Pyramids;
use std::collections::BTreeMap;
use std::time::Instant;

/// Pause between estimates of the error, in times of what the last one took: with millions of
/// patches or pixels one takes longer than a step.
const ESTIMATE_PAUSE: f64 = 10.0;

/// Does a job by a method, chosen and set as it says, with what is made of its scene already.
///
/// # Errors
/// See [`crate::transport::render`].
pub fn drive<'a>(
    method: &dyn Method,
    chosen: Chosen,
    device: &'a mut dyn Device,
    asked: (&'a RenderRequest, &'a Prepared),
    observer: &'a mut dyn Observer,
) -> Result<Rendered, RenderError> {
    admit(method, asked.0, &chosen.settings)?;
    let mut job = Job::new(chosen, asked, observer)?;
    let Some(mut solver) = method.begin(&mut job, device)? else {
        let unlit = silhouette::picture(&job);
        return Ok(job.rendered((unlit, StopReason::NoLight), BTreeMap::new()));
    };
    let result = solve(&mut *solver, &mut job.run)?;
    let diagnostics = solver.diagnostics(&job.run);
    drop(solver);
    Ok(job.rendered(result, diagnostics))
}

/// Refuses what would not fit into memory before anything is allocated.
fn admit(
    method: &dyn Method,
    request: &RenderRequest,
    settings: &Settings,
) -> Result<(), RenderError> {
    let RenderRequest { scene, width, height, .. } = request;
    let triangles = TriangleCount::of(scene);
    // Whether lamps light the scene is told by rays, which take the memory that light of no patch does.
    let environment = most_around(request);
    let patchless = patchless::shines(scene, &environment);
    let size = [*width, *height];
    let pyramid_bytes = Pyramids::needed_bytes(scene);
    let extent = Extent { triangles, pyramid_bytes, size, patchless, settings };
    let needed_bytes = method.needed_bytes(&extent) + SkyLight::needed_bytes(&environment);
    let available_bytes = free_memory();
    if needed_bytes > available_bytes {
        let device = CpuDevice::describe().id;
        return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes }.into());
    }
    Ok(())
}

/// Advances until the budget is used; the last picture, and why it ended.
fn solve(solver: &mut dyn Solver, run: &mut Run<'_>) -> Result<(Picture, StopReason), RenderError> {
    let mut pause = Pause { since: Instant::now(), seconds: 0.0 };
    let stopped = loop {
        if let Some(reason) = solver.finished().or_else(|| run.stop()) {
            break reason;
        }
        if let Some(reason) = solver.advance(run)? {
            break reason;
        }
        let asked = run.wants_estimate() && solver.checks_target(run.standing.tally.iterations);
        if asked || (run.report_is_due() && pause.is_over() && solver.has_news()) {
            let began = Instant::now();
            estimate(solver, run);
            pause = Pause {
                since: Instant::now(),
                seconds: ESTIMATE_PAUSE * began.elapsed().as_secs_f64(),
            };
        }
        if run.report_is_due() {
            run.report(solver.is_visible(), || solver.picture());
        }
        run.keep_if_wanted(|parts| solver.save(parts))?;
    };
    run.keep_solution(|parts| solver.save(parts))?;
    solver.settle()?;
    estimate(solver, run);
    let picture = solver.picture();
    run.end();
    if run.wants_baked() {
        run.hand_over_baked(|most_bytes| solver.baked(most_bytes));
    }
    Ok((picture, stopped))
}

/// Time in which no estimate is made.
struct Pause {
    since: Instant,
    seconds: f64,
}

impl Pause {
    fn is_over(&self) -> bool {
        self.since.elapsed().as_secs_f64() >= self.seconds
    }
}

fn estimate(solver: &mut dyn Solver, run: &mut Run<'_>) {
    let estimate = solver.estimate();
    run.standing.without_estimate = estimate == Estimate::Never;
    run.standing.estimated_error = match estimate {
        Estimate::Error(error) => Some(error),
        Estimate::NotYet | Estimate::Never => None,
    };
    run.standing.error_bounds = solver.error_bounds();
}
