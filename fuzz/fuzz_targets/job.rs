//! Parameters of a job: whatever the bytes, the answer is a job or a problem document.
#![no_main]

use hemilux::api::jobs::JobRequest;
use hemilux::api::limits::JobLimits;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // What reads back is read the same again, and checking it does not panic.
    if let Ok(job) = read(data) {
        let limits = JobLimits { max_side: 64, max_pixels: 4096, max_seconds: 1.0, max_patches: 9 };
        let errors = job.problems(&limits).len() + hemilux::worker::method_problems(&job).len();
        let _ = hemilux::worker::request_problem(&job);
        assert!(errors < 300);
    }
    hemilux_fuzz::post("/v1/jobs", "application/json", data);
});

fn read(data: &[u8]) -> Result<JobRequest, serde_json::Error> {
    serde_json::from_slice(data)
}
