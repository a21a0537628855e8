//! The engine's side of the line: opens a device and runs tasks on it. It knows neither the store
//! nor HTTP; whether it runs in a thread of the server or in a process of its own is the same.

use super::encode;
use super::pacing::Pacing;
use super::requests::without_idle_settings;
use super::shelf::{SceneKey, SceneShelf};
use super::threads::TaskThreads;
use super::translation::{
    environment, finite_header, render_request, to_plan, to_progress, to_stats, units,
};
use super::wire::{ExecutorEvent, Failure, Message, STORAGE, Task};
use super::{devices, scenes};
use crate::api::jobs::{PictureFormat, SnapshotRequest};
use crate::api::solutions::Begins;
use crate::artifacts::Content;
use crate::failpoints;
use bytes::Bytes;
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::device::{Device, DeviceError};
use hemilux_engine::image::{self, Units};
use hemilux_engine::render::{Begin, Observer, Plan, Progress, RenderError, Rendered, StopReason};
use hemilux_engine::scene::Warning;
use hemilux_engine::scene::gltf::BakedMesh;
use hemilux_engine::scene::sky_map::SkyMap;
use hemilux_engine::transport::{Prepared, render_prepared};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// Shortest time between two progress messages.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(120);
/// Snapshots after which the interval doubles.
const SNAPSHOTS_PER_OCTAVE: u32 = 100;
/// Name of the figure that says whether the scene was there from an earlier job.
const SCENE_KEPT: &str = "scene_kept";
/// The files of a result.
const RESULT: [PictureFormat; 2] = [PictureFormat::Png, PictureFormat::Exr];
/// Messages on their way to the server. Progress that finds no room is left out.
pub const ROOM: usize = 16;

/// Where an executor says what happens.
pub type EventSender = mpsc::Sender<Message<ExecutorEvent>>;

/// Where tasks come from, with the parts of their [`Order::Run`](super::wire::Order::Run).
pub type Tasks = std::sync::mpsc::Receiver<(Task, Vec<Content>)>;

/// What may reach a run while it renders.
#[derive(Default)]
pub struct Switches {
    /// The run that is to end; 0 where none is.
    stop: AtomicU64,
    /// Whether the picture that it has then is of no use.
    unwanted: AtomicBool,
    /// The latest run whose snapshot is stored.
    kept: AtomicU64,
    /// How often its interval between snapshots has doubled for want of room.
    slower: AtomicU32,
    /// The latest run whose checkpoint is stored, and what that took, µs.
    stored: AtomicU64,
    stored_micros: AtomicU64,
    /// Whether nobody waits for any run any more.
    abandoned: AtomicBool,
}

impl Switches {
    /// Asks a run to end, with the picture so far where it is wanted.
    pub fn stop(&self, run: u64, wants_picture: bool) {
        self.unwanted.store(!wants_picture, Ordering::Relaxed);
        self.stop.store(run, Ordering::Release);
    }

    /// Whether nobody wants the picture of a run that was stopped.
    fn is_unwanted(&self, run: u64) -> bool {
        self.stop.load(Ordering::Acquire) == run && self.unwanted.load(Ordering::Relaxed)
    }

    /// Lets a run send another snapshot, after an interval that has doubled so often.
    pub fn snapshot_kept(&self, run: u64, slower: u32) {
        self.slower.store(slower, Ordering::Relaxed);
        self.kept.store(run, Ordering::Release);
    }

    /// Lets a run send another checkpoint.
    pub fn checkpoint_kept(&self, run: u64, micros: u64) {
        self.stored_micros.store(micros, Ordering::Relaxed);
        self.stored.store(run, Ordering::Release);
    }

    /// Asks everything to end.
    pub fn abandon(&self) {
        self.abandoned.store(true, Ordering::Relaxed);
    }
}

/// Opens the device and runs tasks until there are none, nobody listens, or a task breaks the
/// device.
pub fn perform(device_id: &str, tasks: &Tasks, switches: &Switches, events: &EventSender) {
    let mut device = match devices::open(device_id) {
        Ok(device) => device,
        Err(error) => {
            let _ = events.blocking_send(ExecutorEvent::NoDevice { error }.into());
            return;
        }
    };
    if events.blocking_send(ExecutorEvent::Ready.into()).is_err() {
        return;
    }
    let (mut crew, mut shelf) = (TaskThreads::default(), SceneShelf::default());
    while let Ok((task, parts)) = tasks.recv() {
        let attempted = catch_unwind(AssertUnwindSafe(|| {
            let means = Means { device: device.as_mut(), crew: &mut crew, shelf: &mut shelf };
            attempt(means, &task, parts, switches, events)
                .and_then(|rendered| last_word(&task, &rendered, switches, events))
        }))
        .unwrap_or_else(|panic| {
            let text = crate::panic_text(&*panic);
            tracing::error!(job = %task.job, panic = text, "the render panicked");
            let failure = Failure::new("panic", format!("an unexpected fault: {text}"));
            Err(Failure { device_is_sound: false, ..failure })
        });
        let device_is_sound = attempted.as_ref().err().is_none_or(|f| f.device_is_sound);
        let said = attempted.unwrap_or_else(|failure| ExecutorEvent::Failed(failure).into());
        if events.blocking_send(said).is_err() || !device_is_sound {
            return;
        }
    }
}

