//! Path tracing against references, closed forms and other methods; Lange's and Dippé's sampling.

use glam::{DVec3, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::{Rgb, lobe_albedo};
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, Observer, Progress, RenderRequest, Rendered, StopReason,
};
use hemilux_engine::sampling::SparsePixels;
use hemilux_engine::scene::{Material, Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::mean_ratio;
use hemilux_tests::oracle::paths::Walks;
use hemilux_tests::oracle::rays::Generator;
use hemilux_tests::oracle::statistics::{Moments, Scores};
use hemilux_tests::rendering::rendered;
use hemilux_tests::replicas::Replicas;
use hemilux_tests::scenes::{Builder, imported};
use hemilux_tests::skips::shared_or_skip;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use std::time::Instant;

fn request(scene: &Arc<Scene>, side: u32, passes: u64) -> RenderRequest {
    RenderRequest {
        limits: Limits::iterations(passes),
        ..RenderRequest::new(scene.clone(), "ray-traced", [side; 2])
    }
}

fn with(mut request: RenderRequest, options: &[(&str, &str)]) -> RenderRequest {
    request.options.extend(options.iter().map(|(n, v)| (n.to_string(), v.to_string())));
    request
}

/// The same request from `count` seeds, with the errors that each estimates of itself.
fn replicas(request: &RenderRequest, count: u64) -> (Replicas, Vec<f64>) {
    let (mut pictures, mut estimates) = (Vec::new(), Vec::new());
    for seed in 1..=count {
        let Rendered { picture, stats } = rendered(&RenderRequest { seed, ..request.clone() });
        pictures.push(picture);
        estimates.extend(stats.figures.estimated_error);
    }
    (Replicas { pictures }, estimates)
}

fn everywhere(_: usize) -> bool {
    true
}

/// Which pixels see no emitter and are next to none that does: an emitter that covers a thousandth
/// of a pixel is not always found, and yet most of its noise.
fn off_emitters(scene: &Arc<Scene>, side: u32) -> impl Fn(usize) -> bool {
    let mut dark = (**scene).clone();
    for material in &mut dark.materials {
        (material.base_color, material.metallic, material.specular_factor) = (Rgb::ZERO, 0.0, 0.0);
    }
    let shining = rendered(&request(&Arc::new(dark), side, 64)).picture;
    let dark = move |x: i32, y: i32| {
        let inside = (0..side as i32).contains(&x) && (0..side as i32).contains(&y);
        !inside || shining.pixels[(y * side as i32 + x) as usize] == Rgb::ZERO
    };
    move |index| {
        let (x, y) = ((index as u32 % side) as i32, (index as u32 / side) as i32);
        (-1..=1).all(|row| (-1..=1).all(|column| dark(x + column, y + row)))
    }
}

fn looking(eye: [f32; 3], target: [f32; 3], yfov_degrees: f32) -> CameraChoice {
    let up = [0.0, 1.0, 0.0];
    CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
}

/// A part of the pixels is what they are in the whole picture, the rest is black; the estimated error is
/// theirs alone.
#[test]
fn some_pixels_are_traced_as_in_the_whole_picture() {
    let scene = Arc::new(imported(&made::cornell()));
    let whole = request(&scene, 48, 64);
    let some = with(whole.clone(), &[("pixel_squares", "4")]);
    let traced = SparsePixels::new(4).mask([48; 2]);
    let [all, few] = [&whole, &some].map(rendered);
    for (index, traced) in traced.iter().enumerate() {
        let expected = if *traced { all.picture.pixels[index] } else { Rgb::ZERO };
        assert_eq!(few.picture.pixels[index], expected, "{index}");
    }
    let [all, few] = [all, few].map(|own| own.stats.figures.estimated_error.unwrap());
    assert!((0.6..1.7).contains(&(few / all)), "{few} {all}");
}

/// The Cornell box at full depth is the reference, within the noise of both.
#[test]
fn the_cornell_box_is_the_shared_reference() {
    let files =
        ["scenes/cornell.glb", "reference/cornell-half-a.exr", "reference/cornell-half-b.exr"];
    let Some([glb, a, b]) = shared_or_skip(files) else { return };
    let reduced = |exr: &[u8]| {
        let full = Picture::from_exr(exr).expect("a picture");
        let mut small = Picture::black(100, 100);
        for (index, pixel) in full.pixels.iter().enumerate() {
            let (x, y) = (index as u32 % full.width, index as u32 / full.width);
            let at = y * 100 / full.height * 100 + x * 100 / full.width;
            small.pixels[at as usize] += *pixel * (1e4 / full.pixels.len() as f32);
        }
        small
    };
    let reference = Replicas { pictures: vec![reduced(&a), reduced(&b)] };
    let counted = |index: usize| reference.pictures[0].pixels[index].x < 1.5;
    for (name, scene) in [("shared", imported(&glb)), ("made", imported(&made::cornell()))] {
        let (traced, _) = replicas(&request(&scene, 100, 16), 8);
        let score = Scores::between(&traced.blocks(6, counted), &reference.blocks(6, counted));
        let (mean, expected) = (traced.mean(counted), reference.mean(counted));
        println!(
            "{name}: {score:?}; mean {:.5} ± {:.5}, reference {:.5}, z {:+.2}",
            mean.mean(),
            mean.standard_error(),
            expected.mean(),
            mean.z(&expected)
        );
        assert!(score.is_chance(), "{name}: {score:?}");
        assert!(mean.z(&expected).abs() < 4.0, "{name}");
        // What the test can see: half a percent of light more or less.
        assert!(mean.standard_error() < 1e-3 * mean.mean());
    }
}

/// Pictures by random walks in double precision through every triangle: no hierarchy, no light
/// sampling, one channel.
struct Looked {
    eye: DVec3,
    target: DVec3,
    yfov_degrees: f64,
}

impl Looked {
    fn camera(&self) -> CameraChoice {
        let [eye, target] = [self.eye, self.target].map(|p| p.as_vec3().to_array());
        looking(eye, target, self.yfov_degrees as f32)
    }

    /// Means of `across` × `across` blocks of a picture of `side` pixels.
    fn blocks(
        &self,
        scene: &Arc<Scene>,
        (side, across): (u32, u32),
        walks_per_pixel: u32,
        counted: impl Fn(usize) -> bool,
    ) -> Vec<Moments> {
        let walks = Walks::new(&PatchedScene::new(scene.clone(), 1));
        let mut generator = Generator::new(7);
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let half = (0.5 * self.yfov_degrees).to_radians().tan();
        let mut blocks = vec![Moments::default(); (across * across) as usize];
        for index in (0..side * side).filter(|index| counted(*index as usize)) {
            let (x, y) = (index % side, index / side);
            let block = &mut blocks[(y * across / side * across + x * across / side) as usize];
            for _ in 0..walks_per_pixel {
                let mut at = |pixel: u32| {
                    (2.0 * (f64::from(pixel) + generator.uniform()) / f64::from(side) - 1.0) * half
                };
                let (across, down) = (at(x), at(y));
                let direction = (forward + across * right - down * up).normalize();
                block.push(walks.seen(self.eye, direction, &mut generator));
            }
        }
        blocks
    }
}

/// Means of blocks in the red channel.
fn red_blocks(all: &Replicas, across: u32, counted: impl Fn(usize) -> bool) -> Vec<Moments> {
    let mut red = all.clone();
    for picture in &mut red.pictures {
        picture.pixels.iter_mut().for_each(|pixel| *pixel = Rgb::new(pixel.x, 0.0, 0.0));
    }
    red.blocks(across, counted)
}

/// The Cornell box without any file: as random walks of another program part see it.
#[test]
fn the_cornell_box_is_what_random_walks_see() {
    let scene = imported(&made::cornell());
    let eye = DVec3::new(0.278, 0.273, -0.8);
    let view = Looked { eye, target: eye + DVec3::Z, yfov_degrees: 39.307_8 };
    let counted = off_emitters(&scene, 32);
    let (traced, _) = replicas(&request(&scene, 32, 64), 8);
    let walked = view.blocks(&scene, (32, 3), 900, &counted);
    let traced = red_blocks(&traced, 3, &counted);
    let score = Scores::between(&traced, &walked);
    for (a, b) in traced.iter().zip(&walked) {
        println!(
            "{:.5} ± {:.5}, walks {:.5} ± {:.5}",
            a.mean(),
            a.standard_error(),
            b.mean(),
            b.standard_error()
        );
    }
    assert!(score.is_chance(), "{score:?}");
}

/// Glossy walls and a block under a shining ceiling, as random walks see them.
#[test]
fn a_glossy_room_is_what_random_walks_see() {
    let mut builder = Builder::default();
    let wall = builder.material(Material::phong("wall", Rgb::splat(0.3), 0.4, 12.0));
    let (low, high) = (Vec3::ZERO, Vec3::new(1.0, 1.3, 0.8));
    builder.cuboid(low, high, true, wall);
    let block = builder.material(Material::phong("block", Rgb::splat(0.2), 0.6, 60.0));
    builder.cuboid(Vec3::new(0.4, 0.0, 0.3), Vec3::new(0.7, 0.5, 0.5), false, block);
    let mut scene = (*builder.build()).clone();
    let light = Material { emission: Rgb::ONE, ..Material::lambertian("light", Rgb::splat(0.2)) };
    scene.materials.push(light);
    for triangle in &mut scene.triangles {
        let ceiling =
            triangle.vertices.iter().all(|v| scene.vertices[*v as usize].position.y > 1.2);
        if ceiling {
            triangle.material = 2;
        }
    }
    let scene = Arc::new(scene);
    let view = Looked {
        eye: DVec3::new(0.05, 0.4, 0.07),
        target: DVec3::new(0.8, 0.35, 0.6),
        yfov_degrees: 75.0,
    };
    let request = RenderRequest { camera: view.camera(), ..request(&scene, 24, 64) };
    let (traced, _) = replicas(&request, 8);
    let walked = view.blocks(&scene, (24, 4), 600, everywhere);
    let traced = red_blocks(&traced, 4, everywhere);
    let score = Scores::between(&traced, &walked);
    let error = walked.iter().map(|m| m.standard_error() / m.mean()).fold(0.0, f64::max);
    println!("{score:?}, worst standard error of the walks {error:.4}");
    assert!(score.is_chance(), "{score:?}");
    assert!(error < 0.02, "the walks are too noisy to tell: {error}");
}

/// A closed box that emits E and reflects a everywhere has the radiance E/(1 − a) everywhere.
#[test]
fn furnaces_reach_emission_over_one_minus_albedo() {
    for albedo in [0.2f32, 0.5, 0.8] {
        let scene = imported(&made::furnace(Rgb::splat(albedo), Rgb::new(1.0, 0.5, 2.0)));
        let camera = looking([0.3, 0.4, 0.2], [0.9, 0.1, 0.95], 80.0);
        let (traced, _) = replicas(&RenderRequest { camera, ..request(&scene, 24, 64) }, 12);
        let expected = 3.5 / (1.0 - f64::from(albedo));
        let blocks = traced.blocks(4, everywhere);
        let score = Scores::new(&blocks, &[expected; 16]);
        let mean = traced.mean(everywhere);
        let z = mean.z(&Moments::exact(expected));
        println!("albedo {albedo}: {score:?}, mean {:.5} of {expected:.5}", mean.mean());
        assert!(score.is_chance(), "albedo {albedo}: {score:?}");
        assert!(z.abs() < 4.0 && mean.standard_error() < 2e-3 * expected, "albedo {albedo}: {z}");
    }
}

/// A Phong surface under radiance 1 from everywhere shows kd + ks·I_n(θ) to a viewer at θ; where
/// its shading normal leans by φ, kd (1 + cosφ)/2 and what the lobe reflects of the hemisphere above
/// both horizons, with the shading normal's cosine.
#[test]
fn phong_surfaces_under_uniform_light_show_their_albedo() {
    let (kd, ks) = (0.2f32, 0.5f32);
    for (exponent, degrees, lean) in [
        (1.0f32, 20.0f32, 0.0f32),
        (20.0, 45.0, 0.0),
        (200.0, 75.0, 0.0),
        (1.0, 20.0, 50.0),
        (4.0, 60.0, -20.0),
        (4.0, 60.0, -40.0),
    ] {
        let mut builder = Builder::default();
        let wall = builder.light(Rgb::ZERO, Rgb::ONE);
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        let glossy = builder.material(Material::phong("glossy", Rgb::splat(kd), ks, exponent));
        builder.quad(Vec3::new(0.47, 0.5, 0.47), Vec3::Z * 0.06, Vec3::X * 0.06, glossy);
        let mut scene = (*builder.build()).clone();
        let turned = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Vec3::new(sin, cos, 0.0)
        };
        for vertex in &mut scene.vertices {
            if vertex.position.y == 0.5 {
                vertex.normal = turned(lean);
            }
        }
        let eye = Vec3::splat(0.5) + 0.3 * turned(degrees);
        let camera = looking(eye.to_array(), [0.5; 3], 0.2);
        let request = RenderRequest { camera, ..request(&Arc::new(scene), 2, 4000) };
        let (traced, _) = replicas(&request, 8);
        let lobe = if lean == 0.0 {
            lobe_albedo(f64::from(exponent), f64::from(turned(degrees).y))
        } else {
            leaning_lobe(f64::from(exponent), turned(degrees).as_dvec3(), turned(lean).as_dvec3())
        };
        let above_both = 0.5 * (1.0 + f64::from(lean.to_radians().cos()));
        let expected = f64::from(kd) * above_both + f64::from(ks) * lobe;
        let mean = traced.mean(everywhere);
        println!(
            "n {exponent} at {degrees}°, leaning {lean}°: {:.4} ± {:.4}, exact {expected:.4}",
            mean.mean() / 3.0,
            mean.standard_error() / 3.0
        );
        assert!(mean.z(&Moments::exact(3.0 * expected)).abs() < 4.0);
        assert!(mean.standard_error() < 5e-3 * mean.mean());
    }
}

