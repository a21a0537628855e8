//! Every switch of the shooting method on the wgpu device against its CPU twin.

use glam::Vec2;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{
    Device, Faces, KnownLight, Selection, ShootingSettings, Substitute, VarianceReduction,
};
use hemilux_engine::hemicube::Shot;
use hemilux_engine::patches::{PatchIndex, PatchedScene};
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::random::{Stream, uniform};
use hemilux_tests::iterations::*;
use hemilux_tests::twins::*;
use std::f32::consts::PI;
use std::sync::Arc;

fn cpu() -> CpuDevice {
    CpuDevice::new(None).expect("threads")
}

#[test]
fn uniform_selection_picks_the_same_patches() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = cpu();
    for (patches, shots_per_iteration, stratified, random_point) in [
        (600, 1, true, true),
        (600, 3, true, true),
        (1800, 48, true, false),
        (600, 1, false, true),
        (1800, 7, false, false),
    ] {
        let scene = blocks(patches);
        let settings = ShootingSettings {
            selection: Selection::Uniform,
            stratified,
            random_point,
            ..settings(8, shots_per_iteration, 1 << 40)
        };
        let on_cpu = Run::new(&mut cpu, &scene, &settings, 100).shooters;
        assert_eq!(on_cpu, Run::new(&mut gpu, &scene, &settings, 100).shooters);
        let mut all: Vec<_> = on_cpu.iter().flatten().copied().collect();
        all.sort_unstable();
        all.dedup();
        assert!(all.len() >= 80, "{} patches shot", all.len());
        let other = ShootingSettings { stratified: !stratified, ..settings };
        let other = Run::new(&mut gpu, &scene, &other, 100).shooters;
        assert_eq!(other == on_cpu, shots_per_iteration == 1, "stratification goes unseen");
    }
}

#[test]
fn traces_do_not_change_who_shot() {
    let Some(mut gpu) = adapter() else { return };
    let scene = blocks(600);
    let mut shooting = gpu.begin(scene.clone(), &settings(16, 3, 4)).expect("begins");
    assert!(shooting.shooters().expect("lists shooters").is_empty());
    shooting.iterate(2).expect("iterates");
    let before = shooting.shooters().expect("lists shooters");
    assert_eq!(before.len(), 3);
    shooting.trace(&random_shots(&scene, 5, 1)).expect("traces");
    assert_eq!(before, shooting.shooters().expect("lists shooters"));
}

/// A known part of the light: the lamps and a constant, and the light that both cause.
fn known(scene: &Arc<PatchedScene>, constant: f32) -> Arc<KnownLight> {
    let patches = &scene.patches;
    let radiance: Vec<_> = patches.emission.iter().map(|emission| *emission + constant).collect();
    let mut irradiance = vec![Rgb::ZERO; patches.len()];
    let mut cpu = cpu();
    let mut shooting = cpu.begin(scene.clone(), &settings(64, 1, 1)).expect("begins");
    for (patch, radiance) in radiance.iter().enumerate() {
        let shots = if patches.emits(patch) { 128 } else { 8 };
        let shot = |k| {
            let counter = (patch * 128 + k) as u64;
            let draw = |stream| uniform(77, stream, counter);
            let at = Vec2::new(draw(Stream::PointU), draw(Stream::PointV));
            let jitter = Vec2::new(draw(Stream::JitterX), draw(Stream::JitterY)) - 0.5;
            let position = scene.point_on_patch(PatchIndex(patch as u32), at);
            let turn = draw(Stream::Azimuth);
            Shot { patch: patch as u32, ..shot_at(position, patches.normal[patch], turn, jitter) }
        };
        let traced = (0..shots).map(shot).collect::<Vec<_>>();
        let power = *radiance * (PI * patches.area[patch] / shots as f32);
        for trace in shooting.trace(&traced).expect("traces") {
            for (i, form_factor) in trace.form_factor.iter().enumerate() {
                irradiance[i] += power * (form_factor / patches.area[i]);
            }
        }
    }
    Arc::new(KnownLight { radiance, irradiance })
}