/// What a run ends with: its figures, and its picture as files unless nobody wants it.
fn last_word(
    task: &Task,
    Rendered { picture, stats }: &Rendered,
    switches: &Switches,
    events: &EventSender,
) -> Result<Message<ExecutorEvent>, Failure> {
    let figures = Box::new(to_stats(stats));
    if stats.stopped == StopReason::Cancelled && switches.is_unwanted(task.run) {
        return Ok(ExecutorEvent::Rendered(figures, None).into());
    }
    let _ = events.blocking_send(ExecutorEvent::Solved.into());
    let held = (&RESULT[..], units(task.request.units));
    encode::message(picture, held, |files| ExecutorEvent::Rendered(figures, Some(files)))
        .map_err(|error| Failure::new("picture", error.to_string()))
}

/// What tasks are done with.
struct Means<'a> {
    device: &'a mut dyn Device,
    crew: &'a mut TaskThreads,
    /// Scenes of earlier tasks.
    shelf: &'a mut SceneShelf,
}

/// Renders by those means; everything that can go wrong on the way is a [`Failure`].
fn attempt(
    Means { device, crew, shelf }: Means<'_>,
    task: &Task,
    parts: Vec<Content>,
    switches: &Switches,
    events: &EventSender,
) -> Result<Rendered, Failure> {
    let about = || format!("seed {}, attempt {}", task.request.seed, task.attempt);
    failpoints::pass("load", about)
        .map_err(|injected| Failure::of_executor(injected.to_string()))?;
    let unread = |error: io::Error| Failure {
        retry: true,
        ..Failure::new(STORAGE, format!("what the job needs cannot be read: {error}"))
    };
    let mut parts = parts.into_iter().map(Content::into_bytes);
    let scene_bytes = parts.next().transpose().map_err(unread)?.unwrap_or_default();
    let key = SceneKey::of(task);
    let kept = shelf.take(&key);
    let was_kept = kept.is_some();
    let mut prepared = kept.map_or_else(|| imported(task, scene_bytes), Ok)?;
    let sky = match task.request.environment_map() {
        Some(_) => Some(load_sky(&parts.next().transpose().map_err(unread)?.unwrap_or_default())?),
        None => None,
    };
    let _ = events.blocking_send(ExecutorEvent::Began.into());
    failpoints::pass("render", about)
        .map_err(|injected| Failure::of_executor(injected.to_string()))?;
    let (begin, trouble) = begin(task, parts.next().transpose().map_err(unread)?);
    let job = without_idle_settings(task.request.clone());
    let around = job.environment.as_ref().map(|around| environment(around, sky)).transpose();
    let around = around.map_err(|error| Failure::new("parameter", error.to_string()))?;
    let (scene, around) = (prepared.scene().clone(), around.map(Arc::new));
    let mut request = render_request(&job, scene, around, Some(task.max_seconds), begin);
    let mut watcher = Watcher::new(task, switches, events);
    watcher.beginning = trouble.map(begins_afresh);
    let threads = crew.of(task.threads).map_err(|error| Failure::of_executor(error.to_string()))?;
    let mut render = |request: &_, prepared: &_, watcher: &mut Watcher<'_>| {
        threads.install(|| render_prepared(device, request, prepared, watcher))
    };
    let mut rendered = render(&request, &prepared, &mut watcher);
    if is_short_of_memory(&rendered) && (shelf.clear() || was_kept) {
        prepared = Prepared::new(prepared.scene().clone());
        rendered = render(&request, &prepared, &mut watcher);
    }
    if let Err(RenderError::Checkpoint(error)) = &rendered {
        tracing::warn!(job = %task.job, %error, "begins afresh");
        watcher.beginning = Some(begins_afresh(error.to_string()));
        request.begin = Begin::Afresh;
        rendered = render(&request, &prepared, &mut watcher);
    }
    watcher.hand_over();
    let mut rendered = rendered.map_err(|error| match error {
        RenderError::Parameter { parameter, what } => {
            Failure::new("parameter", format!("{parameter}: {what}"))
        }
        RenderError::Device(error @ DeviceError::Lost { .. }) => {
            Failure::of_executor(error.to_string())
        }
        RenderError::Device(error) => Failure::new("device", error.to_string()),
        RenderError::Checkpoint(error) => Failure::new("checkpoint", error.to_string()),
    })?;
    failpoints::pass("rendered", about)
        .map_err(|injected| Failure::of_executor(injected.to_string()))?;
    rendered.stats.diagnostics.insert(SCENE_KEPT.into(), f64::from(u8::from(was_kept)));
    shelf.put(key, prepared, task.kept_scene_bytes);
    Ok(rendered)
}

