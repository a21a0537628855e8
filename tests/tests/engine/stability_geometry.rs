//! Geometry that strains hemicubes: each row on every device, each with a figure. The light that
//! strains is in `stability`; `docs/stability.md` has the table.

use glam::{DVec3, Vec2, Vec3};
use hemilux_engine::device::{Device, ShotTrace};
use hemilux_engine::hemicube::Shot;
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::made;
use hemilux_tests::devices::{Effort, means};
use hemilux_tests::oracle::quadrature::Rule;
use hemilux_tests::oracle::rays::Generator;
use hemilux_tests::oracle::statistics::{Moments, Scores};
use hemilux_tests::oracle::view_factors::{by_contour, by_lambert};
use hemilux_tests::scenes::{Builder, imported, settings};
use hemilux_tests::stability::*;
use hemilux_tests::twins::{metal, shot_at, total};
use serde_json::json;
use std::f64::consts::PI;
use std::sync::Arc;

const X: Vec3 = Vec3::X;
const Y: Vec3 = Vec3::Y;
const Z: Vec3 = Vec3::Z;

fn trace(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    resolution: u32,
    shots: &[Shot],
) -> Vec<ShotTrace> {
    let mut shooting = device.begin(scene.clone(), &settings(resolution, 1, 0)).expect("begins");
    shooting.trace(shots).expect("traces")
}

fn corners(corner: Vec3, u: Vec3, v: Vec3) -> Vec<DVec3> {
    [corner, corner + u, corner + u + v, corner + v].map(|p| p.as_dvec3()).to_vec()
}

/// Two rooms with a wall between them that ends `gap` short of the ceiling; a lamp in the first.
/// Odd dimensions, so that no edge falls on round numbers.
fn two_rooms(gap: f32) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.7));
    let light = builder.light(Rgb::ZERO, Rgb::splat(10.0));
    let (size, far) = (Vec3::new(1.037, 0.913, 1.171), 2.173);
    let height = Y * (size.y - gap);
    let floor = X * size.x;
    builder.quad(floor, Z * size.z, height, wall).quad(floor, height, Z * size.z, wall);
    for (start, end) in [(0.0, size.x), (size.x, far)] {
        let (x, y, z) = (X * (end - start), Y * size.y, Z * size.z);
        let corner = X * start;
        builder.quad(corner, z, x, wall).quad(corner + y, x, z, wall);
        builder.quad(corner, x, y, wall).quad(corner + z, y, x, wall);
    }
    builder.quad(Vec3::ZERO, Y * size.y, Z * size.z, wall);
    builder.quad(X * far, Z * size.z, Y * size.y, wall);
    builder.quad(Vec3::new(0.4, 0.912, 0.4), X * 0.3, Z * 0.3, light);
    Arc::new(PatchedScene::new(builder.build(), 300))
}

#[test]
fn sealed_wall() {
    let (sealed, gap) = (two_rooms(0.0), two_rooms(1e-3));
    on_every_device("sealed wall between two rooms", |device| {
        let behind = |device: &mut dyn Device, scene: &Arc<PatchedScene>| {
            let effort = Effort { burn_in: 0, batches: 4, iterations: 30 };
            let estimate = solved(device, scene, &settings(128, 8, 5), effort);
            let second = |i: usize| {
                let (x, normal) = (scene.patches.centroid[i].x, scene.patches.normal[i].x);
                x > 1.037 || (x == 1.037 && normal > 0.0)
            };
            let light = landed(scene, &estimate, 0, second);
            light / landed(scene, &estimate, 0, |_| true)
        };
        let (sealed, gap) = (behind(device, &sealed), behind(device, &gap));
        assert_eq!(sealed, 0.0, "light behind a sealed wall");
        assert!(gap > 3e-5, "a millimetre's gap goes unseen: {gap}");
        format!("share of the power behind it {sealed:e}; with a gap of 1 mm {gap:.1e}")
    });
}