fn reduction(substitute: Substitute, shots: Option<u64>) -> Option<VarianceReduction> {
    Some(VarianceReduction { substitute, shots })
}

/// Every switch by name, away from the default.
fn switches(known: &Arc<KnownLight>, seed: u64) -> Vec<(&'static str, ShootingSettings)> {
    let default = settings(128, 8, seed);
    let faces = |faces| ShootingSettings { faces, ..default.clone() };
    let reduced = |substitute, shots| ShootingSettings {
        variance_reduction: reduction(substitute, shots),
        ..default.clone()
    };
    let known = Some(known.clone());
    vec![
        (
            "uniform",
            ShootingSettings {
                // Enough that lamps are among them.
                shots_per_iteration: 48,
                selection: Selection::Uniform,
                ..default.clone()
            },
        ),
        ("independent", ShootingSettings { stratified: false, ..default.clone() }),
        ("centroid", ShootingSettings { random_point: false, ..default.clone() }),
        ("specular faces", faces(Faces::Specular)),
        ("top and side", faces(Faces::TopAndSide)),
        ("randomised faces", faces(Faces::Randomised)),
        ("zero", reduced(Substitute::Zero, Some(20))),
        ("mean", reduced(Substitute::Mean, Some(20))),
        ("mean of all", reduced(Substitute::Mean, Some(0))),
        ("growing", reduced(Substitute::Mean, None)),
        ("known", ShootingSettings { known: known.clone(), ..default.clone() }),
        (
            "paper",
            ShootingSettings {
                shots_per_iteration: 1,
                stratified: false,
                random_azimuth: false,
                jitter: false,
                variance_reduction: reduction(Substitute::Zero, Some(40)),
                known,
                ..faces(Faces::Randomised)
            },
        ),
    ]
}

#[test]
fn the_same_random_numbers_give_the_same_light_with_every_switch() {
    const ITERATIONS: u32 = 4;
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = cpu();
    let scene = glossy(600);
    let areas = &scene.patches.area;
    let known = known(&scene, 0.4);
    let names: Vec<_> = switches(&known, 0).iter().map(|(name, _)| *name).collect();
    for (index, name) in names.into_iter().enumerate() {
        let mut same = SameNumbers::default();
        let mut changed = 0;
        for seed in 0..8 {
            let (_, settings) = switches(&known, seed).swap_remove(index);
            let on_cpu = Run::new(&mut cpu, &scene, &settings, ITERATIONS);
            let on_gpu = Run::new(&mut gpu, &scene, &settings, ITERATIONS);
            same.push(areas, &on_cpu, &on_gpu);
            // Whatever the switch does must be there to be seen.
            let plain = self::settings(128, settings.shots_per_iteration, seed);
            let plain = Run::new(&mut cpu, &scene, &plain, ITERATIONS);
            let by = distance(areas, &on_cpu.sums.irradiance, &plain.sums.irradiance);
            changed += usize::from(by > 0.02);
        }
        println!("{name}: {changed} of 8 changed, {same:.5?}");
        assert!(same.agree(), "{name}: {same:?}");
        assert!(changed >= 4, "{name}: only {changed} changed");
    }
}

#[test]
fn the_comparator_of_runs_sees_planted_errors() {
    let scene = glossy(300);
    let areas = &scene.patches.area;
    let mut cpu = cpu();
    let runs: Vec<_> =
        (0..4).map(|seed| Run::new(&mut cpu, &scene, &settings(32, 2, seed), 3)).collect();
    let compared = |plant: &dyn Fn(&mut Run)| {
        let mut same = SameNumbers::default();
        for run in &runs {
            let mut wrong = run.clone();
            plant(&mut wrong);
            same.push(areas, run, &wrong);
        }
        same
    };
    assert!(compared(&|_| ()).agree());
    let other_shooter = compared(&|run| run.shooters[1][0] ^= 1);
    assert!(other_shooter.distances.is_empty() && !other_shooter.agree());
    let brighter = |sums: &mut Vec<Rgb>| sums.iter_mut().for_each(|sum| *sum *= 1.02);
    assert!(!compared(&|run| brighter(&mut run.sums.irradiance)).agree());
    assert!(!compared(&|run| brighter(&mut run.sums.glossy)).agree());
    assert!(!compared(&|run| run.sums.irradiance.rotate_right(1)).agree());
}

