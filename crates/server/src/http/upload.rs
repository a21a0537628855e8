//! Taking uploads in: bytes go to an unnamed temporary file while they are counted and hashed, a
//! process of its own imports them from there, and what it accepts is kept (see `kept`). None of it
//! is ever in the server's memory as a whole.

use super::app::App;
use super::gauge::Gauge;
use super::kept::{Received, check_quota, keep, refused, store_received, stored};
use super::problem::Problem;
use super::slots::{NoSlot, Slot, Slots};
use super::spool::{Allowance, Pace, Piece, Spool, check_disk, disk_trouble, unnamed_file};
use super::unzip;
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::environments::EnvironmentMap;
use crate::api::scenes::{Scene, SceneFormat, name_of_file};
use crate::artifacts::Hashing;
use crate::bundle;
use crate::worker::import::{describe_apart, describe_map_apart};
use crate::worker::scenes;
use axum::body::Body;
use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{FromRequest, Multipart, Request};
use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;
use std::time::Duration;

/// Longest time that a small body may take to arrive.
const SMALL_BODY_TIME: Duration = Duration::from_secs(60);
/// Most parts of a multipart upload.
const MAX_PARTS: usize = 128;
/// Longest name of a part.
const MAX_NAME_BYTES: usize = 1024;

/// A small body, whole. `too_large` is what to answer where it has more than `limit` bytes.
pub async fn small_body(
    body: Body,
    limit: usize,
    too_large: impl Fn() -> Problem,
) -> Result<Vec<u8>, Problem> {
    let mut chunks = body.into_data_stream();
    let mut pace = Pace::new(SMALL_BODY_TIME);
    let mut bytes = Vec::new();
    while let Some(chunk) = pace.next(chunks.next()).await? {
        let chunk = chunk
            .map_err(|error| Problem::unreadable(format!("the request broke off: {error}")))?;
        pace.arrived(chunk.len())?;
        if bytes.len() + chunk.len() > limit {
            return Err(too_large());
        }
        bytes.extend_from_slice(&chunk);
    }
    Ok(bytes)
}

/// A slot for an upload of `caller`, or when to come back.
fn slot(app: &App, caller: &Caller) -> Result<Slot, Problem> {
    app.uploads.take(caller.billed_to()).map_err(|full| {
        app.shared.metrics.count_refusal("uploads");
        let Slots { most, most_each, .. } = app.uploads;
        match full {
            NoSlot::All => Problem::uploads_full(format!(
                "{most} uploads are open, which is the server's limit"
            )),
            NoSlot::Own => {
                let detail =
                    format!("{most_each} uploads of this caller are open, which is its limit");
                Problem::over_limit("uploads", detail, 5.0)
            }
        }
    })
}

/// Stores a scene that is the whole body.
pub async fn scene_from_body(
    app: &App,
    caller: &Caller,
    body: Body,
) -> Result<(Scene, bool), Problem> {
    let empty = || Problem::bad_scene("the body is empty; send a .glb, .gltf or .zip file");
    let (_slot, received) = whole_body(app, caller, body, empty).await?;
    let place = (0, received.size);
    if let Some((scene, format)) = unzip::unpacked(app, &received.file, place).await? {
        return store_scene(app, caller, scene, format).await;
    }
    store_scene(app, caller, received, SceneFormat::Gltf).await
}

/// Stores a map of a sky that is the whole body.
pub async fn map_from_body(
    app: &App,
    caller: &Caller,
    body: Body,
) -> Result<(EnvironmentMap, bool), Problem> {
    let empty = || Problem::bad_environment("the body is empty; send an .exr or .hdr file");
    let (_slot, received) = whole_body(app, caller, body, empty).await?;
    store_received(app, caller, received, describe_map_apart).await
}

/// Takes a body in that is one file; what to answer where there is nothing in it.
async fn whole_body(
    app: &App,
    caller: &Caller,
    body: Body,
    empty: impl FnOnce() -> Problem,
) -> Result<(Slot, Received), Problem> {
    let slot = slot(app, caller)?;
    let cut = |error: axum::Error| Problem::unreadable(format!("the upload broke off: {error}"));
    let mut limits = (Allowance::new(app), Pace::new(app.shared.config.intake.upload_time()));
    let mut spool = Spool::new(app).await?;
    let Piece { size, sha256, .. } =
        spool.take(body.into_data_stream(), (&mut limits.0, &mut limits.1), cut).await?;
    if size == 0 {
        return Err(empty());
    }
    Ok((slot, Received { file: spool.into_file().await, sha256, size }))
}

