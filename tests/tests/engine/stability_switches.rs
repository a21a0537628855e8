//! Every switch of stochastic iteration on scenes that strain it, on every device, each with a
//! figure. `docs/stability.md` has the table.

use glam::Vec3;
use hemilux_engine::device::{
    Device, Faces, KnownLight, Selection, ShootingSettings, Substitute, VarianceReduction,
};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{Limits, RenderRequest, StopReason};
use hemilux_engine::scene::made;
use hemilux_engine::transport::known::{Beforehand, ConstantRadiance, known_light};
use hemilux_tests::comparison::largest_relative_deviation;
use hemilux_tests::devices::{Effort, Estimate, estimate_until, means};
use hemilux_tests::oracle::radiosity::Radiosity;
use hemilux_tests::oracle::rooms;
use hemilux_tests::oracle::statistics::Moments;
use hemilux_tests::scenes::{Builder, imported, settings};
use hemilux_tests::stability::*;
use std::f64::consts::PI;
use std::sync::Arc;

/// A switch: its name, the settings, and what is known beforehand.
struct Switch {
    name: &'static str,
    settings: ShootingSettings,
    constant: ConstantRadiance,
    first_shot: bool,
    /// Whether the expectation is that of the plain iteration.
    unbiased: bool,
}

fn switches() -> Vec<Switch> {
    let base = settings(16, 8, 6);
    let plain = |name, settings| Switch {
        name,
        settings,
        constant: ConstantRadiance::Off,
        first_shot: false,
        unbiased: true,
    };
    let reduced = |name, substitute| Switch {
        unbiased: false,
        ..plain(
            name,
            ShootingSettings {
                variance_reduction: Some(VarianceReduction { substitute, shots: None }),
                ..base.clone()
            },
        )
    };
    let faces = |faces| ShootingSettings { faces, ..base.clone() };
    let constant = ConstantRadiance::Corrected;
    vec![
        plain("none", base.clone()),
        plain("uniform picks", ShootingSettings { selection: Selection::Uniform, ..base.clone() }),
        plain("independent picks", ShootingSettings { stratified: false, ..base.clone() }),
        plain("top and one side", faces(Faces::TopAndSide)),
        plain("the paper's faces", faces(Faces::Randomised)),
        Switch { constant, ..plain("constant, corrected", base.clone()) },
        Switch { first_shot: true, ..plain("first shot", base.clone()) },
        Switch { constant, first_shot: true, ..plain("first shot and constant", base.clone()) },
        reduced("rare transfers dropped", Substitute::Zero),
        reduced("rare transfers averaged", Substitute::Mean),
        Switch {
            unbiased: false,
            ..plain("from centroids", ShootingSettings { random_point: false, ..base.clone() })
        },
    ]
}

fn before(constant: ConstantRadiance, first_shot: bool) -> Beforehand {
    Beforehand { constant, first_shot, patchless: None }
}

fn with_known(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    constant: ConstantRadiance,
    first_shot: bool,
) -> ShootingSettings {
    let known =
        known_light(device, scene, settings, before(constant, first_shot)).expect("is found");
    if let Some(KnownLight { radiance, irradiance }) = &known {
        assert!(radiance.iter().chain(irradiance).all(|value| value.is_finite()));
    }
    ShootingSettings { known: known.map(Arc::new), ..settings.clone() }
}

/// A closed grey room lit by a lamp of 1 mm².
fn tiny_lamp() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    let lamp = builder.light(Rgb::splat(0.5), Rgb::splat(1e6));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let corner = Vec3::new(0.45, 0.999, 0.4);
    builder.quad(corner, Vec3::X * 1e-3, Vec3::Z * 1e-3, lamp);
    Arc::new(PatchedScene::new(builder.build(), 60))
}

/// A closed grey room with one red and one cyan wall that shine.
fn red_and_cyan() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    let red = builder.light(Rgb::splat(0.5), Rgb::new(1.0, 0.0, 0.0));
    let cyan = builder.light(Rgb::splat(0.5), Rgb::new(0.0, 1.0, 1.0));
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    builder.quad(Vec3::ZERO, z, x, wall).quad(y, x, z, wall);
    builder.quad(Vec3::ZERO, x, y, wall).quad(z, y, x, wall);
    builder.quad(Vec3::ZERO, y, z, red).quad(x, z, y, cyan);
    Arc::new(PatchedScene::new(builder.build(), 60))
}

