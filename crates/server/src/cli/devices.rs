//! `hemilux devices`.

use super::process::{Failure, print};
use crate::worker::devices;
use std::fmt::Write;

/// Lists the devices.
pub fn run() -> Result<(), Failure> {
    let mut text = String::new();
    for device in devices::list() {
        let (id, kind, name, driver) = (device.id, device.kind, device.name, device.driver);
        let _ = writeln!(text, "{id:<6} {kind:<15} {name} ({driver})");
    }
    print(&text)
}
