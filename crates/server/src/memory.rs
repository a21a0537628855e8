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
