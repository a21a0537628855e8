//! Errors fall with time at the rate that each method should have: as 1/√n where chance alone is left,
//! geometrically where a balance is solved, and to a floor where a mesh or an interpolation stays.

use crate::references::{CORNELL_SIDE, cornell_halves};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{Limits, RenderRequest, StopReason, Unobserved};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{away_from_light, relative_rmse};
use hemilux_tests::halves::Halves;
use hemilux_tests::replicas::Replicas;
use hemilux_tests::rooms_by_chance::room;
use hemilux_tests::scenes::imported;
use std::sync::Arc;
use std::time::SystemTime;

fn request(scene: &Arc<Scene>, method: &str, side: u32) -> RenderRequest {
    RenderRequest::new(scene.clone(), method, [side; 2])
}

/// The same on few patches with small hemicubes.
fn coarse(scene: &Arc<Scene>, method: &str, side: u32) -> RenderRequest {
    let mut request = request(scene, method, side);
    for (name, value) in [("patches", "300"), ("hemicube_resolution", "32"), ("pixel_samples", "2")]
    {
        request.options.insert(name.into(), value.into());
    }
    request
}

/// A picture after so many iterations, or where none are given the one that the method ends with.
fn picture(request: &RenderRequest, iterations: Option<u64>) -> Picture {
    let mut device = CpuDevice::new(None).expect("threads");
    let seconds = iterations.is_none().then_some(60.0);
    let limits = Limits { iterations, seconds, ..Limits::default() };
    let request = RenderRequest { limits, ..request.clone() };
    let rendered = render(&mut device, &request, &mut Unobserved).expect("the request is good");
    let expected =
        if iterations.is_some() { StopReason::Iterations } else { StopReason::Converged };
    assert_eq!(rendered.stats.stopped, expected);
    rendered.picture
}

/// How many times as often errors are looked at again.
const MORE: u64 = 16;

/// rRMSE of single pictures by their scatter, after few iterations and after [`MORE`] times as many,
/// away from emitters. Noise from twelve seeds is known to some 15 %, for pixels of a picture vary
/// together.
fn noise(request: &RenderRequest, few: u64) -> [f64; 2] {
    let both = [few, MORE * few].map(|iterations| {
        let seeded = |seed| picture(&RenderRequest { seed, ..request.clone() }, Some(iterations));
        Replicas { pictures: (1..=12).map(seeded).collect() }
    });
    let best = &both[1].pictures;
    let mut mean = Picture::black(best[0].width, best[0].height);
    for (index, pixel) in mean.pixels.iter_mut().enumerate() {
        *pixel = best.iter().map(|picture| picture.pixels[index]).sum::<Rgb>() / best.len() as f32;
    }
    let counted = away_from_light(&mean, 4.0 * mean.mean() as f32);
    both.map(|replicas| replicas.noise(&counted))
}

/// Whether the second of two errors is the first over √[`MORE`], give or take a factor of √2. An error
/// that stays fails, and so does one that falls with the fourth root or without a root.
fn falls_by_chance([before, after]: [f64; 2]) -> bool {
    let expected = (MORE as f64).sqrt();
    let fell = before / after / expected;
    (1.0 / 2f64.sqrt()..2f64.sqrt()).contains(&fell)
}

fn falls_as_chance_does(method: &str, request: &RenderRequest, few: u64) {
    let errors = noise(request, few);
    println!("{method}: {errors:.4?}, {:.2}", errors[0] / errors[1]);
    assert!(falls_by_chance(errors), "{method}: {errors:?} after {few} and {MORE} times as many");
    let root = (MORE as f64).sqrt();
    for (what, rate) in [("stays", 1.0), ("a fourth root", root.sqrt()), ("no root", root * root)] {
        assert!(!falls_by_chance([errors[0], errors[0] / rate]), "{what} passes");
    }
}

#[test]
fn stochastic_iteration_converges_as_one_over_the_root() {
    let scene = imported(&made::cornell());
    falls_as_chance_does("stochastic", &coarse(&scene, "stochastic", 24), 30);
}

#[test]
fn monte_carlo_radiosity_converges_as_one_over_the_root() {
    let scene = imported(&made::cornell());
    falls_as_chance_does("monte-carlo", &coarse(&scene, "monte-carlo", 24), 4);
}

