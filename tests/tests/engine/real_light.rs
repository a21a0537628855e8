//! Real light against closed forms: skies, suns, lights without extent, the format's microfacets.

use glam::Vec3;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest, Rendered};
use hemilux_engine::scene::{
    Alpha, Environment, LightKind, Material, PunctualLight, Scene, Sky, Sun, Triangle, Vertex,
};
use hemilux_tests::rendering;
use hemilux_tests::scenes::Builder;
use std::f32::consts::PI;
use std::sync::Arc;

/// Both methods that know all of it.
const METHODS: [&str; 2] = ["hemilux", "ray-traced"];
const SIDE: u32 = 24;

fn rendered(
    scene: &Arc<Scene>,
    environment: Option<Environment>,
    camera: ExplicitCamera,
    (method, iterations): (&str, u64),
) -> Rendered {
    let request = RenderRequest {
        environment: environment.map(Arc::new),
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 5,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    rendering::rendered(&request)
}

/// The mean of a picture.
fn mean(picture: &Picture) -> Rgb {
    picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32
}

/// A camera straight above the origin that sees `width` metres of the floor from ten metres.
fn above(width: f32) -> ExplicitCamera {
    let yfov_degrees = 2.0 * (0.5 * width / 10.0).atan().to_degrees();
    ExplicitCamera { eye: [0.0, 10.0, 0.0], target: [0.0; 3], up: [0.0, 0.0, -1.0], yfov_degrees }
}

/// A white Lambertian floor, twenty metres square.
fn floor() -> Builder {
    let mut builder = Builder::default();
    let white = builder.lambertian(Rgb::ONE);
    builder.quad(Vec3::new(-10.0, 0.0, 10.0), 20.0 * Vec3::X, -20.0 * Vec3::Z, white);
    builder
}

/// Radiance of the white floor under the camera, which is its irradiance over π, by each method.
fn assert_floor(scene: &Arc<Scene>, environment: Environment, expected: f32, tolerance: f32) {
    for (method, iterations) in [("hemilux", 4), ("ray-traced", 32)] {
        let run = (method, iterations);
        let picture = rendered(scene, Some(environment.clone()), above(0.02), run).picture;
        let irradiance = PI * mean(&picture).y;
        println!("{method}: {irradiance} of {expected}");
        assert!((irradiance / expected - 1.0).abs() < tolerance, "{method}: {irradiance}");
    }
}

/// A bulb of 100 lm, 1 m above: 100/4π = 7.96 lx.
#[test]
fn a_point_light_shines_by_the_square_law() {
    let mut scene = Scene::clone(&floor().build());
    scene.lights.push(PunctualLight {
        name: "bulb".into(),
        kind: LightKind::Point,
        position: Vec3::new(0.0, 1.0, 0.0),
        direction: -Vec3::Y,
        intensity: Rgb::splat(100.0 / (4.0 * PI)),
        range: None,
    });
    assert_floor(&Arc::new(scene), Environment::none(), 7.9577, 2e-3);
}

/// A small Lambertian emitter of 100 lm, 1 m above: 100/π = 31.8 lx.
#[test]
fn an_emitter_shines_by_its_cosine() {
    let mut builder = floor();
    let side = 0.05;
    let radiance = 100.0 / (PI * side * side);
    let light = builder.light(Rgb::ZERO, Rgb::splat(radiance));
    let corner = Vec3::new(-0.5 * side, 1.0, -0.5 * side);
    builder.quad(corner, side * Vec3::X, side * Vec3::Z, light);
    let mut scene = Scene::clone(&builder.build());
    // Seen from below, so that the lamp is not in the way.
    scene.materials[0].double_sided = true;
    let (scene, environment) = (Arc::new(scene), Environment::none());
    let eye = ExplicitCamera {
        eye: [3.0, 1.0, 0.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 0.2,
    };
    for (method, iterations) in [("hemilux", 4), ("ray-traced", 32)] {
        let run = (method, iterations);
        let picture = rendered(&scene, Some(environment.clone()), eye, run).picture;
        let irradiance = PI * mean(&picture).y;
        assert!((irradiance / 31.83 - 1.0).abs() < 5e-3, "{method}: {irradiance}");
    }
}

/// A lamp that lights one side of a floor leaves the other black: who looks at that side is told why.
#[test]
fn a_black_picture_is_warned_of() {
    let mut builder = floor();
    let light = builder.light(Rgb::ZERO, Rgb::splat(100.0));
    builder.quad(Vec3::new(-0.5, 1.0, -0.5), Vec3::X, Vec3::Z, light);
    let mut scene = Scene::clone(&builder.build());
    scene.materials[0].double_sided = true;
    let scene = Arc::new(scene);
    let at = |height: f32| ExplicitCamera {
        eye: [3.0, height, 0.0],
        target: [2.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 20.0,
    };
    for method in ["hemilux", "ray-traced", "stochastic"] {
        for (height, is_black) in [(0.5, false), (-3.0, true)] {
            let Rendered { picture, stats } =
                rendered(&scene, Some(Environment::none()), at(height), (method, 2));
            assert_eq!(mean(&picture) == Rgb::ZERO, is_black, "{method} {height}");
            let warned = stats.warnings.iter().any(|w| w.what.contains("the picture is black"));
            assert_eq!(warned, is_black, "{method} {height}");
        }
    }
}

/// A sun on a plane: E cosθ; a uniform sky: πL.
#[test]
fn the_sun_shines_by_the_cosine_and_a_uniform_sky_by_pi() {
    let scene = floor().build();
    for height in [0.9f32, 0.3] {
        let across = (1.0 - height * height).sqrt();
        let sun = Sun {
            direction: Vec3::new(0.6 * across, height, 0.8 * across),
            irradiance: Rgb::splat(1000.0),
            angular_radius: 0.00465,
        };
        let environment = Environment { sky: Sky::None, sun: Some(sun), ..Environment::default() };
        assert_floor(&scene, environment, 1000.0 * height, 2e-3);
    }
    let sky = Environment { sky: Sky::Uniform(Rgb::splat(2.0)), ..Environment::default() };
    assert_floor(&scene, sky, 2.0 * PI, 0.02);
}

/// A ball of many smooth triangles about the origin.
fn ball(material: Material) -> Arc<Scene> {
    const ROWS: u32 = 48;
    const COLUMNS: u32 = 96;
    let mut scene = Scene { materials: vec![material], ..Scene::default() };
    for row in 0..=ROWS {
        for column in 0..COLUMNS {
            let (height, angle) =
                (PI * row as f32 / ROWS as f32, 2.0 * PI * column as f32 / COLUMNS as f32);
            let normal =
                Vec3::new(height.sin() * angle.cos(), height.cos(), height.sin() * angle.sin());
            scene.vertices.push(Vertex::new(normal, normal));
        }
    }
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let next = (column + 1) % COLUMNS;
            let [a, b] = [column, next].map(|column| row * COLUMNS + column);
            let [c, d] = [a + COLUMNS, b + COLUMNS];
            for vertices in [[a, b, d], [a, d, c]] {
                scene.triangles.push(Triangle { vertices, material: 0 });
            }
        }
    }
    Arc::new(scene)
}

/// In a uniform sky of radiance 1 a convex body shows its directional albedo: what microfacets
/// reflect of light that is scattered once, as ∫ f cosθ dω by quadrature says.
#[test]
fn a_ball_in_a_uniform_sky_shows_its_albedo() {
    let sky = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::default() };
    for (roughness, metallic) in [(1.0f32, 1.0f32), (0.5, 1.0), (0.6, 0.0)] {
        let material = Material { roughness, metallic, ..Material::default() };
        let scene = ball(material);
        // The middle of the ball is seen along the normal.
        let camera = ExplicitCamera {
            eye: [0.3, 9.0, 4.0],
            target: [0.0; 3],
            up: [0.0, 0.0, -1.0],
            yfov_degrees: 0.5,
        };
        let expected = albedo_along_the_normal(f64::from(roughness), metallic > 0.5) as f32;
        for (method, iterations) in [("hemilux", 64), ("ray-traced", 512)] {
            let picture = rendered(&scene, Some(sky.clone()), camera, (method, iterations)).picture;
            let found = mean(&picture).y;
            println!("{method}, roughness {roughness}, metal {metallic}: {found} of {expected}");
            assert!((found / expected - 1.0).abs() < 5e-3, "{method}: {found} {expected}");
        }
    }
}

