//! Methods side by side: the same light from different algorithms on the same patches.

use glam::Vec3;
use hemilux_engine::device::DeviceError;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, RenderError, RenderRequest, StopReason, Unobserved,
};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{mean_ratio, relative_rmse};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::{Builder, imported};
use std::sync::Arc;

fn request(scene: &Arc<Scene>, method: &str, limits: Limits) -> RenderRequest {
    let options = [("patches", "1500"), ("hemicube_resolution", "128"), ("pixel_samples", "4")];
    RenderRequest {
        limits,
        options: options.map(|(name, value)| (name.to_string(), value.to_string())).into(),
        ..RenderRequest::new(scene.clone(), method, [64; 2])
    }
}

fn iterations(count: u64) -> Limits {
    Limits::iterations(count)
}

/// Time enough to converge.
fn until_converged() -> Limits {
    Limits::seconds(120.0)
}

/// What stochastic iteration, Monte-Carlo radiosity, progressive refinement and Gauss–Seidel say
/// of the Cornell box. The latter two stand on centroids, so they differ near edges.
#[test]
fn all_methods_see_the_same_cornell_box() {
    let scene = imported(&made::cornell());
    let mut long = request(&scene, "stochastic", iterations(4000));
    long.options.insert("burn_in".into(), "10".into());
    let reference = rendered(&long);
    let shows_no_light = |index: usize| reference.picture.pixels[index].max_element() < 5.0;
    for (method, limits, closest, worst) in [
        ("monte-carlo", iterations(300), 0.02, 0.12),
        ("progressive", until_converged(), 0.02, 0.12),
        ("gauss-seidel", until_converged(), 0.02, 0.12),
    ] {
        let mut request = request(&scene, method, limits);
        if method == "gauss-seidel" {
            request.options.insert("form_factor_points".into(), "4".into());
        }
        let rendered = rendered(&request);
        let error = relative_rmse(&rendered.picture, &reference.picture, shows_no_light);
        let mean = mean_ratio(&rendered.picture, &reference.picture, shows_no_light);
        let stats = &rendered.stats;
        println!(
            "{method}: rRMSE {error:.4}, mean ratio {mean:.4}, {} shots, {:.1} s, {:?}",
            stats.figures.shots, stats.seconds_solve, stats.diagnostics
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

/// In a furnace all radiances are E/(1 − a).
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
        let rendered = rendered(&request);
        let mean = rendered.picture.mean() / 2.0;
        println!("{method}: {mean:.5}, {:?}", rendered.stats.diagnostics);
        assert!((mean - 1.0).abs() < allowed, "{method}: {mean}");
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
    let limits = Limits::seconds(0.3);
    let mut request = request(&scene, "gauss-seidel", limits);
    request.options.insert("form_factor_points".into(), "64".into());
    let stats = rendered(&request).stats;
    assert_eq!(stats.stopped, StopReason::TimeBudget);
    assert!(stats.seconds_solve < 2.0, "{}", stats.seconds_solve);
}

#[test]
fn diffuse_methods_say_what_they_make_of_gloss() {
    let scene = imported(&made::phong_cornell());
    for method in ["monte-carlo", "progressive", "gauss-seidel"] {
        let mut request = request(&scene, method, iterations(2));
        request.options.insert("patches".into(), "200".into());
        let stats = rendered(&request).stats;
        let said = stats.warnings.iter().any(|warning| warning.what.contains("glossy"));
        assert!(said, "{method}: {:?}", stats.warnings);
    }
}

/// A cube of five equal walls and an opening; one wall shines, and one leaves a slit open.
fn open_cube(slit: f32) -> Arc<Scene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    let light = builder.light(Rgb::splat(0.5), Rgb::ONE);
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    builder.quad(Vec3::ZERO, z, x, wall).quad(y, x, z, light);
    builder.quad(Vec3::ZERO, x, y, wall);
    builder.quad(Vec3::ZERO, y, z, wall).quad(x + slit * z, (1.0 - slit) * z, y, wall);
    builder.build()
}

/// What Gauss–Seidel says of its matrix.
#[derive(Debug)]
struct Matrix {
    /// Mean and largest |Σ_j F_ij − 1| of the rows.
    closure: [f64; 2],
    /// Σ|A_i F_ij − A_j F_ji|/Σ A_i F_ij.
    reciprocity: f64,
}

fn matrix(scene: &Arc<Scene>, patches: u32, points: u32, resolution: u32) -> Matrix {
    let mut request = request(scene, "gauss-seidel", iterations(1));
    let [eye, target] = [[0.5, 0.5, 0.9], [0.5, 0.5, 0.0]];
    let up = [0.0, 1.0, 0.0];
    request.camera = CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees: 60.0 });
    (request.width, request.height) = (4, 4);
    for (name, value) in
        [("patches", patches), ("form_factor_points", points), ("hemicube_resolution", resolution)]
    {
        request.options.insert(name.into(), value.to_string());
    }
    let said = rendered(&request).stats.diagnostics;
    let matrix = Matrix {
        closure: [said["closure_mean"], said["closure_largest"]],
        reciprocity: said["reciprocity"],
    };
    println!("{patches} patches, {points} points, {resolution}²: {matrix:.6?}");
    matrix
}