/// (n+2)/(2π) ∫ cosⁿα cosθ dω, θ from `shading` and α from the mirror direction about it, over what
/// is above its horizon and that of +Y; midpoint rule.
fn leaning_lobe(exponent: f64, viewer: DVec3, shading: DVec3) -> f64 {
    const STEPS: usize = 1000;
    if shading.dot(viewer) <= 0.0 {
        return 0.0;
    }
    let mirror = 2.0 * shading.dot(viewer) * shading - viewer;
    let mut sum = 0.0;
    for i in 0..STEPS {
        // Equal steps of the height: dω = d(height) dφ.
        let height = (i as f64 + 0.5) / STEPS as f64;
        let sine = (1.0 - height * height).sqrt();
        for j in 0..STEPS {
            let (sin, cos) = ((j as f64 + 0.5) / STEPS as f64 * TAU).sin_cos();
            let direction = DVec3::new(sine * cos, height, sine * sin);
            let cosine = direction.dot(shading).max(0.0);
            sum += cosine * direction.dot(mirror).max(0.0).powf(exponent);
        }
    }
    (exponent + 2.0) / TAU * sum * TAU / (STEPS * STEPS) as f64
}

/// Irradiance under a disk of radiance 1 at the distance `aside` from the point below its centre.
fn under_a_disk(radius: f64, height: f64, aside: f64) -> f64 {
    let (r, h, d) = (radius.powi(2), height.powi(2), aside.powi(2));
    0.5 * PI * (1.0 - (d + h - r) / ((d + h + r).powi(2) - 4.0 * r * d).sqrt())
}

