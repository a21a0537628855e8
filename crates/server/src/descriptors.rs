//! How many files and connections this process may have open. Systems set two limits: a soft one,
//! often 1,024, for programs that cannot do with more, and a hard one up to which a program may
//! raise it.

use rustix::process::{Resource, getrlimit, setrlimit};

/// Most connections at the same time, whatever the limit on files: each costs some kilobytes.
const MAX_CONNECTIONS: u64 = 8192;
/// Most files that are asked for: some systems have a hard limit of a thousand million.
const MOST: u64 = 1 << 20;
/// Files of the service itself: the database, pipes to devices, webhooks, the runtime.
const RESERVE: u64 = 192;
/// Files of an upload: what arrives, its bundle, and the pipes of its import.
const PER_UPLOAD: u64 = 4;
/// Files of a connection: itself, and the file that it is sent.
const PER_CONNECTION: u64 = 2;
/// Fewest connections, however few files there may be.
const LEAST_CONNECTIONS: u64 = 8;

/// Raises the soft limit on open files to the hard one; the limit that then holds.
pub fn raise_limit() -> u64 {
    let mut limit = getrlimit(Resource::Nofile);
    let before = limit.current;
    let wanted = limit.maximum.unwrap_or(MOST).min(MOST);
    if before.is_some_and(|before| before < wanted) {
        limit.current = Some(wanted);
        if let Err(error) = setrlimit(Resource::Nofile, limit) {
            tracing::warn!(%error, "cannot raise the limit on open files");
        }
    }
    getrlimit(Resource::Nofile).current.unwrap_or(MOST)
}

/// How many connections there may be where so many files and uploads may be open.
pub fn connections(files: u64, uploads: u64) -> u64 {
    let left = files.saturating_sub(RESERVE + PER_UPLOAD * uploads);
    (left / PER_CONNECTION).clamp(LEAST_CONNECTIONS, MAX_CONNECTIONS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_leave_files_for_everything_else() {
        assert_eq!(connections(1 << 20, 32), MAX_CONNECTIONS);
        assert_eq!(connections(1024, 32), (1024 - 192 - 128) / 2);
        assert_eq!(connections(64, 32), LEAST_CONNECTIONS);
        assert_eq!(connections(0, u64::from(u32::MAX)), LEAST_CONNECTIONS);
    }

    #[test]
    fn the_limit_is_the_hard_one() {
        let now = raise_limit();
        let hard = getrlimit(Resource::Nofile).maximum.unwrap_or(MOST);
        assert!(now >= hard.min(MOST), "{now} of {hard}");
    }
}