#[test]
fn path_tracing_converges_as_one_over_the_root() {
    let scene = imported(&made::cornell());
    falls_as_chance_does("ray-traced", &request(&scene, "ray-traced", 24), 8);
}

#[test]
fn illumination_maps_converge_as_one_over_the_root() {
    let mut request = request(&imported(&made::ring()), "illumination-map", 16);
    request.options.insert("light_rays".into(), "1000".into());
    falls_as_chance_does("illumination-map", &request, 32);
}

/// Each sweep leaves about the share of the error that a bounce leaves of the light.
#[test]
fn gauss_seidel_converges_geometrically() {
    let scene = imported(&made::cornell());
    let request = coarse(&scene, "gauss-seidel", CORNELL_SIDE / 2);
    let end = picture(&request, None);
    let halves = cornell_halves().half_as_wide(4.0);
    let error =
        |sweeps| relative_rmse(&picture(&request, Some(sweeps)), &end, |i| halves.counted[i]);
    let errors: Vec<f64> = (1..=6).map(error).collect();
    println!("{errors:.5?}, of the mesh {:.4}", halves.error(&end));
    let is_geometric =
        |errors: &[f64]| errors.windows(2).all(|pair| (0.2..0.45).contains(&(pair[1] / pair[0])));
    assert!(is_geometric(&errors), "{errors:?}");
    let planted: Vec<f64> = (1..=6).map(|sweep| 1.0 / f64::from(sweep)).collect();
    assert!(!is_geometric(&planted), "1/n passes");
    assert!(halves.error(&end) < 0.25, "the end is another picture");
}

/// Every shot makes the rest smaller; the first ones most of all, and the rest geometrically.
#[test]
fn progressive_refinement_converges_to_its_mesh() {
    let scene = imported(&made::cornell());
    let request = coarse(&scene, "progressive", CORNELL_SIDE / 2);
    let end = picture(&request, None);
    let halves = cornell_halves().half_as_wide(4.0);
    let error = |shots| relative_rmse(&picture(&request, Some(shots)), &end, |i| halves.counted[i]);
    let errors: Vec<f64> = (0..=7).map(|power| error(1 << power)).collect();
    println!("{errors:.5?}, of the mesh {:.4}", halves.error(&end));
    let falls = |errors: &[f64]| errors.windows(2).all(|pair| pair[1] < 0.97 * pair[0]);
    assert!(falls(&errors), "{errors:?}");
    // Twice the shots square what is left of the error where it falls geometrically.
    let last = &errors[5..];
    let bends = |last: &[f64]| last[2] / last[1] < 0.75 * (last[1] / last[0]);
    assert!(bends(last), "{errors:?}");
    assert!(
        !falls(&[1.0, 0.9, 0.91]) && !bends(&[1.0, 0.5, 0.25]),
        "what does not converge passes"
    );
    assert!(halves.error(&end) < 0.25, "the end is another picture");
}

/// In a room of a new day: what the first picture leaves, sixteen iterations take away.
#[test]
fn hemilux_falls_to_its_floor_in_any_room() {
    let today = || {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970");
        since.as_secs() / 86_400
    };
    let seed = std::env::var("HEMILUX_ROOM_SEED").ok().map(|seed| seed.parse().expect("a number"));
    let seed = seed.unwrap_or_else(today);
    let (scene, camera) = room(seed);
    let traced = RenderRequest { camera: camera.clone(), ..request(&scene, "ray-traced", 32) };
    let limits = Limits::iterations(800);
    let halves = Halves::traced(&RenderRequest { limits, ..traced }, 4.0);
    let shown = RenderRequest { camera, ..request(&scene, "hemilux", 32) };
    let pictures = [1, 16].map(|iterations| picture(&shown, Some(iterations)));
    let errors = pictures.each_ref().map(|picture| halves.error(picture));
    let mean = halves.mean_ratio(&pictures[1]);
    println!("HEMILUX_ROOM_SEED={seed}: {errors:.4?}, mean ratio {mean:.4}");
    let falls = |[before, after]: [f64; 2]| after <= 0.6 * before;
    assert!(falls(errors), "HEMILUX_ROOM_SEED={seed}: {errors:?}");
    assert!(!falls([errors[0], errors[0]]), "an error that stays passes");
    assert!((mean - 1.0).abs() < 0.015, "HEMILUX_ROOM_SEED={seed}: mean ratio {mean}");
}
