//! Taking a backup beside a running server.
//!
//! Files never change once they have their name, so most of them are copied first, at leisure. Then
//! the database is copied as it is at one moment, and what it names beyond these files after that.
//! A file that is gone by then belonged to a job that was deleted meanwhile, or is a checkpoint that
//! was replaced: a newer copy of the database knows. What is gone there too is lost.

use super::copy::{self, Content};
use super::error::{BackupError, at, refuse_filled};
use super::manifest::{FILES, FORMAT, MANIFEST, Manifest};
use crate::artifacts::{Artifacts, FilePlace};
use crate::clock;
use crate::data_folder::{ARTIFACTS, DATABASE};
use crate::store::sqlite::snapshot::{Facts, Kind, NamedFile, Snapshot};
use crate::store::sqlite::tables;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use uuid::Uuid;

/// Copies of the database that are taken for one whose files are all there.
const TRIES: u32 = 6;

/// Takes a backup of a data folder into a new or empty folder; what is in it.
///
/// # Errors
/// Where there is none then. What was copied until then is removed.
pub async fn take(data_dir: &Path, to: &Path) -> Result<Manifest, BackupError> {
    refuse_filled(to, &[])?;
    let database = data_dir.join(DATABASE);
    if !database.exists() {
        let folder = data_dir.display();
        return Err(BackupError::Refused(format!("{folder} is no data folder of hemilux")));
    }
    let partial = partial(to)?;
    let taken = fill(data_dir, &database, &partial).await.and_then(|manifest| {
        move_into_place(&partial, to)?;
        Ok(manifest)
    });
    if taken.is_err() {
        let _ = std::fs::remove_dir_all(&partial);
    }
    taken
}

/// Where a backup is made: on the disk where it is to be. A folder that is there may be the root of
/// another disk, so it is made in there; otherwise beside it.
fn partial(to: &Path) -> Result<PathBuf, BackupError> {
    let unique = format!("partial-{}", Uuid::new_v4());
    if to.is_dir() {
        return Ok(to.join(unique));
    }
    let name = to.file_name().map(|name| name.display().to_string());
    let name = name.ok_or_else(|| {
        BackupError::Refused(format!("{} is no name for a new folder", to.display()))
    })?;
    Ok(to.with_file_name(format!("{name}.{unique}")))
}

/// Gives a finished backup its place. Without its manifest, which comes last, a folder is none.
fn move_into_place(partial: &Path, to: &Path) -> Result<(), BackupError> {
    if partial.parent() == Some(to) {
        for name in [ARTIFACTS, DATABASE, FILES, MANIFEST] {
            std::fs::rename(partial.join(name), to.join(name)).map_err(at(to))?;
            copy::sync_folder(to)?;
        }
        std::fs::remove_dir(partial).map_err(at(partial))?;
        return copy::sync_folder(to);
    }
    std::fs::rename(partial, to).map_err(at(to))?;
    copy::sync_folder(to.parent().unwrap_or(Path::new(".")))
}

async fn fill(data_dir: &Path, database: &Path, partial: &Path) -> Result<Manifest, BackupError> {
    let files = partial.join(ARTIFACTS);
    std::fs::create_dir_all(&files).map_err(at(&files))?;
    let work = Work { source: data_dir.join(ARTIFACTS), files };
    let copied = partial.join(DATABASE);
    // Says early where the database is not of this version, or not that of the files.
    let mut first = Snapshot::take(database, &copied).await?;
    work.check_id(data_dir, &first.facts().await?).await?;
    first.close().await?;
    copy::each_file(&work.source, &mut |place| work.copy(&place).map(drop))?;

    let mut lost = BTreeSet::new();
    let mut snapshot = None;
    for _ in 0..TRIES {
        std::fs::remove_file(&copied).map_err(at(&copied))?;
        let mut taken = Snapshot::take(database, &copied).await?;
        let missing = work.complete(&mut taken).await?;
        snapshot = Some(taken);
        // What two copies in a row name, and neither finds, is not on its way.
        let is_settled = missing == lost;
        lost = missing;
        if lost.is_empty() || is_settled {
            break;
        }
    }
    let Some(mut snapshot) = snapshot else { unreachable!("there is a first try") };
    let (lost, begin_afresh) = do_without(&mut snapshot, lost).await?;
    work.prune(&mut snapshot).await?;
    let facts = snapshot.facts().await?;
    snapshot.close().await?;
    let files = Artifacts::local(&work.files).map_err(at(&work.files))?;
    files.put_store_id(facts.store_id).await?;
    seal(partial, &work, facts, lost, begin_afresh)
}

