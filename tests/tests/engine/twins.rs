//! The wgpu kernels against their CPU twin: shot by shot, iteration by iteration, and on average.

use glam::{Vec2, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Device, ShootingSettings, ShotTrace, Sums};
use hemilux_engine::hemicube::{Shot, item};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::Material;
use hemilux_tests::iterations::*;
use hemilux_tests::twins::*;
use std::sync::Arc;

fn trace(device: &mut dyn Device, scene: &Arc<PatchedScene>, shots: &[Shot]) -> Vec<ShotTrace> {
    trace_at(256, device, scene, shots)
}

fn trace_at(
    resolution: u32,
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    shots: &[Shot],
) -> Vec<ShotTrace> {
    let settings = settings(resolution, 8, 1);
    let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
    shooting.trace(shots).expect("traces")
}

/// Traces on both devices, requires that they agree, and says by how much.
fn compare(name: &str, scene: &Arc<PatchedScene>, shots: &[Shot]) -> Option<Vec<ShotTrace>> {
    let on_gpu = trace(&mut adapter()?, scene, shots);
    let on_cpu = trace(&mut CpuDevice::new(None).expect("threads"), scene, shots);
    let difference = Difference::between(shots, &on_cpu, &on_gpu);
    println!("{name}: {difference:?}");
    assert!(difference.is_small(), "{name}: {difference:?}");
    Some(on_gpu)
}

#[test]
fn shots_agree_in_a_closed_room() {
    let scene = blocks(2000);
    let shots = random_shots(&scene, 20, 1);
    let Some(traces) = compare("blocks", &scene, &shots) else { return };
    for trace in traces {
        let total = total(&trace.form_factor);
        assert!((total - 1.0).abs() < 1e-4, "form factors of a closed room sum to {total}");
    }
}

#[test]
fn lobes_agree() {
    let scene = glossy(1000);
    let shots: Vec<_> =
        random_shots(&scene, 200, 2).into_iter().filter(Shot::has_lobe).take(20).collect();
    assert_eq!(shots.len(), 20);
    let Some(traces) = compare("glossy", &scene, &shots) else { return };
    // A block that stands on the floor sees nothing from below.
    let lit = traces.iter().filter(|trace| total(&trace.lobe_factor) > 1e-4).count();
    assert!(lit >= 15, "{lit}");
}

#[test]
fn weighted_and_left_out_faces_agree() {
    let scene = glossy(1000);
    let mut shots = random_shots(&scene, 20, 3);
    for (index, shot) in shots.iter_mut().enumerate() {
        shot.face_weights = [1.0, 0.0, 0.0, 0.0, 0.0];
        shot.face_weights[1 + index % 4] = 4.0;
        if index % 3 == 0 {
            shot.face_weights = [10.0; 5];
        }
    }
    compare("weighted", &scene, &shots);
}

#[test]
fn shots_half_a_millimetre_from_a_wall_agree() {
    let scene = blocks(2000);
    let shots: Vec<_> = (0..20)
        .map(|k| {
            let (turn, along) = (k as f32 / 20.0, 0.05 + 0.045 * k as f32);
            let near = 5e-4 * [1.0, 0.1, 2.0, 0.02][k % 4];
            // On the floor next to a wall or, every other one, in a corner.
            let other = if k % 2 == 0 { along } else { 1.0 - near };
            shot_at(Vec3::new(near, 0.0, other), Vec3::Y, turn, Vec2::new(0.3, -0.4))
        })
        .collect();
    let Some(traces) = compare("near a wall", &scene, &shots) else { return };
    for trace in traces {
        let total = total(&trace.form_factor);
        assert!((total - 1.0).abs() < 1e-4, "{total}: part of the wall is missing");
        // The ceiling has corners where the walls have none, so single pixels may see through.
        let empty = trace.items.iter().filter(|code| **code == item::EMPTY).count();
        assert!(empty < 10, "{empty} pixels see nothing");
    }
}

