//! Watching a render: an observer on the rendering thread that only counts and sends, and a task
//! beside it that encodes, stores and listens for a cancel, so that rendering never waits.

use super::checkpoints::{self, Costs, Ending, Pacing};
use crate::api;
use crate::api::jobs::{Job, Picture, PictureFormat, SnapshotRequest};
use crate::service::Service;
use crate::store::{Claim, Report, StoreError};
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::image::{self, Exposure, ImageError};
use hemilux_engine::render::{Observer, Plan, Progress};
use hemilux_engine::scene::Warning;
use hemilux_engine::scene::gltf::BakedMesh;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::time::{Duration, Instant};
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio::task::{JoinHandle, JoinSet};
use tokio_util::sync::CancellationToken;

/// Shortest time between two progress events.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(120);
/// How often events are written.
const FLUSH_INTERVAL: Duration = Duration::from_millis(200);
/// Snapshots after which the interval doubles.
const SNAPSHOTS_PER_OCTAVE: u32 = 100;

/// Why a render was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// It was not.
    No,
    /// The client cancelled.
    Cancel,
    /// The job was deleted, or another worker has it.
    ClaimLost,
}

/// Shared between the rendering thread and the task beside it.
#[derive(Default)]
struct Signals {
    stop: AtomicU8,
    encoding: AtomicBool,
}

impl Signals {
    fn stop(&self) -> Stop {
        match self.stop.load(Ordering::Relaxed) {
            0 => Stop::No,
            1 => Stop::Cancel,
            _ => Stop::ClaimLost,
        }
    }

    fn ask_to_stop(&self, stop: Stop) {
        // A lost claim outranks a cancel.
        self.stop.fetch_max(stop as u8, Ordering::Relaxed);
    }
}

enum Message {
    Planned(api::jobs::Plan, Vec<api::Warning>),
    Progress(api::jobs::Progress),
    Snapshot(image::Picture, api::jobs::Progress),
    Checkpoint(Box<Checkpoint>, Option<BakedMesh>),
}

/// The observer of one render.
pub struct Watcher {
    messages: mpsc::Sender<Message>,
    signals: Arc<Signals>,
    shutdown: CancellationToken,
    last_progress: Option<Instant>,
    latest: Option<api::jobs::Progress>,
    snapshots: Option<SnapshotRequest>,
    taken: u32,
    next_snapshot_s: f64,
    pacing: Pacing,
    /// What is known at the end.
    ending: Option<Ending>,
    /// A warning about what the job begins with.
    pub beginning: Option<api::Warning>,
}

impl Watcher {
    /// Begins to watch; the task ends, with everything stored, after the watcher is dropped.
    pub fn start(
        service: &Arc<Service>,
        runtime: &Handle,
        claim: Claim,
        job: &Job,
    ) -> (Self, JoinHandle<()>) {
        let (messages, receiver) = mpsc::channel(64);
        let signals = Arc::new(Signals::default());
        let snapshots = job.request.snapshots.clone();
        let pacing = Pacing::new(&service.config);
        let scribe = Scribe {
            service: service.clone(),
            claim,
            costs: pacing.costs.clone(),
            signals: signals.clone(),
            formats: snapshots.as_ref().map(|s| s.formats.clone()).unwrap_or_default(),
            pending: Report::default(),
            snapshots: JoinSet::new(),
        };
        let watcher = Self {
            messages,
            signals,
            shutdown: service.shutdown.clone(),
            last_progress: None,
            latest: None,
            next_snapshot_s: snapshots.as_ref().map_or(0.0, |s| s.every_s),
            snapshots,
            taken: 0,
            pacing,
            ending: None,
            beginning: None,
        };
        (watcher, runtime.spawn(scribe.run(receiver)))
    }

    /// Why the render was asked to stop, if it was.
    pub fn stop(&self) -> Stop {
        self.signals.stop()
    }

    /// Hands over what is known at the end of the attempt, to be kept.
    pub fn hand_over(&mut self) {
        if let Some(Ending { checkpoint, baked }) = self.ending.take() {
            let message = Message::Checkpoint(Box::new(checkpoint), baked);
            let _ = self.messages.blocking_send(message);
        }
    }