async fn store_scene(
    app: &App,
    caller: &Caller,
    received: Received,
    format: SceneFormat,
) -> Result<(Scene, bool), Problem> {
    let import = move |file: &File, id, bounds| describe_apart(file, id, format, bounds);
    store_received(app, caller, received, import).await
}

/// A multipart request, taken apart.
pub struct Parts {
    /// The part named `job`, where one is expected.
    pub job: Option<Vec<u8>>,
    /// The name of the scene's file, if it came with one.
    pub scene_name: Option<String>,
    scene: Option<Piece>,
    resources: BTreeMap<String, Piece>,
    /// Holds scene and resources.
    spool: Spool,
    _slot: Slot,
}

/// What a multipart request is measured against while it arrives.
struct Arrival {
    gauge: Arc<Gauge>,
    allowance: Allowance,
    pace: Pace,
}

impl Arrival {
    /// What to answer where the form cannot be read.
    fn refuse(gauge: &Gauge, error: &MultipartError) -> Problem {
        if gauge.overflowed() {
            return Problem::too_large("the form has too much between the contents of its parts");
        }
        Problem::unreadable(format!("broken multipart body: {}", error.body_text()))
    }

    /// A part that is JSON, whole.
    async fn json(&mut self, mut field: Field<'_>) -> Result<Vec<u8>, Problem> {
        let mut json = Vec::new();
        while let Some(chunk) = self
            .pace
            .next(field.chunk())
            .await?
            .map_err(|error| Self::refuse(&self.gauge, &error))?
        {
            self.gauge.content(chunk.len());
            self.pace.arrived(chunk.len())?;
            self.allowance.take(chunk.len())?;
            json.extend_from_slice(&chunk);
            if json.len() > super::read::MAX_JSON_BYTES {
                return Err(Problem::too_large("the part `job` is too long"));
            }
        }
        Ok(json)
    }

    /// A part that is a file, into the spool.
    async fn file(&mut self, mut field: Field<'_>, spool: &mut Spool) -> Result<Piece, Problem> {
        let Self { gauge, allowance, pace } = self;
        let contents = (&mut field).inspect_ok(|chunk| gauge.content(chunk.len()));
        spool.take(contents, (allowance, pace), |error| Self::refuse(gauge, &error)).await
    }
}

/// Takes a multipart request in. The scene is the part named `scene`, or the one whose name or
/// file name ends in .gltf, .glb or .zip; other parts are resources, their names the relative URIs that
/// the scene uses.
pub async fn parts(
    app: &App,
    caller: &Caller,
    request: Request,
    with_job: bool,
) -> Result<Parts, Problem> {
    let slot = slot(app, caller)?;
    let gauge = Arc::new(Gauge::default());
    let request = request.map(|body| gauge.clone().watch(body));
    let mut multipart = Multipart::from_request(request, &())
        .await
        .map_err(|rejection| Problem::unreadable(rejection.body_text()))?;
    let (allowance, pace) =
        (Allowance::new(app), Pace::new(app.shared.config.intake.upload_time()));
    let mut arrival = Arrival { gauge, allowance, pace };
    let spool = Spool::new(app).await?;
    let mut parts = Parts {
        job: None,
        scene_name: None,
        scene: None,
        resources: BTreeMap::new(),
        spool,
        _slot: slot,
    };
    let mut count = 0;
    while let Some(field) = arrival
        .pace
        .next(multipart.next_field())
        .await?
        .map_err(|error| Arrival::refuse(&arrival.gauge, &error))?
    {
        arrival.gauge.part();
        arrival.pace.arrived(0)?;
        count += 1;
        if count > MAX_PARTS {
            return Err(Problem::too_large(format!(
                "a form may have at most {MAX_PARTS} parts; pack the scene into one .glb"
            )));
        }
        parts.take(field, &mut arrival, with_job).await?;
    }
    Ok(parts)
}