#[test]
fn two_sided_and_closed_bodies_agree() {
    let scene = screens(2000);
    compare("screens", &scene, &random_shots(&scene, 20, 4));
}

#[test]
fn every_resolution_agrees() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = CpuDevice::new(None).expect("threads");
    let scene = blocks(500);
    // Not multiples of a run of pixels or of the alignment of rows in transfers.
    for resolution in [8, 50, 134, 600] {
        let shots = random_shots(&scene, 11, u64::from(resolution));
        let on_gpu = trace_at(resolution, &mut gpu, &scene, &shots);
        let on_cpu = trace_at(resolution, &mut cpu, &scene, &shots);
        for (a, b) in on_gpu.iter().zip(&on_cpu) {
            let items = different_items(&a.items, &b.items);
            assert!(items <= MAX_DIFFERENT_ITEMS, "R = {resolution}: {items}");
            // A pixel at an edge may go to either neighbour.
            let pixel = 4.0 / (std::f32::consts::PI * (resolution * resolution) as f32);
            let difference = |(a, b): (&f32, &f32)| (a - b).abs();
            let worst = a.form_factor.iter().zip(&b.form_factor).map(difference);
            let worst = worst.fold(0.0, f32::max);
            assert!(worst < 2.0 * pixel + 1e-5, "R = {resolution}: {worst}");
        }
    }
}

#[test]
fn many_small_triangles_agree() {
    let scene = ball(20_000, 60);
    assert!(scene.facets.len() > 10_000, "{}", scene.facets.len());
    compare("ball", &scene, &random_shots(&scene, 20, 5));
}

#[test]
fn comparators_see_planted_errors() {
    let scene = glossy(1000);
    let shots: Vec<_> =
        random_shots(&scene, 200, 6).into_iter().filter(Shot::has_lobe).take(6).collect();
    let mut cpu = CpuDevice::new(None).expect("threads");
    let good = trace(&mut cpu, &scene, &shots);
    assert!(Difference::between(&shots, &good, &good).is_small());

    // Half a pixel of jitter moves edges.
    let mut shifted = shots.clone();
    shifted.iter_mut().for_each(|shot| shot.jitter.x -= 0.5);
    let difference = Difference::between(&shots, &good, &trace(&mut cpu, &scene, &shifted));
    assert!(difference.items > MAX_DIFFERENT_ITEMS, "{difference:?}");

    // One facet's items are another's.
    let mut wrong = good.clone();
    for trace in &mut wrong {
        let seen = trace.items[trace.items.len() / 2];
        let items = trace.items.iter_mut().filter(|code| **code == seen);
        items.for_each(|code| *code += 2);
    }
    let difference = Difference::between(&shots, &good, &wrong);
    assert!(difference.items > MAX_DIFFERENT_ITEMS, "{difference:?}");

    // Form factors 3 % too large.
    let mut scaled = good.clone();
    for trace in &mut scaled {
        trace.form_factor.iter_mut().for_each(|sum| *sum *= 1.03);
    }
    let difference = Difference::between(&shots, &good, &scaled);
    assert!(difference.form_factor > 1.0 && difference.total > 1e-4, "{difference:?}");

    // A lobe one and a half times as sharp.
    let mut sharper = shots.clone();
    sharper.iter_mut().for_each(|shot| shot.exponent *= 1.5);
    let difference = Difference::between(&shots, &good, &trace(&mut cpu, &scene, &sharper));
    assert!(difference.lobe_factor > 1.0, "{difference:?}");
}

/// Sums after a few iterations, in calls of so many each.
fn few(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    calls: &[u32],
) -> Sums {
    let mut shooting = device.begin(scene.clone(), settings).expect("begins");
    let mut shots = 0;
    for iterations in calls {
        let tally = shooting.iterate(*iterations).expect("iterates");
        assert_eq!(tally.iterations, u64::from(*iterations));
        assert!(tally.light_shots > 0 && tally.light_shots <= tally.shots);
        shots += tally.shots;
    }
    let sums = shooting.drain().expect("drains");
    assert_eq!(sums.iterations, u64::from(calls.iter().sum::<u32>()));
    assert_eq!(shots, sums.iterations * u64::from(settings.shots_per_iteration));
    sums
}

