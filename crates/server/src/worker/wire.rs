//! What the server and an executor say to each other, and how it travels over a pipe.
//!
//! A message is a header, plain data in JSON, and parts, bytes that JSON would only bloat: scenes,
//! pictures. On a pipe: length of the header and number of parts, u32; lengths of the parts, u64,
//! all little-endian; header; parts. To a thread of the same process messages go as they are.

use crate::api::Warning;
use crate::api::jobs::{JobRequest, PictureFormat, Plan, Progress, Stats};
use crate::api::scenes::SceneFormat;
use crate::api::solutions::Begins;
use crate::artifacts::Content;
use hemilux_engine::checkpoint::Header;
use rustix::fs::FallocateFlags;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;
use uuid::Uuid;

/// Longest header, bytes; plans and warnings are the longest there are.
const MAX_HEADER: u32 = 64 << 20;
/// Most parts.
const MAX_PARTS: u32 = 8;
/// Longest part, bytes: well above the largest upload and the largest picture.
const MAX_PART: u64 = 1 << 36;
/// Parts grow by this at most before their bytes have come, so that a wrong length costs no
/// memory.
const STEP: u64 = 16 << 20;
/// Parts from this size on go to a file where there is a folder for them.
const LARGE_PART: u64 = 1 << 20;

/// A header with its parts.
#[derive(Debug)]
pub struct Message<H> {
    /// What is said.
    pub header: H,
    /// The bytes that it is said about, in the order that the header's documentation names them;
    /// often none.
    pub parts: Vec<Content>,
}

impl<H> From<H> for Message<H> {
    fn from(header: H) -> Self {
        Self { header, parts: Vec::new() }
    }
}

/// What the server says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Order {
    /// Run this; the first part is the scene's bytes, the next, where the job's sky is a stored map,
    /// that map's, and the last, where [`Task::begins`] says whose, a checkpoint.
    Run(Box<Task>),
    /// End that run.
    Stop {
        /// Its [`Task::run`].
        run: u64,
        /// Whether the picture so far is of use to anyone.
        wants_picture: bool,
    },
    /// The latest snapshot of that run is stored; another one may be sent.
    SnapshotKept {
        /// Its [`Task::run`].
        run: u64,
        /// How often the interval between snapshots has doubled for want of room.
        slower: u32,
    },
    /// The latest checkpoint of that run is stored; another one may be sent.
    CheckpointKept {
        /// Its [`Task::run`].
        run: u64,
        /// What storing it took, µs.
        micros: u64,
    },
}

/// One attempt at a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// Number of this run, never 0 and never used twice by one executor.
    pub run: u64,
    /// The job, for logs.
    pub job: Uuid,
    /// Which counted attempt this is.
    pub attempt: u32,
    /// Id of the scene, a hash of its bytes.
    pub scene: String,
    /// How the scene's bytes are to be read.
    pub scene_format: SceneFormat,
    /// Most triangles of a scene.
    pub max_triangles: usize,
    /// What is asked for.
    pub request: JobRequest,
    /// Longest time of a job, seconds, whatever it asks for.
    pub max_seconds: f64,
    /// How often the interval between snapshots has doubled for want of room.
    pub snapshots_slower: u32,
    /// Threads to compute with.
    pub threads: usize,
    /// Whose the checkpoint is that it begins with, where it does.
    pub begins: Option<Begins>,
    /// Why it begins without one, where it should not.
    pub begins_without: Option<String>,
    /// Seconds between checkpoints; 0 for none.
    pub checkpoint_every_s: f64,
    /// When the first one is taken, where that is sooner: the job was interrupted often. The pauses
    /// after it double.
    pub first_checkpoint_s: Option<f64>,
    /// Most bytes of one.
    pub most_checkpoint_bytes: u64,
    /// Whether what is known at the end is kept, with the light baked.
    pub keeps_solution: bool,
    /// Most bytes of scenes that the device keeps for its next jobs.
    pub kept_scene_bytes: u64,
}

/// What an executor says. Between `Ready` and the end it speaks of one run at a time: that of the
/// latest task, up to `Rendered` or `Failed`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ExecutorEvent {
    /// The device is open.
    Ready,
    /// The device does not open; nothing follows.
    NoDevice {
        /// Why.
        error: String,
    },
    /// The scene is read, solving begins.
    Began,
    /// What the engine decided.
    Planned(Plan, Vec<Warning>),
    /// The figures moved.
    Progress(Progress),
    /// A picture of the present state.
    Snapshot(Progress, PictureParts),
    /// All that the method knows; the first part is the checkpoint's bytes, the second, at the end
    /// and where there are patches, a GLB file with their light.
    Checkpoint(Box<Header>),
    /// Nothing more is rendered in this run; its picture is being encoded.
    Solved,
    /// The run is over, with a picture unless it was stopped and none was wanted.
    Rendered(Box<Stats>, Option<PictureParts>),
    /// The run came to nothing.
    Failed(Failure),
}

