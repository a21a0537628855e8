//! Settings of who may do how much, and of what is kept.

use crate::api::keys::KeyLimits;
use crate::networks::Network;
use axum::http::HeaderValue;
use clap::builder::BoolishValueParser;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Requests a second of one key or address on a service that other machines reach.
const REMOTE_REQUESTS_PER_S: f64 = 100.0;

/// Whether there is an audit log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AuditLog {
    /// A line for each request that makes, changes, removes or downloads something.
    On,
    /// None.
    Off,
}

impl AuditLog {
    /// Whether there is one.
    pub fn is_on(self) -> bool {
        self == Self::On
    }
}

/// Settings of `hemilux serve`: access, quotas, admission, webhooks, retention.
#[derive(Args, Clone, Debug)]
pub struct GuardConfig {
    /// Ask for an API key even while `hemilux keys` has made none. With the first key every
    /// request to /v1 needs one anyway.
    #[arg(long, env = "HEMILUX_REQUIRE_KEYS", action = clap::ArgAction::SetTrue, value_parser = BoolishValueParser::new())]
    pub require_keys: bool,
    /// Ask for an API key at /metrics too.
    #[arg(long, env = "HEMILUX_METRICS_NEED_KEY", action = clap::ArgAction::SetTrue, value_parser = BoolishValueParser::new())]
    pub metrics_need_key: bool,
    /// Origins whose web pages may use the API, such as https://example.org; comma-separated.
    #[arg(long, env = "HEMILUX_CORS_ORIGIN", value_delimiter = ',', value_parser = parse_origin)]
    pub cors_origin: Vec<HeaderValue>,
    /// Names that clients and proxies call this server by, such as render.example.org;
    /// comma-separated, without ports. While it asks for no API keys, it answers only to them, to
    /// localhost and to IP addresses.
    #[arg(long, env = "HEMILUX_ALLOWED_HOST", value_delimiter = ',', value_parser = parse_host)]
    pub allowed_host: Vec<String>,
    /// Requests a second of one key, or of one address where there are no keys; 0 is no limit.
    /// 100 by default where other machines reach the service, else none.
    #[arg(long, env = "HEMILUX_RATE_LIMIT", value_parser = parse_rate)]
    pub rate_limit: Option<f64>,
    /// Jobs of one key or address that may wait; no limit by default.
    #[arg(long, env = "HEMILUX_MAX_QUEUED_EACH")]
    pub max_queued_each: Option<u64>,
    /// Jobs of one key or address that may run at the same time; no limit by default.
    #[arg(long, env = "HEMILUX_MAX_RUNNING_EACH", value_parser = clap::value_parser!(u64).range(1..))]
    pub max_running_each: Option<u64>,
    /// MiB of scenes and environments of one key or address; no limit by default.
    #[arg(long, env = "HEMILUX_MAX_SCENES_MB_EACH", value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    pub max_scenes_mb_each: Option<u64>,
    /// MiB of snapshots of one job. A job that reaches them loses every second one, and the next
    /// ones come half as often, so that no job fills the disk.
    #[arg(long, env = "HEMILUX_MAX_JOB_MB", default_value_t = 1024, value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    pub max_job_mb: u64,
    /// MiB of pictures and solutions of the jobs of one key or address; beyond it no new jobs of
    /// theirs are taken and no snapshots kept. No limit by default.
    #[arg(long, env = "HEMILUX_MAX_STORED_MB_EACH", value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    pub max_stored_mb_each: Option<u64>,
    /// MiB of the jobs of one key or address that may be pinned; by default half of --keep-gb, or
    /// no limit without it.
    #[arg(long, env = "HEMILUX_MAX_PINNED_MB_EACH", value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    pub max_pinned_mb_each: Option<u64>,
    /// MiB that must stay free on the disk of the data folder; below it nothing new is taken.
    #[arg(long, env = "HEMILUX_MIN_FREE_MB", default_value_t = 256, value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    pub min_free_mb: u64,
    /// MiB of memory that one job may need by estimate. By default all of this machine, or what a
    /// device may take in a container (see --job-memory-mb).
    #[arg(long, env = "HEMILUX_MAX_JOB_MEMORY_MB", value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    pub max_job_memory_mb: Option<u64>,
    /// Networks inside which webhooks may be sent, such as 10.1.0.0/16; comma-separated. Without
    /// it, only public addresses.
    #[arg(long, env = "HEMILUX_WEBHOOK_ALLOW", value_delimiter = ',')]
    pub webhook_allow: Vec<Network>,
    /// Messages to webhooks of one key or address that may wait for their receivers; beyond it
    /// the oldest for the receiver that most wait for are given up. 10,000 by default.
    #[arg(long, env = "HEMILUX_MAX_WEBHOOKS_PENDING_EACH", default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    pub max_webhooks_pending_each: u64,
    /// Whether who made, changed, removed or downloaded what is written down, one JSON object a
    /// line; where RUST_LOG is set, it must let the target `audit` through.
    #[arg(long, env = "HEMILUX_AUDIT", value_enum, default_value_t = AuditLog::On)]
    pub audit: AuditLog,
    /// File that the audit log is added to; standard error by default.
    #[arg(long, env = "HEMILUX_AUDIT_FILE")]
    pub audit_file: Option<PathBuf>,
    /// Days that ended jobs are kept, and scenes that no job uses; for ever by default.
    #[arg(long, env = "HEMILUX_KEEP_DAYS", value_parser = parse_amount)]
    pub keep_days: Option<f64>,
    /// GiB of pictures, solutions and scenes beyond which jobs are removed, those of the key or
    /// address that stores most first, and of these the ones that ended longest ago; no limit by
    /// default.
    #[arg(long, env = "HEMILUX_KEEP_GB", value_parser = parse_amount)]
    pub keep_gb: Option<f64>,
    /// Days that files which no record names stay in quarantine before they are removed.
    #[arg(long, env = "HEMILUX_QUARANTINE_DAYS", default_value_t = 7.0, value_parser = parse_amount)]
    pub quarantine_days: f64,
    /// Move files that no record names into quarantine even where they are more than 20 and more
    /// than a tenth of all files. By default so many stay where they are: the database is probably
    /// the wrong one.
    #[arg(long, env = "HEMILUX_SWEEP_LARGE", action = clap::ArgAction::SetTrue, value_parser = BoolishValueParser::new())]
    pub sweep_large: bool,
    /// Take the files of the data folder over although they belong to another database, or to one
    /// that is gone. What no record names is then not removed at once, but goes into quarantine.
    #[arg(long, env = "HEMILUX_ADOPT_FILES", action = clap::ArgAction::SetTrue, value_parser = BoolishValueParser::new())]
    pub adopt_files: bool,
    /// Hours of uptime for which nothing is removed because of its age after the clock has jumped,
    /// or where the server starts more than a day after it last ran; 0 believes the clock at once.
    #[arg(long, env = "HEMILUX_CLOCK_GRACE_HOURS", default_value_t = 24.0, value_parser = parse_hours)]
    pub clock_grace_hours: f64,
}