/// Σ A E of each channel by a dense solution.
fn dense(scene: &PatchedScene) -> [f64; 3] {
    let system = Radiosity::by_rays(scene, 4_000, 3);
    let area: f64 = system.area.iter().sum();
    [0, 1, 2].map(|channel| area * system.mean(&system.solve(channel)))
}

/// Deviation of a channel's mean power from what is expected, and its standard error, both relative.
#[derive(Clone, Copy, Debug)]
struct Deviation {
    mean: f64,
    error: f64,
}

impl Deviation {
    fn new(landed: &Moments, expected: f64) -> Self {
        let (mean, error) = (landed.mean(), landed.standard_error());
        assert!(mean.is_finite() && error.is_finite());
        Self { mean: mean / expected - 1.0, error: error / expected }
    }

    /// Whether only chance differs, within four standard errors, beside the percent that hemicubes of
    /// 16² pixels are off at the edges of an opening.
    fn is_chance(self) -> bool {
        self.mean.abs() < 0.01 + 4.0 * self.error
    }
}

#[test]
fn every_switch_on_scenes_that_strain() {
    let closed = |scene: &PatchedScene| [0, 1, 2].map(|c| emitted(scene, c) / (1.0 - 0.5));
    let (tiny, colours, open) = (tiny_lamp(), red_and_cyan(), rooms::open());
    let scenes = [
        ("lamp of 1 mm²", closed(&tiny), tiny),
        ("red and cyan walls", closed(&colours), colours),
        ("open box", dense(&open), open),
    ];
    for (scene_name, expected, scene) in &scenes {
        for Switch { name, settings, constant, first_shot, unbiased } in switches() {
            on_every_device(&format!("{scene_name} | {name}"), |device| {
                let settings = with_known(device, scene, &settings, constant, first_shot);
                let [deviation, planted] = power_deviations(device, scene, &settings, expected);
                if unbiased {
                    assert!(deviation.is_chance(), "{name}: {deviation:?}");
                } else {
                    // What the rule takes or the centroid misses is a few percent here.
                    assert!(deviation.mean.abs() < 0.05, "{name}: {deviation:?}");
                }
                assert!(!planted.is_chance(), "{name}: more power passes: {planted:?}");
                let Deviation { mean, error } = deviation;
                format!("power {:+.1} ± {:.1} %", 100.0 * mean, 100.0 * error)
            });
        }
    }
}

/// The worst channel's deviation from the expected power, with as many shots as it takes to know; and
/// that of the same run where it should be less, which must be seen.
fn power_deviations(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    expected: &[f64; 3],
) -> [Deviation; 2] {
    let mut settings = settings.clone();
    // Largest standard error of a channel's power that a run ends with, the share more that must be
    // seen then, and how many batches it takes at least. Software GPUs shoot an order slower than the
    // CPU device, with which `twins.rs` compares them shot by shot.
    let on_cpu = device.description().kind == "cpu";
    let (wanted, more, batches) = if on_cpu { (0.005, 0.06, 20) } else { (0.03, 0.25, 12) };
    let mut effort = Effort { burn_in: 20, batches, iterations: 6 };
    if settings.selection == Selection::Uniform {
        // As many as there are patches, or the one that is the light decides about everything.
        settings.shots_per_iteration = scene.patches.len() as u32;
        effort.iterations = 3;
    }
    let of = |landed: &[Moments; 3], factor: f64| -> [Deviation; 3] {
        std::array::from_fn(|c| Deviation::new(&landed[c], factor * expected[c]))
    };
    let is_enough = |e: &Estimate| of(&e.landed, 1.0).iter().all(|d| d.error < wanted);
    let estimate = estimate_until(device, scene, &settings, effort, is_enough);
    checked_largest(&estimate.sum);
    [1.0, 1.0 / (1.0 + more)].map(|factor| {
        let all = of(&estimate.landed, factor).into_iter();
        all.max_by(|a, b| a.mean.abs().total_cmp(&b.mean.abs())).expect("three channels")
    })
}