#[test]
fn uniform_selection_keeps_long_runs_together() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = cpu();
    let scene = glossy(300);
    let mut same = SameNumbers::default();
    for seed in 0..4 {
        let settings = ShootingSettings {
            selection: Selection::Uniform,
            stratified: seed % 2 == 0,
            ..settings(64, 8, seed)
        };
        let on_cpu = Run::new(&mut cpu, &scene, &settings, 300);
        same.push(&scene.patches.area, &on_cpu, &Run::new(&mut gpu, &scene, &settings, 300));
    }
    println!("{same:?}");
    assert!(same.agree() && same.distances.len() == 4, "{same:?}");
}

#[test]
fn averages_agree_with_every_switch() {
    let Some(mut gpu) = adapter() else { return };
    let mut cpu = cpu();
    let scene = glossy(300);
    let areas = &scene.patches.area;
    let default = settings(64, 4, 31);
    let plain = Averages::new(&mut cpu, &scene, &default);
    let reduced = |substitute| ShootingSettings {
        variance_reduction: reduction(substitute, Some(4)),
        ..default.clone()
    };
    let known = ShootingSettings {
        shots_per_iteration: 8,
        known: Some(known(&scene, 0.2)),
        ..default.clone()
    };
    // Known light, of both signs, and single faces are noisy: over seeds, the means of such runs
    // scatter by almost a hundredth.
    for (name, settings, overall, biased) in [
        ("known", known, 0.04, false),
        ("zero", reduced(Substitute::Zero), 0.015, true),
        ("mean", reduced(Substitute::Mean), 0.015, true),
        ("faces", ShootingSettings { faces: Faces::Randomised, ..default.clone() }, 0.04, false),
    ] {
        let on_cpu = Averages::new(&mut cpu, &scene, &settings);
        let settings = ShootingSettings { seed: 32, ..settings };
        let on_gpu = Averages::new(&mut gpu, &scene, &settings);
        let test = ZTest::between(areas, &on_cpu.irradiance, &on_gpu.irradiance);
        let glossy = ZTest::between(areas, &on_cpu.glossy, &on_gpu.glossy);
        let from_plain = ZTest::between(areas, &plain.irradiance, &on_gpu.irradiance);
        println!("{name}: {test:?}, glossy {glossy:?}, plain {from_plain:?}");
        println!("light {} {}", on_cpu.light_ratio, on_gpu.light_ratio);
        assert!(test.passes_within(overall), "{name}: {test:?}");
        // Too few shots light the narrow lobes for a tight bound on their overall mean.
        assert!(glossy.passes_within(0.5), "{name}: {glossy:?}");
        assert!((on_cpu.light_ratio - on_gpu.light_ratio).abs() < 0.01, "{name}");
        // What is not meant to change the mean does not, and what does is seen.
        // (The known part has noise of its own, the same in all iterations.)
        let unmoved = from_plain.rms < 1.6 && from_plain.overall < overall;
        assert_eq!(unmoved, !biased, "{name}: {from_plain:?}");
        for wrong in [on_gpu.irradiance.swapped(), on_gpu.irradiance.scaled(1.08)] {
            let planted = ZTest::between(areas, &on_cpu.irradiance, &wrong);
            assert!(!planted.passes_within(overall), "{name}: an error passed: {planted:?}");
        }
    }
}