/// A picture as files, which are the parts of its message: one a format, in this order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureParts {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// What the parts are.
    pub formats: Vec<PictureFormat>,
}

/// Why an attempt came to nothing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// A short name for programs, as [`crate::api::jobs::JobError::code`].
    pub code: String,
    /// What happened, in words.
    pub detail: String,
    /// Whether another attempt may succeed.
    pub retry: bool,
    /// Whether the device can go on.
    pub device_is_sound: bool,
}

/// The code of failures of the storage, which say nothing of the job.
pub const STORAGE: &str = "storage";

impl Failure {
    /// A failure that another attempt would meet again, on a device that can go on.
    pub fn new(code: &str, detail: impl Into<String>) -> Self {
        Self { code: code.into(), detail: detail.into(), retry: false, device_is_sound: true }
    }

    /// The device, or whoever runs tasks on it, has failed: another attempt may succeed, and the
    /// device must be opened again first.
    pub fn of_executor(detail: String) -> Self {
        Self { retry: true, device_is_sound: false, ..Self::new("device", detail) }
    }
}

/// Writes a message.
///
/// # Errors
/// As the pipe.
pub fn write<H: Serialize>(pipe: &mut impl Write, message: &Message<H>) -> io::Result<()> {
    let header = serde_json::to_vec(&message.header)?;
    let length = u32::try_from(header.len()).ok().filter(|length| *length <= MAX_HEADER);
    let length = length.ok_or_else(|| io::Error::other("the header is too long"))?;
    let parts = u32::try_from(message.parts.len()).ok().filter(|parts| *parts <= MAX_PARTS);
    let parts = parts.ok_or_else(|| io::Error::other("there are too many parts"))?;
    pipe.write_all(&length.to_le_bytes())?;
    pipe.write_all(&parts.to_le_bytes())?;
    for part in &message.parts {
        pipe.write_all(&part.size()?.to_le_bytes())?;
    }
    pipe.write_all(&header)?;
    for part in &message.parts {
        part.write_to(pipe)?;
    }
    pipe.flush()
}

/// Reads a message; `None` where the pipe ends between two. Large parts go to files without a name
/// in `folder`; without one, or where the disk has no room for them, they are held in memory.
///
/// # Errors
/// As the pipe, or where what comes is no message.
pub fn read<H: DeserializeOwned>(
    pipe: &mut impl Read,
    folder: Option<&Path>,
) -> io::Result<Option<Message<H>>> {
    let mut counts = [0; 8];
    match pipe.read(&mut counts[..1])? {
        0 => return Ok(None),
        _ => pipe.read_exact(&mut counts[1..])?,
    }
    let [a, b, c, d, rest @ ..] = counts;
    let (header, parts) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes(rest));
    if header > MAX_HEADER || parts > MAX_PARTS {
        return Err(io::Error::other("this is no message"));
    }
    let mut lengths = Vec::new();
    for _ in 0..parts {
        let mut length = [0; 8];
        pipe.read_exact(&mut length)?;
        let length = u64::from_le_bytes(length);
        if length > MAX_PART {
            return Err(io::Error::other(format!("no part has {length} bytes")));
        }
        lengths.push(length);
    }
    let header = serde_json::from_slice(&take(pipe, u64::from(header))?)?;
    let mut parts = Vec::new();
    for length in lengths {
        let file = folder.filter(|_| length >= LARGE_PART).and_then(|to| file_for(to, length));
        parts.push(match file {
            Some(mut file) => {
                copy(pipe, &mut file, length)?;
                Content::from(file)
            }
            None => Content::from(take(pipe, length)?),
        });
    }
    Ok(Some(Message { header, parts }))
}

/// A file with room for so many bytes. They are claimed before any is written: a disk that turned
/// out to be full in the middle of a part would take the part with it.
fn file_for(folder: &Path, length: u64) -> Option<File> {
    let file = tempfile::tempfile_in(folder).ok()?;
    let mode = FallocateFlags::KEEP_SIZE;
    let claimed = rustix::fs::fallocate(&file, mode, 0, length);
    claimed.ok().map(|()| file)
}