/// Five walls of albedo .7: the constant term as printed takes the opening for a wall and makes the
/// box too bright by what its own equations say; the corrected one and none at all agree with the
/// dense solution.
#[test]
fn open_box_with_the_constant_term() {
    let scene = rooms::open();
    let mut system = Radiosity::by_rays(&scene, 8_000, 7);
    let truth = system.mean(&means(&Radiosity::solve_by_rays(&scene, 8_000, 4)));
    // As printed: E_K = π L̄ whatever is seen, source L^e + (a − 1) L̄.
    let mut cpu = hemilux_engine::device::cpu::CpuDevice::new(None).expect("threads");
    let base = settings(32, 8, 9);
    let known = known_light(&mut cpu, &scene, &base, before(ConstantRadiance::Printed, false))
        .expect("is found")
        .expect("is asked for");
    let emitted = system.emitted.clone();
    for (i, emitted) in system.emitted.iter_mut().enumerate() {
        let constant = known.radiance[i].to_array().map(|k| PI * f64::from(k));
        for c in 0..3 {
            emitted[c] += (system.albedo[i][c] - 1.0) * constant[c];
        }
    }
    let residual = system.mean(&system.solve_sum());
    let constant: f64 = known.irradiance[0].to_array().iter().map(|e| f64::from(*e)).sum();
    let printed = residual + constant;
    system.emitted = emitted;
    assert!(printed > 1.5 * truth, "{printed} {truth}");
    on_every_device("open box | constant term", |device| {
        // Lavapipe is an order slower than the CPU device.
        let (iterations, bound) =
            if device.description().kind == "cpu" { (300, 0.01) } else { (25, 0.04) };
        let effort = Effort { burn_in: 40, batches: 12, iterations };
        let mut mean = |constant| {
            let settings = with_known(device, &scene, &base, constant, false);
            let estimate = solved(device, &scene, &settings, effort);
            system.mean(&means(&estimate.sum)) / truth - 1.0
        };
        let off = mean(ConstantRadiance::Off);
        let as_printed = mean(ConstantRadiance::Printed);
        let corrected = mean(ConstantRadiance::Corrected);
        let predicted = printed / truth - 1.0;
        assert!((as_printed - predicted).abs() < bound, "{as_printed}, predicted {predicted}");
        assert!(corrected.abs() < bound, "{corrected}");
        assert!(off.abs() < bound, "{off}");
        format!(
            "none {:+.1} %, printed {:+.1} % (predicted {:+.1} %), corrected {:+.2} %",
            100.0 * off,
            100.0 * as_printed,
            100.0 * predicted,
            100.0 * corrected
        )
    });
}

/// In a uniform furnace the constant is the solution and nothing is left to shoot.
#[test]
fn nothing_left_beside_the_constant_term() {
    let scene = imported(&made::furnace(Rgb::new(0.5, 0.3, 0.8), Rgb::new(1.0, 2.0, 0.5)));
    let scene = Arc::new(PatchedScene::new(scene, 48));
    let exact = [1.0 / 0.5, 2.0 / 0.7, 0.5 / 0.2].map(|radiance| PI * radiance);
    for constant in [ConstantRadiance::Printed, ConstantRadiance::Corrected] {
        on_every_device(&format!("ΔL ≡ 0 | {constant:?}"), |device| {
            let settings = with_known(device, &scene, &settings(32, 8, 1), constant, false);
            let estimate = solved(device, &scene, &settings, SHORT);
            let worst = (0..3)
                .map(|c| largest_relative_deviation(&means(&estimate.channels[c]), exact[c]))
                .fold(0.0, f64::max);
            assert!(worst < 1e-4, "{worst}");
            let scatter = estimate.sum.iter().map(Moments::standard_error).fold(0.0, f64::max);
            assert!(scatter < 1e-3, "{scatter}");
            format!("patches exact to {worst:.0e}, {} shots", estimate.tally.shots)
        });
    }
}

/// The same as a picture, by the printed algorithm: nothing to shoot must not read as no light.
#[test]
fn a_picture_of_nothing_but_the_constant_term() {
    let scene = imported(&made::furnace(Rgb::splat(0.5), Rgb::new(1.0, 2.0, 0.5)));
    let option = |name: &str, value: &str| (name.to_string(), value.to_string());
    let request = RenderRequest {
        limits: Limits::iterations(40),
        options: [option("preset", "paper"), option("patches", "60")].into(),
        ..RenderRequest::new(scene, "stochastic", [16; 2])
    };
    on_every_device("ΔL ≡ 0 | preset paper", |device| {
        let rendered = rendered(device, &request);
        assert_eq!(rendered.stats.stopped, StopReason::Iterations);
        let error = rendered.stats.figures.estimated_error;
        assert!(error.is_none_or(|error| (0.0..1e-4).contains(&error)), "{error:?}");
        let pixels = rendered.picture.pixels.iter();
        let worst =
            pixels.map(|pixel| (*pixel / Rgb::new(2.0, 4.0, 1.0) - 1.0).abs().max_element());
        let worst = worst.fold(0.0, f32::max);
        assert!(worst < 1e-4, "{worst}");
        format!("pixels exact to {worst:.0e}, estimated error {error:?}")
    });
}