/// Rows of a closed scene sum to 1. The five walls of a cube see its opening as much as the opening
/// sees them, so a fifth is missing on average; hemicubes differ by pixels at the opening's edges.
#[test]
fn rows_of_form_factors_sum_to_what_is_seen() {
    let furnace = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    for resolution in [32, 128] {
        let [_, largest] = matrix(&furnace, 700, 1, resolution).closure;
        assert!(largest < 1e-5, "{resolution}²: {largest}");
    }
    let is_open = |scene: &Arc<Scene>, resolution: u32, allowed: f64| {
        let [mean, _] = matrix(scene, 700, 1, resolution).closure;
        (mean - 0.2).abs() < allowed
    };
    let cube = open_cube(0.0);
    assert!(is_open(&cube, 16, 4e-4) && is_open(&cube, 64, 5e-5));
    // Planted: a slit of a two-hundredth of one wall.
    assert!(!is_open(&open_cube(0.005), 16, 4e-4) && !is_open(&open_cube(0.005), 64, 5e-5));
}

/// A_i F_ij is A_j F_ji but for the pixels that hemicubes are made of, of which twice the resolution
/// leaves half the error, and for standing on one point of each patch, of which more points leave less.
#[test]
fn form_factors_are_reciprocal_within_their_pixels() {
    let furnace = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    for (name, scene, bound) in
        [("furnace", furnace.clone(), 14.0), ("open cube", open_cube(0.0), 11.0)]
    {
        let errors = [32, 64, 128].map(|n| matrix(&scene, 700, 1, n).reciprocity);
        // Pixels of 1/R and, at last, .02 of the centroids.
        let is_bounded = |error: f64, resolution: u32| error < bound / f64::from(resolution) + 0.02;
        for (error, resolution) in errors.into_iter().zip([32, 64, 128]) {
            assert!(is_bounded(error, resolution), "{name}, {resolution}²: {error}");
            // Planted: the matrix of half the resolution in its place.
            let coarser = matrix(&scene, 700, 1, resolution / 2).reciprocity;
            assert!(!is_bounded(coarser, resolution), "{name}, {resolution}²: {coarser} passes");
        }
        for pair in errors.windows(2) {
            let falls = pair[0] / pair[1];
            assert!((1.6..2.1).contains(&falls), "{name}: {errors:?}");
        }
    }
    let [one, many] = [1, 64].map(|points| matrix(&furnace, 200, points, 64).reciprocity);
    assert!(many < 0.03 && many < one / 4.0, "{one} of centroids, {many} of 64 points");
}
