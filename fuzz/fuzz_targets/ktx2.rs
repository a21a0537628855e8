//! Pictures in KTX2 files: whatever the bytes, importing the texture ends, without a panic, within bounds.
#![no_main]

use hemilux_fuzz::compressed::{import, ktx2};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| import(&ktx2(data), data));