/// A disk of light over a floor, unoccluded: area sampling sees the closed form; Lange's disks see
/// w·(all from the centre) + (1 − w)·(the mean over the area, or over the rim), w = cosθ.
#[test]
fn disk_lights_light_a_floor_as_they_should() {
    let (radius, height, kd) = (0.4f64, 1.0f64, 0.6f64);
    let mut builder = Builder::default();
    let floor = builder.lambertian(Rgb::splat(kd as f32));
    builder.quad(Vec3::new(-3.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 6.0, floor);
    let light = builder.light(Rgb::ZERO, Rgb::ONE);
    // The polygon has the disk's area.
    let sides = 96;
    let corner = radius * (PI / (0.5 * f64::from(sides) * (TAU / f64::from(sides)).sin())).sqrt();
    let axes = [Vec3::X, Vec3::Z];
    builder.polygon(Vec3::Y * height as f32, axes, corner as f32, sides, light);
    let scene = builder.build();
    for aside in [0.0, 0.5, 1.3] {
        let camera = looking([aside as f32 + 0.3, 0.8, 2.0], [aside as f32, 0.0, 0.0], 0.2);
        let seen = |options: &[(&str, &str)], passes| {
            let request = RenderRequest { camera: camera.clone(), ..request(&scene, 2, passes) };
            rendered(&with(request, options)).picture.mean()
        };
        let power = PI * radius * radius;
        let square = height * height + aside * aside;
        let (centre, weight) =
            (power * height * height / (square * square), height / square.sqrt());
        let area = under_a_disk(radius, height, aside);
        let steps = 720;
        let on_rim = |step: i32| {
            let (sin, cos) = (f64::from(step) / f64::from(steps) * TAU).sin_cos();
            let square = (radius * cos - aside).powi(2) + (radius * sin).powi(2) + height * height;
            power * height * height / (square * square)
        };
        let rim = (0..steps).map(on_rim).sum::<f64>() / f64::from(steps);
        let mixed = |random: f64| weight * centre + (1.0 - weight) * random;
        for (name, options, passes, irradiance) in [
            ("area", vec![], 30_000, area),
            ("lange", vec![("preset", "lange")], 400, mixed(area)),
            ("rim", vec![("preset", "lange"), ("light_sampling", "rim")], 400, mixed(rim)),
        ] {
            let (found, exact) = (seen(&options, passes), irradiance * kd / PI);
            println!("{name}, {aside} m aside: {found:.5}, closed form {exact:.5}");
            assert!((found / exact - 1.0).abs() < 0.004, "{name}: {found} {exact}");
        }
        // The closed forms differ by more than the tolerance, so a mix-up would show.
        assert!((mixed(area) / area - 1.0).abs() > 0.008, "{}", mixed(area) / area);
        assert!((mixed(rim) / mixed(area) - 1.0).abs() > 0.008 || weight > 0.8);
    }
}

/// All ways to sample a pixel have the same mean, but for `adaptive`, which loses light: a rare
/// bright sample makes its pixel split, and then counts for a small part of it.
#[test]
fn pixels_look_alike_however_they_are_sampled() {
    let scene = imported(&made::phong_cornell());
    let counted = off_emitters(&scene, 40);
    let sampled = |sampling: &str, passes| {
        let request = with(request(&scene, 40, passes), &[("pixel_sampling", sampling)]);
        replicas(&request, 12).0
    };
    let independent = sampled("independent", 32);
    let blocks = independent.blocks(5, &counted);
    let mean = independent.mean(&counted);
    for (sampling, passes) in [("jittered", 32), ("adaptive_fresh", 2), ("adaptive", 2)] {
        let found = sampled(sampling, passes);
        let score = Scores::between(&found.blocks(5, &counted), &blocks);
        let all = found.mean(&counted);
        println!(
            "{sampling}: {score:?}, mean {:.4}, z {:+.1}",
            all.mean() / mean.mean(),
            all.z(&mean)
        );
        if sampling == "adaptive" {
            assert!(all.z(&mean) < -5.0, "the known bias is not there");
        } else {
            assert!(score.is_chance(), "{sampling}: {score:?}");
            assert!(all.z(&mean).abs() < 4.0, "{sampling}");
        }
    }
}

/// The error that a picture estimates of itself is the one that it has.
#[test]
fn estimated_errors_are_true() {
    for (name, glb) in [
        ("cornell", made::cornell()),
        ("phong_cornell", made::phong_cornell()),
        ("office", made::office()),
    ] {
        let scene = imported(&glb);
        let counted = off_emitters(&scene, 24);
        for (sampling, passes) in
            [("jittered", 64), ("jittered", 20), ("independent", 30), ("adaptive_fresh", 6)]
        {
            let request = with(request(&scene, 24, passes), &[("pixel_sampling", sampling)]);
            let (traced, estimates) = replicas(&request, 8);
            assert_eq!(estimates.len(), 8, "every picture has an estimate");
            let actual = traced.noise(&counted);
            let squares = estimates.iter().map(|e| e * e).sum::<f64>() / estimates.len() as f64;
            let ratio = squares.sqrt() / actual;
            println!("{name}, {sampling}, {passes} passes: actual {actual:.4}, ratio {ratio:.3}");
            assert!((0.7..1.4).contains(&ratio), "{name}, {sampling}: {ratio}");
        }
    }
}

#[test]
fn threads_and_steps_leave_the_bits_alone() {
    let scene = imported(&made::phong_cornell());
    let traced = |threads: usize, seed: u64, sampling: &str| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let request = with(request(&scene, 37, 5), &[("pixel_sampling", sampling)]);
        let request = RenderRequest { height: 23, seed, ..request };
        pool.install(|| rendered(&request))
    };
    for sampling in ["jittered", "adaptive"] {
        let one = traced(1, 1, sampling);
        for threads in [2, 5] {
            let many = traced(threads, 1, sampling);
            assert_eq!(one.picture.pixels, many.picture.pixels, "{threads} threads");
            assert_eq!(one.stats.figures.estimated_error, many.stats.figures.estimated_error);
            assert_eq!(one.stats.figures.shots, many.stats.figures.shots);
        }
        assert_ne!(one.picture.pixels, traced(1, 2, sampling).picture.pixels, "another seed");
    }
}