/// A black box halved by a black wall with a slit of 1 mm, a lamp opposite: what passes follows
/// from the view factor between lamp and slit, though the slit is far narrower than a pixel.
#[test]
fn gap_of_a_millimetre() {
    let mut builder = Builder::default();
    let black = builder.lambertian(Rgb::ZERO);
    let light = builder.light(Rgb::ZERO, Rgb::ONE);
    builder.cuboid(Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0), true, black);
    let (low, slit) = (0.5, 1e-3);
    for (y, height) in [(0.0, low), (low + slit, 1.0 - low - slit)] {
        let corner = X + Y * y;
        builder.quad(corner, Z, Y * height, black).quad(corner, Y * height, Z, black);
    }
    let lamp = (Vec3::new(0.01, 0.3, 0.3), Y * 0.4, Z * 0.4);
    builder.quad(lamp.0, lamp.1, lamp.2, light);
    let scene = Arc::new(PatchedScene::new(builder.build(), 60));
    let opening = corners(X + Y * low, Z, Y * slit);
    let expected = emitted(&scene, 0)
        * by_contour(&corners(lamp.0, lamp.1, lamp.2), &opening, &Rule::gauss(24));
    let second = |patch: usize| {
        let (x, normal) = (scene.patches.centroid[patch].x, scene.patches.normal[patch].x);
        x > 1.0 || (x == 1.0 && normal > 0.0)
    };
    on_every_device("gap of 1 mm, pixels of 3 cm", |device| {
        let effort = Effort { burn_in: 1, batches: 30, iterations: 8 };
        let estimate = solved(device, &scene, &settings(64, 8, 7), effort);
        let seen = landed(&scene, &estimate, 0, second);
        let deviation = near(seen, expected, 0.08);
        format!(
            "power through it {deviation:+.1e} ({:.1e} of the lamp's)",
            seen / emitted(&scene, 0)
        )
    });
}

/// A hundred receivers of 5 mm side seen by pixels of 6 cm: each gets its light on average, and
/// together they get what their square gets.
#[test]
fn patches_below_a_pixel() {
    let mut builder = Builder::default();
    let black = builder.lambertian(Rgb::ZERO);
    let light = builder.light(Rgb::ZERO, Rgb::ONE);
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, black);
    let lamp = (Vec3::new(0.3, 0.99, 0.3), X * 0.4, Z * 0.4);
    builder.quad(lamp.0, lamp.1, lamp.2, light);
    let (corner, side) = (Vec3::new(0.35, 0.01, 0.42), 0.005);
    let small = builder.lambertian(Rgb::splat(0.5));
    for k in 0..100 {
        let (i, j) = ((k % 10) as f32, (k / 10) as f32);
        builder.quad(corner + X * (i * side) + Z * (j * side), Z * side, X * side, small);
    }
    let scene = Arc::new(PatchedScene::new(builder.build(), 60));
    let is_small = |patch: usize| scene.patches.diffuse[patch].x > 0.0;
    assert_eq!((0..scene.patches.len()).filter(|p| is_small(*p)).count(), 200);
    let square = corners(corner, Z * (10.0 * side), X * (10.0 * side));
    let lamp = corners(lamp.0, lamp.1, lamp.2);
    let rule = Rule::gauss(8);
    let expected = emitted(&scene, 0) * by_lambert(&lamp, &square, &rule);
    // Over so small a square the light is even.
    let irradiance = 3.0 * expected / (10.0 * f64::from(side)).powi(2);
    on_every_device("patches of 5 mm, pixels of 6 cm", |device| {
        let effort = Effort { burn_in: 1, batches: 40, iterations: 8 };
        let estimate = solved(device, &scene, &settings(32, 8, 3), effort);
        let power = near(landed(&scene, &estimate, 0, is_small), expected, 0.06);
        let small: Vec<Moments> =
            (0..scene.patches.len()).filter(|p| is_small(*p)).map(|p| estimate.sum[p]).collect();
        let scores = Scores::new(&small, &vec![irradiance; small.len()]);
        assert!(scores.rms < 1.6, "{scores:?}");
        format!("power {power:+.1e}; each z rms {:.2}", scores.rms)
    });
}

