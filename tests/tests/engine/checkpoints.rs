//! Jobs that go on from checkpoints, and pictures that begin with what others found out.

use hemilux_engine::checkpoint::{Checkpoint, CheckpointError};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Device, open};
use hemilux_engine::render::{
    Begin, CameraChoice, ExplicitCamera, Limits, Observer, Progress, RenderError, RenderRequest,
    Rendered, StopReason,
};
use hemilux_engine::scene::{Background, Scene, made};
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{away_from_light, relative_rmse};
use hemilux_tests::scenes::imported;
use hemilux_tests::skips::{skipped, without_wgpu};
use std::sync::Arc;

/// Takes checkpoints, and stops where it is told to.
#[derive(Default)]
struct Keeper {
    /// Stop after so many iterations.
    stop_after: Option<u64>,
    /// Take a checkpoint on the way, after so many iterations.
    take_after: Option<u64>,
    most_bytes: Option<u64>,
    stopping: bool,
    taken: Vec<Checkpoint>,
}

impl Observer for Keeper {
    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        self.stopping |= self.stop_after.is_some_and(|after| progress.figures.iterations >= after);
        let wanted = self.take_after.is_some_and(|after| progress.figures.iterations >= after);
        if wanted {
            self.take_after = None;
        }
        wanted
    }

    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        true
    }

    fn most_checkpoint_bytes(&self) -> u64 {
        self.most_bytes.unwrap_or(u64::MAX)
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        // Through bytes and back, as a server does.
        let bytes = checkpoint.to_bytes();
        self.taken.push(Checkpoint::from_bytes(&bytes).expect("what was written can be read"));
    }

    fn cancelled(&self) -> bool {
        self.stopping
    }
}

fn request(scene: &Arc<Scene>, method: &str, iterations: u64) -> RenderRequest {
    RenderRequest {
        limits: Limits::iterations(iterations),
        ..RenderRequest::new(scene.clone(), method, [32, 27])
    }
}

fn with(mut request: RenderRequest, options: &[(&str, &str)]) -> RenderRequest {
    request.options.extend(options.iter().map(|(n, v)| (n.to_string(), v.to_string())));
    request
}

fn run(request: &RenderRequest, keeper: &mut Keeper) -> Rendered {
    let mut device = CpuDevice::new(Some(2)).expect("threads");
    render(&mut device, request, keeper).expect("the request is good")
}

fn bits(rendered: &Rendered) -> Vec<u32> {
    let alpha = rendered.picture.alpha.iter().flatten().copied();
    let pixels = rendered.picture.pixels.iter().flat_map(|p| p.to_array());
    pixels.chain(alpha).map(f32::to_bits).collect()
}

/// Stops a job after some of its iterations, at its limit or by a cancellation, and in a process
/// that dies right after a checkpoint: each time it goes on to the bits of the undisturbed one.
fn goes_on(device: &mut dyn Device, whole: &RenderRequest, after: &[u64]) {
    let name = format!("{} {:?}", whole.method, whole.options);
    let mut keeper = Keeper::default();
    let expected = render(device, whole, &mut keeper).expect("renders");
    let kept = keeper.taken.pop().expect("a solution");
    for (turn, after) in after.iter().enumerate() {
        let mut keeper = Keeper::default();
        let mut part = whole.clone();
        match turn % 3 {
            0 => keeper.stop_after = Some(*after),
            1 => keeper.take_after = Some(*after),
            _ => part.limits.iterations = Some(*after),
        }
        let stopped = render(device, &part, &mut keeper).expect("renders");
        let checkpoint = keeper.taken.swap_remove(0);
        let header = checkpoint.header().clone();
        println!(
            "{name}: stopped after {} ({:?}), goes on after {}, {} bytes",
            stopped.stats.figures.iterations,
            stopped.stats.stopped,
            header.iterations,
            checkpoint.size()
        );
        let begin = Begin::Continue(Arc::new(checkpoint));
        let mut keeper = Keeper::default();
        let again = render(device, &RenderRequest { begin, ..whole.clone() }, &mut keeper);
        let again = again.expect("goes on");
        assert!(bits(&again) == bits(&expected), "{name} after {after}");
        let figures = |rendered: &Rendered| {
            let stats = &rendered.stats;
            (
                stats.figures.iterations,
                stats.figures.shots,
                stats.stopped,
                stats.figures.estimated_error,
            )
        };
        assert_eq!(figures(&again), figures(&expected), "{name} after {after}");
        assert!(again.stats.seconds_solve > header.seconds, "{name}: seconds add up");
        let again = keeper.taken.pop().expect("a solution");
        assert!(again.header().seconds > header.seconds);
        assert_eq!(again.size(), kept.size(), "{name}: the same is known at the end");
    }
}