#[test]
fn the_same_random_numbers_give_the_same_light() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = CpuDevice::new(None).expect("threads");
    for (name, scene) in [("blocks", blocks(600)), ("glossy", glossy(600))] {
        let areas = &scene.patches.area;
        let (mut distances, mut glossy_distances) = (Vec::new(), Vec::new());
        for seed in 0..16 {
            let settings = settings(128, 2, seed);
            let on_cpu = few(&mut cpu, &scene, &settings, &[3]);
            let on_gpu = few(&mut gpu, &scene, &settings, &[3]);
            distances.push(distance(areas, &on_cpu.irradiance, &on_gpu.irradiance));
            if !on_cpu.glossy.is_empty() {
                glossy_distances.push(distance(areas, &on_cpu.glossy, &on_gpu.glossy));
            }
            if seed == 0 {
                let other = ShootingSettings { seed: 99, ..settings };
                let other = few(&mut cpu, &scene, &other, &[3]);
                let other = distance(areas, &on_cpu.irradiance, &other.irradiance);
                assert!(other > 0.05, "other random numbers go unseen: {other}");
                let brighter: Vec<_> = on_gpu.irradiance.iter().map(|e| *e * 1.02).collect();
                let planted = distance(areas, &on_cpu.irradiance, &brighter);
                assert!(planted > 0.01, "2 % too much light goes unseen: {planted}");
            }
        }
        assert_eq!(glossy_distances.is_empty(), name != "glossy");
        // Where rounding moves a pick over the border between two patches, the rest is another
        // random walk; most runs have no such pick.
        for distances in [&mut distances, &mut glossy_distances] {
            distances.sort_by(f64::total_cmp);
            println!("{name}: {distances:.5?}");
            let median = distances.get(8).copied().unwrap_or(0.0);
            assert!(median < 0.01, "{name}: {distances:?}");
        }
    }
}

#[test]
fn one_seed_gives_one_result_however_calls_are_cut() {
    let Some(mut gpu) = adapter() else { return };
    let scene = glossy(600);
    let bits = |sums: Sums| -> Vec<u32> {
        let all = sums.irradiance.iter().chain(&sums.glossy);
        all.flat_map(|rgb| rgb.to_array()).map(f32::to_bits).collect()
    };
    let mut run = |seed, calls: &[u32]| bits(few(&mut gpu, &scene, &settings(128, 5, seed), calls));
    let once = run(5, &[12]);
    assert_eq!(once, run(5, &[12]));
    assert_eq!(once, run(5, &[1, 4, 7]));
    assert_ne!(once, run(6, &[12]));
    assert!(once.iter().any(|word| *word != 0));
}

#[test]
fn tracing_leaves_the_iteration_as_it_is() {
    let Some(mut gpu) = adapter() else { return };
    let scene = glossy(600);
    let shots = random_shots(&scene, 12, 8);
    let mut shooting = gpu.begin(scene.clone(), &settings(64, 5, 3)).expect("begins");
    shooting.iterate(3).expect("iterates");
    shooting.trace(&shots).expect("traces");
    shooting.iterate(3).expect("iterates");
    let disturbed = shooting.drain().expect("drains").irradiance;
    drop(shooting);
    let mut shooting = gpu.begin(scene.clone(), &settings(64, 5, 3)).expect("begins");
    shooting.iterate(6).expect("iterates");
    assert_eq!(disturbed, shooting.drain().expect("drains").irradiance);
}

