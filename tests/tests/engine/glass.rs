//! Glass: what `hemilux` shows behind, in and by way of it, against closed forms and path tracing.

use glam::Vec3;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest};
use hemilux_engine::scene::{
    Alpha, Environment, LightKind, Material, PunctualLight, Scene, Sky, Sun, Triangle, Vertex,
    Volume,
};
use hemilux_tests::blocks::{block_means, largest_deviation};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::f32::consts::PI;
use std::sync::Arc;

/// What a test renders.
struct Shot {
    scene: Arc<Scene>,
    environment: Environment,
    camera: ExplicitCamera,
    side: u32,
    seed: u64,
}

impl Shot {
    fn by(&self, method: &str, iterations: u64) -> Picture {
        let request = RenderRequest {
            environment: Some(Arc::new(self.environment.clone())),
            camera: CameraChoice::Explicit(self.camera),
            limits: Limits::iterations(iterations),
            seed: self.seed,
            ..RenderRequest::new(self.scene.clone(), method, [self.side; 2])
        };
        rendered(&request).picture
    }
}

fn mean(picture: &Picture) -> Rgb {
    picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32
}

/// A sheet of glass that takes some colour.
fn pane(tint: Rgb, roughness: f32) -> Material {
    let clear = Material::glass("pane", 1.5);
    Material { base_color: tint, volume: None, roughness, ..clear }
}

/// Unpolarised reflectance of glass by Fresnel's equations, in double precision.
fn fresnel(cosine: f64) -> f64 {
    let below = (1.0 - (1.0 - cosine * cosine) / 2.25).sqrt();
    let across = (cosine - 1.5 * below) / (cosine + 1.5 * below);
    let along = (1.5 * cosine - below) / (1.5 * cosine + below);
    0.5 * (across * across + along * along)
}

