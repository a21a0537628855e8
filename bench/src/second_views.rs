//! `views`: a second camera of a solved scene. How long until its picture is as good as one that
//! it takes by itself in the given time, and what the checkpoint in between takes.

use crate::results::{self, Failure};
use hemilux_charts::table::Table;
use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::render::{
    Begin, CameraChoice, ExplicitCamera, Limits, Observer, Progress, RenderRequest, Rendered,
};
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Iterations of a view that are looked at, until one is good enough.
const ITERATIONS: [u64; 14] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 32];
const PIXEL_SAMPLES: u32 = 64;
/// Pixels brighter than this, in times of the mean, see an emitter and don't count.
const EMITTER: f64 = 8.0;

#[derive(clap::Args)]
pub struct Arguments {
    /// Seconds of the first picture, and of the second one by itself.
    #[arg(long, default_value_t = 3.0)]
    seconds: f64,
    /// Seconds of the reference.
    #[arg(long, default_value_t = 40.0)]
    reference_seconds: f64,
    /// Width and height of pictures, pixels.
    #[arg(long, default_value_t = 500)]
    side: u32,
    /// A further scene, .glb.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Page whose generated part is rewritten.
    #[arg(long)]
    page: Option<PathBuf>,
}

/// Takes the solution, and how long it took to make.
#[derive(Default)]
struct Taker {
    asked: Option<Instant>,
    taken: Option<(Checkpoint, f64)>,
}

impl Observer for Taker {
    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        self.asked = Some(Instant::now());
        true
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        let seconds = self.asked.map_or(0.0, |asked| asked.elapsed().as_secs_f64());
        self.taken = Some((checkpoint, seconds));
    }
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut scenes =
        vec![("Cornell box".to_string(), made::cornell()), ("office".to_string(), made::office())];
    if let Some(path) = &arguments.scene {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        scenes.push((name, std::fs::read(path)?));
    }
    let mut views = Table::new(&[
        "scene",
        "error alone",
        "seconds alone",
        "error of the view",
        "seconds of the view",
        "share",
    ]);
    let mut checkpoints = Table::new(&[
        "scene",
        "MB",
        "of them for any camera",
        "s to make",
        "s to bytes",
        "s to read",
    ]);
    for (name, glb) in scenes {
        let scene = Arc::new(import(&glb, &Resources::new(), &ImportLimits::default())?);
        let (checkpoint, row) = first_picture(&name, &scene, arguments)?;
        checkpoints.add(row);
        views.add(second_picture(&name, &scene, arguments, checkpoint)?);
    }
    let text = format!("{}\n{}\n{}", results::machine(), views.markdown(), checkpoints.markdown());
    results::publish(arguments.page.as_deref(), &[("views".into(), text)])
}

/// Solves a scene; its checkpoint, and what that takes as a row of the table.
fn first_picture(
    name: &str,
    scene: &Arc<Scene>,
    arguments: &Arguments,
) -> Result<(Checkpoint, Vec<String>), Failure> {
    let mut taker = Taker::default();
    work(&request(scene, arguments, CameraChoice::First, arguments.seconds), &mut taker)?;
    let (checkpoint, making) = taker.taken.ok_or("no checkpoint was made")?;
    let began = Instant::now();
    let bytes = checkpoint.to_bytes();
    let writing = began.elapsed().as_secs_f64();
    let began = Instant::now();
    let checkpoint = Checkpoint::from_bytes(&bytes)?;
    let reading = began.elapsed().as_secs_f64();
    let row = vec![
        name.into(),
        format!("{:.1}", bytes.len() as f64 / 1e6),
        format!("{:.1}", checkpoint.shared_size() as f64 / 1e6),
        format!("{making:.3}"),
        format!("{writing:.3}"),
        format!("{reading:.3}"),
    ];
    Ok((checkpoint, row))
}

