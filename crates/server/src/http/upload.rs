//! Taking uploads in: bytes go to an unnamed temporary file while they are counted and hashed, so
//! a sender that never ends costs disk up to the limit and no memory.

use super::App;
use super::gauge::Gauge;
use super::problem::Problem;
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::scenes::{Scene, SceneFormat, name_of_file};
use crate::artifacts::{hex, sha256_hex};
use crate::bundle;
use crate::worker::scenes::{SceneRefusal, describe};
use axum::body::Body;
use axum::extract::{FromRequest, Multipart, Request};
use bytes::Bytes;
use futures_util::{Stream, StreamExt, TryStreamExt};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncSeekExt, AsyncWriteExt};
use tokio::sync::OwnedSemaphorePermit;

/// Longest silence in the middle of an upload.
const IDLE: Duration = Duration::from_secs(30);
/// Most parts of a multipart upload; each holds a file open.
const MAX_PARTS: usize = 128;
/// Longest name of a part.
const MAX_NAME_BYTES: usize = 1024;

/// Bytes on disk.
struct Spooled {
    file: tokio::fs::File,
    size: u64,
    sha256: String,
}

impl Spooled {
    async fn read(mut self) -> Result<Vec<u8>, Problem> {
        let mut bytes = Vec::with_capacity(usize::try_from(self.size).unwrap_or(0));
        self.file.rewind().await.map_err(disk_trouble)?;
        self.file.read_to_end(&mut bytes).await.map_err(disk_trouble)?;
        Ok(bytes)
    }
}

fn disk_trouble(error: std::io::Error) -> Problem {
    tracing::error!(%error, "cannot keep an upload");
    Problem::unavailable("the upload could not be kept; the disk may be full")
}

/// Counts the bytes of a request against the server's limit.
struct Allowance {
    left: u64,
    limit_mb: u64,
}

impl Allowance {
    fn new(app: &App) -> Self {
        Self { left: app.config.max_upload_bytes(), limit_mb: app.config.max_upload_mb }
    }

    fn take(&mut self, bytes: usize) -> Result<(), Problem> {
        match self.left.checked_sub(bytes as u64) {
            Some(left) => self.left = left,
            None => {
                let limit = self.limit_mb;
                return Err(Problem::too_large(format!("uploads may have at most {limit} MiB")));
            }
        }
        Ok(())
    }
}

fn silence() -> Problem {
    Problem::too_slow(format!("nothing arrived for {} seconds", IDLE.as_secs()))
}

/// A small body, whole. `too_large` is what to answer where it has more than `limit` bytes.
pub async fn small_body(
    body: Body,
    limit: usize,
    too_large: impl Fn() -> Problem,
) -> Result<Vec<u8>, Problem> {
    let mut chunks = body.into_data_stream();
    let mut bytes = Vec::new();
    loop {
        let next = tokio::time::timeout(IDLE, chunks.next()).await;
        let Some(chunk) = next.map_err(|_| silence())? else { return Ok(bytes) };
        let chunk = chunk
            .map_err(|error| Problem::unreadable(format!("the request broke off: {error}")))?;
        if bytes.len() + chunk.len() > limit {
            return Err(too_large());
        }
        bytes.extend_from_slice(&chunk);
    }
}

async fn spool<E>(
    app: &App,
    mut chunks: impl Stream<Item = Result<Bytes, E>> + Unpin,
    allowance: &mut Allowance,
    refuse: impl Fn(E) -> Problem,
) -> Result<Spooled, Problem> {
    let folder = app.config.data_dir.join("tmp");
    let file = tokio::task::spawn_blocking(move || tempfile::tempfile_in(folder))
        .await
        .map_err(|error| Problem::internal(error.to_string()))?
        .map_err(disk_trouble)?;
    let mut spooled =
        Spooled { file: tokio::fs::File::from_std(file), size: 0, sha256: String::new() };
    let mut hash = Sha256::new();
    loop {
        let next = tokio::time::timeout(IDLE, chunks.next()).await;
        let Some(chunk) = next.map_err(|_| silence())? else { break };
        let chunk = chunk.map_err(&refuse)?;
        allowance.take(chunk.len())?;
        spooled.size += chunk.len() as u64;
        hash.update(&chunk);
        spooled.file.write_all(&chunk).await.map_err(disk_trouble)?;
    }
    spooled.file.flush().await.map_err(disk_trouble)?;
    spooled.sha256 = hex(&hash.finalize());
    Ok(spooled)
}