/// Every wall of a room twice at the same place: one of the two gets the light, none is lost, and
/// a shooter is not shaded by its double.
#[test]
fn coplanar_duplicates() {
    let room = |copies: usize| {
        let mut builder = Builder::default();
        let wall = builder.light(Rgb::splat(0.5), Rgb::ONE);
        for _ in 0..copies {
            builder.cuboid(Vec3::ZERO, Vec3::new(1.0, 1.3, 0.8), true, wall);
        }
        Arc::new(PatchedScene::new(builder.build(), 60 * copies))
    };
    let (once, twice) = (room(1), room(2));
    assert_eq!(twice.patches.len(), 2 * once.patches.len());
    let mut generator = Generator::new(5);
    let shots: Vec<_> = (0..12)
        .map(|_| {
            let [a, b, turn, jitter] = [(); 4].map(|()| generator.uniform() as f32);
            shot_at(Vec3::new(a, 0.0, 0.8 * b), Y, turn, Vec2::splat(jitter - 0.5))
        })
        .collect();
    on_every_device("coplanar duplicates", |device| {
        let single = trace(device, &once, 128, &shots);
        let double = trace(device, &twice, 128, &shots);
        let (mut worst_sum, mut worst_pair) = (0f64, 0f32);
        for (single, double) in single.iter().zip(&double) {
            worst_sum = worst_sum.max((total(&double.form_factor) - 1.0).abs());
            let half = single.form_factor.len();
            for (i, alone) in single.form_factor.iter().enumerate() {
                let pair = double.form_factor[i] + double.form_factor[half + i];
                worst_pair = worst_pair.max((pair - alone).abs());
            }
        }
        assert!(worst_sum < 1e-4 && worst_pair < 2e-4, "{worst_sum} {worst_pair}");
        // Both copies shine, and what lands on either is reflected.
        let estimate = solved(device, &twice, &settings(32, 8, 1), SHORT);
        let expected = closed_room(emitted(&twice, 0), 0.5, SHORT);
        let power = near(landed(&twice, &estimate, 0, |_| true), expected, 1e-3);
        format!(
            "|ΣΔF − 1| ≤ {worst_sum:.0e}, pairs as single ones to {worst_pair:.0e}, power {power:+.1e}"
        )
    });
}

/// Shooters on the edge, in the corner and on the plane of receivers.
#[test]
fn shooter_touches_a_receiver() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    // A block that stands on the floor against a wall.
    builder.cuboid(Vec3::new(0.0, 0.0, 0.3), Vec3::new(0.4, 0.5, 0.7), false, wall);
    let scene = Arc::new(PatchedScene::new(builder.build(), 200));
    let mut shots = Vec::new();
    for position in [
        Vec3::ZERO,
        Vec3::new(0.0, 0.0, 0.1),
        Vec3::new(0.4, 0.0, 0.5),
        Vec3::new(0.4, 0.0, 0.7),
        Vec3::new(0.4 + 1e-7, 0.0, 0.5),
        Vec3::new(0.2, 0.0, 0.5),
        Vec3::new(1.0, 0.0, 1.0),
    ] {
        for turn in [0.0, 0.1, 0.125] {
            shots.push(shot_at(position, Y, turn, Vec2::new(0.2, -0.3)));
        }
    }
    on_every_device("shooter touches receivers", |device| {
        let (mut largest, mut sum) = (0f32, 0f64);
        for trace in trace(device, &scene, 128, &shots) {
            assert!(trace.form_factor.iter().all(|f| f.is_finite() && *f >= 0.0));
            largest = trace.form_factor.iter().fold(largest, |a, b| a.max(*b));
            sum = sum.max(total(&trace.form_factor));
        }
        assert!(largest <= 1.0 && sum <= 1.0 + 1e-5, "{largest} {sum}");
        assert!(sum > 0.5, "nothing is seen: {sum}");
        format!("finite, largest F {largest:.3}, largest ΣΔF {sum:.6}")
    });
}