#[test]
fn averages_agree_but_for_chance() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = CpuDevice::new(None).expect("threads");
    for (name, scene) in [("screens", screens(300)), ("glossy", glossy(300))] {
        let areas = &scene.patches.area;
        let on_cpu = Averages::new(&mut cpu, &scene, &settings(64, 4, 21));
        let on_gpu = Averages::new(&mut gpu, &scene, &settings(64, 4, 22));
        let test = ZTest::between(areas, &on_cpu.irradiance, &on_gpu.irradiance);
        println!("{name}: {test:?}, light {} {}", on_cpu.light_ratio, on_gpu.light_ratio);
        assert!(test.passes(), "{name}: {test:?}");
        assert!((on_cpu.light_ratio - on_gpu.light_ratio).abs() < 0.01, "{name}");
        let planted = ZTest::between(areas, &on_cpu.irradiance, &on_gpu.irradiance.scaled(1.02));
        assert!(!planted.passes(), "{name}: 2 % too much light passed: {planted:?}");
        let planted = ZTest::between(areas, &on_cpu.irradiance, &on_gpu.irradiance.swapped());
        assert!(!planted.passes(), "{name}: swapped patches passed: {planted:?}");
        if name == "glossy" {
            let seen: Vec<_> =
                (0..areas.len()).filter(|patch| on_cpu.glossy.mean(*patch) > 0.0).collect();
            assert!(seen.len() > 10, "{} patches reflect to the viewer", seen.len());
            // Too few shots light the narrow lobes for a tight bound on their overall mean.
            let test = ZTest::between(areas, &on_cpu.glossy, &on_gpu.glossy);
            println!("glossy radiance: {test:?}");
            assert!(test.rms < 1.6 && test.outliers < 0.005, "{test:?}");
        } else {
            assert!(on_cpu.irradiance.mean(0) > 0.0);
        }
    }
}

#[test]
fn scenes_without_light_or_surface_agree() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = CpuDevice::new(None).expect("threads");
    let mut dark = Builder::default();
    let grey = dark.material(Material::lambertian("grey", Rgb::splat(0.5)));
    dark.block(Vec3::ZERO, Vec3::ONE, 0.0, grey);
    for scene in [dark.cut(50), Builder::default().cut(50)] {
        let settings = settings(32, 3, 1);
        let run = |device: &mut dyn Device| {
            let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
            let tally = shooting.iterate(2).expect("iterates");
            let sums = shooting.drain().expect("drains");
            let shot = shot_at(Vec3::splat(3.0), Vec3::NEG_ONE.normalize(), 0.0, Vec2::ZERO);
            let traces = shooting.trace(&[shot]).expect("traces");
            (tally, sums.iterations, sums.irradiance, sums.glossy, traces[0].items.len())
        };
        let on_cpu = run(&mut cpu);
        assert_eq!((on_cpu.0.shots, on_cpu.0.iterations), (0, 2));
        assert_eq!(on_cpu, run(&mut gpu));
    }
}

/// Shots per second, to be run alone: `cargo test --release -p hemilux-tests --test engine
/// shooting_rate -- --ignored --nocapture`.
#[test]
#[ignore = "measures; needs a quiet machine"]
fn shooting_rate() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = CpuDevice::new(None).expect("threads");
    let devices: [&mut dyn Device; 2] = [&mut gpu, &mut cpu];
    for device in devices {
        println!("{:?}", device.description());
        for (name, scene) in [
            ("diffuse", blocks(10_000)),
            ("glossy", glossy(10_000)),
            ("ball of 14k triangles", ball(10_000, 60)),
            ("ball of 100k triangles", ball(100_000, 160)),
        ] {
            for shots_per_iteration in [1, 8] {
                let settings = settings(256, shots_per_iteration, 1);
                let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
                shooting.iterate(16 / shots_per_iteration).expect("iterates");
                let (mut shots, start) = (0, std::time::Instant::now());
                while start.elapsed().as_secs_f64() < 2.0 {
                    shots += shooting.iterate(64 / shots_per_iteration).expect("iterates").shots;
                }
                let rate = shots as f64 / start.elapsed().as_secs_f64();
                let (patches, facets) = (scene.patches.len(), scene.facets.len());
                println!(
                    "{name}: {patches} patches, {facets} facets, K = {shots_per_iteration}: \
                     {rate:.0} shots/s"
                );
            }
        }
    }
}