fn processor() -> CpuDevice {
    CpuDevice::new(Some(2)).expect("threads")
}

#[test]
fn stochastic_goes_on_bit_for_bit() {
    let scene = imported(&made::phong_cornell());
    let small = [("patches", "300"), ("hemicube_resolution", "32"), ("pixel_samples", "2")];
    let request = with(request(&scene, "stochastic", 61), &small);
    goes_on(&mut processor(), &request, &[1, 2, 5, 31, 60]);
    let known = [("burn_in", "7"), ("first_shot", "true"), ("constant_radiance", "corrected")];
    let request = with(request, &known);
    goes_on(&mut processor(), &request, &[3, 20, 42]);
}

#[test]
fn stochastic_goes_on_on_a_gpu() {
    if without_wgpu() {
        skipped("HEMILUX_NO_WGPU=1");
        return;
    }
    let scene = imported(&made::phong_cornell());
    let small = [("patches", "300"), ("hemicube_resolution", "32"), ("pixel_samples", "2")];
    let request = with(request(&scene, "stochastic", 23), &small);
    let mut gpu = open("0").expect("a wgpu adapter");
    goes_on(&mut *gpu, &request, &[3, 10, 14]);
    // What the processor knows is of no use there.
    let mut keeper = Keeper::default();
    run(&request, &mut keeper);
    let begin = Begin::Continue(Arc::new(keeper.taken.remove(0)));
    let error = render(&mut *gpu, &RenderRequest { begin, ..request }, &mut Keeper::default());
    let error = error.expect_err("another device");
    assert!(matches!(&error, RenderError::Checkpoint(CheckpointError::Foreign { .. })), "{error}");
}

#[test]
fn hemilux_goes_on_bit_for_bit() {
    for scene in [made::cornell(), made::phong_cornell()] {
        let fixed = [("pixel_samples", "16"), ("coarse_patches", "400"), ("gather_rays", "16")];
        let request = with(request(&imported(&scene), "hemilux", 7), &fixed);
        goes_on(&mut processor(), &request, &[1, 3, 6]);
    }
    // What the limits decide is decided once.
    let request = request(&imported(&made::cornell()), "hemilux", 6);
    goes_on(&mut processor(), &request, &[2, 4]);
}

#[test]
fn rays_go_on_bit_for_bit() {
    let request = request(&imported(&made::cornell()), "ray-traced", 9);
    goes_on(&mut processor(), &request, &[1, 4, 8]);
    let adaptive = with(request, &[("pixel_sampling", "adaptive_fresh")]);
    goes_on(&mut processor(), &adaptive, &[2]);
    let transparent = RenderRequest { background: Background::Transparent, ..adaptive };
    goes_on(&mut processor(), &transparent, &[2, 5]);
    let map = self::request(&imported(&made::ring()), "illumination-map", 7);
    let map = with(map, &[("map_texels", "20000"), ("light_rays", "3000")]);
    goes_on(&mut processor(), &map, &[1, 3, 6]);
}

