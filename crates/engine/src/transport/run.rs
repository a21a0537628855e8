//! A job under way, whatever its method: clock, limits, counts, and who is told about them.

use super::bake::{bake, baked_bytes};
use super::kept::{Owner, Parts};
use crate::checkpoint::{Checkpoint, Writer};
use crate::device::{DeviceError, Tally};
use crate::image::Picture;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{Begin, Limits, Observer, Progress, RenderRequest, StopReason};
use std::time::Instant;

/// Least time between progress reports, seconds.
const REPORT_SECONDS: f64 = 0.2;

/// A job under way.
pub struct Run<'a> {
    start: Instant,
    /// Seconds that were spent before the start, by earlier attempts at the same job.
    spent: f64,
    /// Whose checkpoints this run makes.
    pub owner: Owner,
    /// A checkpoint was too large, so that no more are made.
    too_large: bool,
    limits: Limits,
    observer: &'a mut dyn Observer,
    reported: Instant,
    /// The last picture is part of the time budget: seconds that it will take.
    pub picture_seconds: f64,
    /// What was done so far.
    pub tally: Tally,
    /// Estimated rRMSE of the present picture.
    pub estimated_error: Option<f64>,
    /// Whether there is nothing to estimate the error from: the method can't, or every pixel sees
    /// an emitter or darkness. Then a target error alone does not end the job, the default time
    /// budget does.
    pub without_estimate: bool,
    /// Share of the work done, where the method knows it better than the limits do.
    pub known_fraction: Option<f64>,
}

impl<'a> Run<'a> {
    /// A run of `request` that started at `start`, or went on then.
    pub fn new(
        start: Instant,
        request: &RenderRequest,
        owner: Owner,
        observer: &'a mut dyn Observer,
    ) -> Self {
        let past = match &request.begin {
            Begin::Continue(past) => Some(past.header()),
            Begin::Afresh | Begin::View(_) => None,
        };
        Self {
            start,
            spent: past.map_or(0.0, |past| past.seconds),
            owner,
            too_large: false,
            limits: request.limits,
            observer,
            reported: Instant::now(),
            picture_seconds: 0.0,
            tally: past.map_or(Tally::default(), |past| Tally {
                iterations: past.iterations,
                shots: past.shots,
                light_shots: past.light_shots,
            }),
            estimated_error: past.and_then(|past| past.estimated_error),
            without_estimate: false,
            known_fraction: None,
        }
    }