impl GuardConfig {
    /// Quotas of a key that has none of its own, or of an address.
    pub fn limits(&self, is_remote: bool) -> KeyLimits {
        let rate = self.rate_limit.unwrap_or(if is_remote { REMOTE_REQUESTS_PER_S } else { 0.0 });
        KeyLimits {
            requests_per_s: (rate > 0.0).then_some(rate),
            jobs_queued: self.max_queued_each,
            jobs_running: self.max_running_each,
            scene_bytes: self.max_scenes_mb_each.map(|mb| mb << 20),
            stored_bytes: self.max_stored_mb_each.map(|mb| mb << 20),
            pinned_bytes: match self.max_pinned_mb_each {
                Some(mb) => Some(mb << 20),
                None => self.keep_bytes().map(|bytes| bytes / 2),
            },
        }
    }

    /// Most bytes that are kept.
    pub fn keep_bytes(&self) -> Option<u64> {
        self.keep_gb.map(|gb| (gb * f64::from(1 << 30)) as u64)
    }
}

/// An origin as browsers send it: scheme, host and perhaps a port, nothing after it.
fn parse_origin(text: &str) -> Result<HeaderValue, String> {
    let rule = || format!("{text:?} must read like https://example.org or http://localhost:3000");
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let is_host = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || ".-:[]".contains(c);
    match rest {
        Some(rest) if !rest.is_empty() && rest.chars().all(is_host) => {
            text.parse().map_err(|_| rule())
        }
        _ => Err(rule()),
    }
}

/// A host's name as `Host` headers have it, without a port.
fn parse_host(text: &str) -> Result<String, String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || ".-_".contains(c);
    if !text.is_empty() && text.len() <= 253 && text.chars().all(is_part) {
        Ok(text.to_ascii_lowercase())
    } else {
        Err(format!("{text:?} must be a name such as render.example.org, without scheme or port"))
    }
}

fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.0..=1e6).contains(&rate) => Ok(rate),
        _ => Err("must be a number between 0 and 1000000".into()),
    }
}

fn parse_hours(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hours) if (0.0..=8760.0).contains(&hours) => Ok(hours),
        _ => Err("must be a number of hours from 0 to 8760".into()),
    }
}

fn parse_amount(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(amount) if amount > 0.0 && amount <= 1e6 => Ok(amount),
        _ => Err("must be a number above 0 and at most 1000000".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_whole_and_bare() {
        for good in ["https://example.org", "http://localhost:3000", "http://[::1]:80"] {
            assert!(parse_origin(good).is_ok(), "{good}");
        }
        for bad in ["", "*", "null", "example.org", "https://", "https://a/", "https://A.org"] {
            assert!(parse_origin(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn hosts_are_bare_names() {
        assert_eq!(parse_host("Render.example.org").as_deref(), Ok("render.example.org"));
        for bad in ["", "*", "a:80", "https://a", "a b", "a/", "[::1]"] {
            assert!(parse_host(bad).is_err(), "{bad}");
        }
    }
}