#[test]
fn near_plane_sweep() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let scene = Arc::new(PatchedScene::new(builder.build(), 100));
    // Below a millionth of the room's size a wall counts as lying in the shooter's plane.
    let distances: Vec<f32> = (0..=5).map(|power| 0.1f32.powi(power) * 0.3).collect();
    let shots: Vec<_> = distances
        .iter()
        .flat_map(|d| [0.5, *d].map(|z| shot_at(Vec3::new(*d, 0.0, z), Y, 0.37, Vec2::ZERO)))
        .collect();
    on_every_device("shooter 30 cm to 3 µm from walls", |device| {
        let traces = trace(device, &scene, 128, &shots);
        let worst = traces.iter().map(|trace| (total(&trace.form_factor) - 1.0).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 1e-4, "{worst}");
        format!("|ΣΔF − 1| ≤ {worst:.0e}")
    });
}

/// A mirror-like floor between shining walls: lobes far narrower than a pixel lose nothing on
/// average. Their albedo tends to ks·cosθ, two thirds of ks under even light.
#[test]
fn exponent_of_ten_thousand() {
    let mut builder = Builder::default();
    let floor = builder.material(metal(Rgb::splat(0.8), 1e4));
    let wall = builder.light(Rgb::ZERO, Rgb::ONE);
    builder.quad(Vec3::ZERO, Z, X, floor).quad(Y, X, Z, wall);
    builder.quad(Vec3::ZERO, X, Y, wall).quad(Z, Y, X, wall);
    builder.quad(Vec3::ZERO, Y, Z, wall).quad(X, Z, Y, wall);
    let scene = Arc::new(PatchedScene::new(builder.build(), 200));
    let glossy = |patch: usize| scene.patches.is_glossy(patch);
    let sample = (0..scene.patches.len()).find(|p| glossy(*p)).expect("a floor");
    let (ks, n) = (f64::from(scene.patches.specular[sample].x), scene.patches.exponent[sample]);
    assert!((n / 1e4 - 1.0).abs() < 0.01, "{n}");
    // Of the π W/m² that the floor receives its lobes send ks · 2 ∫ a(μ) μ dμ.
    let rule = Rule::gauss(64);
    let albedo =
        2.0 * rule.integrate(|mu| mu * hemilux_engine::radiometry::lobe_albedo(f64::from(n), mu));
    assert!((albedo - 2.0 / 3.0).abs() < 1e-3, "{albedo}");
    on_every_device("exponent 10⁴, pixels of 2°", |device| {
        let effort = Effort { burn_in: 10, batches: 30, iterations: 8 };
        let estimate = solved(device, &scene, &settings(64, 8, 2), effort);
        let received = landed(&scene, &estimate, 0, glossy);
        let floor = near(received, PI, 0.05);
        // What lands in all is what the five walls send, and what the floor sends on.
        let all = landed(&scene, &estimate, 0, |_| true);
        let reflected = near(all - 5.0 * PI, ks * albedo * PI, 0.1);
        format!("floor receives {floor:+.1e}, its lobes send {reflected:+.1e}")
    });
}