/// The scene of a task, read from its file.
fn imported(task: &Task, bytes: Bytes) -> Result<Prepared, Failure> {
    let options = scenes::options(task.max_triangles, Some(&task.request));
    let scene = scenes::load(task.scene_format, &bytes, &options)
        .map_err(|refusal| Failure::new("scene", refusal.to_string()))?;
    Ok(Prepared::new(Arc::new(scene)))
}

/// Whether a job was refused because there is too little memory: scenes that are kept take some.
fn is_short_of_memory(rendered: &Result<Rendered, RenderError>) -> bool {
    matches!(rendered, Err(RenderError::Device(DeviceError::OutOfMemory { .. })))
}

/// The map that is a job's sky.
fn load_sky(bytes: &[u8]) -> Result<Arc<SkyMap>, Failure> {
    let map = scenes::load_map(bytes).map(Arc::new);
    map.map_err(|refusal| Failure::new("environment", refusal.to_string()))
}

/// What a task begins with, and why not with what it should.
fn begin(task: &Task, checkpoint: Option<Bytes>) -> (Begin, Option<String>) {
    let (Some(begins), Some(bytes)) = (task.begins, checkpoint) else {
        return (Begin::Afresh, task.begins_without.clone());
    };
    match Checkpoint::from_bytes(&bytes).map(Arc::new) {
        Ok(checkpoint) => match begins {
            Begins::Continue => (Begin::Continue(checkpoint), None),
            Begins::View => (Begin::View(checkpoint), None),
        },
        Err(error) => (Begin::Afresh, Some(error.to_string())),
    }
}

/// Says that a job does not begin with what it should.
fn begins_afresh(why: String) -> Warning {
    let what = format!("what was kept of it cannot be used, so the job began afresh: {why}");
    Warning::new("job", what)
}

/// The observer of one run: counts and sends, so that rendering never waits for the store.
struct Watcher<'a> {
    run: u64,
    switches: &'a Switches,
    events: &'a EventSender,
    last_progress: Option<Instant>,
    snapshots: Option<SnapshotRequest>,
    units: Units,
    taken: u32,
    /// How often the interval has doubled for want of room.
    slower: u32,
    /// Whether a snapshot is on its way and not yet stored.
    underway: bool,
    /// Encodes the latest one.
    encoder: Option<JoinHandle<bool>>,
    last_snapshot_s: f64,
    most_checkpoint_bytes: u64,
    keeps_solution: bool,
    pacing: Pacing,
    /// What is known at the end, and the light of the surfaces.
    ending: Option<(Checkpoint, Option<BakedMesh>)>,
    /// A warning about what the job begins with.
    beginning: Option<Warning>,
}

impl<'a> Watcher<'a> {
    fn new(task: &Task, switches: &'a Switches, events: &'a EventSender) -> Self {
        let snapshots = task.request.snapshots.clone();
        Self {
            run: task.run,
            switches,
            events,
            last_progress: None,
            last_snapshot_s: 0.0,
            snapshots,
            units: units(task.request.units),
            taken: 0,
            slower: task.snapshots_slower,
            underway: false,
            encoder: None,
            most_checkpoint_bytes: task.most_checkpoint_bytes,
            keeps_solution: task.keeps_solution,
            pacing: Pacing::new(task.checkpoint_every_s, task.first_checkpoint_s, Instant::now()),
            ending: None,
            beginning: None,
        }
    }

    fn formats(&self) -> Vec<PictureFormat> {
        self.snapshots.as_ref().map(|snapshots| snapshots.formats.clone()).unwrap_or_default()
    }

