//! Devices of this machine.

use crate::api::DeviceView;
use hemilux_engine::device::{self, Device};

/// All devices, none marked as being in a pool.
pub fn list() -> Vec<DeviceView> {
    device::list()
        .into_iter()
        .map(|device| DeviceView {
            id: device.id,
            name: device.name,
            kind: device.kind,
            driver: device.driver,
            in_pool: false,
            status: None,
            job: None,
            error: None,
            restarts: 0,
            last_fault: None,
        })
        .collect()
}

/// Opens a device; a panicking driver counts as one that does not open.
pub fn open(id: &str) -> Result<Box<dyn Device>, String> {
    match std::panic::catch_unwind(|| device::open(id)) {
        Ok(opened) => opened.map_err(|error| error.to_string()),
        Err(panic) => Err(format!("opening panicked: {}", crate::panic_text(&*panic))),
    }
}

/// The device ids that the words of `--devices` mean. `auto` is every GPU and the CPU device:
/// software GPUs are left out, the CPU device is faster than they are.
///
/// # Errors
/// A word that names no device here.
pub fn choose(words: &[String]) -> Result<Vec<String>, String> {
    // Looking for GPUs takes time and makes some drivers talk.
    if words.iter().all(|word| word == "cpu") && !words.is_empty() {
        return Ok(vec!["cpu".into()]);
    }
    let there = list();
    let mut chosen: Vec<String> = Vec::new();
    for word in words {
        let ids: Vec<String> = if word == "auto" {
            let wanted = |device: &&DeviceView| {
                device.kind.ends_with("_gpu") && device.kind != "software_gpu" || device.id == "cpu"
            };
            there.iter().filter(wanted).map(|device| device.id.clone()).collect()
        } else {
            there.iter().filter(|device| device.id == *word).map(|d| d.id.clone()).collect()
        };
        if ids.is_empty() {
            let known: Vec<_> = there.iter().map(|device| device.id.as_str()).collect();
            return Err(format!("no device {word:?} here; there are {known:?}"));
        }
        for id in ids {
            if !chosen.contains(&id) {
                chosen.push(id);
            }
        }
    }
    if chosen.is_empty() { Err("--devices names no device".into()) } else { Ok(chosen) }
}

/// The one device that the word of `--device` means: `auto` is the first discrete GPU, else any
/// real GPU, else the CPU.
///
/// # Errors
/// A word that names no device here.
pub fn choose_one(word: &str) -> Result<String, String> {
    let ids = choose(&[word.to_owned()])?;
    if let [only] = ids.as_slice() {
        return Ok(only.clone());
    }
    let there = list();
    let rank = |id: &String| {
        let kind = there.iter().find(|device| device.id == *id).map_or("", |d| d.kind.as_str());
        match kind {
            "discrete_gpu" => 0,
            "integrated_gpu" | "virtual_gpu" => 1,
            _ => 2,
        }
    };
    ids.into_iter().min_by_key(rank).ok_or_else(|| "there is no device".into())
}
