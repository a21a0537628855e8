//! Textures that are finer than a pixel, and textures that shine: what a picture shows of them is
//! their mean, as rays that know nothing but points of them find it.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest, Rendered};
use hemilux_engine::scene::{Environment, Scene, Sky, made};
use hemilux_tests::comparison::error_by_halves;
use hemilux_tests::rendering;
use hemilux_tests::scenes::imported;
use std::sync::Arc;

const SIDE: u32 = 64;
/// Pixels along a side of a block.
const BLOCK: u32 = 8;

fn rendered(
    scene: &Arc<Scene>,
    sky: f32,
    camera: CameraChoice,
    (method, iterations, seed): (&str, u64, u64),
) -> Rendered {
    let environment = match sky {
        0.0 => Environment::none(),
        _ => Environment { sky: Sky::Uniform(Rgb::splat(sky)), ..Environment::none() },
    };
    let request = RenderRequest {
        environment: Some(Arc::new(environment)),
        camera,
        limits: Limits::iterations(iterations),
        seed,
        ..RenderRequest::new(scene.clone(), method, [SIDE; 2])
    };
    rendering::rendered(&request)
}

/// Pictures of several seeds and their mean.
struct Seeds {
    all: Vec<Picture>,
    predicted: Option<f64>,
}

impl Seeds {
    fn new(
        scene: &Arc<Scene>,
        sky: f32,
        camera: &CameraChoice,
        (method, iterations): (&str, u64),
    ) -> Self {
        let renders: Vec<Rendered> = (1..=3)
            .map(|seed| rendered(scene, sky, camera.clone(), (method, iterations, seed)))
            .collect();
        let predicted = renders[0].stats.figures.estimated_error;
        Self { all: renders.into_iter().map(|one| one.picture).collect(), predicted }
    }

    fn mean(&self) -> Picture {
        let mut mean = Picture::black(SIDE, SIDE);
        for picture in &self.all {
            for (sum, pixel) in mean.pixels.iter_mut().zip(&picture.pixels) {
                *sum += *pixel / self.all.len() as f32;
            }
        }
        mean
    }
}

/// Means of the green of all blocks of 8 × 8 pixels.
fn blocks(picture: &Picture) -> Vec<f64> {
    let mut sums = vec![0.0; (SIDE / BLOCK * SIDE / BLOCK) as usize];
    for (index, pixel) in (0..).zip(&picture.pixels) {
        let [x, y] = [index % SIDE / BLOCK, index / SIDE / BLOCK];
        sums[(y * (SIDE / BLOCK) + x) as usize] += f64::from(pixel.y) / f64::from(BLOCK * BLOCK);
    }
    sums
}

/// Root mean square of the differences between blocks, and the largest one, as shares of the mean.
fn block_error(picture: &Picture, reference: &Picture) -> (f64, f64) {
    let (own, theirs) = (blocks(picture), blocks(reference));
    let mean = theirs.iter().sum::<f64>() / theirs.len() as f64;
    let off = || own.iter().zip(&theirs).map(|(a, b)| (a - b).abs() / mean);
    let square = off().map(|off| off * off).sum::<f64>() / own.len() as f64;
    (square.sqrt(), off().fold(0.0, f64::max))
}

/// From ten metres above the origin.
fn above(width: f32) -> CameraChoice {
    let yfov_degrees = 2.0 * (0.5 * width / 10.0).atan().to_degrees();
    CameraChoice::Explicit(ExplicitCamera {
        eye: [0.1, 10.0, 0.2],
        target: [0.1, 0.0, 0.2],
        up: [0.0, 0.0, -1.0],
        yfov_degrees,
    })
}

/// A checker of 3.3 or 10 squares a pixel, seen from above, and one that goes on to the horizon:
/// the same picture as by paths, in blocks within 1 %, and each pixel as far off as predicted.
#[test]
fn a_checker_finer_than_a_pixel_is_its_mean() {
    let cases = [
        ("3.3 squares a pixel", 26.4, above(8.0)),
        ("10.1 squares a pixel", 81.0, above(8.0)),
        ("to the horizon", 4.0, CameraChoice::First),
        ("finer to the horizon", 37.0, CameraChoice::First),
    ];
    for (name, squares, camera) in cases {
        let scene = imported(&made::checker(squares));
        let flagship = Seeds::new(&scene, 1.0, &camera, ("hemilux", 8));
        let paths = Seeds::new(&scene, 1.0, &camera, ("ray-traced", 192));
        let (rms, most) = block_error(&flagship.mean(), &paths.mean());
        // Single pixels of the reference have noise of their own.
        let [own, a, b] = [&flagship.all[0], &paths.all[0], &paths.all[1]];
        let error = error_by_halves(own, a, b, |_| true);
        let predicted = flagship.predicted.expect("a prediction");
        println!(
            "{name}: blocks {rms:.4}, at most {most:.4}; pixels {error:.4}, predicted {predicted:.4}"
        );
        assert!(rms < 0.01 && most < 0.02, "{name}");
        assert!(error < 2.0 * predicted + 0.006, "{name}: {error} {predicted}");
    }
}