impl Parts {
    /// Takes one part.
    async fn take(
        &mut self,
        field: Field<'_>,
        arrival: &mut Arrival,
        with_job: bool,
    ) -> Result<(), Problem> {
        let name = field.name().unwrap_or("").to_owned();
        let file_name = field.file_name().unwrap_or("").to_owned();
        if name.is_empty() || name.len() > MAX_NAME_BYTES {
            let rule = format!("every part needs a name of at most {MAX_NAME_BYTES} bytes");
            return Err(Problem::unreadable(rule));
        }
        if with_job && name == "job" {
            let json = arrival.json(field).await?;
            return if self.job.replace(json).is_some() { Err(repeated("job")) } else { Ok(()) };
        }
        let piece = arrival.file(field, &mut self.spool).await?;
        let is_scene = name == "scene" || is_scene(&name) || is_scene(&file_name);
        if is_scene && self.scene.is_none() {
            self.scene = Some(piece);
            let file_name = if file_name.is_empty() && name != "scene" { name } else { file_name };
            self.scene_name = name_of_file(&file_name);
        } else if is_scene {
            return Err(repeated("scene"));
        } else if self.resources.insert(name.clone(), piece).is_some() {
            return Err(repeated(&name));
        }
        Ok(())
    }

    /// Whether there is a scene among them.
    pub fn has_scene(&self) -> bool {
        self.scene.is_some()
    }

    /// Stores the scene with its resources.
    pub async fn store(self, app: &App, caller: &Caller) -> Result<(Scene, bool), Problem> {
        let Self { scene, resources, spool, _slot, .. } = self;
        let Some(scene) = scene else {
            let rule = "send the scene as a part named scene, or ending in .gltf, .glb or .zip";
            return Err(Problem::invalid(vec![FieldError::new("scene", rule)]));
        };
        let file = spool.into_file().await;
        if let Some((unpacked, format)) = unzip::unpacked(app, &file, scene.place()).await? {
            if let Some(other) = resources.keys().next() {
                let rule = "comes beside a zip archive, which brings its own files";
                return Err(Problem::invalid(vec![FieldError::new(other, rule)]));
            }
            return store_scene(app, caller, unpacked, format).await;
        }
        if resources.is_empty() {
            // Then there is nothing else in the file.
            let received = Received { file, sha256: scene.sha256, size: scene.size };
            return store_scene(app, caller, received, SceneFormat::Gltf).await;
        }
        let packed = pack(app, file, scene, resources).await?;
        store_scene(app, caller, packed, SceneFormat::Bundle).await
    }
}

/// Packs a scene and its resources, all pieces of `file`, into a file of their own.
async fn pack(
    app: &App,
    file: File,
    scene: Piece,
    resources: BTreeMap<String, Piece>,
) -> Result<Received, Problem> {
    check_disk(app, scene.size + resources.values().map(|piece| piece.size).sum::<u64>())?;
    let out = unnamed_file(app).await?;
    let packed = tokio::task::spawn_blocking(move || {
        let packable = |piece: &Piece| (piece.size, piece.reader(&file));
        let resources = resources.iter().map(|(uri, piece)| (uri.clone(), packable(piece)));
        let mut out = BufWriter::new(Hashing::new(out));
        bundle::pack(&mut out, packable(&scene), resources.collect())?;
        out.into_inner().map_err(std::io::IntoInnerError::into_error)
    });
    let packed = packed.await.map_err(|error| Problem::internal(error.to_string()))?;
    let (file, size, sha256) = packed.map_err(disk_trouble)?.finish();
    Ok(Received { file, sha256, size })
}

fn repeated(name: &str) -> Problem {
    Problem::invalid(vec![FieldError::new(name, "comes twice; each part may come once")])
}

fn is_scene(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    [".gltf", ".glb", ".zip"].iter().any(|ending| name.ends_with(ending))
}

/// Keeps a scene of the program's own, which nobody needs protection from and every job may ask
/// for.
pub async fn store_builtin(
    app: &App,
    caller: &Caller,
    id: String,
    bytes: &'static [u8],
) -> Result<Scene, Problem> {
    if let Some((scene, _)) = stored(app, caller, &id, false).await? {
        return Ok(scene);
    }
    check_quota(app, caller, bytes.len() as u64).await?;
    let _turn = app.imports.take(caller.billed_to()).await;
    let max_triangles = app.shared.config.max_triangles;
    let described = tokio::task::spawn_blocking(move || {
        let scene = scenes::load(SceneFormat::Gltf, bytes, &scenes::options(max_triangles, None))?;
        Ok(scenes::describe(id, SceneFormat::Gltf, bytes.len() as u64, &scene))
    });
    let described = described.await.map_err(|error| Problem::internal(error.to_string()))?;
    let scene = described.map_err(refused::<Scene>)?;
    Ok(keep(app, caller, scene, Bytes::from_static(bytes)).await?.0)
}
