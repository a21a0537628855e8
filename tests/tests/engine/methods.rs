//! Methods side by side: the same light from different algorithms on the same patches.

use hemilux_engine::device::DeviceError;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, RenderError, RenderRequest, Rendered, StopReason,
    Unobserved,
};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{mean_ratio, relative_rmse};
use hemilux_tests::scenes::imported;
use std::sync::Arc;

fn request(scene: &Arc<Scene>, method: &str, limits: Limits) -> RenderRequest {
    let options = [("patches", "1500"), ("hemicube_resolution", "128"), ("pixel_samples", "4")];
    RenderRequest {
        scene: scene.clone(),
        camera: CameraChoice::First,
        width: 64,
        height: 64,
        method: method.into(),
        limits,
        seed: 1,
        options: options.map(|(name, value)| (name.to_string(), value.to_string())).into(),
        begin: Default::default(),
    }
}

fn run(request: &RenderRequest) -> Rendered {
    let mut device = CpuDevice::new(None).unwrap();
    render(&mut device, request, &mut Unobserved).expect("the request is good")
}

fn iterations(count: u64) -> Limits {
    Limits { iterations: Some(count), ..Limits::default() }
}

/// Time enough to converge.
fn until_converged() -> Limits {
    Limits { seconds: Some(120.0), ..Limits::default() }
}

/// What stochastic iteration, Monte-Carlo radiosity, progressive refinement and Gauss–Seidel say
/// of the Cornell box. The latter two stand on centroids, so they differ near edges.
#[test]
fn all_methods_see_the_same_cornell_box() {
    let scene = imported(&made::cornell());
    let mut long = request(&scene, "stochastic", iterations(4000));
    long.options.insert("burn_in".into(), "10".into());
    let reference = run(&long);
    let shows_no_light = |index: usize| reference.picture.pixels[index].max_element() < 5.0;
    for (method, limits, closest, worst) in [
        ("monte-carlo", iterations(300), 0.02, 0.12),
        ("progressive", until_converged(), 0.02, 0.12),
        ("gauss-seidel", until_converged(), 0.02, 0.12),
    ] {
        let mut request = request(&scene, method, limits);
        request.options.insert("form_factor_points".into(), "4".into());
        let rendered = run(&request);
        let error = relative_rmse(&rendered.picture, &reference.picture, shows_no_light);
        let mean = mean_ratio(&rendered.picture, &reference.picture, shows_no_light);
        let stats = &rendered.stats;
        println!(
            "{method}: rRMSE {error:.4}, mean ratio {mean:.4}, {} shots, {:.1} s, {:?}",
            stats.shots, stats.seconds_solve, stats.diagnostics
        );
        assert!((mean - 1.0).abs() < closest, "{method}: mean ratio {mean}");
        assert!(error < worst, "{method}: {error}");
        let expected = match method {
            "monte-carlo" => StopReason::Iterations,
            _ => StopReason::Converged,
        };
        assert_eq!(stats.stopped, expected, "{method}");
    }
}

/// In a furnace the matrix closes, and all radiances are E/(1 − a).
#[test]
fn radiosity_methods_reach_the_furnace() {
    let scene = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    let camera = CameraChoice::Explicit(ExplicitCamera {
        eye: [0.3, 0.4, 0.2],
        target: [0.9, 0.1, 0.95],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 80.0,
    });
    for (method, limits, allowed) in [
        ("monte-carlo", iterations(200), 0.02),
        ("progressive", until_converged(), 0.02),
        ("gauss-seidel", until_converged(), 0.002),
    ] {
        let mut request = request(&scene, method, limits);
        request.camera = camera.clone();
        request.options.insert("patches".into(), "200".into());
        let rendered = run(&request);
        let mean = rendered.picture.mean() / 2.0;
        println!("{method}: {mean:.5}, {:?}", rendered.stats.diagnostics);
        assert!((mean - 1.0).abs() < allowed, "{method}: {mean}");
        if method == "gauss-seidel" {
            assert!(rendered.stats.diagnostics["closure_largest"] < 1e-4);
            assert!(rendered.stats.diagnostics["reciprocity"] < 0.2);
        }
    }
}

#[test]
fn a_matrix_too_large_is_refused_before_it_starts() {
    let scene = imported(&made::cornell());
    let mut request = request(&scene, "gauss-seidel", until_converged());
    request.options.insert("patches".into(), "1000000".into());
    let mut device = CpuDevice::new(None).unwrap();
    let error = render(&mut device, &request, &mut Unobserved).expect_err("4 TB");
    match error {
        RenderError::Device(DeviceError::OutOfMemory { needed_bytes, .. }) => {
            assert!(needed_bytes > 3 << 40);
        }
        other => panic!("{other}"),
    }
}

#[test]
fn a_matrix_that_takes_too_long_is_given_up_in_time() {
    let scene = imported(&made::cornell());
    let limits = Limits { seconds: Some(0.3), ..Limits::default() };
    let mut request = request(&scene, "gauss-seidel", limits);
    request.options.insert("form_factor_points".into(), "64".into());
    let stats = run(&request).stats;
    assert_eq!(stats.stopped, StopReason::TimeBudget);
    assert!(stats.seconds_solve < 2.0, "{}", stats.seconds_solve);
}

#[test]
fn diffuse_methods_say_what_they_make_of_gloss() {
    let scene = imported(&made::phong_cornell());
    for method in ["monte-carlo", "progressive", "gauss-seidel"] {
        let mut request = request(&scene, method, iterations(2));
        request.options.insert("patches".into(), "200".into());
        let stats = run(&request).stats;
        let said = stats.warnings.iter().any(|warning| warning.what.contains("glossy"));
        assert!(said, "{method}: {:?}", stats.warnings);
    }
}