    /// Seconds since solving began, in all attempts.
    pub fn seconds(&self) -> f64 {
        self.spent + self.start.elapsed().as_secs_f64()
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

    /// Bakes the solution, if that is wanted.
    pub fn bake(&mut self, scene: &PatchedScene, irradiance: impl FnOnce() -> Vec<Rgb>) {
        if self.observer.wants_baked()
            && baked_bytes(scene) <= self.observer.most_checkpoint_bytes()
        {
            let mesh = bake(scene, &irradiance());
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
        let header = self.owner.header(progress, self.tally.light_shots);
        let kept = (parts.shared.finish()).zip(parts.bound.finish());
        let kept = kept.map(|(shared, bound)| Checkpoint::new(header, shared, bound));
        match kept.filter(|checkpoint| checkpoint.size() <= most) {
            Some(checkpoint) => self.observer.checkpoint(checkpoint),
            None => self.too_large = true,
        }
        Ok(())
    }

    /// Why to stop now, if at all. At least one iteration is done, however little time there is.
    pub fn stop(&self) -> Option<StopReason> {
        if self.observer.cancelled() {
            return Some(StopReason::Cancelled);
        }
        let Limits { iterations, target_error, .. } = self.limits;
        if iterations.is_some_and(|limit| self.tally.iterations >= limit) {
            return Some(StopReason::Iterations);
        }
        if self.tally.iterations > 0
            && let Some(reason) = self.out_of_time()
        {
            return Some(reason);
        }
        let error = self.estimated_error?;
        target_error.is_some_and(|target| error <= target).then_some(StopReason::TargetError)
    }

    /// Which of the times only suffices for the last picture, if any does: the time budget, or the
    /// longest time that is allowed.
    fn out_of_time(&self) -> Option<StopReason> {
        let needed = self.seconds() + self.picture_seconds;
        let is_over = |limit: Option<f64>| limit.is_some_and(|limit| needed >= limit);
        if is_over(self.seconds_limit()) {
            Some(StopReason::TimeBudget)
        } else if is_over(self.limits.cap_seconds) {
            Some(StopReason::ServerLimit)
        } else {
            None
        }
    }

    /// Whether the job may end by the estimated error.
    pub fn wants_estimate(&self) -> bool {
        self.limits.target_error.is_some()
    }

    /// Iterations that the limit leaves.
    pub fn iterations_left(&self) -> u64 {
        let limit = self.limits.iterations.unwrap_or(u64::MAX);
        limit.saturating_sub(self.tally.iterations)
    }

    /// Whether it is time for a report.
    pub fn report_is_due(&self) -> bool {
        self.reported.elapsed().as_secs_f64() >= REPORT_SECONDS
    }

    /// Why to stop in the middle of an iteration, if at all.
    pub fn stop_early(&self) -> Option<StopReason> {
        if self.observer.cancelled() {
            return Some(StopReason::Cancelled);
        }
        self.out_of_time()
    }

    /// Reports before there is anything to see.
    pub fn report_progress(&mut self) {
        self.observer.progress(&self.progress());
        self.reported = Instant::now();
    }

    /// Reports; where there is something to see already, with a picture if one is wanted.
    pub fn report(&mut self, seen: bool, picture: impl FnOnce() -> Picture) {
        let progress = self.progress();
        self.observer.progress(&progress);
        if seen && self.observer.wants_snapshot(&progress) {
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

    /// The time budget: the asked one, or the default where nothing else would end the job.
    fn seconds_limit(&self) -> Option<f64> {
        let Limits { seconds, iterations, target_error, .. } = self.limits;
        let endless = target_error.is_none() || self.without_estimate;
        let unlimited = iterations.is_none() && endless;
        seconds.or(unlimited.then_some(Limits::DEFAULT_SECONDS))
    }

    fn progress(&self) -> Progress {
        let seconds = self.seconds();
        let Limits { iterations, target_error, .. } = self.limits;
        let Tally { iterations: done, shots, light_shots } = self.tally;
        let by_time = [self.seconds_limit(), self.limits.cap_seconds].into_iter().flatten();
        let by_time = by_time.reduce(f64::min).map(|limit| (limit - seconds).max(0.0));
        let by_iterations = iterations
            .filter(|_| done > 0)
            .map(|limit| seconds / done as f64 * limit.saturating_sub(done) as f64);
        // Noise falls with the square root of time.
        let by_error = target_error
            .zip(self.estimated_error)
            .map(|(target, error)| seconds * ((error / target).powi(2) - 1.0).max(0.0));
        let by_fraction = self
            .known_fraction
            .filter(|fraction| *fraction > 0.0)
            .map(|fraction| seconds * (1.0 / fraction - 1.0).max(0.0));
        let seconds_remaining =
            [by_time, by_iterations, by_error, by_fraction].into_iter().flatten().reduce(f64::min);
        Progress {
            iterations: done,
            shots,
            light_source_selection_ratio: light_shots as f64 / shots.max(1) as f64,
            estimated_error: self.estimated_error,
            seconds,
            seconds_remaining,
            fraction: seconds_remaining.map_or(0.0, |rest| seconds / (seconds + rest).max(1e-9)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{CameraChoice, Unobserved, choose_camera};
    use std::collections::BTreeMap;
    use std::sync::Arc;
    use std::time::Duration;

    #[test]
    fn a_target_that_cannot_be_estimated_ends_by_time() {
        let long_ago = Instant::now().checked_sub(Duration::from_secs(60)).expect("a minute ago");
        let request = RenderRequest {
            scene: Arc::default(),
            camera: CameraChoice::First,
            width: 1,
            height: 1,
            method: "auto".into(),
            limits: Limits { target_error: Some(0.05), ..Limits::default() },
            seed: 0,
            options: BTreeMap::new(),
            begin: Begin::Afresh,
        };
        let (camera, _) = choose_camera(&request.scene, &request.camera).expect("a camera");
        let owner = Owner::new(&request, "auto", &request.options, &camera);
        let mut observer = Unobserved;
        let mut run = Run::new(long_ago, &request, owner, &mut observer);
        run.tally.iterations = 1;
        assert_eq!(run.stop(), None, "an estimate may still come");
        run.without_estimate = true;
        assert_eq!(run.stop(), Some(StopReason::TimeBudget));
        run.limits.seconds = Some(120.0);
        assert_eq!(run.stop(), None, "a longer time was asked for");
        (run.estimated_error, run.without_estimate) = (Some(0.04), false);
        assert_eq!(run.stop(), Some(StopReason::TargetError));
        run.estimated_error = Some(0.06);
        run.limits.cap_seconds = Some(90.0);
        assert_eq!(run.stop(), None, "the cap is not reached");
        assert!(run.progress().seconds_remaining.is_some_and(|rest| rest <= 30.0));
        run.limits.cap_seconds = Some(30.0);
        assert_eq!(run.stop(), Some(StopReason::ServerLimit));
        run.limits.seconds = Some(20.0);
        assert_eq!(run.stop(), Some(StopReason::TimeBudget), "what was asked for goes first");
    }
}