/// What a metal reflects is as sharp as its texture after few rays, since its albedo is known without
/// them: each pixel is nearer to paths' picture than the squares that few rays happen to meet.
#[test]
fn a_checker_of_metal_is_as_sharp_as_its_texture() {
    let mut scene = Scene::clone(&imported(&made::checker(1.7)));
    for material in &mut scene.materials {
        (material.metallic, material.roughness) = (1.0, 1.0);
    }
    let scene = Arc::new(scene);
    let flagship = Seeds::new(&scene, 1.0, &above(8.0), ("hemilux", 3));
    let paths = Seeds::new(&scene, 1.0, &above(8.0), ("ray-traced", 384));
    let (rms, _) = block_error(&flagship.mean(), &paths.mean());
    let error = error_by_halves(&flagship.all[0], &paths.all[0], &paths.all[1], |_| true);
    let predicted = flagship.predicted.expect("a prediction");
    println!("blocks {rms:.4}; pixels {error:.4}, predicted {predicted:.4}");
    assert!(rms < 0.01 && error < 0.013, "{rms} {error}");
    assert!(error < 1.5 * predicted, "{error} {predicted}");
}

/// The comparator finds what is wrong: a floor of the mean of the codes instead of that of the
/// light, and a pixel in eight that shows one square alone.
#[test]
fn a_wrong_checker_is_found() {
    let scene = imported(&made::checker(81.0));
    let right = rendered(&scene, 1.0, above(8.0), ("hemilux", 4, 1)).picture;
    let mut by_codes = Scene::clone(&scene);
    by_codes.textures[0].texels.fill([150, 150, 150, 255]);
    let by_codes = rendered(&Arc::new(by_codes), 1.0, above(8.0), ("hemilux", 4, 1)).picture;
    assert!(block_error(&by_codes, &right).0 > 0.1);
    let mut aliased = right.clone();
    aliased.pixels.iter_mut().step_by(8).for_each(|pixel| *pixel *= 1.4);
    assert!(block_error(&aliased, &right).0 > 0.01);
    assert!(block_error(&right, &right).1 == 0.0);
}

/// Nine screens light a room: the picture is that of paths, in blocks within 2 %, the screens
/// themselves too; and they are not as many lights as they have texels.
#[test]
fn nine_screens_light_a_room_as_their_texels_do() {
    let scene = imported(&made::screens(5));
    let flagship = Seeds::new(&scene, 0.0, &CameraChoice::First, ("hemilux", 8));
    let paths = Seeds::new(&scene, 0.0, &CameraChoice::First, ("ray-traced", 384));
    let reference = paths.mean();
    let (rms, most) = block_error(&flagship.mean(), &reference);
    let scatter = block_error(&paths.all[0], &paths.all[1]).0;
    println!("blocks {rms:.4}, at most {most:.4}, two references {scatter:.4}");
    assert!(rms < 0.01 && most < 0.05);
    // By the light in the room alone, each block against its own brightness.
    let (own, theirs) = (blocks(&flagship.mean()), blocks(&reference));
    let bright = theirs.iter().sum::<f64>() / theirs.len() as f64;
    let off =
        own.iter().zip(&theirs).filter(|(_, b)| **b < bright).map(|(a, b)| (a / b - 1.0).abs());
    let off: Vec<f64> = off.collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    println!("{} dark blocks are {mean:.4} off", off.len());
    assert!(off.len() > 10 && mean < 0.02);
    let lights = rendered(&scene, 0.0, CameraChoice::First, ("hemilux", 1, 1));
    let lights = lights.stats.diagnostics["lights"];
    println!("{lights} lights");
    assert!((18.0..400.0).contains(&lights));
}

/// The comparator finds screens that emit what one of their texels does.
#[test]
fn screens_that_emit_one_texel_are_found() {
    let scene = imported(&made::screens(5));
    let right = rendered(&scene, 0.0, CameraChoice::First, ("hemilux", 4, 1)).picture;
    let mut wrong = Scene::clone(&scene);
    for texture in &mut wrong.textures {
        let one = texture.texels[64 * 21 + 21];
        texture.texels.fill(one);
    }
    let wrong = rendered(&Arc::new(wrong), 0.0, CameraChoice::First, ("hemilux", 4, 1)).picture;
    assert!(block_error(&wrong, &right).0 > 0.05);
}