/// Stores a scene that is the whole body.
pub async fn scene_from_body(
    app: &App,
    caller: &Caller,
    body: Body,
) -> Result<(Scene, bool), Problem> {
    let cut = |error: axum::Error| Problem::unreadable(format!("the upload broke off: {error}"));
    let spooled = spool(app, body.into_data_stream(), &mut Allowance::new(app), cut).await?;
    if spooled.size == 0 {
        return Err(Problem::bad_scene("the body is empty; send a .glb or .gltf file"));
    }
    if let Some(stored) = stored_scene(app, caller, &spooled.sha256, true).await? {
        return Ok(stored);
    }
    let id = spooled.sha256.clone();
    let turn = import_turn(app).await?;
    let bytes = Bytes::from(spooled.read().await?);
    store_scene(app, caller, id, SceneFormat::Gltf, bytes, Some(turn)).await
}

/// A multipart request, taken apart.
pub struct Parts {
    /// The part named `job`, where one is expected.
    pub job: Option<Vec<u8>>,
    /// The name of the scene's file, if it came with one.
    pub scene_name: Option<String>,
    scene: Option<Spooled>,
    resources: BTreeMap<String, Spooled>,
}

/// Takes a multipart request in. The scene is the part named `scene`, or the one whose name or
/// file name ends in .gltf or .glb; other parts are resources, their names the relative URIs that
/// the scene uses.
pub async fn parts(app: &App, request: Request, with_job: bool) -> Result<Parts, Problem> {
    let gauge = Arc::new(Gauge::default());
    let request = request.map(|body| gauge.clone().watch(body));
    let mut multipart = Multipart::from_request(request, &())
        .await
        .map_err(|rejection| Problem::unreadable(rejection.body_text()))?;
    let mut allowance = Allowance::new(app);
    let mut parts = Parts { job: None, scene_name: None, scene: None, resources: BTreeMap::new() };
    let refuse = |error: axum::extract::multipart::MultipartError| {
        if gauge.overflowed() {
            return Problem::too_large("the form has too much between the contents of its parts");
        }
        Problem::unreadable(format!("broken multipart body: {}", error.body_text()))
    };
    let mut count = 0;
    loop {
        let next = tokio::time::timeout(IDLE, multipart.next_field()).await;
        let next = next.map_err(|_| silence())?;
        let Some(mut field) = next.map_err(refuse)? else { break };
        gauge.part();
        count += 1;
        let name = field.name().unwrap_or("").to_owned();
        let file_name = field.file_name().unwrap_or("").to_owned();
        if count > MAX_PARTS {
            return Err(Problem::too_large(format!(
                "a form may have at most {MAX_PARTS} parts; pack the scene into one .glb"
            )));
        }
        if name.is_empty() || name.len() > MAX_NAME_BYTES {
            let rule = format!("every part needs a name of at most {MAX_NAME_BYTES} bytes");
            return Err(Problem::unreadable(rule));
        }
        if with_job && name == "job" {
            let mut json = Vec::new();
            loop {
                let next = tokio::time::timeout(IDLE, field.chunk()).await;
                let chunk = next.map_err(|_| silence())?.map_err(refuse)?;
                let Some(chunk) = chunk else { break };
                gauge.content(chunk.len());
                allowance.take(chunk.len())?;
                json.extend_from_slice(&chunk);
                if json.len() > super::read::MAX_JSON_BYTES {
                    return Err(Problem::too_large("the part `job` is too long"));
                }
            }
            if parts.job.replace(json).is_some() {
                return Err(repeated("job"));
            }
            continue;
        }
        let contents = (&mut field).inspect_ok(|chunk| gauge.content(chunk.len()));
        let spooled = spool(app, contents, &mut allowance, refuse).await?;
        let is_scene = name == "scene" || is_gltf(&name) || is_gltf(&file_name);
        if is_scene && parts.scene.is_none() {
            parts.scene = Some(spooled);
            let file_name = if file_name.is_empty() && name != "scene" { name } else { file_name };
            parts.scene_name = name_of_file(&file_name);
        } else if is_scene {
            return Err(repeated("scene"));
        } else if parts.resources.insert(name.clone(), spooled).is_some() {
            return Err(repeated(&name));
        }
    }
    Ok(parts)
}

fn repeated(name: &str) -> Problem {
    Problem::invalid(vec![FieldError::new(name, "comes twice; each part may come once")])
}

fn is_gltf(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.ends_with(".gltf") || name.ends_with(".glb")
}

impl Parts {
    /// Whether there is a scene among them.
    pub fn has_scene(&self) -> bool {
        self.scene.is_some()
    }

