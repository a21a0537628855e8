//! Closed forms: furnaces, power balance, sealed walls, view factors, lobe albedo.

use glam::Vec3;
use hemilux_engine::device::Device;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::hemicube::Shot;
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::{Rgb, lobe_albedo};
use hemilux_engine::sampling::frame;
use hemilux_engine::scene::made;
use hemilux_tests::comparison::largest_relative_deviation;
use hemilux_tests::scenes::{Builder, imported, settings, solve};
use std::f64::consts::PI;
use std::sync::Arc;

/// A closed box that emits E and reflects a everywhere has the radiance E/(1 − a) everywhere.
#[test]
fn furnace_reaches_emission_over_one_minus_albedo_on_every_patch() {
    for albedo in [0.2f32, 0.5, 0.8] {
        let scene = imported(&made::furnace(Rgb::splat(albedo), Rgb::ONE));
        let patched = Arc::new(PatchedScene::new(scene, 48));
        let count = patched.patches.len() as u32;
        assert!(count >= 40, "{count} patches");
        // One shot from each patch an iteration, so only the points on them are random.
        let (sums, _) = solve(&patched, &settings(64, count, 1), 60, 1500);
        let radiance: Vec<f64> = (0..patched.patches.len())
            .flat_map(|i| {
                let e = sums.irradiance[i] / sums.iterations as f32;
                let l = patched.patches.emission[i]
                    + patched.patches.diffuse[i] * e / std::f32::consts::PI;
                l.to_array().map(f64::from)
            })
            .collect();
        let expected = 1.0 / (1.0 - f64::from(albedo));
        let worst = largest_relative_deviation(&radiance, expected);
        println!("albedo {albedo}: {count} patches, worst relative deviation {worst:.5}");
        assert!(worst < 0.01, "albedo {albedo}: {worst}");
    }
}

/// In a closed room with one albedo everywhere all power lands, so a small light's share of the
/// power, and of the shots, is 1 − a.
#[test]
fn shots_start_on_the_light_with_probability_one_minus_albedo() {
    for albedo in [0.2f32, 0.5, 0.8] {
        let mut builder = Builder::default();
        let wall = builder.lambertian(Rgb::splat(albedo));
        let light = builder.light(Rgb::splat(albedo), Rgb::splat(100.0));
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        builder.quad(Vec3::new(0.49, 0.999, 0.49), Vec3::X * 0.02, Vec3::Z * 0.02, light);
        let patched = Arc::new(PatchedScene::new(builder.build(), 200));
        // One shot an iteration: stratification would make the share too even for the test.
        let shots = 20_000;
        let (_, share) = solve(&patched, &settings(32, 1, 3), 200, shots);
        let expected = 1.0 - f64::from(albedo);
        let standard_error = (expected * (1.0 - expected) / f64::from(shots)).sqrt();
        let deviation = (share - expected) / standard_error;
        println!("albedo {albedo}: share {share:.4}, {deviation:+.2} standard errors");
        assert!(
            deviation.abs() < 3.0,
            "albedo {albedo}: {share} is {deviation} standard errors off"
        );
    }
}

/// Two rooms with a wall between them, light in the first; share of the power that lands in the
/// second.
fn power_behind_a_wall(gap: f32) -> f64 {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.7));
    let light = builder.light(Rgb::ZERO, Rgb::splat(10.0));
    // Odd dimensions, so that no edge falls on round numbers. The wall between the rooms ends
    // `gap` short of the ceiling, on both sides.
    let (size, far) = (Vec3::new(1.037, 0.913, 1.171), Vec3::new(2.173, 0.913, 1.171));
    let height = Vec3::Y * (size.y - gap);
    let floor = Vec3::X * size.x;
    builder.quad(floor, Vec3::Z * size.z, height, wall);
    builder.quad(floor, height, Vec3::Z * size.z, wall);
    for (start, end) in [(0.0, size.x), (size.x, far.x)] {
        let (x, y, z) = (Vec3::X * (end - start), Vec3::Y * size.y, Vec3::Z * size.z);
        let corner = Vec3::X * start;
        builder.quad(corner, z, x, wall).quad(corner + y, x, z, wall);
        builder.quad(corner, x, y, wall).quad(corner + z, y, x, wall);
    }
    builder.quad(Vec3::ZERO, Vec3::Y * size.y, Vec3::Z * size.z, wall);
    builder.quad(Vec3::X * far.x, Vec3::Z * size.z, Vec3::Y * size.y, wall);
    builder.quad(Vec3::new(0.4, 0.912, 0.4), Vec3::X * 0.3, Vec3::Z * 0.3, light);
    let patched = Arc::new(PatchedScene::new(builder.build(), 800));
    let (sums, _) = solve(&patched, &settings(128, 8, 5), 0, 400);
    let patches = &patched.patches;
    let (mut before, mut behind) = (0.0, 0.0);
    for i in 0..patches.len() {
        let power = f64::from(sums.irradiance[i].x * patches.area[i]);
        let x = patches.centroid[i].x;
        let second = x > size.x || (x == size.x && patches.normal[i].x > 0.0);
        *(if second { &mut behind } else { &mut before }) += power;
    }
    behind / (before + behind)
}