/// A dark floor, of albedo .01, that light comes to through a tinted pane half a metre above.
fn under_a_pane() -> (Arc<Scene>, ExplicitCamera) {
    let mut builder = Builder::default();
    let floor = builder.lambertian(Rgb::splat(0.01));
    builder.quad(Vec3::new(-400.0, 0.0, 400.0), 800.0 * Vec3::X, -800.0 * Vec3::Z, floor);
    let glass = builder.material(pane(TINT, 0.0));
    builder.quad(Vec3::new(-90.0, 0.5, 90.0), 180.0 * Vec3::X, -180.0 * Vec3::Z, glass);
    let below = ExplicitCamera {
        eye: [0.0, 0.3, 0.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 1.0,
    };
    (builder.build(), below)
}

const TINT: Rgb = Rgb::new(0.9, 0.5, 0.7);

/// The sun, a bulb and a uniform sky through a pane: what Fresnel's equations and its colour leave.
#[test]
fn light_goes_straight_through_panes() {
    let (scene, camera) = under_a_pane();
    let cosine = 0.6f64;
    let sun = Sun {
        direction: Vec3::new(0.8, 0.6, 0.0),
        irradiance: Rgb::splat(1000.0),
        angular_radius: 0.00465,
    };
    let mut with_bulb = Scene::clone(&scene);
    with_bulb.lights.push(PunctualLight {
        name: "bulb".into(),
        kind: LightKind::Point,
        position: Vec3::new(0.0, 2.0, 0.0),
        direction: -Vec3::Y,
        intensity: Rgb::splat(40.0),
        range: None,
    });
    let under_sky = {
        // ∫ (1 − F) cosθ dω over the hemisphere.
        let steps = 2000;
        let of = |k: i32| {
            let height = (f64::from(k) + 0.5) / f64::from(steps);
            (1.0 - fresnel(height)) * height
        };
        2.0 * std::f64::consts::PI * (0..steps).map(of).sum::<f64>() / f64::from(steps)
    };
    let cases = [
        ("sun", scene.clone(), Environment { sun: Some(sun), ..Environment::none() }, {
            1000.0 * cosine * (1.0 - fresnel(cosine))
        }),
        ("bulb", Arc::new(with_bulb), Environment::none(), 10.0 * (1.0 - fresnel(1.0))),
        (
            "sky",
            scene,
            Environment { sky: Sky::Uniform(Rgb::splat(50.0)), ..Environment::none() },
            { 50.0 * under_sky },
        ),
    ];
    for (name, scene, environment, irradiance) in cases {
        let shot = Shot { scene, environment, camera, side: 16, seed: 3 };
        for (method, iterations) in [("hemilux", 16), ("ray-traced", 256)] {
            let found = mean(&shot.by(method, iterations)) * (PI / 0.01);
            let expected = TINT * irradiance as f32;
            println!("{name}, {method}: {found} of {expected}");
            let off = (found / expected - Rgb::ONE).abs().max_element();
            assert!(off < 0.012, "{name}, {method}: {found} {expected}");
            // Planted: a pane that takes its colour twice.
            assert!((found / (expected * TINT) - Rgb::ONE).abs().max_element() > 0.05);
        }
    }
}

/// A ball of many smooth triangles about the origin.
fn ball(material: Material) -> Arc<Scene> {
    const ROWS: u32 = 40;
    const COLUMNS: u32 = 80;
    let mut scene = Scene { materials: vec![material], ..Scene::default() };
    add_ball(&mut scene, (Vec3::ZERO, 1.0), 0, [ROWS, COLUMNS]);
    Arc::new(scene)
}

fn add_ball(
    scene: &mut Scene,
    (center, radius): (Vec3, f32),
    material: u32,
    [rows, columns]: [u32; 2],
) {
    let first = scene.vertices.len() as u32;
    for row in 0..=rows {
        for column in 0..columns {
            let height = PI * row as f32 / rows as f32;
            let angle = 2.0 * PI * column as f32 / columns as f32;
            let normal =
                Vec3::new(height.sin() * angle.cos(), height.cos(), height.sin() * angle.sin());
            scene.vertices.push(Vertex::new(center + radius * normal, normal));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let next = (column + 1) % columns;
            let [a, b] = [column, next].map(|column| first + row * columns + column);
            let [c, d] = [a + columns, b + columns];
            for vertices in [[a, b, d], [a, d, c]] {
                scene.triangles.push(Triangle { vertices, material });
            }
        }
    }
}

/// In a uniform sky of radiance 1 clear glass can't be seen, and rough glass loses what its
/// microfacets mask, by either method alike.
#[test]
fn glass_in_a_uniform_sky_loses_nothing() {
    let camera = ExplicitCamera {
        eye: [0.3, 9.0, 4.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 8.0,
    };
    for (roughness, least) in [(0.0, 0.995), (0.3, 0.95), (0.6, 0.7)] {
        let material = Material { roughness, ..Material::glass("glass", 1.5) };
        let scene = ball(material);
        let environment = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        let shot = Shot { scene, environment, camera, side: 16, seed: 3 };
        let [ours, traced] = [("hemilux", 16), ("ray-traced", 128)]
            .map(|(method, iterations)| mean(&shot.by(method, iterations)).y);
        println!("roughness {roughness}: {ours}, {traced}");
        assert!((least..1.003).contains(&ours), "{roughness}: {ours}");
        assert!((ours / traced - 1.0).abs() < 0.01, "{roughness}: {ours} {traced}");
    }
}

/// A closed room with a lamp on its ceiling, a pane, a frosted pane, a tinted ball of glass, and a
/// block behind them.
fn room(dispersion: f32) -> Arc<Scene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::new(0.6, 0.55, 0.5));
    let red = builder.lambertian(Rgb::new(0.6, 0.15, 0.1));
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
    let clear = builder.material(pane(Rgb::new(0.7, 0.9, 0.8), 0.0));
    let frosted = builder.material(pane(Rgb::splat(0.95), 0.4));
    let volume = Volume { attenuation_color: Rgb::new(0.3, 0.7, 0.9), attenuation_distance: 0.5 };
    let solid = builder.material(Material {
        volume: Some(volume),
        dispersion,
        ..Material::glass("ball", 1.5)
    });
    builder.cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true, wall);
    builder.quad(Vec3::new(1.5, 2.99, 1.5), Vec3::X, Vec3::Z, lamp);
    builder.cuboid(Vec3::new(0.4, 0.0, 0.3), Vec3::new(1.2, 1.1, 0.9), false, red);
    builder.quad(Vec3::new(0.2, 0.05, 1.6), 1.2 * Vec3::X, 1.5 * Vec3::Y, clear);
    builder.quad(Vec3::new(1.6, 0.05, 1.2), 1.0 * Vec3::X, 1.4 * Vec3::Y, frosted);
    let mut scene = Scene::clone(&builder.build());
    add_ball(&mut scene, (Vec3::new(2.9, 0.5, 2.0), 0.4), solid, [32, 64]);
    Arc::new(scene)
}

