//! Pictures of the whole engine: orientation, flatness, accuracy, repeatability, honest errors.

use glam::Vec3;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::{Rgb, lobe_albedo};
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, RenderError, RenderRequest, Rendered, StopReason,
    Unobserved,
};
use hemilux_engine::scene::{Environment, Material, Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{mean_ratio, relative_rmse};
use hemilux_tests::scenes::{Builder, imported};
use hemilux_tests::skips::shared_or_skip;
use std::sync::Arc;

fn request(scene: Arc<Scene>, side: u32, iterations: u64) -> RenderRequest {
    RenderRequest {
        limits: Limits::iterations(iterations),
        ..RenderRequest::new(scene, "stochastic", [side; 2])
    }
}

fn run(threads: Option<usize>, request: &RenderRequest) -> Rendered {
    let mut device = CpuDevice::new(threads).unwrap();
    render(&mut device, request, &mut Unobserved).expect("the request is good")
}

fn from(eye: [f32; 3], target: [f32; 3], yfov_degrees: f32) -> CameraChoice {
    let up = [0.0, 1.0, 0.0];
    CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
}

/// Red left, green right, blue top, white bottom, seen down −Z: nothing is mirrored or flipped,
/// and emitters read their own radiance.
#[test]
fn pictures_are_the_right_way_round() {
    let mut builder = Builder::default();
    for (x, y, color) in
        [(-1.0, 0.0, Rgb::X), (1.0, 0.0, Rgb::Y), (0.0, 1.0, Rgb::Z), (0.0, -1.0, Rgb::ONE)]
    {
        let light = builder.light(Rgb::ZERO, color * 17.0);
        builder.quad(Vec3::new(x - 0.2, y - 0.2, -4.0), Vec3::X * 0.4, Vec3::Y * 0.4, light);
    }
    let camera = from([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 40.0);
    let picture = run(None, &RenderRequest { camera, ..request(builder.build(), 81, 1) }).picture;
    let at = |x: f32, y: f32| {
        let half = 4.0 * 20f32.to_radians().tan();
        let pixel = |v: f32| ((v / half * 0.5 + 0.5) * 81.0) as usize;
        picture.pixels[pixel(-y) * 81 + pixel(x)]
    };
    assert_eq!(at(-1.0, 0.0), Rgb::X * 17.0);
    assert_eq!(at(1.0, 0.0), Rgb::Y * 17.0);
    assert_eq!(at(0.0, 1.0), Rgb::Z * 17.0);
    assert_eq!(at(0.0, -1.0), Rgb::splat(17.0));
    assert_eq!(at(0.0, 0.0), Rgb::ZERO);
}

/// From inside a furnace every pixel reads E/(1 − a): no seams, corners, blotches.
#[test]
fn a_furnace_looks_flat() {
    let scene = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    let camera = from([0.3, 0.4, 0.2], [0.9, 0.1, 0.95], 80.0);
    let mut request = RenderRequest { camera, ..request(scene, 64, 800) };
    request.options.insert("patches".into(), "300".into());
    request.options.insert("hemicube_resolution".into(), "64".into());
    request.options.insert("shots_per_iteration".into(), "64".into());
    let picture = run(None, &request).picture;
    let worst = picture.pixels.iter().map(|p| (p.x / 2.0 - 1.0).abs()).fold(0f32, f32::max);
    println!("worst pixel deviates by {worst:.4}");
    assert!(worst < 0.03, "{worst}");
    assert!((picture.mean() / 2.0 - 1.0).abs() < 3e-3, "{}", picture.mean());
}

/// A small Phong mirror in a furnace of radiance 2 shows 2·(kd + ks·I_n(θ)) to a viewer at θ.
#[test]
fn a_phong_surface_in_a_furnace_shows_its_albedo() {
    let (kd, ks, exponent) = (0.2f32, 0.25f32, 20.0f32);
    for degrees in [10.0f32, 45.0, 75.0] {
        let mut builder = Builder::default();
        let wall = builder.light(Rgb::splat(0.5), Rgb::ONE);
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        let glossy = builder.material(Material::phong("glossy", Rgb::splat(kd), ks, exponent));
        builder.quad(Vec3::new(0.47, 0.5, 0.47), Vec3::Z * 0.06, Vec3::X * 0.06, glossy);
        let angle = degrees.to_radians();
        let eye = Vec3::splat(0.5) + 0.3 * Vec3::new(angle.sin(), angle.cos(), 0.0);
        let camera = from(eye.to_array(), [0.5; 3], 0.2);
        let mut request = RenderRequest { camera, ..request(builder.build(), 2, 800) };
        for (name, value) in
            [("patches", "100"), ("hemicube_resolution", "64"), ("shots_per_iteration", "64")]
        {
            request.options.insert(name.into(), value.into());
        }
        let picture = run(None, &request).picture;
        let albedo = f64::from(kd) + f64::from(ks) * lobe_albedo(20.0, f64::from(angle.cos()));
        let ratio = picture.mean() / (2.0 * albedo);
        println!("seen at {degrees}°: {:.4}, exact {:.4}", picture.mean(), 2.0 * albedo);
        // Standard error of the lobe's average: about 1.2 %.
        assert!((ratio - 1.0).abs() < 0.03, "{degrees}°: {ratio}");
    }
}

/// A fixed number of iterations is within the noise that it should have of the path-traced
/// reference, and the estimated error says so.
#[test]
fn cornell_box_matches_the_reference() {
    let files = ["scenes/cornell.glb", "reference/cornell.exr"];
    let Some([glb, reference]) = shared_or_skip(files) else { return };
    let reference = Picture::from_exr(&reference).unwrap();
    let rendered = run(None, &request(imported(&glb), 500, 1200));
    let emitter = |index: usize| reference.pixels[index].x > 5.0;
    let error = relative_rmse(&rendered.picture, &reference, |index| !emitter(index));
    let ratio = mean_ratio(&rendered.picture, &reference, |index| !emitter(index));
    let estimated = rendered.stats.figures.estimated_error.unwrap();
    println!("rRMSE {error:.4}, estimated {estimated:.4}, mean ratio {ratio:.4}");
    assert!(error < 0.15, "rRMSE {error}");
    assert!((ratio - 1.0).abs() < 0.02, "mean ratio {ratio}");
    assert!((0.5..2.0).contains(&(estimated / error)), "estimated {estimated}, actual {error}");
}

/// Same seed, same device, same iterations: same bits, however many threads; another seed differs.
#[test]
fn pictures_repeat_bit_for_bit() {
    let request = request(imported(&made::phong_cornell()), 48, 37);
    let first = run(Some(1), &request).picture;
    assert_eq!(first, run(Some(1), &request).picture);
    assert_eq!(first, run(Some(2), &request).picture);
    assert_eq!(first, run(Some(3), &request).picture);
    assert_ne!(first, run(Some(1), &RenderRequest { seed: 2, ..request }).picture);
}

/// The estimated error predicts the scatter between independent runs.
#[test]
fn estimated_error_is_honest() {
    let request = request(imported(&made::cornell()), 64, 400);
    let runs: Vec<Rendered> =
        (0..6).map(|seed| run(None, &RenderRequest { seed, ..request.clone() })).collect();
    let mean = Picture {
        pixels: (0..64 * 64)
            .map(|i| runs.iter().map(|r| r.picture.pixels[i]).sum::<Rgb>() / runs.len() as f32)
            .collect(),
        ..runs[0].picture.clone()
    };
    let off_emitter = |index: usize| mean.pixels[index].x < 5.0;
    let unbiased = (runs.len() as f64 / (runs.len() - 1) as f64).sqrt();
    let (mut actual, mut predicted) = (0.0, 0.0);
    for run in &runs {
        actual += relative_rmse(&run.picture, &mean, off_emitter).powi(2);
        predicted += run.stats.figures.estimated_error.unwrap().powi(2);
    }
    let ratio = predicted.sqrt() / (actual.sqrt() * unbiased);
    println!("predicted/actual = {ratio:.3}");
    assert!((0.7..1.5).contains(&ratio), "{ratio}");
}

#[test]
fn a_scene_without_light_is_black_and_says_so() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::ONE * 0.5);
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let environment = Some(Arc::new(Environment::none()));
    let request = RenderRequest { environment, ..request(builder.build(), 8, 10) };
    let rendered = run(None, &request);
    assert_eq!(rendered.picture, Picture::black(8, 8));
    assert_eq!(rendered.stats.stopped, StopReason::NoLight);
    assert!(rendered.stats.warnings.iter().any(|w| w.what.contains("nothing gives light")));
    assert!(rendered.stats.warnings.iter().any(|w| w.at == "camera"));
}