/// Renders the second camera's picture by itself, and from the checkpoint until it is as good: a
/// row of the table.
fn second_picture(
    name: &str,
    scene: &Arc<Scene>,
    arguments: &Arguments,
    checkpoint: Checkpoint,
) -> Result<Vec<String>, Failure> {
    let alone_request = request(scene, arguments, beside(scene), arguments.seconds);
    let reference = RenderRequest {
        limits: Limits::seconds(arguments.reference_seconds),
        seed: 1000,
        ..alone_request.clone()
    };
    let reference = work(&reference, &mut Taker::default())?.picture;
    let counted = away_from_emitters(&reference);
    let error =
        |rendered: &Rendered| relative_error(&rendered.picture, &reference, |pixel| counted[pixel]);
    let alone = work(&alone_request, &mut Taker::default())?;
    let goal = error(&alone);
    let checkpoint = Arc::new(checkpoint);
    let mut last = None;
    for iterations in ITERATIONS {
        let view = RenderRequest {
            limits: Limits::iterations(iterations),
            begin: Begin::View(checkpoint.clone()),
            ..alone_request.clone()
        };
        let view = work(&view, &mut Taker::default())?;
        let (reached, seconds) = (error(&view), view.stats.seconds_solve);
        println!("{name}: {iterations} iterations, {seconds:.2} s, {reached:.4} of {goal:.4}");
        print_diagnostics(&view);
        last = Some((reached, seconds));
        if reached <= goal || seconds > arguments.seconds {
            break;
        }
    }
    let (reached, seconds) = last.ok_or("no view was taken")?;
    println!("{name} alone: {} iterations", alone.stats.figures.iterations);
    print_diagnostics(&alone);
    let by_itself = alone.stats.seconds_solve;
    Ok(vec![
        name.into(),
        format!("{:.2} %", 100.0 * goal),
        format!("{by_itself:.2}"),
        format!("{:.2} %", 100.0 * reached),
        format!("{seconds:.2}"),
        format!("{:.2}", seconds / by_itself),
    ])
}

fn print_diagnostics(rendered: &Rendered) {
    for (what, value) in &rendered.stats.diagnostics {
        println!("    {what} {value:.3}");
    }
}

fn request(
    scene: &Arc<Scene>,
    arguments: &Arguments,
    camera: CameraChoice,
    seconds: f64,
) -> RenderRequest {
    RenderRequest {
        camera,
        limits: Limits::seconds(seconds),
        // What limits by iterations would choose otherwise than limits by seconds.
        options: [("pixel_samples".to_string(), PIXEL_SAMPLES.to_string())].into(),
        ..RenderRequest::new(scene.clone(), "hemilux", [arguments.side; 2])
    }
}

fn work(request: &RenderRequest, taker: &mut Taker) -> Result<Rendered, Failure> {
    Ok(render(&mut CpuDevice::new(None)?, request, taker)?)
}

/// Pixels that see no emitter, and are next to none that does: how well edges are sampled is not
/// what a view is about.
fn away_from_emitters(picture: &Picture) -> Vec<bool> {
    const AROUND: i64 = 2;
    let (width, height) = (i64::from(picture.width), i64::from(picture.height));
    let bright = (EMITTER * picture.mean()) as f32;
    let shines = |column: i64, row: i64| {
        let inside = (0..width).contains(&column) && (0..height).contains(&row);
        inside && picture.pixels[(row * width + column) as usize].max_element() >= bright
    };
    let near = |pixel: i64| {
        let (column, row) = (pixel % width, pixel / width);
        let mut around = (-AROUND..=AROUND).flat_map(|x| (-AROUND..=AROUND).map(move |y| (x, y)));
        around.any(|(x, y)| shines(column + x, row + y))
    };
    (0..width * height).map(|pixel| !near(pixel)).collect()
}

/// rRMSE over the pixels that count. Both pictures are of the same method, so what it neglects is
/// in neither error.
fn relative_error(picture: &Picture, reference: &Picture, counts: impl Fn(usize) -> bool) -> f64 {
    let (mut squares, mut sum, mut values) = (0.0, 0.0, 0.0);
    for (index, (a, b)) in picture.pixels.iter().zip(&reference.pixels).enumerate() {
        if counts(index) {
            squares += f64::from((*a - *b).length_squared());
            sum += f64::from(b.element_sum());
            values += 3.0;
        }
    }
    (squares / f64::max(values, 1.0)).sqrt() / (sum / f64::max(values, 1.0))
}

/// Beside the first camera by a fifth of the way to the middle of the scene, looking there.
fn beside(scene: &Scene) -> CameraChoice {
    let (low, high) = scene.bounds().unwrap_or_default();
    let center = (low + high) / 2.0;
    let camera = &scene.cameras[0].to_world;
    let (right, eye) = (camera.x_axis.truncate(), camera.w_axis.truncate());
    let eye = eye + right * (0.2 * eye.distance(center));
    CameraChoice::Explicit(ExplicitCamera {
        eye: eye.to_array(),
        target: center.to_array(),
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 45.0,
    })
}