/// Triangles without area, with a corner twice, and needles change nothing but the warnings.
#[test]
fn degenerate_triangles() {
    let room = |extra: bool| {
        let mut builder = Builder::default();
        let wall = builder.light(Rgb::splat(0.5), Rgb::ONE);
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        if extra {
            // Edges along each other, of no length, and so thin that their area rounds to zero.
            builder.quad(Vec3::splat(0.5), X * 0.1, X * 0.2, wall);
            builder.quad(Vec3::splat(0.4), Vec3::ZERO, Y, wall);
            builder.quad(Vec3::splat(0.3), X * 1e-30, Y * 1e-30, wall);
        }
        PatchedScene::new(builder.build(), 60)
    };
    let (plain, extra) = (Arc::new(room(false)), Arc::new(room(true)));
    assert_eq!(extra.patches.len(), plain.patches.len());
    let warning = extra.warnings.first().expect("a warning");
    assert!(warning.what.starts_with("6 triangles without area"), "{warning:?}");
    // A needle of a micrometre's width is a triangle like any other.
    let mut builder = Builder::default();
    let wall = builder.light(Rgb::splat(0.5), Rgb::ONE);
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    builder.quad(Vec3::splat(0.5), X * 0.4, Y * 1e-6, wall);
    let needle = Arc::new(PatchedScene::new(builder.build(), 60));
    assert!(needle.patches.len() > plain.patches.len());
    on_every_device("degenerate triangles", |device| {
        let reference = solved(device, &plain, &settings(32, 8, 1), SHORT);
        let same = solved(device, &extra, &settings(32, 8, 1), SHORT);
        assert_eq!(means(&same.sum), means(&reference.sum), "left out, but not without trace");
        let estimate = solved(device, &needle, &settings(32, 8, 1), SHORT);
        let walls = landed(&needle, &estimate, 0, |p| needle.patches.area[p] > 1e-3);
        let deviation = near(walls, closed_room(6.0 * PI, 0.5, SHORT), 2e-3);
        format!("left out with a warning, same bits; needle of 1 µm: power {deviation:+.1e}")
    });
}

/// A node that mirrors its mesh: the room stays closed, fronts stay inside, light is mirrored.
#[test]
fn mirrored_node_transforms() {
    let plain = made::cornell();
    let length = u32::from_le_bytes(plain[12..16].try_into().expect("a GLB")) as usize;
    let mut root: serde_json::Value =
        serde_json::from_slice(&plain[20..20 + length]).expect("JSON");
    let binary = &plain[20 + length + 8..];
    for node in root["nodes"].as_array_mut().expect("nodes") {
        if node.get("mesh").is_some() {
            node["scale"] = json!([-1.0, 1.0, 1.0]);
        }
    }
    let mirrored = made::assemble(&root, binary);
    let cut = |glb: &[u8]| Arc::new(PatchedScene::new(imported(glb), 250));
    let (plain, mirrored) = (cut(&plain), cut(&mirrored));
    let count = plain.patches.len();
    assert_eq!(mirrored.patches.len(), count);
    let flip = |v: Vec3| Vec3::new(-v.x, v.y, v.z);
    // The patch at the mirrored place that faces the mirrored way.
    let partner: Vec<usize> = (0..count)
        .map(|i| {
            let (at, facing) = (flip(plain.patches.centroid[i]), flip(plain.patches.normal[i]));
            (0..count)
                .find(|&j| {
                    mirrored.patches.centroid[j].distance(at) < 1e-4
                        && mirrored.patches.normal[j].dot(facing) > 0.999
                })
                .unwrap_or_else(|| panic!("no patch mirrors {i}"))
        })
        .collect();
    on_every_device("mirrored node transforms", |device| {
        let effort = Effort { burn_in: 30, batches: 25, iterations: 10 };
        let a = solved(device, &plain, &settings(32, 8, 1), effort);
        let b = solved(device, &mirrored, &settings(32, 8, 2), effort);
        let reordered: Vec<Moments> = partner.iter().map(|j| b.sum[*j]).collect();
        let scores = Scores::between(&a.sum, &reordered);
        assert!(scores.is_chance(), "{scores:?}");
        let power = |scene, estimate| landed(scene, estimate, 1, |_| true);
        let deviation = near(power(&mirrored, &b), power(&plain, &a), 0.06);
        format!("patches z rms {:.2}, power {deviation:+.1e}", scores.rms)
    });
}