#[test]
fn an_empty_scene_is_black_and_says_so() {
    let environment = Some(Arc::new(Environment::none()));
    let empty = request(Arc::new(Scene::default()), 8, 10);
    let rendered = run(None, &RenderRequest { environment, ..empty });
    assert_eq!(rendered.picture, Picture::black(8, 8));
    assert!(rendered.stats.warnings.iter().any(|w| w.what.contains("no surface")));
}

/// A room modelled as one outward-facing, two-sided box with a glowing ceiling is lit inside.
#[test]
fn a_two_sided_room_is_lit_by_its_own_ceiling() {
    let mut builder = Builder::default();
    let two_sided = |material: Material| Material { double_sided: true, ..material };
    let wall = builder.material(two_sided(Material::lambertian("wall", Rgb::splat(0.5))));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, false, wall);
    let light = builder.material(two_sided(Material {
        emission: Rgb::ONE,
        ..Material::lambertian("light", Rgb::ZERO)
    }));
    let mut scene = (*builder.build()).clone();
    // The ceiling of the box, y = 1, glows.
    for triangle in &mut scene.triangles {
        if triangle.vertices.iter().all(|v| scene.vertices[*v as usize].position.y == 1.0) {
            triangle.material = light;
        }
    }
    let camera = from([0.5, 0.5, 0.9], [0.5, 0.2, 0.0], 60.0);
    let rendered = run(None, &RenderRequest { camera, ..request(Arc::new(scene), 16, 30) });
    assert!(rendered.picture.pixels.iter().all(|pixel| pixel.x > 0.02), "dark inside");
}

