//! What the server and an executor say to each other, and how it travels over a pipe.
//!
//! A message is a header, plain data in JSON, and parts, bytes that JSON would only bloat: scenes,
//! pixels. On a pipe: length of the header and number of parts, u32; lengths of the parts, u64, all
//! little-endian; header; parts. To a thread of the same process messages go as they are.

use crate::api::Warning;
use crate::api::jobs::{JobRequest, Plan, Progress, Stats};
use crate::api::scenes::SceneFormat;
use crate::api::solutions::Begins;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};
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

/// A header with its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Message<H> {
    /// What is said.
    pub header: H,
    /// The bytes that it is said about, in the order that the header's documentation names them;
    /// often none.
    pub parts: Vec<Vec<u8>>,
}

impl<H> Message<H> {
    /// A message about some bytes.
    pub fn about(header: H, part: Vec<u8>) -> Self {
        Self { header, parts: vec![part] }
    }
}

impl<H> From<H> for Message<H> {
    fn from(header: H) -> Self {
        Self { header, parts: Vec::new() }
    }
}

/// What the server says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Order {
    /// Run this; the first part is the scene's bytes, the second, where [`Task::begins`] says
    /// whose, a checkpoint.
    Run(Box<Task>),
    /// End that run, with the picture so far.
    Stop {
        /// Its [`Task::run`].
        run: u64,
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
}

/// What an executor says. Between `Ready` and the end it speaks of one run at a time: that of the
/// latest task, up to `Rendered` or `Failed`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Said {
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
    /// A picture of the present state; one part, its pixels.
    Snapshot(Progress, Size),
    /// All that the method knows; the first part is the checkpoint's bytes, the second, at the end
    /// and where there are patches, a GLB file with their light.
    Checkpoint(Checkpointed),
    /// The run is over; one part, the picture's pixels.
    Rendered(Box<Stats>, Size),
    /// The run came to nothing.
    Failed(Failure),
}

/// What a checkpoint is of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpointed {
    /// The method that runs.
    pub method: String,
    /// Whole iterations.
    pub iterations: u64,
    /// Seconds that they took.
    pub seconds: f64,
    /// Estimated rRMSE of the picture at that moment.
    pub estimated_error: Option<f64>,
}

/// Width and height of a picture, pixels. Its part has 12 bytes a pixel: red, green and blue
/// as f32, little-endian, rows from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Size(pub u32, pub u32);

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

impl Failure {
    /// A failure that another attempt would meet again, on a device that can go on.
    pub fn new(code: &str, detail: impl Into<String>) -> Self {
        Self { code: code.into(), detail: detail.into(), retry: false, device_is_sound: true }
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
        pipe.write_all(&(part.len() as u64).to_le_bytes())?;
    }
    pipe.write_all(&header)?;
    for part in &message.parts {
        pipe.write_all(part)?;
    }
    pipe.flush()
}

/// Reads a message; `None` where the pipe ends between two.
///
/// # Errors
/// As the pipe, or where what comes is no message.
pub fn read<H: DeserializeOwned>(pipe: &mut impl Read) -> io::Result<Option<Message<H>>> {
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
    let parts = lengths.into_iter().map(|length| take(pipe, length)).collect::<Result<_, _>>()?;
    Ok(Some(Message { header, parts }))
}

fn take(pipe: &mut impl Read, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut left = length;
    while left > 0 {
        let step = left.min(STEP);
        bytes.reserve_exact(step as usize);
        let got = pipe.by_ref().take(step).read_to_end(&mut bytes)?;
        if got as u64 != step {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        left -= step;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_out_as_they_went_in() {
        let progress = Progress { iterations: 3, seconds: 0.1, ..Progress::default() };
        let said = [
            Message::from(Said::Ready),
            Message {
                header: Said::Snapshot(progress, Size(2, 1)),
                parts: vec![vec![7; 24], Vec::new(), vec![1]],
            },
            Message::from(Said::Failed(Failure::new("panic", "an unexpected fault"))),
        ];
        let mut pipe = Vec::new();
        said.iter().for_each(|message| write(&mut pipe, message).unwrap());
        let mut rest = pipe.as_slice();
        for message in &said {
            assert_eq!(read(&mut rest).unwrap().as_ref(), Some(message));
        }
        assert_eq!(read::<Said>(&mut rest).unwrap(), None);
        // A pipe that breaks off is no orderly end, wherever it does.
        let first = 8 + serde_json::to_vec(&Said::Ready).unwrap().len();
        let second = first + {
            let mut rest = &pipe[first..];
            read::<Said>(&mut rest).unwrap();
            pipe.len() - first - rest.len()
        };
        for length in (1..pipe.len()).filter(|length| ![first, second].contains(length)) {
            let mut rest = &pipe[..length];
            let end = std::iter::repeat_with(|| read::<Said>(&mut rest))
                .find(|message| !matches!(message, Ok(Some(_))));
            assert!(end.unwrap().is_err(), "cut to {length}");
        }
    }

    #[test]
    fn wrong_lengths_cost_no_memory() {
        let mut frame = vec![2, 0, 0, 0, 1, 0, 0, 0];
        frame.extend(MAX_PART.to_le_bytes());
        frame.extend(b"{}rest");
        let read: io::Result<Option<Message<serde_json::Value>>> = read(&mut frame.as_slice());
        assert_eq!(read.unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        let nonsense = [255; 64];
        assert!(super::read::<Said>(&mut nonsense.as_slice()).is_err());
    }
}
