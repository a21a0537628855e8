//! Where the audit log is written, and how much of it those may fill who are not let in.

use crate::config::GuardConfig;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Lines a second of requests that were not let in.
const STRANGERS_A_SECOND: u32 = 20;

/// Where lines go.
pub struct AuditLog {
    is_on: bool,
    file: Option<PathBuf>,
    refused: Mutex<RefusedRequests>,
}

/// Counts the audit lines about requests that were refused, to limit their number.
#[derive(Default)]
struct RefusedRequests {
    /// In the second that began then.
    lines: Option<(Instant, u32)>,
    left_out: u64,
}

impl RefusedRequests {
    /// Whether there may be another line, and how many were left out since the last one.
    fn next(&mut self) -> Option<u64> {
        let now = Instant::now();
        let second = Duration::from_secs(1);
        let (began, lines) =
            self.lines.filter(|(began, _)| now.duration_since(*began) < second).unwrap_or((now, 0));
        self.lines = Some((began, lines + 1));
        if lines >= STRANGERS_A_SECOND {
            self.left_out += 1;
            return None;
        }
        Some(std::mem::take(&mut self.left_out))
    }
}

impl AuditLog {
    /// As the operator has set it.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn new(config: &GuardConfig) -> std::io::Result<Self> {
        let audit = Self {
            is_on: config.audit.is_on(),
            file: config.audit_file.clone(),
            refused: Mutex::default(),
        };
        if audit.is_on {
            audit.write(b"")?;
        }
        Ok(audit)
    }

    /// Whether there is a log at all.
    pub fn is_wanted(&self) -> bool {
        self.is_on && tracing::enabled!(target: "audit", tracing::Level::INFO)
    }

    /// Writes a whole line at once. The file is opened for each, so that it may be moved away at
    /// any time.
    pub fn write(&self, line: &[u8]) -> std::io::Result<()> {
        match &self.file {
            Some(path) => File::options().create(true).append(true).open(path)?.write_all(line),
            None => std::io::stderr().lock().write_all(line),
        }
    }

    /// Whether there may be another line of a request that was not let in, and how many were left
    /// out since the last one.
    pub fn next_of_strangers(&self) -> Option<u64> {
        self.refused.lock().unwrap_or_else(PoisonError::into_inner).next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_not_let_in_does_not_fill_the_log() {
        let mut refused = RefusedRequests::default();
        let written = (0..1000).filter(|_| refused.next().is_some()).count() as u64;
        assert_eq!(written, u64::from(STRANGERS_A_SECOND));
        refused.lines = refused.lines.map(|(began, lines)| (began - Duration::from_secs(1), lines));
        assert_eq!(refused.next(), Some(1000 - written), "they are counted");
        assert_eq!(refused.next(), Some(0));
    }
}
