//! Keeping what was uploaded: a process of its own looks at the file, and what it accepts is kept
//! once, for everyone who sends it. The same for scenes and for maps of skies.

use super::app::App;
use super::problem::Problem;
use super::spool::check_disk;
use crate::access::Caller;
use crate::api::FieldError;
use crate::api::environments::EnvironmentMap;
use crate::api::scenes::Scene;
use crate::api::uploads::Upload;
use crate::artifacts::Content;
use crate::retention::{Keeper, RetentionError};
use crate::store::scenes::Viewer;
use crate::store::{Store, StoreError};
use crate::worker::import::{ImportBounds, ImportError};
use crate::worker::scenes::SceneRefusal;
use std::fs::File;

/// A kind of uploads, as it is stored.
pub trait Kept: Upload {
    /// The record of that id, whoever holds it.
    fn find(
        store: &dyn Store,
        id: &str,
    ) -> impl Future<Output = Result<Option<Self>, StoreError>> + Send;

    /// The record of that id as `viewer` sees it.
    fn shown(
        store: &dyn Store,
        id: &str,
        viewer: Viewer<'_>,
    ) -> impl Future<Output = Result<Option<Self>, StoreError>> + Send;

    /// Stores file and record; whether that is new to `holder`.
    fn keep(
        &self,
        keeper: &Keeper,
        content: Content,
        holder: &str,
    ) -> impl Future<Output = Result<bool, RetentionError>> + Send;

    /// The answer where the file cannot be used, and no limit is the reason.
    fn unusable(detail: String) -> Problem;
}

impl Kept for Scene {
    async fn find(store: &dyn Store, id: &str) -> Result<Option<Self>, StoreError> {
        store.scene(id).await
    }

    async fn shown(
        store: &dyn Store,
        id: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<Self>, StoreError> {
        store.shown_scene(id, viewer).await
    }

    async fn keep(
        &self,
        keeper: &Keeper,
        content: Content,
        holder: &str,
    ) -> Result<bool, RetentionError> {
        keeper.keep_scene(self, content, holder).await
    }

    fn unusable(detail: String) -> Problem {
        Problem::bad_scene(detail)
    }
}

impl Kept for EnvironmentMap {
    async fn find(store: &dyn Store, id: &str) -> Result<Option<Self>, StoreError> {
        store.environment(id).await
    }

    async fn shown(
        store: &dyn Store,
        id: &str,
        viewer: Viewer<'_>,
    ) -> Result<Option<Self>, StoreError> {
        store.shown_environment(id, viewer).await
    }

    async fn keep(
        &self,
        keeper: &Keeper,
        content: Content,
        holder: &str,
    ) -> Result<bool, RetentionError> {
        keeper.keep_environment(self, content, holder).await
    }