    /// The latest figures.
    pub fn latest(&self) -> Option<api::jobs::Progress> {
        self.latest.clone()
    }
}

impl Observer for Watcher {
    fn planned(&mut self, plan: &Plan, warnings: &[Warning]) {
        let warnings = warnings.iter().map(super::scenes::warning);
        let warnings = warnings.chain(self.beginning.clone()).collect();
        // The task only goes away together with the job.
        let _ = self.messages.blocking_send(Message::Planned(to_plan(plan), warnings));
    }

    fn progress(&mut self, progress: &Progress) {
        let progress = to_progress(progress);
        self.latest = Some(progress.clone());
        if self.last_progress.is_none_or(|at| at.elapsed() >= PROGRESS_INTERVAL) {
            self.last_progress = Some(Instant::now());
            // A full channel means that the store is slow; the next event says more.
            let _ = self.messages.try_send(Message::Progress(progress));
        }
    }

    fn wants_snapshot(&mut self, progress: &Progress) -> bool {
        self.snapshots.is_some()
            && progress.seconds >= self.next_snapshot_s
            && !self.signals.encoding.load(Ordering::Acquire)
    }

    fn snapshot(&mut self, picture: &image::Picture, progress: &Progress) {
        let Some(snapshots) = &self.snapshots else { return };
        self.taken += 1;
        let octave = (self.taken / SNAPSHOTS_PER_OCTAVE).min(32) as i32;
        self.next_snapshot_s = progress.seconds + snapshots.every_s * 2f64.powi(octave);
        self.signals.encoding.store(true, Ordering::Release);
        let message = Message::Snapshot(picture.clone(), to_progress(progress));
        let _ = self.messages.blocking_send(message);
    }

    fn wants_checkpoint(&mut self, _progress: &Progress) -> bool {
        self.pacing.is_due()
    }

    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        match self.stop() {
            Stop::ClaimLost => false,
            // Where the server shuts down, the next attempt goes on from here.
            Stop::No if self.shutdown.is_cancelled() => true,
            Stop::No | Stop::Cancel => self.pacing.keeps_solutions,
        }
    }

    fn most_checkpoint_bytes(&self) -> u64 {
        self.pacing.most_bytes
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        if self.pacing.made() {
            let message = Message::Checkpoint(Box::new(checkpoint), None);
            let _ = self.messages.blocking_send(message);
        } else {
            self.ending = Some(Ending { checkpoint, baked: None });
        }
    }

    fn wants_baked(&self) -> bool {
        self.ending.is_some() && !self.shutdown.is_cancelled()
    }

    fn baked(&mut self, mesh: BakedMesh) {
        if let Some(ending) = &mut self.ending {
            ending.baked = Some(mesh);
        }
    }

    fn cancelled(&self) -> bool {
        self.stop() != Stop::No || self.shutdown.is_cancelled()
    }
}

/// Writes down what a watcher sends.
struct Scribe {
    service: Arc<Service>,
    claim: Claim,
    costs: Arc<Costs>,
    signals: Arc<Signals>,
    formats: Vec<PictureFormat>,
    pending: Report,
    snapshots: JoinSet<()>,
}

