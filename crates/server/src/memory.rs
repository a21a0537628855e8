//! How much memory a job could ever have, and who gives way where it runs out.

use std::path::{Path, PathBuf};

/// Values from here on mean "no limit": version 1 of cgroups writes a number near 2^63.
const UNLIMITED: u64 = 1 << 60;
/// What a device's process leaves to the server and its other children where a container bounds
/// them all: a quarter of it, and no more than this many bytes.
const SERVER_RESERVE: u64 = 512 << 20;

/// Bytes of memory that the control groups of this process allow, its own and all around it;
/// `None` where none sets a limit.
pub fn container() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    group_limit(&groups, Path::new("/sys/fs/cgroup"))
}

/// Bytes of memory that a device's process may take by default where a container bounds server and
/// devices together: then the job that takes too much fails, and not the container.
pub fn default_job_limit(container: u64) -> u64 {
    container - SERVER_RESERVE.min(container / 4)
}

/// Bytes of memory that a job may need by estimate where nobody has set a limit for that: what its
/// process may take, `of_process` or else what a container leaves it, and no more than this machine
/// has.
pub fn default_estimate_limit(of_process: Option<u64>) -> Option<u64> {
    machine().into_iter().chain(of_process.or_else(|| container().map(default_job_limit))).min()
}

/// The smallest limit of the groups that the text, in the form of `/proc/self/cgroup`, names below
/// `root`, and of those around them.
fn group_limit(groups: &str, root: &Path) -> Option<u64> {
    let limit_of = |line: &str| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, path) = (fields.next()?, fields.next()?);
        let (folder, file) = if controllers.is_empty() {
            (root.to_owned(), "memory.max")
        } else if controllers.split(',').any(|name| name == "memory") {
            (root.join("memory"), "memory.limit_in_bytes")
        } else {
            return None;
        };
        // In a container the path may be that of the host, of which only the root is to be seen.
        let inside = Path::new(path.trim_start_matches('/'));
        let is_plain = !inside.components().any(|part| part.as_os_str() == "..");
        let groups = inside.ancestors().filter(|_| is_plain).map(|group| folder.join(group));
        groups.chain([folder.clone()]).filter_map(|group| limit(group.join(file))).min()
    };
    groups.lines().filter_map(limit_of).min()
}

/// The limit in a file; `None` where there is none.
fn limit(file: PathBuf) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    text.trim().parse::<u64>().ok().filter(|bytes| *bytes < UNLIMITED)
}

#[cfg(target_os = "linux")]
fn machine() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(not(target_os = "linux"))]
fn machine() -> Option<u64> {
    None
}

/// How much more readily than the server the kernel ends the process of a device where memory runs
/// out.
pub const DEVICE_GOES_EARLY: i16 = 500;
/// The same for the process of an import, which goes before any other.
pub const IMPORT_GOES_FIRST: i16 = 1000;

/// Tells the kernel to end this process before the server where memory runs out (`oom_score_adj`),
/// for children of the server, which can be started again and begin with its number. Where the
/// system knows no such thing, nothing changes.
pub fn offer_to_the_kernel(more: i16) {
    let path = "/proc/self/oom_score_adj";
    let server: i16 =
        std::fs::read_to_string(path).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0);
    let _ = std::fs::write(path, (server.max(0) + more).min(1000).to_string());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linux_says_how_much_memory_there_is() {
        if cfg!(target_os = "linux") {
            let total = default_estimate_limit(None).unwrap();
            assert!((64 << 20..1 << 50).contains(&total), "{total}");
            // What would end its process is refused at the door.
            assert_eq!(default_estimate_limit(Some(64 << 20)), Some(64 << 20));
            assert_eq!(default_estimate_limit(Some(u64::MAX)), machine());
        }
    }

    /// A tree of groups with these files.
    fn tree(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        root
    }

    #[test]
    fn the_smallest_limit_of_all_groups_around_counts() {
        let second = tree(&[
            ("memory.max", "max\n"),
            ("a/memory.max", "3000000000\n"),
            ("a/b/memory.max", "5000000000\n"),
            ("a/b/c/memory.max", "max\n"),
            ("other/memory.max", "1000\n"),
        ]);
        assert_eq!(group_limit("0::/a/b/c\n", second.path()), Some(3_000_000_000));
        assert_eq!(group_limit("0::/\n", second.path()), None);
        // What goes beyond what can be seen is left alone.
        assert_eq!(group_limit("0::/../other\n", second.path()), None);
        // In a container: the path is unknown there, its own limit is that of the root.
        let container = tree(&[("memory.max", "4000\n")]);
        assert_eq!(group_limit("0::/docker/0af3\n", container.path()), Some(4000));
        assert_eq!(group_limit("0::/\n", container.path()), Some(4000));
        assert_eq!(group_limit("", container.path()), None);
        assert_eq!(group_limit("nonsense\n0\n::", container.path()), Some(4000));
    }

    #[test]
    fn the_first_version_is_read_too_and_its_no_limit_is_none() {
        let first = tree(&[
            ("memory/memory.limit_in_bytes", "9223372036854771712\n"),
            ("memory/pod/memory.limit_in_bytes", "2000000\n"),
            ("cpu/pod/memory.limit_in_bytes", "7\n"),
        ]);
        let groups = "12:cpu,cpuacct:/pod\n5:memory:/pod/x\n1:name=systemd:/pod\n0::/pod\n";
        assert_eq!(group_limit(groups, first.path()), Some(2_000_000));
        assert_eq!(group_limit("5:memory:/\n", first.path()), None);
    }

    #[test]
    fn a_job_leaves_the_server_its_share_of_a_container() {
        assert_eq!(default_job_limit(8 << 30), (8 << 30) - (512 << 20));
        assert_eq!(default_job_limit(1 << 30), 768 << 20);
        assert_eq!(default_job_limit(0), 0);
    }
}
