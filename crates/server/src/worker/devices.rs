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

/// The devices that the word of `--device` may mean, best first: for `auto` discrete GPUs, then
/// other real GPUs, then the CPU device.
///
/// # Errors
/// A word that names no device here.
pub fn candidates(word: &str) -> Result<Vec<String>, String> {
    let mut ids = choose(&[word.to_owned()])?;
    if ids.len() > 1 {
        let there = list();
        let rank = |id: &String| {
            let kind = there.iter().find(|device| device.id == *id).map_or("", |d| d.kind.as_str());
            match kind {
                "discrete_gpu" => 0,
                "integrated_gpu" | "virtual_gpu" => 1,
                _ => 2,
            }
        };
        ids.sort_by_key(rank);
    }
    Ok(ids)
}

/// Opens the first of these devices that can be opened, and says on standard error which ones
/// before it could not.
///
/// # Errors
/// What the last one says, where none can.
pub fn open_first(ids: &[String]) -> Result<Box<dyn Device>, String> {
    let mut refusal = String::from("there is no device");
    for (id, left) in ids.iter().zip((0..ids.len()).rev()) {
        match open(id) {
            Ok(device) => return Ok(device),
            Err(error) if left > 0 => eprintln!("warning: device {id} is left out: {error}"),
            Err(error) => refusal = error,
        }
    }
    Err(refusal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_device_is_taken_where_one_cannot_be_opened() {
        let ids = |ids: &[&str]| ids.iter().map(|id| (*id).to_owned()).collect::<Vec<_>>();
        let opened = open_first(&ids(&["999", "cpu"])).expect("the CPU device opens");
        assert_eq!(opened.description().id, "cpu");
        let refusal = open_first(&ids(&["cpu?", "999"])).err().expect("there are none");
        assert!(refusal.contains("999"), "{refusal}");
        assert!(open_first(&[]).is_err());
    }

    #[test]
    fn auto_ends_with_the_cpu_device() {
        let ids = candidates("auto").expect("there is always one");
        assert_eq!(ids.last().map(String::as_str), Some("cpu"));
        assert!(candidates("no such device").is_err());
    }
}