/// Powers that underflow are no light, not a panic.
#[test]
fn emission_too_small_for_a_number_is_no_light() {
    let mut builder = Builder::default();
    let glossy = builder.material(Material { emission: Rgb::X * 1e-44, ..Material::default() });
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, glossy);
    let environment = Some(Arc::new(Environment::none()));
    let rendered = run(None, &RenderRequest { environment, ..request(builder.build(), 8, 10) });
    assert_eq!(rendered.stats.stopped, StopReason::NoLight);
}

/// A disc of many thin triangles round one hub costs no more than its size.
#[test]
fn a_fan_of_many_triangles_is_no_burden() {
    let mut builder = Builder::default();
    let light = builder.light(Rgb::splat(0.5), Rgb::ONE);
    let mut scene = (*builder.build()).clone();
    let count = 30_000u32;
    let vertex = |position| hemilux_engine::scene::Vertex::new(position, Vec3::Y);
    scene.vertices.push(vertex(Vec3::ZERO));
    for i in 0..count {
        let (sin, cos) = (i as f32 / count as f32 * std::f32::consts::TAU).sin_cos();
        scene.vertices.push(vertex(Vec3::new(cos, 0.0, -sin)));
        let vertices = [0, 1 + i, 1 + (i + 1) % count];
        scene.triangles.push(hemilux_engine::scene::Triangle { vertices, material: light });
    }
    let camera = from([0.0, 1.0, 0.1], [0.0, 0.0, 0.0], 40.0);
    let rendered = run(None, &RenderRequest { camera, ..request(Arc::new(scene), 16, 3) });
    assert!((rendered.picture.mean() - 1.0).abs() < 1e-3, "{}", rendered.picture.mean());
    assert!(rendered.stats.seconds_solve < 20.0, "{} s", rendered.stats.seconds_solve);
}

#[test]
fn limits_are_kept() {
    let scene = imported(&made::cornell());
    let mut timed = request(scene.clone(), 64, 1);
    timed.limits = Limits::seconds(1.5);
    let rendered = run(None, &timed);
    assert_eq!(rendered.stats.stopped, StopReason::TimeBudget);
    assert!((1.2..2.5).contains(&rendered.stats.seconds_solve), "{}", rendered.stats.seconds_solve);

    let counted = run(None, &request(scene.clone(), 16, 123));
    assert_eq!((counted.stats.figures.iterations, counted.stats.figures.shots), (123, 984));

    let mut accurate = request(scene, 64, 1);
    accurate.limits = Limits { target_error: Some(0.2), seconds: Some(30.0), ..Limits::default() };
    let rendered = run(None, &accurate);
    assert_eq!(rendered.stats.stopped, StopReason::TargetError);
    assert!(rendered.stats.figures.estimated_error.unwrap() <= 0.2);
}

#[test]
fn requests_out_of_range_name_the_parameter() {
    let scene = imported(&made::cornell());
    let good = request(scene, 8, 1);
    let limits = |seconds, iterations, target_error| Limits {
        seconds,
        iterations,
        target_error,
        ..Limits::default()
    };
    let bad = [
        ("width", RenderRequest { width: 0, ..good.clone() }),
        ("height", RenderRequest { height: 100_000, ..good.clone() }),
        ("width", RenderRequest { width: 16_000, height: 16_000, ..good.clone() }),
        ("method", RenderRequest { method: "magic".into(), ..good.clone() }),
        ("camera", RenderRequest { camera: CameraChoice::Index(7), ..good.clone() }),
        ("camera", RenderRequest { camera: CameraChoice::Name("x".into()), ..good.clone() }),
        (
            "camera.yfov_degrees",
            RenderRequest { camera: from([0.0; 3], [1.0; 3], 180.0), ..good.clone() },
        ),
        ("camera.target", RenderRequest { camera: from([1.0; 3], [1.0; 3], 40.0), ..good.clone() }),
        ("seconds", RenderRequest { limits: limits(Some(f64::NAN), None, None), ..good.clone() }),
        ("iterations", RenderRequest { limits: limits(None, Some(0), None), ..good.clone() }),
        ("target_error", RenderRequest { limits: limits(None, None, Some(1.0)), ..good.clone() }),
    ];
    let mut device = CpuDevice::new(Some(1)).unwrap();
    for (name, request) in bad {
        match render(&mut device, &request, &mut Unobserved) {
            Err(RenderError::Parameter { parameter, .. }) => assert_eq!(parameter, name),
            other => panic!("{name}: {other:?}"),
        }
    }
}