/// ∫ f cosθ dω of a white material along the normal, in double precision: with the half vector at
/// an angle δ from the normal, the source is at 2δ.
fn albedo_along_the_normal(roughness: f64, metal: bool) -> f64 {
    const STEPS: u32 = 20_000;
    let square = roughness.powi(4);
    let pi = std::f64::consts::PI;
    let step = 0.5 * pi / f64::from(STEPS);
    let sum: f64 = (0..STEPS)
        .map(|k| {
            let angle = (f64::from(k) + 0.5) * step;
            let (source, half) = (angle.cos(), (0.5 * angle).cos());
            let fresnel = |f0: f64| f0 + (1.0 - f0) * (1.0 - half).powi(5);
            let d = square / (pi * (half * half * (square - 1.0) + 1.0).powi(2));
            let slant = (square + (1.0 - square) * source * source).sqrt();
            let visible = 0.5 / (source + slant);
            let value = match metal {
                true => d * visible,
                false => (1.0 - fresnel(0.04)) / pi + fresnel(0.04) * d * visible,
            };
            value * source * 2.0 * pi * angle.sin()
        })
        .sum();
    sum * step
}

/// Where nothing lights a scene, a studio does, and a warning says so; whoever wants black gets it.
#[test]
fn a_scene_without_light_is_lit_by_a_studio() {
    let scene = floor().build();
    for method in METHODS {
        let lit = rendered(&scene, None, above(2.0), (method, 4));
        assert!(mean(&lit.picture).y > 0.05, "{method} is dark");
        let said = |rendered: &Rendered| {
            rendered.stats.warnings.iter().any(|warning| format!("{warning:?}").contains("studio"))
        };
        assert!(said(&lit), "{method}: {:?}", lit.stats.warnings);
        let black = rendered(&scene, Some(Environment::none()), above(2.0), (method, 4));
        assert_eq!(mean(&black.picture), Rgb::ZERO);
        assert!(!said(&black));
    }
}