/// Nothing passes a sealed wall, and the measure would see a millimetre's gap.
#[test]
fn no_light_behind_a_sealed_wall() {
    let (sealed, gap) = (power_behind_a_wall(0.0), power_behind_a_wall(1e-3));
    println!("share of the power behind the wall: sealed {sealed:.2e}, 1 mm gap {gap:.2e}");
    assert_eq!(sealed, 0.0);
    assert!(gap > 1e-5, "{gap}");
}

fn shot(position: Vec3, normal: Vec3) -> Shot {
    let (tangent, bitangent) = frame(normal, 0.3);
    Shot { position, tangent, bitangent, normal, ..Shot::default() }
}

/// View factors of unit squares by hemicubes on a grid of points against the closed forms.
#[test]
fn view_factors_of_unit_squares() {
    // Parallel at distance 1; perpendicular with a common edge (Howell's catalogue C-11, C-14).
    let cases = [
        ("parallel", Vec3::new(0.0, 0.0, 1.0), Vec3::Y, Vec3::X, 0.199_824_895_698_387),
        ("perpendicular", Vec3::ZERO, Vec3::Y, Vec3::Z, 0.200_043_776_075_403),
    ];
    for (name, corner, u, v, exact) in cases {
        let mut builder = Builder::default();
        let material = builder.lambertian(Rgb::splat(0.5));
        builder.quad(corner, u, v, material);
        let patched = Arc::new(PatchedScene::new(builder.build(), 2));
        let mut device = CpuDevice::new(Some(1)).unwrap();
        let mut shooting = device.begin(patched, &settings(256, 1, 0)).unwrap();
        let grid = 24;
        let shots: Vec<Shot> = (0..grid * grid)
            .map(|i| {
                let at = |k: i32| (k as f32 + 0.5) / grid as f32;
                shot(Vec3::new(at(i % grid), at(i / grid), 0.0), Vec3::Z)
            })
            .collect();
        let traces = shooting.trace(&shots).unwrap();
        let mean: f64 =
            traces.iter().flat_map(|t| &t.form_factor).map(|f| f64::from(*f)).sum::<f64>()
                / f64::from(grid * grid);
        println!("{name}: {mean:.6}, exact {exact:.6}");
        assert!((mean / exact - 1.0).abs() < 2e-3, "{name}: {mean} instead of {exact}");
    }
}

/// In a closed room every shot's delta form factors sum to 1, and a lobe's weights to its albedo.
#[test]
fn closed_rooms_receive_everything() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    builder.cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), true, wall);
    let patched = Arc::new(PatchedScene::new(builder.build(), 500));
    let mut device = CpuDevice::new(Some(1)).unwrap();
    let mut shooting = device.begin(patched, &settings(256, 1, 0)).unwrap();
    for (exponent, degrees) in [(10.0f32, 0.0f32), (28.0, 40.0), (28.0, 75.0), (200.0, 60.0)] {
        let angle = degrees.to_radians();
        let lobe_axis = Vec3::new(angle.sin(), angle.cos(), 0.0);
        let shot = Shot {
            lobe: Rgb::ONE,
            lobe_axis,
            exponent,
            ..shot(Vec3::new(0.41, 0.0, 1.3), Vec3::Y)
        };
        let trace = &shooting.trace(&[shot]).unwrap()[0];
        let sum: f64 = trace.form_factor.iter().map(|f| f64::from(*f)).sum();
        assert!((sum - 1.0).abs() < 1e-4, "ΣΔF = {sum}");
        // ∫ (n+2)/(2π) cosⁿα cosθ dω = (n+2)/2 ΣΔF cosⁿα.
        let lobe: f64 = trace.lobe_factor.iter().map(|f| f64::from(*f)).sum();
        let albedo = (f64::from(exponent) + 2.0) / (2.0 * PI) * PI * lobe;
        let exact = lobe_albedo(f64::from(exponent), f64::from(angle.cos()));
        println!("n {exponent} at {degrees}°: {albedo:.5}, exact {exact:.5}, ΣΔF {sum:.6}");
        assert!(
            (albedo / exact - 1.0).abs() < 3e-3,
            "n {exponent} at {degrees}°: {albedo} {exact}"
        );
    }
}

/// A shooter half a millimetre from a wall loses nothing to a near plane.
#[test]
fn a_shooter_next_to_a_wall_loses_nothing() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let patched = Arc::new(PatchedScene::new(builder.build(), 100));
    let mut device = CpuDevice::new(Some(1)).unwrap();
    let mut shooting = device.begin(patched, &settings(128, 1, 0)).unwrap();
    for distance in [1e-1, 1e-2, 5e-4, 1e-5, 1e-6] {
        let trace = &shooting.trace(&[shot(Vec3::new(distance, 0.0, 0.5), Vec3::Y)]).unwrap()[0];
        let sum: f64 = trace.form_factor.iter().map(|f| f64::from(*f)).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{distance} m from the wall: ΣΔF = {sum}");
    }
}
