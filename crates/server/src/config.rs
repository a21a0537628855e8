//! What an operator can set.

mod guard;
mod intake;

pub use guard::GuardConfig;
pub use intake::IntakeConfig;

use crate::api::limits::{HARD_MAX_PIXELS, HARD_MAX_SIDE, JobLimits};
use crate::memory;
use crate::telemetry::LogFormat;
use clap::{Args, ValueEnum};
use std::net::SocketAddr;
use std::path::PathBuf;

/// Most threads of all devices together.
const MAX_THREADS: usize = 4096;

/// Settings of `hemilux serve`; each is also an environment variable.
#[derive(Args, Clone, Debug)]
pub struct Config {
    /// Address and port to listen on; port 0 picks a free one.
    #[arg(long, env = "HEMILUX_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// Allow a --listen address that other machines can reach while no API keys are asked for:
    /// everyone who reaches the port can then use the service. Not needed behind a proxy on the
    /// same machine.
    #[arg(long, env = "HEMILUX_ALLOW_REMOTE", action = clap::ArgAction::SetTrue, value_parser = clap::builder::BoolishValueParser::new())]
    pub allow_remote: bool,
    /// Folder of the database and the files; created if missing.
    #[arg(long, env = "HEMILUX_DATA_DIR", default_value = "./hemilux-data")]
    pub data_dir: PathBuf,
    /// Devices of the pool: `auto`, `cpu`, or ids from `hemilux devices`, comma-separated.
    #[arg(long, env = "HEMILUX_DEVICES", default_value = "auto", value_delimiter = ',')]
    pub devices: Vec<String>,
    /// Threads that the jobs of all devices compute with together, shared evenly among the devices;
    /// by default as many as this process may use, by its cores, its affinity and its cgroup.
    #[arg(long, env = "HEMILUX_THREADS", value_parser = parse_threads)]
    pub threads: Option<usize>,
    /// Largest upload, MiB.
    #[arg(long, env = "HEMILUX_MAX_UPLOAD_MB", default_value_t = 256, value_parser = clap::value_parser!(u64).range(1..=65_536))]
    pub max_upload_mb: u64,
    /// Longest side of a picture, pixels.
    #[arg(long, env = "HEMILUX_MAX_SIDE", default_value_t = 8192, value_parser = clap::value_parser!(u32).range(1..=i64::from(HARD_MAX_SIDE)))]
    pub max_side: u32,
    /// Most pixels of a picture.
    #[arg(long, env = "HEMILUX_MAX_PIXELS", default_value_t = 16 << 20, value_parser = clap::value_parser!(u64).range(1..=HARD_MAX_PIXELS))]
    pub max_pixels: u64,
    /// Longest time that a job may take, seconds: the largest time budget, and the end of a job that
    /// only names other limits. It changes nothing else about a job.
    #[arg(long, env = "HEMILUX_MAX_SECONDS", default_value_t = 3600.0, value_parser = parse_seconds)]
    pub max_seconds: f64,
    /// Most patches that a job may ask for.
    #[arg(long, env = "HEMILUX_MAX_PATCHES", default_value_t = 2_000_000)]
    pub max_patches: u64,
    /// Jobs that may wait; beyond it the server answers 429.
    #[arg(long, env = "HEMILUX_MAX_QUEUED", default_value_t = 1000)]
    pub max_queued: u64,
    /// Most triangles of a scene; those of a mesh that instances share count once, and each of its
    /// instances as two.
    #[arg(long, env = "HEMILUX_MAX_TRIANGLES", default_value_t = 4_000_000)]
    pub max_triangles: usize,
    /// Seconds between checkpoints of a running job, more where writing them would cost over 2 %
    /// of the time; 0 for none.
    #[arg(long, env = "HEMILUX_CHECKPOINT_EVERY_S", default_value_t = 10.0, value_parser = parse_pause)]
    pub checkpoint_every_s: f64,
    /// Largest checkpoint, MiB, and so the largest solution that is kept of an ended job, to
    /// extend it or to take other views; 0 keeps none beyond the end.
    #[arg(long, env = "HEMILUX_KEEP_SOLUTIONS_MB", default_value_t = 256, value_parser = clap::value_parser!(u64).range(0..=65_536))]
    pub keep_solutions_mb: u64,
    /// How the log on standard error is written.
    #[arg(long, env = "HEMILUX_LOG_FORMAT", value_enum, default_value_t)]
    pub log_format: LogFormat,
    /// Access, quotas, admission, webhooks, retention.
    #[command(flatten)]
    pub guard: GuardConfig,
    /// Connections, uploads, imports.
    #[command(flatten)]
    pub intake: IntakeConfig,
    /// Where jobs run: in a process per device, so that nothing that a job does can end the
    /// server, or in threads of the server.
    #[arg(long, env = "HEMILUX_ISOLATION", value_enum, default_value_t = Isolation::Process)]
    pub isolation: Isolation,
    /// Most memory of a device's process, MiB of address space beside the 72 that each of its threads
    /// reserves. Without it, the CPU device in a
    /// container with a limit may take that less a quarter, at most 512 MiB, for the server; all
    /// else is unlimited: drivers of GPUs reserve much more address space than they use.
    #[arg(long, env = "HEMILUX_JOB_MEMORY_MB", value_parser = clap::value_parser!(u64).range(64..=67_108_864))]
    pub job_memory_mb: Option<u64>,
    /// Most memory of each device for the scenes of its latest jobs, MiB: another job on one of them
    /// begins without importing it again. At most a quarter of what the device's process may take; 0
    /// keeps none.
    #[arg(long, env = "HEMILUX_KEEP_SCENES_MB", default_value_t = 512, value_parser = clap::value_parser!(u64).range(0..=1_048_576))]
    pub keep_scenes_mb: u64,
    /// Seconds of silence after which a job's device is started again and the attempt counts as
    /// failed; more than any honest iteration takes.
    #[arg(long, env = "HEMILUX_NO_PROGRESS_S", default_value_t = 600.0, value_parser = parse_seconds)]
    pub no_progress_s: f64,
    /// Seconds that a cancelled job gets to hand over its picture so far before its process is
    /// ended.
    #[arg(long, env = "HEMILUX_CANCEL_GRACE_S", default_value_t = 20.0, value_parser = parse_seconds)]
    pub cancel_grace_s: f64,
}

