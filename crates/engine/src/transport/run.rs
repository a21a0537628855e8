//! A job under way: its clock, its budget, and who is told about it.

use super::budget::{Budget, Standing};
use super::checkpoints::{Owner, Parts};
use crate::checkpoint::{Checkpoint, Writer};
use crate::device::{DeviceError, Tally};
use crate::image::Picture;
use crate::render::{Begin, Observer, Progress, RenderRequest, StopReason};
use crate::scene::gltf::BakedMesh;
use std::time::Instant;

/// Least time between progress reports, seconds.
const REPORT_SECONDS: f64 = 0.2;

/// A job under way.
pub struct Run<'a> {
    start: Instant,
    /// Seconds that it took, once the last picture was there.
    ended: Option<f64>,
    /// Seconds that were spent before the start, by earlier attempts at the same job.
    spent: f64,
    budget: Budget,
    /// Where the job stands, but for the time, which is [`Run::seconds`].
    pub standing: Standing,
    /// Whose checkpoints this run makes.
    pub owner: Owner,
    /// Whether a checkpoint was too large, so that no more are made.
    too_large: bool,
    observer: &'a mut dyn Observer,
    reported: Instant,
}

impl<'a> Run<'a> {
    /// A run of `request` that started then, or went on then.
    pub fn new(
        (request, start): (&RenderRequest, Instant),
        owner: Owner,
        observer: &'a mut dyn Observer,
    ) -> Self {
        let past = match &request.begin {
            Begin::Continue(past) => Some(past.header()),
            Begin::Afresh | Begin::View(_) => None,
        };
        let standing = past.map_or(Standing::default(), |past| Standing {
            tally: Tally {
                iterations: past.iterations,
                shots: past.shots,
                light_shots: past.light_shots,
            },
            estimated_error: past.estimated_error,
            ..Standing::default()
        });
        Self {
            start,
            ended: None,
            spent: past.map_or(0.0, |past| past.seconds),
            budget: Budget::new(request.limits),
            standing,
            owner,
            too_large: false,
            observer,
            reported: Instant::now(),
        }
    }

    /// Seconds since solving began, in all attempts.
    pub fn seconds(&self) -> f64 {
        self.ended.unwrap_or_else(|| self.spent + self.start.elapsed().as_secs_f64())
    }

    /// Stops the clock: the last picture is there, and what comes after it is not solving.
    pub fn end(&mut self) {
        self.ended = Some(self.seconds());
    }

    /// Who watches.
    pub fn observer(&mut self) -> &mut dyn Observer {
        self.observer
    }

    /// Why to stop before another iteration, if at all.
    pub fn stop(&self) -> Option<StopReason> {
        match self.observer.cancelled() {
            true => Some(StopReason::Cancelled),
            false => self.budget.stop(&self.now()),
        }
    }

    /// Why to stop in the middle of an iteration, if at all.
    pub fn stop_early(&self) -> Option<StopReason> {
        match self.observer.cancelled() {
            true => Some(StopReason::Cancelled),
            false => self.budget.out_of_time(&self.now()),
        }
    }

    /// Seconds until the job is out of time, the last picture's not left out; `None` where no time ends
    /// it.
    pub fn seconds_left(&self) -> Option<f64> {
        self.budget.seconds_left(&self.now())
    }

    /// Whether the job may end by the estimated error.
    pub fn wants_estimate(&self) -> bool {
        self.budget.wants_estimate()
    }

    /// Iterations that are left of those asked for.
    pub fn iterations_left(&self) -> u64 {
        self.budget.iterations_left(&self.standing)
    }

    /// Whether it is time for a report.
    pub fn report_is_due(&self) -> bool {
        self.reported.elapsed().as_secs_f64() >= REPORT_SECONDS
    }

    /// Reports; where there is something to see already, with a picture if one is wanted.
    pub fn report(&mut self, is_visible: bool, picture: impl FnOnce() -> Picture) {
        let progress = self.progress();
        self.observer.progress(&progress);
        if is_visible && self.observer.wants_snapshot(&progress) {
            self.observer.snapshot(&picture(), &progress);
        }
        self.reported = Instant::now();
    }

    /// The last report.
    pub fn finish(&mut self) -> Progress {
        let last = Progress { fraction: 1.0, seconds_remaining: Some(0.0), ..self.progress() };
        self.observer.progress(&last);
        last
    }

    /// Makes a checkpoint of the present state, if one is wanted now.
    pub fn keep_if_wanted(
        &mut self,
        state: impl FnOnce(&mut Parts) -> Result<(), DeviceError>,
    ) -> Result<(), DeviceError> {
        if self.too_large {
            return Ok(());
        }
        let progress = self.progress();
        match self.observer.wants_checkpoint(&progress) {
            true => self.keep(&progress, state),
            false => Ok(()),
        }
    }

    /// Makes a checkpoint of the state at the end, if that is wanted.
    pub fn keep_solution(
        &mut self,
        state: impl FnOnce(&mut Parts) -> Result<(), DeviceError>,
    ) -> Result<(), DeviceError> {
        let progress = self.progress();
        match self.observer.wants_solution(&progress) {
            true => self.keep(&progress, state),
            false => Ok(()),
        }
    }

    /// Whether the solution is wanted as a mesh.
    pub fn wants_baked(&self) -> bool {
        self.observer.wants_baked()
    }

    /// Hands over the solution as a mesh, unless there is none or it would be too large.
    pub fn hand_over_baked(&mut self, bake: impl FnOnce(u64) -> Option<BakedMesh>) {
        if let Some(mesh) = bake(self.observer.most_checkpoint_bytes()) {
            self.observer.baked(mesh);
        }
    }

    fn keep(
        &mut self,
        progress: &Progress,
        state: impl FnOnce(&mut Parts) -> Result<(), DeviceError>,
    ) -> Result<(), DeviceError> {
        let most = self.observer.most_checkpoint_bytes();
        let mut parts = Parts { shared: Writer::new(most), bound: Writer::new(most) };
        state(&mut parts)?;
        let header = self.owner.header(progress, self.standing.tally.light_shots);
        let kept = (parts.shared.finish()).zip(parts.bound.finish());
        let kept = kept.map(|(shared, bound)| Checkpoint::new(header, shared, bound));
        match kept.filter(|checkpoint| checkpoint.size() <= most) {
            Some(checkpoint) => self.observer.checkpoint(checkpoint),
            None => self.too_large = true,
        }
        Ok(())
    }

    fn now(&self) -> Standing {
        Standing { seconds: self.seconds(), ..self.standing }
    }

    fn progress(&self) -> Progress {
        self.budget.progress(&self.now())
    }
}
