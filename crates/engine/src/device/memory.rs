//! How much memory there is.

/// Memory that this process may still take, bytes: what is free of the machine's, and no more than
/// is left of the process's limit on its address space, if it has one; 4 GiB where the system says
/// neither.
pub fn free_memory() -> u64 {
    const UNKNOWN: u64 = 4 << 30;
    let memory = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let of_machine = kibibytes(&memory, "MemAvailable:");
    let taken = kibibytes(&status, "VmSize:").unwrap_or(0);
    let left = address_space(&limits).map(|limit| limit.saturating_sub(taken));
    of_machine.into_iter().chain(left).min().unwrap_or(UNKNOWN)
}

/// A figure in a table of the system's, bytes.
fn kibibytes(table: &str, name: &str) -> Option<u64> {
    let figure = table.lines().find_map(|line| line.strip_prefix(name))?;
    Some(figure.trim().trim_end_matches(" kB").parse::<u64>().ok()? * 1024)
}

/// The soft limit on the address space in a table of limits, bytes.
fn address_space(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_of_the_process_bounds_what_is_free() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units
Max open files            1024                 4096                 files
Max address space         805306368            unlimited            bytes
";
        assert_eq!(address_space(limits), Some(768 << 20));
        assert_eq!(address_space(&limits.replace("805306368", "unlimited")), None);
        assert_eq!(
            kibibytes("MemFree: 1 kB\nMemAvailable:   20 kB\n", "MemAvailable:"),
            Some(20 << 10)
        );
        assert_eq!(kibibytes("", "VmSize:"), None);
        let free = free_memory();
        assert!((1 << 20..1 << 50).contains(&free), "{free}");
    }
}