    fn send(&self, checkpoint: &Checkpoint, baked: Option<BakedMesh>) {
        let header = Box::new(finite_header(checkpoint.header()));
        let mut parts = vec![checkpoint.to_bytes().into()];
        parts.extend(baked.map(|mesh| mesh.to_glb().into()));
        let _ =
            self.events.blocking_send(Message { header: ExecutorEvent::Checkpoint(header), parts });
    }

    /// Hands over what is known at the end, before the picture, with which the run is over.
    fn hand_over(&mut self) {
        if let Some((checkpoint, baked)) = self.ending.take() {
            self.send(&checkpoint, baked);
        }
        if let Some(encoder) = self.encoder.take() {
            let _ = encoder.join();
        }
    }
}

impl Observer for Watcher<'_> {
    fn planned(&mut self, plan: &Plan, warnings: &[Warning]) {
        let warnings = warnings.iter().chain(&self.beginning).map(scenes::warning).collect();
        // Nobody listening any more shows in `cancelled`.
        let _ = self.events.blocking_send(ExecutorEvent::Planned(to_plan(plan), warnings).into());
    }

    fn progress(&mut self, progress: &Progress) {
        if self.last_progress.is_none_or(|at| at.elapsed() >= PROGRESS_INTERVAL) {
            self.last_progress = Some(Instant::now());
            // No room means that the store is slow; the next message says more.
            let _ = self.events.try_send(ExecutorEvent::Progress(to_progress(progress)).into());
        }
    }

    fn wants_snapshot(&mut self, progress: &Progress) -> bool {
        if self.underway && self.switches.kept.load(Ordering::Acquire) == self.run {
            self.switches.kept.store(0, Ordering::Relaxed);
            self.slower = self.slower.max(self.switches.slower.load(Ordering::Relaxed));
            self.underway = false;
        }
        if self.encoder.as_ref().is_some_and(JoinHandle::is_finished) {
            let was_sent =
                self.encoder.take().is_some_and(|encoder| encoder.join().unwrap_or(false));
            // What was not sent is not stored, either.
            self.underway &= was_sent;
        }
        let Some(snapshots) = self.snapshots.as_ref().filter(|_| !self.underway) else {
            return false;
        };
        let octave = (self.taken / SNAPSHOTS_PER_OCTAVE + self.slower).min(32) as i32;
        progress.seconds >= self.last_snapshot_s + snapshots.every_s * 2f64.powi(octave)
    }

    fn snapshot(&mut self, picture: &image::Picture, progress: &Progress) {
        self.taken += 1;
        self.last_snapshot_s = progress.seconds;
        self.underway = true;
        let (picture, progress) = (picture.clone(), to_progress(progress));
        let (events, formats, units) = (self.events.clone(), self.formats(), self.units);
        // Beside the render, which goes on meanwhile.
        let encode = move || match encode::message(&picture, (&formats, units), |files| {
            ExecutorEvent::Snapshot(progress, files)
        }) {
            Ok(message) => events.blocking_send(message).is_ok(),
            Err(error) => {
                tracing::error!(%error, "a snapshot cannot be encoded");
                false
            }
        };
        match std::thread::Builder::new().name("encodes".into()).spawn(encode) {
            Ok(encoder) => self.encoder = Some(encoder),
            Err(error) => {
                tracing::warn!(%error, "a snapshot was left out: no thread to encode it");
                self.underway = false;
            }
        }
    }

    fn wants_checkpoint(&mut self, _progress: &Progress) -> bool {
        if self.pacing.is_underway() && self.switches.stored.load(Ordering::Acquire) == self.run {
            self.switches.stored.store(0, Ordering::Relaxed);
            let micros = self.switches.stored_micros.load(Ordering::Relaxed);
            self.pacing.stored(Duration::from_micros(micros));
        }
        self.pacing.is_due(Instant::now())
    }

    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        // Who stops it may be a server that shuts down; the next one goes on from here.
        self.keeps_solution || self.cancelled()
    }

    fn most_checkpoint_bytes(&self) -> u64 {
        self.most_checkpoint_bytes
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        match self.pacing.made(Instant::now()) {
            true => self.send(&checkpoint, None),
            false => self.ending = Some((checkpoint, None)),
        }
    }

    fn wants_baked(&self) -> bool {
        self.keeps_solution && self.ending.is_some()
    }

    fn baked(&mut self, mesh: BakedMesh) {
        if let Some((_, baked)) = &mut self.ending {
            *baked = Some(mesh);
        }
    }

    fn cancelled(&self) -> bool {
        self.switches.stop.load(Ordering::Relaxed) == self.run
            || self.switches.abandoned.load(Ordering::Relaxed)
            || self.events.is_closed()
    }
}
