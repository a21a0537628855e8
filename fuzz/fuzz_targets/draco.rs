//! Streams of Draco: whatever the bytes, importing the mesh ends, without a panic, within bounds.
#![no_main]

use hemilux_fuzz::compressed::{draco, import};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| import(&draco(data), data));
