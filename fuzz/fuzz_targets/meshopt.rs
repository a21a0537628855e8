//! Streams of meshopt, behind a byte that says how to decode them: whatever the bytes, importing the
//! mesh ends, without a panic, within bounds.
#![no_main]

use hemilux_fuzz::compressed::{import, meshopt};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Some((how, stream)) = data.split_first() {
        import(&meshopt(*how, stream), stream);
    }
});