#[test]
fn radiosity_goes_on_bit_for_bit() {
    let scene = imported(&made::cornell());
    let small = [("patches", "200"), ("hemicube_resolution", "32"), ("pixel_samples", "2")];
    for (method, iterations) in [("monte-carlo", 30), ("progressive", 25), ("gauss-seidel", 6)] {
        let request = with(request(&scene, method, iterations), &small);
        goes_on(&mut processor(), &request, &[1, 2, 4, iterations - 1]);
    }
    // In the middle of the matrix, where no iteration is done yet.
    goes_on(&mut processor(), &with(request(&scene, "gauss-seidel", 6), &small), &[0, 0]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let scene = imported(&made::cornell());
    let small = [("patches", "100"), ("hemicube_resolution", "16"), ("pixel_samples", "1")];
    let whole = with(request(&scene, "stochastic", 5), &small);
    let mut keeper = Keeper::default();
    run(&whole, &mut keeper);
    let kept = Arc::new(keeper.taken.remove(0));
    let refused = |request: RenderRequest| {
        let begin = Begin::Continue(kept.clone());
        let result =
            render(&mut processor(), &RenderRequest { begin, ..request }, &mut Keeper::default());
        match result.expect_err("it does not fit") {
            RenderError::Checkpoint(error) => error.to_string(),
            other => panic!("{other}"),
        }
    };
    let brighter = {
        let mut scene = Scene::clone(&scene);
        scene.materials[0].base_color *= 0.999;
        Arc::new(scene)
    };
    for (request, about) in [
        (RenderRequest { seed: 2, ..whole.clone() }, "seed 1"),
        (RenderRequest { width: 31, ..whole.clone() }, "size"),
        (RenderRequest { camera: other_camera(&scene), ..whole.clone() }, "camera"),
        (RenderRequest { background: Background::Transparent, ..whole.clone() }, "background"),
        (RenderRequest { method: "monte-carlo".into(), ..whole.clone() }, "stochastic"),
        (RenderRequest { scene: brighter, ..whole.clone() }, "scene"),
        (with(whole.clone(), &[("patches", "101")]), "patches=100"),
    ] {
        let error = refused(request);
        assert!(error.contains(about), "{about}: {error}");
    }
    // And one that would be too large is not made.
    let mut keeper = Keeper { most_bytes: Some(1000), take_after: Some(1), ..Keeper::default() };
    run(&whole, &mut keeper);
    assert!(keeper.taken.is_empty());
}

/// Beside the scene's own camera, turned a little.
fn other_camera(scene: &Scene) -> CameraChoice {
    let [right, up, back, eye] = scene.cameras[0].to_world.to_cols_array_2d();
    let at =
        |x: f32, y: f32, z: f32| [0, 1, 2].map(|k| eye[k] + x * right[k] + y * up[k] - z * back[k]);
    let (eye, target) = (at(0.12, 0.05, 0.1), at(0.05, 0.0, 1.0));
    CameraChoice::Explicit(ExplicitCamera { eye, target, up: [0.0, 1.0, 0.0], yfov_degrees: 40.0 })
}

/// A second camera: as near to the truth as by itself, with less work, for every method that has
/// anything to hand on.
#[test]
fn a_second_camera_begins_with_the_first_ones_solution() {
    for (scene, method, first, alone) in [
        (made::cornell(), "hemilux", 12, 12),
        (made::phong_cornell(), "stochastic", 800, 800),
        (made::cornell(), "stochastic", 400, 400),
        (made::cornell(), "monte-carlo", 60, 60),
        (made::cornell(), "progressive", 300, 300),
        (made::cornell(), "gauss-seidel", 10, 10),
        (made::ring(), "illumination-map", 4, 4),
        (made::cornell(), "ray-traced", 2, 2),
    ] {
        let scene = imported(&scene);
        let options: &[(&str, &str)] = match method {
            // Without what is each camera's own.
            "hemilux" => &[("coarse_patches", "1000"), ("light", "false"), ("pixel_samples", "16")],
            "ray-traced" | "illumination-map" => &[],
            _ => &[("patches", "600"), ("hemicube_resolution", "64"), ("pixel_samples", "4")],
        };
        let mut keeper = Keeper::default();
        run(&with(request(&scene, method, first), options), &mut keeper);
        let kept = Arc::new(keeper.taken.pop().expect("a solution"));
        let other = RenderRequest {
            camera: match method {
                "illumination-map" => CameraChoice::First,
                _ => other_camera(&scene),
            },
            width: 60,
            height: 50,
            ..with(request(&scene, method, 1), options)
        };
        let begin = Begin::View(kept.clone());
        let mut keeper = Keeper::default();
        let view = run(&RenderRequest { begin: begin.clone(), ..other.clone() }, &mut keeper);
        assert!(view.stats.figures.iterations <= 1, "{method}: {:?}", view.stats.stopped);
        let limits = Limits::iterations(alone);
        let by_itself = run(&RenderRequest { limits, ..other.clone() }, &mut Keeper::default());
        let afresh = run(&other, &mut Keeper::default());
        // A pixel at the lamp's edge shows how finely that is seen.
        let counts = away_from_light(&by_itself.picture, 3.0);
        let near = relative_rmse(&view.picture, &by_itself.picture, &counts);
        let far = relative_rmse(&afresh.picture, &by_itself.picture, &counts);
        println!("{method}: a view is off by {near:.4}, one iteration alone by {far:.4}");
        match method {
            "ray-traced" => assert!(bits(&view) == bits(&afresh), "nothing to hand on"),
            // The map is there: its light need not be shot again.
            "illumination-map" => {
                assert_eq!(view.stats.diagnostics["light_rays"], 0.0);
                assert!(afresh.stats.diagnostics["light_rays"] > 0.0);
            }
            _ => assert!(near < 0.7 * far, "{method}: {near} {far}"),
        }
        // A view goes on like any other job, and hands on in its turn.
        let part = Arc::new(keeper.taken.pop().expect("a solution"));
        let limits = Limits::iterations(3);
        let three = RenderRequest { limits, ..other };
        let undisturbed = RenderRequest { begin, ..three.clone() };
        let continued = RenderRequest { begin: Begin::Continue(part.clone()), ..three.clone() };
        let undisturbed = run(&undisturbed, &mut Keeper::default());
        if !matches!(undisturbed.stats.stopped, StopReason::Converged) {
            let continued = run(&continued, &mut Keeper::default());
            assert!(bits(&undisturbed) == bits(&continued), "{method}");
        }
        run(&RenderRequest { begin: Begin::View(part), ..three }, &mut Keeper::default());
    }
}