const IN_THE_ROOM: ExplicitCamera = ExplicitCamera {
    eye: [2.1, 1.6, 3.9],
    target: [1.9, 0.8, 1.0],
    up: [0.0, 1.0, 0.0],
    yfov_degrees: 62.0,
};

/// Blocks of pixels of a room full of glass are what path tracing says.
#[test]
fn a_room_with_glass_is_that_of_path_tracing() {
    let shot = Shot {
        scene: room(0.0),
        environment: Environment::none(),
        camera: IN_THE_ROOM,
        side: 48,
        seed: 5,
    };
    let reference = block_means(&shot.by("ray-traced", 300), 8);
    let ours = shot.by("hemilux", 12);
    let deviation = largest_deviation(&block_means(&ours, 8), &reference);
    println!("largest deviation of a block: {deviation:.4}");
    assert!(deviation < 0.04, "{deviation}");
    // Planted: a tenth more light in the lower half.
    let mut planted = ours.clone();
    let half = planted.pixels.len() / 2;
    planted.pixels[half..].iter_mut().for_each(|pixel| *pixel *= 1.1);
    assert!(largest_deviation(&block_means(&planted, 8), &reference) > 0.04);
}

/// The same of one whose ball disperses light more than any mineral does.
#[test]
fn a_room_with_dispersion_is_that_of_path_tracing() {
    let shot = |dispersion| Shot {
        scene: room(dispersion),
        environment: Environment::none(),
        camera: IN_THE_ROOM,
        side: 48,
        seed: 6,
    };
    let reference = block_means(&shot(4.0).by("ray-traced", 400), 8);
    let ours = block_means(&shot(4.0).by("hemilux", 24), 8);
    let deviation = largest_deviation(&ours, &reference);
    println!("largest deviation of a block: {deviation:.4}");
    assert!(deviation < 0.05, "{deviation}");
}

/// A box of red panes, half of which is opaque, on a ground under a sky.
fn half_clear_box(tint: Rgb) -> Arc<Scene> {
    let mut builder = Builder::default();
    let ground = builder.lambertian(Rgb::splat(0.8));
    let half_clear = Material { transmission: 0.5, double_sided: true, ..pane(tint, 0.0) };
    let half_clear = builder.material(half_clear);
    builder.quad(Vec3::new(-2.0, 0.0, 2.0), 4.0 * Vec3::X, -4.0 * Vec3::Z, ground);
    builder.cuboid(Vec3::new(-0.5, 0.1, -0.5), Vec3::new(0.5, 1.1, 0.5), false, half_clear);
    builder.build()
}

/// The inside of a closed body of panes is lit, and what bounces into it has the panes' colour.
#[test]
fn a_box_of_coloured_panes_is_lit_inside() {
    let eye = ExplicitCamera {
        eye: [0.9, 1.6, 1.7],
        target: [0.0, 0.55, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 45.0,
    };
    let shot = |tint| Shot {
        scene: half_clear_box(tint),
        environment: Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() },
        camera: eye,
        side: 48,
        seed: 5,
    };
    let tint = Rgb::new(0.95, 0.2, 0.1);
    let red = |picture: &Picture| -> Vec<Rgb> {
        block_means(picture, 8).into_iter().map(|block| Rgb::splat(block.x)).collect()
    };
    let reference = red(&shot(tint).by("ray-traced", 500));
    let [ours, planted] = [tint, Rgb::new(0.88, 0.2, 0.1)]
        .map(|tint| largest_deviation(&red(&shot(tint).by("hemilux", 12)), &reference));
    println!("a box of panes: largest deviation {ours:.4}, planted {planted:.4}");
    assert!(ours < 0.02, "{ours}");
    assert!(planted > 0.04, "{planted}");
}