    fn unusable(detail: String) -> Problem {
        Problem::bad_environment(detail)
    }
}

/// A file as it will be kept, whole on disk.
pub struct Received {
    /// The file.
    pub file: File,
    /// SHA-256 of it, in hex.
    pub sha256: String,
    /// Its bytes.
    pub size: u64,
}

/// Checks an uploaded file by `import`, which has a process of its own look at it, then keeps it;
/// whether it is new to the caller. What cannot be imported is not kept.
pub async fn store_received<T: Kept>(
    app: &App,
    caller: &Caller,
    received: Received,
    import: impl FnOnce(&File, String, ImportBounds) -> Result<T, ImportError> + Send + 'static,
) -> Result<(T, bool), Problem> {
    let Received { file, sha256: id, size } = received;
    if let Some(stored) = stored(app, caller, &id, true).await? {
        return Ok(stored);
    }
    check_quota(app, caller, size).await?;
    let turn = app.imports.take(caller.billed_to()).await;
    // Somebody may have sent it at the same time.
    if let Some(stored) = stored(app, caller, &id, true).await? {
        return Ok(stored);
    }
    let bounds = ImportBounds {
        max_triangles: app.shared.config.max_triangles,
        memory_mb: app.shared.config.intake.import_memory_mb,
        seconds: app.shared.config.intake.import_seconds,
    };
    // The import goes on where the client hangs up meanwhile, and keeps its turn until it ends.
    let (record, file, _turn) =
        tokio::task::spawn_blocking(move || (import(&file, id, bounds), file, turn))
            .await
            .map_err(|error| Problem::internal(error.to_string()))?;
    check_disk(app, size)?;
    keep(app, caller, record.map_err(import_problem::<T>)?, file).await
}

/// Keeps a file with its record; whether it is new to the caller.
pub async fn keep<T: Kept>(
    app: &App,
    caller: &Caller,
    record: T,
    content: impl Into<Content>,
) -> Result<(T, bool), Problem> {
    let is_new = record.keep(&app.keeper, content.into(), caller.billed_to()).await?;
    Ok((record, is_new))
}

/// The upload of that id, if it is there already and sound; it is the caller's too from now on.
/// Whether it was not before, as if it had been stored for them.
pub async fn stored<T: Kept>(
    app: &App,
    caller: &Caller,
    id: &str,
    thorough: bool,
) -> Result<Option<(T, bool)>, Problem> {
    let Some(record) = sound::<T>(app, id, thorough).await? else { return Ok(None) };
    let is_new = !app.shared.store.holds_scene(id, caller.billed_to()).await?;
    if is_new {
        check_quota(app, caller, record.size()).await?;
        app.shared.store.hold_scene(id, caller.billed_to()).await?;
    }
    // It may have been collected since it was read.
    Ok(app.shared.store.use_scene(id).await?.then_some((record, is_new)))
}

/// The record of that id, unless its file is lost or damaged, so that sending it again mends it.
/// Damage is looked for where the look is to be `thorough`.
async fn sound<T: Kept>(app: &App, id: &str, thorough: bool) -> Result<Option<T>, Problem> {
    let Some(record) = T::find(&*app.shared.store, id).await? else { return Ok(None) };
    let sound = if thorough {
        app.shared.artifacts.scene_is_sound(id).await?
    } else {
        app.shared.artifacts.has_scene(id, record.size()).await?
    };
    if !sound {
        tracing::warn!(id, kind = T::KIND, "the file is lost or damaged and is stored again");
    }
    Ok(sound.then_some(record))
}

/// What was just stored as the caller sees it, by its new name if it has one.
pub async fn named<T: Kept>(
    app: &App,
    caller: &Caller,
    record: T,
    name: Option<String>,
) -> Result<T, Problem> {
    let store = &*app.shared.store;
    if let Some(name) = name {
        store.name_scene(record.id(), caller.billed_to(), &name).await?;
    }
    Ok(T::shown(store, record.id(), caller.viewer()).await?.unwrap_or(record))
}

/// Lets go of an upload of a kind, if there is one; its file goes when nobody has a use for it.
pub async fn let_go<T: Kept>(app: &App, caller: &Caller, id: &str) -> Result<(), Problem> {
    if T::find(&*app.shared.store, id).await?.is_none() {
        return Ok(());
    }
    let holder = (!caller.sees_all()).then(|| caller.billed_to());
    app.shared.store.let_go_scene(id, holder).await?;
    if let Err(error) = app.keeper.collect_let_go().await {
        // Retention finds it again.
        tracing::warn!(%error, id, kind = T::KIND, "cannot remove what nobody holds");
    }
    Ok(())
}

/// Refuses uploads over the caller's quota. Uploads at the same time may each find room: then it
/// is exceeded by as many as may be imported at once.
pub async fn check_quota(app: &App, caller: &Caller, size: u64) -> Result<(), Problem> {
    let Some(most) = caller.limits.scene_bytes else { return Ok(()) };
    let held = app.shared.store.scene_bytes_of(caller.billed_to()).await?;
    if held.saturating_add(size) <= most {
        return Ok(());
    }
    app.shared.metrics.count_refusal("scene_bytes");
    let detail = format!(
        "this caller has {held} bytes of scenes and environments and may have {most}; this one has {size}, and what no job uses expires"
    );
    Err(Problem::over_limit("scene_bytes", detail, 600.0))
}

fn import_problem<T: Kept>(error: ImportError) -> Problem {
    match error {
        ImportError::Refused(refusal) => refused::<T>(refusal),
        ImportError::Trouble(error) => {
            tracing::error!(%error, kind = T::KIND, "cannot import an upload");
            Problem::unavailable(format!("the {} cannot be imported now", T::KIND))
        }
    }
}

/// The answer to who sent what cannot be used.
pub fn refused<T: Kept>(refusal: SceneRefusal) -> Problem {
    let SceneRefusal { at, what, fix, too_large } = refusal;
    let detail = format!("{at}: {what}; {fix}");
    let problem = if too_large { Problem::too_large(detail) } else { T::unusable(detail) };
    problem.with_error(FieldError::new(at, format!("{what}; {fix}")))
}