/// Makes the copy forget checkpoints and baked light that cannot be had: what is lost for good, and
/// the jobs that only begin afresh.
async fn do_without(
    snapshot: &mut Snapshot,
    missing: BTreeSet<Lost>,
) -> Result<(Vec<String>, Vec<Uuid>), BackupError> {
    let (mut lost, mut begin_afresh) = (Vec::new(), Vec::new());
    for Lost { place, kind, why } in missing {
        let what = format!("{}: {why}", place.path());
        let (FilePlace::Job(job, _), Kind::Checkpoint | Kind::Baked) = (&place, kind) else {
            lost.push(what);
            continue;
        };
        match kind {
            Kind::Checkpoint => snapshot.forget_solution(*job).await?,
            _ => snapshot.forget_baked(*job).await?,
        }
        match (snapshot.has_ended(*job).await?, kind) {
            (true, Kind::Checkpoint) => lost.push(format!("{what}, so it cannot be extended")),
            (true, _) => lost.push(what),
            (false, Kind::Checkpoint) => begin_afresh.push(*job),
            // There will be another one when it ends.
            (false, _) => {}
        }
    }
    Ok((lost, begin_afresh))
}

/// A file that a record names and that cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Lost {
    place: FilePlace,
    kind: Kind,
    why: &'static str,
}

/// The folders of files.
struct Work {
    source: PathBuf,
    files: PathBuf,
}

impl Work {
    /// Copies a file, unless it is gone; a picture or a scene whose content is not what its name
    /// says is none.
    fn copy(&self, place: &FilePlace) -> Result<Option<Content>, BackupError> {
        let (path, to) = (place.path(), self.files.join(place.path()));
        let copied = copy::copy(&self.source.join(&path), &to)?;
        if let (Some(content), Some(named)) = (&copied, hash_in_name(place))
            && content.sha256 != named
        {
            std::fs::remove_file(&to).map_err(at(&to))?;
        }
        Ok(copied)
    }

    /// Copies what the records name and is not here yet; what cannot be had.
    async fn complete(&self, snapshot: &mut Snapshot) -> Result<BTreeSet<Lost>, BackupError> {
        let mut lost = BTreeSet::new();
        // Those that run replace their checkpoints in the meantime.
        for job in snapshot.running().await? {
            for file in snapshot.files_of(job).await? {
                lost.extend(self.have(&file)?);
            }
        }
        let mut after = None;
        loop {
            let jobs = snapshot.jobs(after).await?;
            for job in &jobs {
                for file in snapshot.files_of(*job).await? {
                    lost.extend(self.have(&file)?);
                }
            }
            match jobs.last() {
                Some(last) => after = Some(*last),
                None => break,
            }
        }
        let mut after = String::new();
        loop {
            let scenes = snapshot.scenes(&after).await?;
            for scene in &scenes {
                lost.extend(self.have(scene)?);
            }
            match scenes.last() {
                Some(NamedFile { sha256: Some(last), .. }) => after.clone_from(last),
                _ => break,
            }
        }
        Ok(lost)
    }