    /// Stores the scene with its resources.
    pub async fn store(self, app: &App, caller: &Caller) -> Result<(Scene, bool), Problem> {
        let Some(scene) = self.scene else {
            let rule = "send the scene as a part named scene, or ending in .gltf or .glb";
            return Err(Problem::invalid(vec![FieldError::new("scene", rule)]));
        };
        let turn = import_turn(app).await?;
        if self.resources.is_empty() {
            let id = scene.sha256.clone();
            let bytes = scene.read().await?.into();
            return store_scene(app, caller, id, SceneFormat::Gltf, bytes, Some(turn)).await;
        }
        let main = scene.read().await?;
        let mut resources = BTreeMap::new();
        for (uri, file) in self.resources {
            resources.insert(uri, file.read().await?);
        }
        let packed = bundle::pack(&main, &resources);
        let id = sha256_hex(&packed);
        store_scene(app, caller, id, SceneFormat::Bundle, packed.into(), Some(turn)).await
    }
}

/// Waits for a turn at importing.
async fn import_turn(app: &App) -> Result<OwnedSemaphorePermit, Problem> {
    let turn = app.imports.clone().acquire_owned();
    turn.await.map_err(|error| Problem::internal(error.to_string()))
}

/// The scene of that id, unless its file is lost or damaged, so that sending it again mends it.
/// Damage is looked for where the look is to be `thorough`.
async fn kept(app: &App, id: &str, thorough: bool) -> Result<Option<Scene>, Problem> {
    let Some(scene) = app.store.scene(id).await? else { return Ok(None) };
    let sound = if thorough {
        match app.artifacts.scene(id).await {
            Ok(_) => true,
            Err(error) if error.is_lasting() => false,
            Err(error) => return Err(error.into()),
        }
    } else {
        app.artifacts.has_scene(id, scene.size).await?
    };
    if !sound {
        tracing::warn!(scene = id, "the file is lost or damaged and is stored again");
    }
    Ok(sound.then_some(scene))
}

/// Checks a scene by importing it, then keeps it; whether it is new to the caller. What cannot be imported is
/// not kept. Without a `turn` it waits for one where there is something to import.
pub async fn store_scene(
    app: &App,
    caller: &Caller,
    id: String,
    format: SceneFormat,
    bytes: Bytes,
    turn: Option<OwnedSemaphorePermit>,
) -> Result<(Scene, bool), Problem> {
    // Built-in scenes, which come without a turn, are asked for with every job.
    if let Some(stored) = stored_scene(app, caller, &id, turn.is_some()).await? {
        return Ok(stored);
    }
    check_quota(app, caller, bytes.len() as u64).await?;
    let turn = match turn {
        Some(turn) => turn,
        None => import_turn(app).await?,
    };
    let max_triangles = app.config.max_triangles;
    let (import_id, import_bytes) = (id.clone(), bytes.clone());
    // The import goes on where the client hangs up meanwhile, and keeps its turn until it ends.
    let (described, _turn) = tokio::task::spawn_blocking(move || {
        (describe(import_id, format, &import_bytes, max_triangles), turn)
    })
    .await
    .map_err(|error| Problem::internal(error.to_string()))?;
    let scene = described.map_err(scene_problem)?;
    let is_new = app.keeper.keep_scene(&scene, bytes, caller.billed_to()).await?;
    Ok((scene, is_new))
}

/// The scene of that id, if it is there already and sound; it is the caller's too from now on.
/// Whether it was not before, as if it had been stored for them.
async fn stored_scene(
    app: &App,
    caller: &Caller,
    id: &str,
    thorough: bool,
) -> Result<Option<(Scene, bool)>, Problem> {
    let Some(scene) = kept(app, id, thorough).await? else { return Ok(None) };
    let is_new = !app.store.holds_scene(id, caller.billed_to()).await?;
    if is_new {
        check_quota(app, caller, scene.size).await?;
        app.store.hold_scene(id, caller.billed_to()).await?;
    }
    // It may have been collected since it was read.
    Ok(app.store.use_scene(id).await?.then_some((scene, is_new)))
}

/// Refuses scenes over the caller's quota. Uploads at the same time may each find room: then it
/// is exceeded by as many as may be imported at once.
async fn check_quota(app: &App, caller: &Caller, size: u64) -> Result<(), Problem> {
    let Some(most) = caller.limits.scene_bytes else { return Ok(()) };
    let held = app.store.scene_bytes_of(caller.billed_to()).await?;
    if held.saturating_add(size) <= most {
        return Ok(());
    }
    app.metrics.count_refusal("scene_bytes");
    let detail = format!(
        "this caller has {held} bytes of scenes and may have {most}; this one has {size}, and what no job uses expires"
    );
    Err(Problem::over_limit("scene_bytes", detail, 600.0))
}

fn scene_problem(refusal: SceneRefusal) -> Problem {
    let SceneRefusal { at, what, fix, too_large } = refusal;
    let detail = format!("{at}: {what}; {fix}");
    let problem = if too_large { Problem::too_large(detail) } else { Problem::bad_scene(detail) };
    problem.with_error(FieldError::new(at, format!("{what}; {fix}")))
}