impl Scribe {
    async fn run(mut self, mut messages: mpsc::Receiver<Message>) {
        let mut bell = self.service.bell.listen();
        let mut flush = tokio::time::interval(FLUSH_INTERVAL);
        flush.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut recheck = tokio::time::interval(Duration::from_secs(1));
        loop {
            tokio::select! {
                message = messages.recv() => match message {
                    Some(message) => self.take(message),
                    None => break,
                },
                _ = flush.tick() => self.flush().await,
                () = bell.news_of(self.claim.job) => self.look_for_cancel().await,
                _ = recheck.tick() => self.look_for_cancel().await,
            }
        }
        self.flush().await;
        while self.snapshots.join_next().await.is_some() {}
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Planned(plan, warnings) => self.pending.plan = Some((plan, warnings)),
            Message::Progress(progress) => self.pending.progress.push(progress),
            Message::Checkpoint(checkpoint, baked) => {
                let (service, claim) = (self.service.clone(), self.claim);
                let costs = self.costs.clone();
                self.snapshots.spawn(async move {
                    if let Err(error) =
                        checkpoints::keep(&service, claim, *checkpoint, baked, &costs).await
                    {
                        tracing::warn!(job = %claim.job, %error, "a checkpoint was lost");
                    }
                });
            }
            Message::Snapshot(picture, progress) => {
                let (service, claim) = (self.service.clone(), self.claim);
                let (signals, formats) = (self.signals.clone(), self.formats.clone());
                self.snapshots.spawn(async move {
                    if let Err(error) =
                        keep_snapshot(&service, claim, picture, progress, formats).await
                    {
                        tracing::warn!(job = %claim.job, %error, "a snapshot was lost");
                    }
                    signals.encoding.store(false, Ordering::Release);
                });
            }
        }
    }

    async fn flush(&mut self) {
        if self.pending.plan.is_none() && self.pending.progress.is_empty() {
            return;
        }
        let report = std::mem::take(&mut self.pending);
        match self.service.store.report(self.claim, report).await {
            Ok(cancel) => {
                if cancel {
                    self.signals.ask_to_stop(Stop::Cancel);
                }
                self.service.bell.ring(self.claim.job);
            }
            Err(StoreError::ClaimLost(_)) => self.signals.ask_to_stop(Stop::ClaimLost),
            Err(error) => tracing::error!(job = %self.claim.job, %error, "progress was lost"),
        }
    }

    async fn look_for_cancel(&mut self) {
        match self.service.store.job(self.claim.job).await {
            Ok(Some(job)) if job.cancel_requested => self.signals.ask_to_stop(Stop::Cancel),
            Ok(None) => self.signals.ask_to_stop(Stop::ClaimLost),
            Ok(Some(_)) => {}
            Err(error) => tracing::error!(job = %self.claim.job, %error, "cannot read the job"),
        }
    }
}

async fn keep_snapshot(
    service: &Service,
    claim: Claim,
    picture: image::Picture,
    progress: api::jobs::Progress,
    formats: Vec<PictureFormat>,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let pictures = keep_picture(service, claim, Arc::new(picture), formats).await?;
    let report = Report { snapshots: vec![(pictures, progress)], ..Report::default() };
    service.store.report(claim, report).await?;
    service.bell.ring(claim.job);
    Ok(())
}

/// Encodes a picture in each of the formats and stores the files.
pub async fn keep_picture(
    service: &Service,
    claim: Claim,
    picture: Arc<image::Picture>,
    mut formats: Vec<PictureFormat>,
) -> Result<Vec<Picture>, Box<dyn std::error::Error + Send + Sync>> {
    formats.sort_unstable();
    formats.dedup();
    let size = (picture.width, picture.height);
    let encoded = tokio::task::spawn_blocking(move || {
        let encode = |format| match format {
            PictureFormat::Png => picture.to_png(Exposure::Auto),
            PictureFormat::Exr => picture.to_exr(),
        };
        formats.into_iter().map(|f| Ok((f, encode(f)?))).collect::<Result<Vec<_>, ImageError>>()
    })
    .await??;
    let mut pictures = Vec::new();
    for (format, bytes) in encoded {
        pictures.push(service.artifacts.put_picture(claim.job, format, size, bytes).await?);
    }
    Ok(pictures)
}

/// JSON has no NaN; a figure that is none reads 0.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// The engine's progress in the API's words.
pub fn to_progress(progress: &Progress) -> api::jobs::Progress {
    api::jobs::Progress {
        iterations: progress.iterations,
        shots: progress.shots,
        light_source_selection_ratio: finite(progress.light_source_selection_ratio),
        estimated_error: progress.estimated_error.filter(|error| error.is_finite()),
        seconds: finite(progress.seconds),
        seconds_remaining: progress.seconds_remaining.filter(|seconds| seconds.is_finite()),
        fraction: finite(progress.fraction),
    }
}

fn to_plan(plan: &Plan) -> api::jobs::Plan {
    api::jobs::Plan {
        method: plan.method.clone(),
        reasons: plan.reasons.clone(),
        settings: plan.settings.clone(),
        patches: plan.patches,
        triangles: plan.triangles,
    }
}