    /// Has a file here, copied now if need be; why not, where it cannot be had.
    fn have(&self, file: &NamedFile) -> Result<Option<Lost>, BackupError> {
        let path = file.place.path();
        let lost = |why| Some(Lost { place: file.place.clone(), kind: file.kind, why });
        let here = self.files.join(&path);
        if !here.exists() && self.copy(&file.place)?.is_none() {
            return Ok(lost("is missing"));
        }
        // What is named by its hash was checked when it was copied.
        let content = match (&file.sha256, hash_in_name(&file.place)) {
            (Some(_), Some(_)) | (None, _) => here.metadata().ok().map(|about| Content {
                size: about.len(),
                sha256: file.sha256.clone().unwrap_or_default(),
            }),
            (Some(_), None) => Some(copy::content(&here)?),
        };
        let is_whole = content.is_some_and(|content| {
            content.size == file.size
                && file.sha256.as_ref().is_none_or(|sha256| *sha256 == content.sha256)
        });
        if is_whole {
            return Ok(None);
        }
        // It was taken from a running server: perhaps the next look finds it whole.
        let _ = std::fs::remove_file(&here);
        Ok(lost("is damaged"))
    }

    /// Removes what no record of the copy names.
    async fn prune(&self, snapshot: &mut Snapshot) -> Result<(), BackupError> {
        let mut places = Vec::new();
        copy::each_file(&self.files, &mut |place| {
            places.push(place);
            Ok(())
        })?;
        for place in places {
            if !snapshot.names(&place).await? {
                let path = self.files.join(place.path());
                std::fs::remove_file(&path).map_err(at(&path))?;
                // A job's folder goes with its last file.
                let _ = path.parent().map(std::fs::remove_dir);
            }
        }
        Ok(())
    }

    /// Refuses files of another store.
    async fn check_id(&self, data_dir: &Path, facts: &Facts) -> Result<(), BackupError> {
        let source = Artifacts::local(&self.source).map_err(at(&self.source))?;
        let (own, borne) = (facts.store_id.to_string(), source.store_id().await?);
        if borne.as_ref() != Some(&own) {
            let (folder, borne) = (data_dir.display(), borne.unwrap_or_else(|| "none".into()));
            return Err(BackupError::Refused(format!(
                "database and files in {folder} do not belong together: the database is that of store {own}, the files bear {borne}; start the server on the folder, which says what to do"
            )));
        }
        Ok(())
    }
}

/// The hash that the name of a scene or a picture is.
fn hash_in_name(place: &FilePlace) -> Option<&str> {
    let name = match place {
        FilePlace::Scene(id) => id,
        FilePlace::Job(_, name) => name.split('.').next()?,
    };
    (name.len() == 64 && name.bytes().all(|b| b.is_ascii_hexdigit())).then_some(name)
}

/// Writes the list of files and the manifest, and has everything on disk.
fn seal(
    partial: &Path,
    work: &Work,
    facts: Facts,
    lost: Vec<String>,
    begin_afresh: Vec<Uuid>,
) -> Result<Manifest, BackupError> {
    let (mut list, mut files, mut bytes) = (String::new(), 0, 0);
    copy::each_file(&work.files, &mut |place| {
        let path = work.files.join(place.path());
        let content = match hash_in_name(&place) {
            Some(sha256) => {
                let size = path.metadata().map_err(at(&path))?.len();
                Content { sha256: sha256.to_owned(), size }
            }
            None => copy::content(&path)?,
        };
        let _ = writeln!(list, "{}  {ARTIFACTS}/{}", content.sha256, place.path());
        files += 1;
        bytes += content.size;
        Ok(())
    })?;
    let database = partial.join(DATABASE);
    std::fs::File::open(&database).and_then(|file| file.sync_all()).map_err(at(&database))?;
    copy::write(&partial.join(FILES), list.as_bytes())?;
    let manifest = Manifest {
        format: FORMAT,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        tables: tables::newest_version(),
        store_id: facts.store_id,
        taken_at: clock::wall(),
        jobs: facts.jobs,
        scenes: facts.scenes,
        files,
        bytes,
        database_sha256: copy::content(&database)?.sha256,
        files_sha256: crate::hash::sha256_hex(list.as_bytes()),
        lost,
        begin_afresh,
    };
    let text = serde_json::to_string_pretty(&manifest).unwrap_or_default();
    copy::write(&partial.join(MANIFEST), (text + "\n").as_bytes())?;
    copy::sync_names(partial)?;
    Ok(manifest)
}