fn copy(pipe: &mut impl Read, out: &mut impl Write, length: u64) -> io::Result<()> {
    match io::copy(&mut pipe.by_ref().take(length), out)? {
        copied if copied == length => Ok(()),
        _ => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

fn take(pipe: &mut impl Read, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut left = length;
    while left > 0 {
        let step = left.min(STEP);
        bytes.reserve_exact(step as usize);
        copy(pipe, &mut bytes, step)?;
        left -= step;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Header and parts as they can be compared.
    fn content<H: Serialize>(message: Message<H>) -> (Value, Vec<Vec<u8>>) {
        let parts = message.parts.into_iter().map(|part| part.into_bytes().unwrap().to_vec());
        (serde_json::to_value(&message.header).unwrap(), parts.collect())
    }

    fn files(formats: Vec<PictureFormat>) -> PictureParts {
        PictureParts { width: 2, height: 1, formats }
    }

    #[test]
    fn messages_come_out_as_they_went_in() {
        let progress = Progress { seconds: 0.1, ..Progress::default() };
        let said = || {
            let snapshot =
                ExecutorEvent::Snapshot(progress.clone(), files(vec![PictureFormat::Png]));
            let parts = [vec![7; 24], Vec::new(), vec![1]].map(Content::from).into();
            [
                Message::from(ExecutorEvent::Ready),
                Message { header: snapshot, parts },
                Message::from(ExecutorEvent::Failed(Failure::new("panic", "an unexpected fault"))),
            ]
        };
        let mut pipe = Vec::new();
        said().iter().for_each(|message| write(&mut pipe, message).unwrap());
        let mut rest = pipe.as_slice();
        for message in said() {
            let read = read::<ExecutorEvent>(&mut rest, None).unwrap().unwrap();
            assert_eq!(content(read), content(message));
        }
        assert!(read::<ExecutorEvent>(&mut rest, None).unwrap().is_none());
        // A pipe that breaks off is no orderly end, wherever it does.
        let first = 8 + serde_json::to_vec(&ExecutorEvent::Ready).unwrap().len();
        let second = first + {
            let mut rest = &pipe[first..];
            read::<ExecutorEvent>(&mut rest, None).unwrap();
            pipe.len() - first - rest.len()
        };
        for length in (1..pipe.len()).filter(|length| ![first, second].contains(length)) {
            let mut rest = &pipe[..length];
            let end = std::iter::repeat_with(|| read::<ExecutorEvent>(&mut rest, None))
                .find(|message| !matches!(message, Ok(Some(_))));
            assert!(end.unwrap().is_err(), "cut to {length}");
        }
    }

    #[test]
    fn large_parts_go_to_files_and_small_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        let large: Vec<u8> = (0..LARGE_PART + 3).map(|i| (i % 251) as u8).collect();
        let parts = || [large.clone(), vec![1, 2], large.clone()].map(Content::from).into();
        let formats = vec![PictureFormat::Exr];
        let header = || ExecutorEvent::Snapshot(Progress::default(), files(formats.clone()));
        let mut pipe = Vec::new();
        for _ in 0..2 {
            write(&mut pipe, &Message { header: header(), parts: parts() }).unwrap();
        }
        // Where there is no such folder, as where the disk is full, nothing is lost.
        let nowhere = folder.path().join("not there");
        let mut rest = pipe.as_slice();
        for (to, in_file) in [(folder.path(), true), (&nowhere, false)] {
            let read = read::<ExecutorEvent>(&mut rest, Some(to)).unwrap().unwrap();
            let are_files: Vec<_> =
                read.parts.iter().map(|part| matches!(part, Content::File(_))).collect();
            assert_eq!(are_files, [in_file, false, in_file]);
            let expected = Message { header: header(), parts: parts() };
            assert!(content(read) == content(expected), "in a file: {in_file}");
        }
        let cut = &pipe[..pipe.len() / 3];
        assert!(read::<ExecutorEvent>(&mut &*cut, Some(folder.path())).is_err());
        assert!(file_for(folder.path(), u64::MAX >> 1).is_none(), "no disk has so much room");
    }

    #[test]
    fn wrong_lengths_cost_no_memory() {
        let mut frame = vec![2, 0, 0, 0, 1, 0, 0, 0];
        frame.extend(MAX_PART.to_le_bytes());
        frame.extend(b"{}rest");
        let read: io::Result<Option<Message<Value>>> = read(&mut frame.as_slice(), None);
        assert_eq!(read.unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        let nonsense = [255; 64];
        assert!(super::read::<ExecutorEvent>(&mut nonsense.as_slice(), None).is_err());
    }
}