/// Where jobs run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Isolation {
    /// In a process per device.
    Process,
    /// In threads of the server.
    Thread,
}

fn parse_threads(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(threads) if (1..=MAX_THREADS).contains(&threads) => Ok(threads),
        _ => Err(format!("must be a whole number from 1 to {MAX_THREADS}")),
    }
}

fn parse_pause(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number from 0 to 86400".into()),
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 86_400.0 => Ok(seconds),
        _ => Err("must be a number above 0 and at most 86400".into()),
    }
}

impl Config {
    /// What jobs may ask of this server.
    pub fn job_limits(&self) -> JobLimits {
        JobLimits {
            max_side: self.max_side,
            max_pixels: self.max_pixels,
            max_seconds: self.max_seconds,
            max_patches: self.max_patches,
        }
    }

    /// Most memory of that device's process, MiB of address space; `None` is unlimited.
    pub fn device_memory_mb(&self, device: &str) -> Option<u64> {
        let of_container =
            || memory::container().map(|bytes| memory::default_job_limit(bytes) >> 20);
        self.job_memory_mb.or_else(|| if device == "cpu" { of_container() } else { None })
    }

    /// Most bytes of scenes that that device keeps for its next jobs.
    pub fn kept_scene_bytes(&self, device: &str) -> u64 {
        let share = self.device_memory_mb(device).map_or(u64::MAX, |limit| limit / 4);
        self.keep_scenes_mb.min(share) << 20
    }

    /// Largest upload, bytes.
    pub fn max_upload_bytes(&self) -> u64 {
        self.max_upload_mb << 20
    }
}
