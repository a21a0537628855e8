//! Light that no patch sends (skies, suns, lights without extent) in the methods on patches, against
//! closed forms and against path tracing.

use glam::Vec3;
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    Begin, CameraChoice, ExplicitCamera, Limits, Observer, Progress, RenderRequest, Rendered,
    StopReason,
};
use hemilux_engine::scene::{Environment, LightKind, PunctualLight, Scene, Sky, Sun};
use hemilux_engine::transport::render;
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::f32::consts::PI;
use std::sync::Arc;

/// The methods on patches, each with iterations that are enough for what is tested here.
const METHODS: [(&str, u64); 4] =
    [("stochastic", 600), ("gauss-seidel", 60), ("progressive", 4000), ("monte-carlo", 40)];
const SIDE: u32 = 24;

fn request(
    scene: &Arc<Scene>,
    environment: Option<Environment>,
    camera: ExplicitCamera,
    (method, iterations): (&str, u64),
) -> RenderRequest {
    let mut request = RenderRequest {
        environment: environment.map(Arc::new),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 5,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    if method != "ray-traced" {
        request.options.insert("patches".into(), "700".into());
        request.options.insert("hemicube_resolution".into(), "64".into());
    }
    request
}

fn mean(picture: &Picture) -> Rgb {
    picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32
}

fn warns(rendered: &Rendered, of: &str) -> bool {
    rendered.stats.warnings.iter().any(|warning| warning.what.contains(of))
}

/// A camera straight above the origin that sees `width` metres of the floor from two metres.
fn above(width: f32) -> ExplicitCamera {
    let yfov_degrees = 2.0 * (0.5 * width / 2.0).atan().to_degrees();
    ExplicitCamera { eye: [0.0, 2.0, 0.0], target: [0.0; 3], up: [0.0, 0.0, -1.0], yfov_degrees }
}

/// A Lambertian floor, sixty centimetres square.
fn floor(albedo: Rgb) -> Builder {
    let mut builder = Builder::default();
    let material = builder.lambertian(albedo);
    builder.quad(Vec3::new(-0.3, 0.0, 0.3), 0.6 * Vec3::X, -0.6 * Vec3::Z, material);
    builder
}

fn bulb(position: Vec3) -> PunctualLight {
    PunctualLight {
        name: "bulb".into(),
        kind: LightKind::Point,
        position,
        direction: -Vec3::Y,
        intensity: Rgb::splat(100.0 / (4.0 * PI)),
        range: None,
    }
}

fn sun(height: f32) -> Environment {
    let across = (1.0 - height * height).sqrt();
    let sun = Sun {
        direction: Vec3::new(0.6 * across, height, 0.8 * across),
        irradiance: Rgb::splat(1000.0),
        angular_radius: 0.00465,
    };
    Environment { sky: Sky::None, sun: Some(sun), ..Environment::default() }
}

fn uniform(radiance: Rgb) -> Environment {
    Environment { sky: Sky::Uniform(radiance), ..Environment::default() }
}

/// Irradiance of the white floor under the camera, by each method; nothing bounces.
fn assert_floor(scene: &Arc<Scene>, environment: Environment, expected: f32) {
    for (method, _) in METHODS {
        let asked = request(scene, Some(environment.clone()), above(0.01), (method, 100));
        let rendered = rendered(&asked);
        let irradiance = PI * mean(&rendered.picture).y;
        println!("{method}: {irradiance} of {expected}, {:?}", rendered.stats.stopped);
        assert!((irradiance / expected - 1.0).abs() < 3e-3, "{method}: {irradiance}");
        assert_ne!(rendered.stats.stopped, StopReason::NoLight);
        assert!(!warns(&rendered, "nothing gives light") && !warns(&rendered, "leaves out"));
    }
}

/// A uniform sky of radiance L: πL.
#[test]
fn a_uniform_sky_lights_a_floor_by_pi() {
    assert_floor(&floor(Rgb::ONE).build(), uniform(Rgb::splat(2.0)), 2.0 * PI);
}

/// A sun: E cosθ.
#[test]
fn a_sun_lights_a_floor_by_its_cosine() {
    let scene = floor(Rgb::ONE).build();
    assert_floor(&scene, sun(0.9), 900.0);
    assert_floor(&scene, sun(0.3), 300.0);
}

/// A bulb of 100 lm, 1 m above: 100/4π = 7.96 lx.
#[test]
fn a_bulb_lights_a_floor_by_the_square_law() {
    let mut scene = Scene::clone(&floor(Rgb::ONE).build());
    scene.lights.push(bulb(Vec3::Y));
    assert_floor(&Arc::new(scene), Environment::none(), 7.9577);
}

/// A closed grey room of 2 × 2 × 3 m with a bulb inside, and a camera.
fn room() -> (Arc<Scene>, ExplicitCamera) {
    let mut builder = Builder::default();
    let grey = builder.lambertian(Rgb::new(0.7, 0.5, 0.3));
    builder.cuboid(Vec3::ZERO, Vec3::new(2.0, 2.0, 3.0), true, grey);
    builder.cuboid(Vec3::new(0.5, 0.2, 0.4), Vec3::new(0.9, 0.8, 0.9), false, grey);
    let mut scene = Scene::clone(&builder.build());
    scene.lights.push(bulb(Vec3::new(1.3, 1.4, 1.2)));
    let camera = ExplicitCamera {
        eye: [1.0, 1.0, 2.8],
        target: [1.0, 0.9, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 60.0,
    };
    (Arc::new(scene), camera)
}

/// Each method's mean picture is that of path tracing, in each colour.
fn assert_as_traced(
    scene: &Arc<Scene>,
    environment: &Environment,
    camera: ExplicitCamera,
    patches: u32,
) {
    let asked = |run| request(scene, Some(environment.clone()), camera, run);
    let expected = mean(&rendered(&asked(("ray-traced", 250))).picture);
    for run in METHODS {
        let mut asked = asked(run);
        asked.options.insert("patches".into(), patches.to_string());
        let found = mean(&rendered(&asked).picture);
        println!("{}: {found} of {expected}", run.0);
        let off = (found / expected - Rgb::ONE).abs().max_element();
        assert!(off < 0.015, "{}: {found} of {expected}", run.0);
    }
}

#[test]
fn a_room_with_a_bulb_is_as_path_tracing_has_it() {
    let (scene, camera) = room();
    assert_as_traced(&scene, &Environment::none(), camera, 3000);
}

/// Light of surfaces comes on top of that of a sky, and is counted once. The camera sees past the
/// floor, too.
#[test]
fn a_lamp_under_a_sky_is_counted_once() {
    let mut builder = floor(Rgb::new(0.7, 0.5, 0.3));
    let wall = builder.lambertian(Rgb::splat(0.6));
    builder.quad(Vec3::new(-0.3, 0.0, -0.3), 0.6 * Vec3::X, 0.6 * Vec3::Y, wall);
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
    builder.quad(Vec3::new(-0.1, 0.5, -0.1), 0.2 * Vec3::X, 0.2 * Vec3::Z, lamp);
    let camera = ExplicitCamera {
        eye: [0.3, 0.7, 1.2],
        target: [0.0, 0.1, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 45.0,
    };
    let environment = uniform(Rgb::new(0.5, 1.0, 2.0));
    assert_as_traced(&builder.build(), &environment, camera, 700);
}

/// What is known beforehand in other ways adds up with it: the picture stays the same.
#[test]
fn constants_and_first_shots_change_nothing() {
    let (scene, camera) = room();
    let asked = request(&scene, Some(Environment::none()), camera, ("stochastic", 200));
    let expected = mean(&rendered(&asked).picture);
    for (key, value) in [
        ("first_shot", "true"),
        ("constant_radiance", "corrected"),
        ("constant_radiance", "printed"),
    ] {
        let mut asked = asked.clone();
        asked.options.insert(key.into(), value.into());
        let found = mean(&rendered(&asked).picture);
        let off = (found / expected - Rgb::ONE).abs().max_element();
        assert!(off < 0.02, "{key} {value}: {found} of {expected}");
    }
}

/// Where nothing lights a scene, the studio does, and is seen behind it as path tracing sees it.
#[test]
fn the_studio_lights_a_dark_scene_and_stands_behind_it() {
    let scene = floor(Rgb::splat(0.5)).build();
    let traced = rendered(&request(&scene, None, above(1.2), ("ray-traced", 64))).picture;
    for (method, _) in METHODS {
        let rendered = rendered(&request(&scene, None, above(1.2), (method, 100)));
        assert!(warns(&rendered, "studio"), "{method}: {:?}", rendered.stats.warnings);
        let middle = (SIDE / 2 * SIDE + SIDE / 2) as usize;
        // Four corners, and the floor.
        let last = (SIDE * SIDE - 1) as usize;
        for at in [0, SIDE as usize - 1, last + 1 - SIDE as usize, last, middle] {
            let (found, expected) = (rendered.picture.pixels[at], traced.pixels[at]);
            let off = (found / expected - Rgb::ONE).abs().max_element();
            assert!(off < 0.03, "{method}, pixel {at}: {found} of {expected}");
        }
    }
}

/// Where nothing reflects, and even where there is no surface, the sky is to be seen at once.
#[test]
fn scenes_that_reflect_nothing_are_solved_at_once() {
    let sky = uniform(Rgb::new(1.0, 2.0, 3.0));
    for scene in [floor(Rgb::ZERO).build(), Arc::new(Scene::default())] {
        for (method, _) in METHODS {
            let asked = request(&scene, Some(sky.clone()), above(1.2), (method, 1_000_000));
            let rendered = rendered(&asked);
            assert_eq!(rendered.picture.pixels[0], Rgb::new(1.0, 2.0, 3.0), "{method}");
            assert_eq!(rendered.stats.stopped, StopReason::Converged, "{method}");
            assert!(!warns(&rendered, "nothing gives light"), "{method}");
        }
    }
}

/// Takes a checkpoint at the end.
#[derive(Default)]
struct Keeper(Option<Checkpoint>);

impl Observer for Keeper {
    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        true
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        let read = Checkpoint::from_bytes(&checkpoint.to_bytes());
        self.0 = Some(read.expect("what was written can be read"));
    }
}

/// A job that goes on from a checkpoint ends with the bits of one that was never stopped, where the
/// light is reflected and where there is nothing to shoot.
#[test]
fn jobs_go_on_to_the_same_bits() {
    let (room, camera) = room();
    let bare = (floor(Rgb::ZERO).build(), above(1.2));
    for (scene, camera) in [(room, camera), bare] {
        for (method, _) in METHODS {
            let sky = Some(uniform(Rgb::ONE));
            let mut whole = request(&scene, sky, camera, (method, 12));
            whole.options.insert("patches".into(), "200".into());
            let expected = rendered(&whole).picture;
            let mut part = whole.clone();
            part.limits.iterations = Some(5);
            let (mut device, mut keeper) = (CpuDevice::new(Some(2)).unwrap(), Keeper::default());
            render(&mut device, &part, &mut keeper).expect("it renders");
            let begin = Begin::Continue(Arc::new(keeper.0.expect("a solution")));
            let again = rendered(&RenderRequest { begin, ..whole }).picture;
            assert!(again == expected, "{method}");
        }
    }
}
