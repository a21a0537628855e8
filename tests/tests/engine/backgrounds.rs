//! What the camera sees beside the surfaces: the sky, nothing, or a colour, in every method.

use glam::Vec3;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, RenderError, RenderRequest, StopReason, Unobserved,
};
use hemilux_engine::scene::{Background, Environment, Material, Scene, Sky};
use hemilux_engine::transport::render;
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::Builder;
use std::sync::Arc;

/// Every method, with iterations that are enough here.
const METHODS: [(&str, u64); 7] = [
    ("hemilux", 2),
    ("ray-traced", 64),
    ("illumination-map", 16),
    ("stochastic", 20),
    ("gauss-seidel", 10),
    ("progressive", 20),
    ("monte-carlo", 4),
];
const SIDE: u32 = 32;
const COLOUR: Rgb = Rgb::new(0.25, 2.0, 0.5);
const SKY: Rgb = Rgb::new(1.5, 1.0, 0.75);
/// Width and height of the board; the picture is four metres square at its place.
const BOARD: [f32; 2] = [2.3, 1.7];

/// A grey board that faces the camera.
fn board() -> Arc<Scene> {
    let mut builder = Builder::default();
    let grey = builder.lambertian(Rgb::splat(0.5));
    builder.quad(Vec3::new(-1.2, -0.9, 0.0), BOARD[0] * Vec3::X, BOARD[1] * Vec3::Y, grey);
    builder.build()
}

fn request(scene: &Arc<Scene>, (method, iterations): (&str, u64)) -> RenderRequest {
    let environment = Environment { sky: Sky::Uniform(SKY), ..Environment::none() };
    let camera = ExplicitCamera {
        eye: [0.0, 0.0, 2.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 90.0,
    };
    let coarse = [("patches", "100"), ("hemicube_resolution", "32")];
    let is_on_patches = METHODS[3..].iter().any(|(name, _)| *name == method);
    let options = coarse.iter().filter(|_| is_on_patches);
    RenderRequest {
        environment: Some(Arc::new(environment)),
        background: Background::Sky,
        camera: CameraChoice::Explicit(camera),
        limits: Limits::iterations(iterations),
        seed: 3,
        options: options.map(|(name, value)| (name.to_string(), value.to_string())).collect(),
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    }
}

fn picture(request: &RenderRequest, background: Background) -> Picture {
    let mut device = CpuDevice::new(Some(2)).expect("threads");
    let request = RenderRequest { background, ..request.clone() };
    render(&mut device, &request, &mut Unobserved).expect("it renders").picture
}

/// Largest difference between a picture and a premultiplied one laid over `behind`.
fn off(picture: &Picture, over: &Picture, behind: Rgb) -> f32 {
    let alpha = over.alpha.as_ref().expect("an alpha");
    let laid = over.pixels.iter().zip(alpha).map(|(pixel, alpha)| *pixel + (1.0 - alpha) * behind);
    laid.zip(&picture.pixels).map(|(a, b)| (a - *b).abs().max_element()).fold(0.0, f32::max)
}

/// The transparent picture, laid over the sky or over a colour, is the picture before either: so the
/// light on the surfaces is the same, and alpha is their share of each pixel.
#[test]
fn transparent_pictures_lie_over_any_background() {
    let scene = board();
    for method in METHODS {
        let request = request(&scene, method);
        let transparent = picture(&request, Background::Transparent);
        let (sky, colour) =
            (picture(&request, Background::Sky), picture(&request, Background::Colour(COLOUR)));
        assert!(sky.alpha.is_none() && colour.alpha.is_none());
        let (of_sky, of_colour) =
            (off(&sky, &transparent, SKY), off(&colour, &transparent, COLOUR));
        let alpha = transparent.alpha.as_ref().unwrap();
        let covered = alpha.iter().sum::<f32>() / (SIDE * SIDE) as f32;
        println!("{}: off by {of_sky:e} {of_colour:e}, {covered} covered", method.0);
        assert!(of_sky < 1e-4 && of_colour < 1e-4, "{}", method.0);
        assert!((covered / (BOARD[0] * BOARD[1] / 16.0) - 1.0).abs() < 0.02, "{}", method.0);
        let middle = (SIDE * SIDE / 2 + SIDE / 2) as usize;
        assert_eq!((alpha[0], alpha[middle]), (0.0, 1.0), "{}", method.0);
        assert!(alpha.iter().any(|alpha| *alpha > 0.05 && *alpha < 0.95), "{}", method.0);
        assert_eq!(transparent.pixels[0], Rgb::ZERO);
        // Planted errors that the comparison must see: no alpha at the edges, another background.
        let hard = alpha.iter().map(|alpha| alpha.round()).collect();
        let hard = Picture { alpha: Some(hard), ..transparent.clone() };
        assert!(off(&colour, &hard, COLOUR) > 0.02, "{}", method.0);
        assert!(off(&colour, &transparent, SKY) > 0.5, "{}", method.0);
    }
}

/// Through glass the camera sees the sky, whatever is beside it, and glass covers its pixels.
#[test]
fn glass_shows_the_sky_before_any_background() {
    let mut builder = Builder::default();
    let glass = builder.material(Material::glass("glass", 1.5));
    builder.cuboid(Vec3::new(-1.0, -1.0, -0.5), Vec3::new(1.0, 1.0, 0.0), false, glass);
    let scene = builder.build();
    let middle = (SIDE * SIDE / 2 + SIDE / 2) as usize;
    for method in [("ray-traced", 200), ("illumination-map", 100)] {
        let request = request(&scene, method);
        let colour = picture(&request, Background::Colour(COLOUR));
        assert_eq!(colour.pixels[0], COLOUR);
        // In a uniform sky, clear glass is invisible.
        let near = (colour.pixels[middle] / SKY - Rgb::ONE).abs().max_element();
        assert!(near < 0.05, "{}: {}", method.0, colour.pixels[middle]);
        let transparent = picture(&request, Background::Transparent);
        let alpha = transparent.alpha.unwrap();
        assert_eq!((alpha[0], alpha[middle]), (0.0, 1.0));
    }
}

/// What nothing lights is a silhouette.
#[test]
fn without_light_surfaces_are_black_before_the_background() {
    let scene = board();
    for method in ["hemilux", "ray-traced", "stochastic"] {
        let dark = RenderRequest {
            environment: Some(Arc::new(Environment::none())),
            background: Background::Colour(COLOUR),
            ..request(&scene, (method, 2))
        };
        let rendered = rendered(&dark);
        assert_eq!(rendered.stats.stopped, StopReason::NoLight);
        let middle = (SIDE * SIDE / 2 + SIDE / 2) as usize;
        let pixels = &rendered.picture.pixels;
        assert_eq!((pixels[0], pixels[middle]), (COLOUR, Rgb::ZERO), "{method}");
        let transparent = picture(&dark, Background::Transparent);
        assert!(off(&rendered.picture, &transparent, COLOUR) < 1e-5, "{method}");
        assert_eq!(picture(&dark, Background::Sky), Picture::black(SIDE, SIDE));
    }
}

#[test]
fn what_is_no_colour_is_refused() {
    let request =
        RenderRequest { background: Background::Colour(-Rgb::X), ..request(&board(), METHODS[0]) };
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    match render(&mut device, &request, &mut Unobserved) {
        Err(RenderError::Parameter { parameter, .. }) => assert_eq!(parameter, "background"),
        other => panic!("{other:?}"),
    }
}
