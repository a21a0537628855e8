//! `hemilux backup` and `hemilux restore`.

use super::process::{self, Failure, print};
use crate::backup::{self, Manifest};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `hemilux backup`.
#[derive(Args)]
pub struct Backup {
    /// New or empty folder for the backup.
    to: PathBuf,
    /// The server's data folder.
    #[arg(long, env = "HEMILUX_DATA_DIR", default_value = "./hemilux-data")]
    data_dir: PathBuf,
}

/// Arguments of `hemilux restore`.
#[derive(Args)]
pub struct Restore {
    /// Folder of the backup.
    from: PathBuf,
    /// New or empty data folder.
    #[arg(long, env = "HEMILUX_DATA_DIR")]
    data_dir: PathBuf,
    /// Put back the database alone, beside the files of the same store that are in the data folder;
    /// the one that is there stays under another name.
    #[arg(long)]
    database_only: bool,
}

/// Takes a backup.
pub fn take(arguments: &Backup) -> Result<(), Failure> {
    process::keep_files_private();
    let runtime = process::runtime()?;
    let taken = runtime.block_on(backup::take(&arguments.data_dir, &arguments.to));
    let manifest = taken.map_err(Failure::failed)?;
    print(&format!("{} is a backup of {}\n", arguments.to.display(), told(&manifest)))?;
    for job in &manifest.begin_afresh {
        eprintln!(
            "hemilux: no checkpoint of job {job} could be had; in the backup it begins afresh"
        );
    }
    if manifest.lost.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!(
        "the backup is there, but the data folder itself has lost files that its records name: {}",
        manifest.lost.join("; ")
    )))
}

/// Restores a backup.
pub fn restore(arguments: &Restore) -> Result<(), Failure> {
    process::keep_files_private();
    let Restore { from, data_dir, database_only } = arguments;
    if *database_only {
        let former = backup::restore_database(from, data_dir).map_err(Failure::failed)?;
        let former = former.map_or_else(
            || "there was none before".to_owned(),
            |path| format!("the one of before is {}", path.display()),
        );
        return print(&format!(
            "the database of {} is in {}; {former}\n",
            from.display(),
            data_dir.display()
        ));
    }
    let manifest = backup::restore(from, data_dir).map_err(Failure::failed)?;
    print(&format!("{} holds {}\n", arguments.data_dir.display(), told(&manifest)))
}

fn told(manifest: &Manifest) -> String {
    let Manifest { jobs, scenes, files, bytes, store_id, taken_at, .. } = manifest;
    format!(
        "store {store_id} as of {taken_at:.0}: {jobs} jobs, {scenes} scenes, {files} files of {} MiB",
        bytes.div_ceil(1 << 20)
    )
}
