//! Events of a job, numbered per job from 1 without ever going back.

use super::jobs::{JobError, Picture, Progress};
use crate::job_state::JobState;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What happened. The serialised `data` of a server-sent event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum EventData {
    /// `snapshot`: a picture of the present state.
    Snapshot(SnapshotEvent),
    /// `progress`: the figures moved.
    Progress(ProgressEvent),
    /// `notice`: something that a client should know; the job goes on.
    Notice(NoticeEvent),
    /// `state`, or the terminal `succeeded`, `failed`, `cancelled`.
    State(StateEvent),
}

impl EventData {
    /// The event's name on the wire.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Snapshot(_) => "snapshot",
            Self::Progress(_) => "progress",
            Self::Notice(_) => "notice",
            Self::State(event) if event.state.is_terminal() => event.state.as_str(),
            Self::State(_) => "state",
        }
    }

    /// Whether no event follows.
    pub fn is_terminal(&self) -> bool {
        matches!(self, Self::State(event) if event.state.is_terminal())
    }

    /// Reads an event back from its stored kind and JSON.
    pub fn from_stored(kind: &str, data: &str) -> Result<Self, serde_json::Error> {
        Ok(match kind {
            "progress" => Self::Progress(serde_json::from_str(data)?),
            "snapshot" => Self::Snapshot(serde_json::from_str(data)?),
            "notice" => Self::Notice(serde_json::from_str(data)?),
            _ => Self::State(serde_json::from_str(data)?),
        })
    }
}

/// The job went into another state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StateEvent {
    /// The new state.
    pub state: JobState,
    /// Counted attempts so far.
    pub attempts: u32,
    /// Why, where there is something to say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The final picture's files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<Picture>,
    /// Why the job failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<JobError>,
}

/// The figures moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProgressEvent {
    /// Which claim of the job reports; grows with every claim.
    pub fence: u64,
    /// The figures.
    #[serde(flatten)]
    pub progress: Progress,
}

/// A picture of the present state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SnapshotEvent {
    /// Its files, one a format.
    pub pictures: Vec<Picture>,
    /// The figures when it was taken.
    pub progress: Progress,
}

/// Something that a client should know; the job goes on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct NoticeEvent {
    /// What it is about, for programs.
    pub what: Notice,
    /// What happened and what follows from it, in words.
    pub detail: String,
    /// Snapshots that were removed, with their events.
    pub removed: u64,
}

/// What a notice is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Notice {
    /// The snapshots of the job reached their share of bytes: every second one is gone, and the
    /// next ones come half as often.
    SnapshotsThinned,
    /// No snapshots are kept until there is room: the disk is short, or the caller's quota is used
    /// up, or one alone is larger than the share. Once there is room, `snapshot` events go on.
    SnapshotsPaused,
}

/// An event as the store keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Number within the job.
    pub seq: u64,
    /// When it was stored.
    pub at: Timestamp,
    /// What happened.
    pub data: EventData,
}