/// A plate of albedo ½ in the middle of a ball of glass, in a box whose walls all shine: by way of
/// the glass it gets from every side what it would get without, but for what the ball mirrors back.
/// (Radiance inside is n² times that outside, within a cone so much narrower.) Half there, it hides half of
/// what is behind it.
#[test]
fn a_plate_inside_glass_gets_what_it_would_get_outside() {
    // A 25th is mirrored and comes back to the plate, which reflects half of it again.
    let whole = 0.5 * (0.96 + 0.04 * 0.49);
    assert_plate(Material::lambertian("plate", Rgb::splat(0.5)), whole);
    let veil = Material {
        alpha: Alpha::Blend,
        opacity: 0.5,
        ..Material::lambertian("veil", Rgb::splat(0.5))
    };
    assert_plate(veil, 0.5 * whole + 0.5 * 0.98);
}

/// Asserts the mean radiance of a picture of such a plate from inside the ball.
fn assert_plate(plate: Material, expected: f32) {
    let mut builder = Builder::default();
    let walls = builder.light(Rgb::ZERO, Rgb::ONE);
    let gray = builder.material(plate);
    let solid = builder.material(Material::glass("ball", 1.5));
    builder.cuboid(Vec3::splat(-2.0), Vec3::splat(2.0), true, walls);
    builder.quad(Vec3::new(-0.15, 0.0, 0.15), 0.3 * Vec3::X, -0.3 * Vec3::Z, gray);
    let mut scene = Scene::clone(&builder.build());
    add_ball(&mut scene, (Vec3::ZERO, 0.5), solid, [40, 80]);
    let camera = ExplicitCamera {
        eye: [0.0, 0.3, 0.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 40.0,
    };
    let shot = Shot {
        scene: Arc::new(scene),
        environment: Environment::none(),
        camera,
        side: 12,
        seed: 4,
    };
    // Few light rays land on what is so small: the map's noise after 24 iterations is a good
    // part of what is allowed.
    for (method, iterations) in [("hemilux", 12), ("ray-traced", 200)] {
        let found = mean(&shot.by(method, iterations)).y;
        println!("{method}: {found} of {expected}");
        assert!((found / expected - 1.0).abs() < 0.04, "{method}: {found} {expected}");
    }
}

/// A lamp and a plate inside a block of glass, in a room: blocks of pixels are what path tracing says. The
/// camera looks at the lamp's back, which is not there for it, through the glass either.
#[test]
fn a_lamp_inside_glass_is_that_of_path_tracing() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
    let solid = builder.material(Material::glass("block", 1.5));
    builder.cuboid(Vec3::ZERO, Vec3::splat(3.0), true, wall);
    builder.cuboid(Vec3::new(0.8, 0.5, 0.8), Vec3::new(2.2, 1.5, 2.2), false, solid);
    builder.quad(Vec3::new(1.2, 1.2, 1.2), 0.6 * Vec3::X, 0.6 * Vec3::Z, lamp);
    builder.quad(Vec3::new(1.0, 0.7, 1.9), 0.5 * Vec3::X, -0.5 * Vec3::Z, wall);
    let camera = ExplicitCamera {
        eye: [1.5, 2.4, 2.9],
        target: [1.5, 0.6, 1.2],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 60.0,
    };
    let shot = Shot {
        scene: builder.build(),
        environment: Environment::none(),
        camera,
        side: 32,
        seed: 8,
    };
    let reference = block_means(&shot.by("ray-traced", 3000), 8);
    let deviation = largest_deviation(&block_means(&shot.by("hemilux", 16), 8), &reference);
    println!("largest deviation of a block: {deviation:.4}");
    assert!(deviation < 0.05, "{deviation}");
}