/// Something small a thousand kilometres away makes the bounds huge and must not matter.
#[test]
fn far_outlier() {
    let room = |outlier: bool| {
        let mut builder = Builder::default();
        let wall = builder.lambertian(Rgb::splat(0.5));
        let lamp = builder.light(Rgb::splat(0.5), Rgb::splat(10.0));
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        builder.quad(Vec3::new(0.4, 0.999, 0.4), X * 0.2, Z * 0.2, lamp);
        builder.quad(Vec3::new(0.4, 0.999, 0.4), Z * 0.2, X * 0.2, wall);
        if outlier {
            let far = Vec3::new(1e6, 1e6, -1e6);
            builder.quad(far, X, Y, wall);
        }
        Arc::new(PatchedScene::new(builder.build(), 60))
    };
    let (plain, far) = (room(false), room(true));
    on_every_device("outlier 10⁶ m away", |device| {
        let reference = solved(device, &plain, &settings(32, 8, 1), SHORT);
        let estimate = solved(device, &far, &settings(32, 8, 1), SHORT);
        let inside = |patch: usize| far.patches.centroid[patch].x < 10.0;
        let expected = closed_room(emitted(&far, 0), 0.5, SHORT);
        let deviation = near(landed(&far, &estimate, 0, inside), expected, 2e-3);
        let scores = Scores::between(&estimate.sum[..plain.patches.len()], &reference.sum);
        assert!(scores.is_chance(), "{scores:?}");
        let outside: f64 = landed(&far, &estimate, 0, |patch| !inside(patch));
        assert_eq!(outside, 0.0, "light left the closed room");
        format!("power in the room {deviation:+.1e}, patches z rms {:.2}", scores.rms)
    });
}

/// A lamp over a plain of 10 km in two patches, beside a room's worth of small ones: the plain gets
/// what its view factor says, in patches of 50 km².
#[test]
fn one_huge_patch() {
    let mut builder = Builder::default();
    let ground = builder.lambertian(Rgb::splat(0.5));
    let light = builder.light(Rgb::ZERO, Rgb::splat(100.0));
    let half = 5e3;
    builder.quad(Vec3::new(-half, 0.0, -half), Z * (2.0 * half), X * (2.0 * half), ground);
    let lamp = (Vec3::new(-0.5, 2.0, -0.5), X, Z);
    builder.quad(lamp.0, lamp.1, lamp.2, light);
    let table = (Vec3::new(-0.5, 1.0, -0.5), Z, X);
    builder.quad(table.0, table.1, table.2, ground);
    builder.quad(table.0, table.2, table.1, ground);
    let scene = Arc::new(PatchedScene::new(builder.build(), 2));
    let huge = |patch: usize| scene.patches.area[patch] > 1e6;
    assert_eq!((0..scene.patches.len()).filter(|p| huge(*p)).count(), 2);
    // What leaves the lamp lands on the table or the ground; the ground sees nothing of the rest.
    let on_table = by_contour(
        &corners(lamp.0, lamp.1, lamp.2),
        &corners(table.0, table.1, table.2),
        &Rule::gauss(16),
    );
    on_every_device("one huge patch", |device| {
        let phi = emitted(&scene, 0);
        let mut lit = Moments::default();
        let mut tabled = Moments::default();
        // First iterations only: direct light, by seed.
        for seed in 0..20 {
            let effort = Effort { burn_in: 0, batches: 1, iterations: 1 };
            let estimate = solved(device, &scene, &settings(64, 16, seed), effort);
            lit.push(landed(&scene, &estimate, 0, huge));
            tabled.push(landed(&scene, &estimate, 0, |p| {
                !huge(p) && scene.patches.normal[p].y > 0.5
            }));
        }
        let ground = near(lit.mean(), phi * (1.0 - on_table), 5e-3);
        let table = near(tabled.mean(), phi * on_table, 1e-2);
        let long = Effort { burn_in: 20, batches: 10, iterations: 10 };
        let estimate = solved(device, &scene, &settings(64, 4, 1), long);
        let both = landed(&scene, &estimate, 0, |_| true);
        // The ground's light goes to the sky but for what the table's underside catches.
        assert!(both >= 0.999 * phi && both < 1.5 * phi, "{both} of {phi}");
        format!("ground {ground:+.1e}, table {table:+.1e} of their view factors")
    });
}
