//! Where results go: a folder for tables and charts, and the generated parts of a page.

use hemilux_charts::table::replace_generated;
use std::path::Path;

/// Why a benchmark could not be done.
pub type Failure = Box<dyn std::error::Error>;

/// Makes the folder and looks whether the page is there: what can't be written should be known
/// before the minutes of measuring.
pub fn prepare(out: &Path, page: Option<&Path>) -> Result<(), Failure> {
    std::fs::create_dir_all(out)
        .map_err(|error| format!("cannot make the folder {}: {error}", out.display()))?;
    if let Some(path) = page {
        std::fs::metadata(path)
            .map_err(|error| format!("cannot rewrite {}: {error}", path.display()))?;
    }
    Ok(())
}

/// Rewrites the named parts of the page, or prints them where there is none.
pub fn publish(page: Option<&Path>, parts: &[(String, String)]) -> Result<(), Failure> {
    let Some(path) = page else {
        parts.iter().for_each(|(name, text)| println!("{name}\n\n{text}\n"));
        return Ok(());
    };
    let read = std::fs::read_to_string(path);
    let mut text = read.map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    for (name, content) in parts {
        text = replace_generated(&text, name, content)
            .map_err(|error| format!("{}: {error}", path.display()))?;
    }
    std::fs::write(path, text)?;
    Ok(())
}

/// Runnable threads, averaged over the last five minutes, where the system tells.
pub fn load() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().nth(1)?.parse().ok()
}

/// Processor, threads and load in words, as items of a list.
pub fn machine() -> String {
    let device = hemilux_engine::device::cpu::CpuDevice::describe();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("- {} ({}), {threads} hardware threads\n{}", device.name, device.driver, busy())
}

/// The load in words, as an item of a list; empty where the system doesn't tell.
pub fn busy() -> String {
    load().map_or_else(String::new, |load| {
        format!("- load average (5 minutes) at the end: {load:.1}\n")
    })
}

/// A figure of /proc/self/status, bytes.
pub fn status_bytes(name: &str) -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    let kilobytes: u64 = line.trim().strip_suffix(" kB")?.trim().parse().ok()?;
    Some(kilobytes << 10)
}
