//! Multipart forms: whatever the bytes, the answer is a job or a problem document.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    hemilux_fuzz::post("/v1/jobs", "multipart/form-data; boundary=x", data);
});
