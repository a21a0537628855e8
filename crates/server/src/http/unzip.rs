//! Scenes that come as zip archives: unpacked once, on disk, into what the same files would have been
//! kept as had they come one by one, so that they have the same id.

use super::app::App;
use super::kept::{Received, refused};
use super::problem::Problem;
use super::spool::{check_disk, disk_trouble, unnamed_file};
use crate::api::scenes::{Scene, SceneFormat};
use crate::archive::{ArchiveError, Packed, Stretch};
use crate::artifacts::Hashing;
use crate::bundle;
use std::fs::File;
use std::io::{self, BufWriter, Read};

/// What a file holds as a scene: unpacked where it is an archive, `None` where it is none. The
/// archive lies at `start` and has `size` bytes.
pub async fn unpacked(
    app: &App,
    file: &File,
    (start, size): (u64, u64),
) -> Result<Option<(Received, SceneFormat)>, Problem> {
    if !(Stretch { file, start, size }).is_archive().map_err(disk_trouble)? {
        return Ok(None);
    }
    let (out, file) = (unnamed_file(app).await?, file.try_clone().map_err(disk_trouble)?);
    let app = app.clone();
    let unpack = move || {
        let archive = Stretch { file: &file, start, size };
        let most = app.shared.config.max_upload_bytes();
        let packed = Packed::open(archive, most).map_err(answer)?;
        check_disk(&app, packed.size())?;
        write(&packed, out).map_err(|error| answer(error.into()))
    };
    let unpacked = tokio::task::spawn_blocking(unpack).await;
    unpacked.map_err(|error| Problem::internal(error.to_string()))?.map(Some)
}

fn answer(error: ArchiveError) -> Problem {
    match error {
        ArchiveError::Refused(refusal) => refused::<Scene>(refusal),
        ArchiveError::Trouble(error) => disk_trouble(error),
    }
}

/// Writes a scene to `out`, with its resources where it has some.
fn write(packed: &Packed<'_>, out: File) -> io::Result<(Received, SceneFormat)> {
    let mut out = BufWriter::new(Hashing::new(out));
    let format = if packed.is_alone() {
        let (size, main) = packed.main();
        io::copy(&mut main.take(size), &mut out)?;
        SceneFormat::Gltf
    } else {
        bundle::pack(&mut out, packed.main(), packed.resources())?;
        SceneFormat::Bundle
    };
    let out = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    let (file, size, sha256) = out.finish();
    Ok((Received { file, sha256, size }, format))
}