/// Glass behind a screen that is half there shows by half, and the screen as bright as without it.
#[test]
fn a_screen_before_glass_is_seen_once() {
    let scene = |has_glass| {
        let mut builder = Builder::default();
        let lamp = builder.light(Rgb::ZERO, Rgb::ONE);
        let screen = Material {
            alpha: Alpha::Blend,
            opacity: 0.3,
            ..Material::lambertian("screen", Rgb::splat(0.8))
        };
        let screen = builder.material(screen);
        builder.quad(Vec3::new(-5.0, -5.0, 4.0), 10.0 * Vec3::Y, 10.0 * Vec3::X, lamp);
        builder.quad(Vec3::new(-2.0, -2.0, 0.0), 4.0 * Vec3::X, 4.0 * Vec3::Y, screen);
        if has_glass {
            let solid = builder.material(Material::glass("block", 1.5));
            builder.cuboid(Vec3::new(-2.0, -2.0, -1.0), Vec3::new(2.0, 2.0, -0.5), false, solid);
        }
        builder.build()
    };
    let camera = ExplicitCamera {
        eye: [0.0, 0.0, 3.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 10.0,
    };
    let shot = |has_glass| Shot {
        scene: scene(has_glass),
        environment: Environment::none(),
        camera,
        side: 16,
        seed: 2,
    };
    let alone = mean(&shot(false).by("hemilux", 12)).y;
    let [ours, traced] = [("hemilux", 12), ("ray-traced", 400)]
        .map(|(method, iterations)| mean(&shot(true).by(method, iterations)).y);
    println!("{ours}, traced {traced}, without glass {alone}");
    assert!((ours / traced - 1.0).abs() < 0.03, "{ours} {traced}");
    // Seen twice it would be 1.7 times as bright, and what glass mirrors of the lamp less than a tenth.
    assert!((1.0..1.4).contains(&(ours / alone)), "{ours} {alone}");
}

/// Panes are the same from behind, where the material has one side too: single, and as a box around the
/// camera. Before a uniform sky they show what Fresnel's equations and their colour leave of it.
#[test]
fn panes_are_seen_from_behind() {
    let around = |outwards: bool| {
        let mut builder = Builder::default();
        let glass = builder.material(pane(TINT, 0.0));
        builder.cuboid(Vec3::splat(-1.0), Vec3::splat(1.0), !outwards, glass);
        builder.build()
    };
    let single = {
        let mut builder = Builder::default();
        let glass = builder.material(pane(TINT, 0.0));
        builder.quad(Vec3::new(-2.0, -2.0, -1.0), 4.0 * Vec3::Y, 4.0 * Vec3::X, glass);
        builder.build()
    };
    let camera = ExplicitCamera {
        eye: [0.0; 3],
        target: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 2.0,
    };
    let mirrored = fresnel(1.0) as f32;
    let passed = TINT * (1.0 - mirrored);
    // In a box what is mirrored comes through the pane behind the camera, and so on.
    let in_box = passed / (1.0 - mirrored);
    let cases = [
        ("single", single, Rgb::splat(mirrored) + passed),
        ("box, backs", around(true), in_box),
        ("box, fronts", around(false), in_box),
    ];
    for (name, scene, expected) in cases {
        let environment = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        let shot = Shot { scene, environment, camera, side: 16, seed: 5 };
        for (method, iterations) in [("hemilux", 16), ("ray-traced", 256)] {
            let found = mean(&shot.by(method, iterations));
            println!("{name}, {method}: {found} of {expected}");
            let off = (found / expected - Rgb::ONE).abs().max_element();
            assert!(off < 0.01, "{name}, {method}: {found} {expected}");
        }
    }
}

/// A camera within a closed box sees its inside, which is black, and not what is around it.
#[test]
fn a_closed_box_is_black_inside() {
    let scene = |double_sided| {
        let mut builder = Builder::default();
        let wall = Material { double_sided, ..Material::lambertian("wall", Rgb::splat(0.7)) };
        let wall = builder.material(wall);
        builder.cuboid(Vec3::splat(-1.0), Vec3::splat(1.0), false, wall);
        builder.cuboid(Vec3::splat(0.2), Vec3::splat(0.3), false, wall);
        builder.build()
    };
    let camera = ExplicitCamera {
        eye: [0.0; 3],
        target: [1.0, 0.4, 0.3],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 70.0,
    };
    let mean_of = |double_sided, method| {
        let environment = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        let scene = scene(double_sided);
        let shot = Shot { scene, environment, camera, side: 24, seed: 5 };
        mean(&shot.by(method, 4)).y
    };
    for method in ["hemilux", "ray-traced"] {
        let inside = mean_of(true, method);
        assert!(inside < 1e-3, "{method}: {inside}");
        // Backs of one-sided walls are not there for cameras.
        assert!(mean_of(false, method) > 0.3, "{method}");
    }
}

/// A block of glass that stands on a table, and one that hangs a millimetre above it, look alike; where
/// surfaces that touch are not parted, rays get from glass into the table.
#[test]
fn a_table_under_glass_is_seen_and_lit_through_it() {
    let scene = |lifted: f32| {
        let mut builder = Builder::default();
        let wood = builder.lambertian(Rgb::splat(0.6));
        let lamp = builder.light(Rgb::ZERO, Rgb::splat(20.0));
        let solid = builder.material(Material::glass("block", 1.5));
        builder.quad(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, lamp);
        builder.quad(Vec3::new(-2.0, 0.0, 2.0), 4.0 * Vec3::X, -4.0 * Vec3::Z, wood);
        let lift = lifted * Vec3::Y;
        let (low, high) = (Vec3::new(-0.4, 0.0, -0.4), Vec3::new(0.4, 0.3, 0.4));
        builder.cuboid(low + lift, high + lift, false, solid);
        Scene::clone(&builder.build())
    };
    let camera = ExplicitCamera {
        eye: [0.0, 2.0, 1.8],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 12.0,
    };
    let shown = |scene: Scene, method, iterations| {
        let (scene, environment) = (Arc::new(scene), Environment::none());
        mean(&Shot { scene, environment, camera, side: 24, seed: 4 }.by(method, iterations)).y
    };
    let mut parted = scene(0.0);
    parted.part_touching();
    for (method, iterations) in [("hemilux", 12), ("ray-traced", 200)] {
        let lifted = shown(scene(1e-3), method, iterations);
        let stands = shown(parted.clone(), method, iterations) / lifted;
        let through = shown(scene(0.0), method, iterations) / lifted;
        println!("{method}: {stands} and, not parted, {through} of {lifted}");
        assert!((stands - 1.0).abs() < 0.03, "{method}: {stands}");
        // Planted: as before they were parted.
        assert!(through < 0.9, "{method}: {through}");
    }
}

/// A bulb in the middle of a ball that absorbs lights a floor by what the ball leaves on the first way
/// out and on those after each reflection, (1 − F)c/(1 − Fc²), over the light of a clear ball.
#[test]
fn a_body_absorbs_light_from_inside_before_its_first_crossing() {
    let left = Rgb::new(0.5, 0.7, 0.9);
    let lit = |volume: Volume| {
        let glass = Material { volume: Some(volume), ..Material::glass("ball", 1.5) };
        let mut scene = Scene::clone(&ball(glass));
        scene.materials.push(Material::lambertian("floor", Rgb::splat(0.05)));
        let first = scene.vertices.len() as u32;
        for [x, z] in [[-9.0, 9.0], [9.0, 9.0], [9.0, -9.0], [-9.0, -9.0]] {
            scene.vertices.push(Vertex::new(Vec3::new(x, -3.0, z), Vec3::Y));
        }
        for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
            scene.triangles.push(Triangle { vertices, material: 1 });
        }
        scene.lights.push(PunctualLight {
            name: "bulb".into(),
            kind: LightKind::Point,
            position: Vec3::ZERO,
            direction: -Vec3::Y,
            intensity: Rgb::splat(40.0),
            range: None,
        });
        let camera = ExplicitCamera {
            eye: [2.5, -1.0, 0.0],
            target: [0.0, -3.0, 0.0],
            up: [0.0, 1.0, 0.0],
            yfov_degrees: 25.0,
        };
        let (scene, environment) = (Arc::new(scene), Environment::none());
        mean(&Shot { scene, environment, camera, side: 24, seed: 6 }.by("hemilux", 6))
    };
    let clear = lit(Volume::default());
    let found = lit(Volume { attenuation_color: left, attenuation_distance: 1.0 }) / clear;
    let mirrored = fresnel(1.0) as f32;
    let expected = left * ((1.0 - mirrored) / (Rgb::ONE - left * left * mirrored));
    println!("{found} of {expected}, on {clear}");
    let off = (found / expected - Rgb::ONE).abs();
    assert!(off.max_element() < 0.03, "{found} {expected}");
}
