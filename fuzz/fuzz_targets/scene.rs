//! Scene files: whatever the bytes, importing them ends, without a panic, within bounds.
#![no_main]

use hemilux::api::scenes::SceneFormat;
use hemilux::worker::scenes::{load, options};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    for format in [SceneFormat::Gltf, SceneFormat::Bundle] {
        match load(format, data, &options(10_000, None)) {
            Ok(scene) => assert!(scene.triangles.len() <= 10_000),
            // The service lives through a panic of the importer; here it is a finding.
            Err(refusal) => assert!(!refusal.what.starts_with("the importer failed"), "{refusal}"),
        }
    }
});
