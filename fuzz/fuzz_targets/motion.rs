//! Scene files in motion: whatever the bytes, any scene of a file at any moment of any of its
//! animations is imported or refused, without a panic, within bounds.
#![no_main]

use hemilux::api::jobs::JobRequest;
use hemilux::api::parts::PartRequest;
use hemilux::api::scenes::SceneFormat;
use hemilux::worker::scenes::{load, options};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // Two bytes choose what is asked for; the rest is the file.
    let Some(([which, moment], file)) = data.split_first_chunk::<2>() else { return };
    let asked = serde_json::json!({ "time": f64::from(*moment) / 16.0 });
    let mut job: JobRequest = serde_json::from_value(asked).expect("all else has defaults");
    job.animation = Some(PartRequest::Index(u32::from(which & 3)));
    // One file in four is asked for a scene of its own.
    job.gltf_scene = (which >> 6 == 3).then(|| PartRequest::Index(u32::from(which >> 2 & 3)));
    match load(SceneFormat::Gltf, file, &options(10_000, Some(&job))) {
        Ok(scene) => assert!(scene.triangles.len() <= 10_000),
        // The service lives through a panic of the importer; here it is a finding.
        Err(refusal) => assert!(!refusal.what.starts_with("the importer failed"), "{refusal}"),
    }
});
