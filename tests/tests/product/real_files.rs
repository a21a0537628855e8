//! Files that others made, as a user has them rendered: `auto` shows what path tracing shows, block
//! of pixels by block. All of the shared files are in docs/stability.md; these are the quicker ones.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_tests::blocks::{block_means, largest_deviation};
use hemilux_tests::server::program;
use hemilux_tests::skips::{shared_folder, skipped};
use std::path::Path;
use std::process::Command;

/// Pixels along a side of a picture, and of a block.
const SIDE: u32 = 48;
const BLOCK: u32 = 8;

fn rendered(file: &Path, method: &str, iterations: u64, seed: u64) -> Picture {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("picture.exr");
    let size = format!("{SIDE}x{SIDE}");
    let mut command = Command::new(program());
    command.arg("render").arg(file).arg("-o").arg(&out);
    command.args(["--device", "cpu", "--size", &size, "--method", method]);
    command.args(["--iterations", &iterations.to_string(), "--seed", &seed.to_string()]);
    let done = command.output().unwrap();
    assert!(done.status.success(), "{file:?}: {}", String::from_utf8_lossy(&done.stderr));
    let decoded = image::open(&out).expect("a picture").into_rgb32f();
    let pixels = decoded.pixels().map(|pixel| Rgb::from_array(pixel.0)).collect();
    Picture::new(decoded.width(), decoded.height(), pixels)
}

/// Asserts that no block of `auto` is off by `bound`, and that one would be if a quarter of the
/// picture had twice `bound` more light.
fn assert_blocks(name: &str, [iterations, passes, seed]: [u64; 3], bound: f64) {
    let file = shared_folder().join("gltf/models").join(name);
    if !file.exists() {
        return skipped(&format!("shared test data, {name}: it is not there"));
    }
    let reference = block_means(&rendered(&file, "ray-traced", passes, seed + 1), BLOCK);
    let ours = rendered(&file, "auto", iterations, seed);
    let deviation = |picture: &Picture| largest_deviation(&block_means(picture, BLOCK), &reference);
    let found = deviation(&ours);
    println!("{name}, seed {seed}: largest deviation of a block {found:.4}");
    assert!(found < bound, "{name}, seed {seed}: {found}");
    let mut planted = ours.clone();
    let quarter = planted.pixels.len() / 4;
    for pixel in &mut planted.pixels[2 * quarter..3 * quarter] {
        *pixel *= 1.0 + 2.0 * bound as f32;
    }
    assert!(deviation(&planted) > bound, "{name}: a planted error is not found");
}

#[test]
fn smooth_and_textured_models_are_those_of_path_tracing() {
    for (seed, name) in ["Duck/Duck.glb", "BoxTextured/BoxTextured.glb"].into_iter().enumerate() {
        assert_blocks(name, [8, 300, seed as u64], 0.03);
    }
    assert_blocks("WaterBottle/WaterBottle.gltf", [8, 300, 3], 0.03);
}

/// Where metal mirrors what stands on it, where dark plastic mirrors itself, and where rough spheres
/// mirror each other.
#[test]
fn gloss_that_mirrors_gloss_is_that_of_path_tracing() {
    assert_blocks("OrientationTest/OrientationTest.glb", [8, 400, 4], 0.04);
    assert_blocks("Suzanne/Suzanne.gltf", [8, 400, 5], 0.03);
}

/// Facets of one plane, some of which see the sky through gaps.
#[test]
fn labels_a_little_above_a_board_cast_no_dark_lines() {
    assert_blocks("VertexColorTest/VertexColorTest.glb", [8, 400, 6], 0.05);
}

/// Edges between metal, paint and coat that are finer than a pixel.
#[test]
fn textures_of_metal_and_paint_are_those_of_path_tracing() {
    assert_blocks("TextureTransformTest/TextureTransformTest.gltf", [8, 300, 7], 0.04);
    assert_blocks("Avocado/Avocado.gltf", [8, 300, 8], 0.03);
}
