//! A job that is given a target ends when its own estimate says that it is reached. Whether it is
//! reached is judged here against path tracing in two halves, of which the job knows nothing.

use crate::references::{CORNELL_SIDE, cornell_halves};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::render::{Limits, RenderRequest, StopReason, Unobserved};
use hemilux_engine::scene::made;
use hemilux_engine::transport::render;
use hemilux_tests::halves::Halves;
use hemilux_tests::scenes::imported;
use std::sync::Arc;

fn request(scene: &Arc<hemilux_engine::scene::Scene>, method: &str, target: f64) -> RenderRequest {
    RenderRequest {
        limits: Limits { target_error: Some(target), seconds: Some(60.0), ..Limits::default() },
        ..RenderRequest::new(scene.clone(), method, [CORNELL_SIDE; 2])
    }
}

/// Actual errors of jobs that ended by their target, one a seed.
fn actual_errors(request: &RenderRequest, seeds: u64, halves: &Halves) -> Vec<f64> {
    let mut device = CpuDevice::new(None).expect("threads");
    let error = |seed| {
        let request = RenderRequest { seed, ..request.clone() };
        let rendered = render(&mut device, &request, &mut Unobserved).expect("the request is good");
        assert_eq!(rendered.stats.stopped, StopReason::TargetError, "{}", request.method);
        halves.error(&rendered.picture)
    };
    (1..=seeds).map(error).collect()
}

/// Whether errors are what was asked for: most of them within 1.5 of it, and together neither farther
/// off than 1.3 nor so much better that most of the time was wasted.
fn keep_their_word(errors: &[f64], target: f64) -> bool {
    let within = errors.iter().filter(|error| **error <= 1.5 * target).count();
    let mean_square = errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64;
    3 * within >= 2 * errors.len() && (0.5..1.3).contains(&(mean_square.sqrt() / target))
}

/// Every method that estimates its error, at a target that lies well above what is left by patches
/// (stochastic iteration, Monte-Carlo) and by the coarse mesh (hemilux).
#[test]
fn a_target_is_reached_as_path_tracing_sees_it() {
    let scene = imported(&made::cornell());
    let halves = cornell_halves();
    for (method, target) in [
        ("stochastic", 0.2),
        ("monte-carlo", 0.2),
        ("ray-traced", 0.2),
        ("illumination-map", 0.2),
        ("hemilux", 0.025),
    ] {
        let errors = actual_errors(&request(&scene, method, target), 3, halves);
        println!("{method}, {target}: {errors:.4?}");
        assert!(keep_their_word(&errors, target), "{method}: {errors:?} for {target}");
        // Planted: an estimate that says half of the error, and one that says three times as much.
        assert!(!keep_their_word(&errors, target / 2.0), "{method}: half of the error passes");
        assert!(!keep_their_word(&errors, target * 3.0), "{method}: three times passes");
    }
}
