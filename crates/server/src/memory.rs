//! How much memory a job could ever have.

/// Bytes of memory of this machine, or of the container that this process is in; `None` where
/// the system does not say.
pub fn total() -> Option<u64> {
    let machine = machine();
    let container = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let container = container.and_then(|text| text.trim().parse::<u64>().ok());
    machine.into_iter().chain(container).min()
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

/// How readily the kernel ends the process of a device where memory runs out: before the server,
/// whose number is 0 unless somebody has set another.
pub const DEVICE_GOES_EARLY: i16 = 500;
/// The same for the process of an import, which goes before any other.
pub const IMPORT_GOES_FIRST: i16 = 1000;

/// Tells the kernel how readily to end this process where memory runs out (`oom_score_adj`), for
/// children of the server, which can be started again. Where the system knows no such thing, or
/// the process stands higher already, nothing changes.
pub fn offer_to_the_kernel(readiness: i16) {
    let _ = std::fs::write("/proc/self/oom_score_adj", readiness.to_string());
}

#[cfg(test)]
mod tests {
    #[test]
    fn linux_says_how_much_memory_there_is() {
        if cfg!(target_os = "linux") {
            let total = super::total().unwrap();
            assert!((64 << 20..1 << 50).contains(&total), "{total}");
        }
    }
}