/// What is unlit shows its colour, whatever lights the rest, and lights nothing.
#[test]
fn unlit_surfaces_show_their_colour() {
    let mut builder = Builder::default();
    let color = Rgb::new(0.8, 0.4, 0.1);
    let poster = Material { unlit: true, ..Material::lambertian("poster", color) };
    let poster = builder.material(poster);
    builder.quad(Vec3::new(-9.0, 0.0, 9.0), 18.0 * Vec3::X, -18.0 * Vec3::Z, poster);
    let scene = builder.build();
    for method in METHODS {
        let sky = Environment { sky: Sky::Uniform(Rgb::splat(3.0)), ..Environment::default() };
        for environment in [None, Some(Environment::none()), Some(sky)] {
            let found = mean(&rendered(&scene, environment, above(2.0), (method, 2)).picture);
            assert!((found - color).abs().max_element() < 1e-4, "{method}: {found}");
        }
    }
}

/// A curtain with half of it cut out lets half of the sky's light through to the floor.
#[test]
fn half_a_curtain_lets_half_of_the_light_through() {
    let mut builder = floor();
    let black = Material {
        alpha: Alpha::Blend,
        opacity: 0.5,
        double_sided: true,
        ..Material::lambertian("curtain", Rgb::ZERO)
    };
    let curtain = builder.material(black);
    builder.quad(Vec3::new(-9.0, 0.5, 9.0), 18.0 * Vec3::X, -18.0 * Vec3::Z, curtain);
    let scene = builder.build();
    let sky = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::default() };
    let below = ExplicitCamera {
        eye: [0.0, 0.3, 0.0],
        target: [0.0; 3],
        up: [0.0, 0.0, -1.0],
        yfov_degrees: 10.0,
    };
    for (method, iterations) in [("hemilux", 24), ("ray-traced", 256)] {
        let found =
            mean(&rendered(&scene, Some(sky.clone()), below, (method, iterations)).picture).y;
        assert!((found - 0.5).abs() < 0.005, "{method}: {found}");
    }
}