/// Two methods that share nothing but materials: rays from the camera, and hemicubes on patches.
#[test]
fn glossy_bodies_look_as_stochastic_iteration_shows_them() {
    let scene = imported(&made::phong_cornell());
    let counted = off_emitters(&scene, 48);
    let mut shot = request(&scene, 48, 800);
    shot.method = "stochastic".into();
    let shot = with(
        shot,
        &[
            ("patches", "6000"),
            ("hemicube_resolution", "128"),
            ("burn_in", "10"),
            ("pixel_samples", "4"),
        ],
    );
    let shot = rendered(&shot);
    let traced = rendered(&request(&scene, 48, 96));
    let ratio = mean_ratio(&traced.picture, &shot.picture, &counted);
    println!("ray-traced over stochastic: {ratio:.4}");
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

/// Waits until an end is in sight, five seconds at most.
struct Patient {
    begun: Instant,
    remaining: Option<f64>,
}

impl Observer for Patient {
    fn progress(&mut self, progress: &Progress) {
        self.remaining = progress.seconds_remaining;
    }

    fn cancelled(&self) -> bool {
        self.remaining.is_some() || self.begun.elapsed().as_secs_f64() > 5.0
    }
}

/// Where every pixel sees an emitter there is no error to estimate, so that a target alone ends by
/// time.
#[test]
fn a_target_without_an_estimate_has_an_end() {
    let scene = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    let camera = looking([0.3, 0.4, 0.2], [0.9, 0.1, 0.95], 80.0);
    let limits = Limits { target_error: Some(0.01), ..Limits::default() };
    let request = RenderRequest { camera, limits, ..request(&scene, 16, 1) };
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    let mut patient = Patient { begun: Instant::now(), remaining: None };
    let stats = render(&mut device, &request, &mut patient).expect("good").stats;
    assert_eq!((stats.stopped, stats.figures.estimated_error), (StopReason::Cancelled, None));
    assert!(patient.begun.elapsed().as_secs_f64() < 5.0, "no end is in sight");
}

#[test]
fn targets_and_budgets_end_a_job() {
    let scene = imported(&made::cornell());
    let limits = Limits { target_error: Some(0.3), ..Limits::default() };
    let stats = rendered(&RenderRequest { limits, ..request(&scene, 32, 1) }).stats;
    assert_eq!(stats.stopped, StopReason::TargetError);
    assert!(stats.figures.estimated_error.is_some_and(|error| error <= 0.3));
    let limits = Limits::seconds(0.3);
    let stats = rendered(&RenderRequest { limits, ..request(&scene, 32, 1) }).stats;
    assert_eq!(stats.stopped, StopReason::TimeBudget);
    assert!(stats.seconds_solve < 1.0, "{}", stats.seconds_solve);
    assert_eq!(stats.figures.shots as f64, stats.diagnostics["rays"]);
}

#[test]
fn bias_that_was_asked_for_is_said() {
    let scene = imported(&made::cornell());
    let said = |options: &[(&str, &str)]| {
        let stats = rendered(&with(request(&scene, 4, 1), options)).stats;
        let biased = stats.warnings.iter().filter(|warning| warning.what.contains("biased"));
        biased.map(|warning| warning.at.clone()).collect::<Vec<_>>()
    };
    assert_eq!(said(&[]), [""; 0]);
    assert_eq!(said(&[("pixel_sampling", "adaptive_fresh")]), [""; 0]);
    assert_eq!(said(&[("pixel_sampling", "adaptive")]), ["options.pixel_sampling"]);
    assert_eq!(said(&[("preset", "lange")]), ["options.light_sampling"]);
}

/// Reflectances that vanish in single precision, and lights of any strength.
#[test]
fn extreme_materials_give_finite_pictures() {
    // 2·10⁻⁴⁴ leaves the smallest lobe that there is; its albedo at grazing angles is nothing.
    for (specular, emission) in [(2e-44f32, 1.0f32), (1.0, 1e-38), (0.5, 1e30)] {
        let mut builder = Builder::default();
        let wall = builder.material(Material {
            base_color: Rgb::splat(if specular < 0.1 { 0.0 } else { specular }),
            specular_factor: specular,
            roughness: 0.3,
            ..Material::default()
        });
        let light = builder.light(Rgb::ZERO, Rgb::splat(emission));
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        builder.quad(Vec3::new(0.4, 0.99, 0.4), Vec3::X * 0.2, Vec3::Z * 0.2, light);
        let scene = builder.build();
        let camera = looking([0.1, 0.2, 0.1], [0.9, 0.3, 0.9], 60.0);
        for preset in ["default", "lange"] {
            let request = RenderRequest { camera: camera.clone(), ..request(&scene, 8, 8) };
            let rendered = rendered(&with(request, &[("preset", preset)]));
            assert!(
                rendered.picture.pixels.iter().all(|pixel| pixel.is_finite()),
                "specular {specular}, emission {emission}, {preset}"
            );
        }
    }
}
