//! Scenes that strain the light: each row on every device, each with a figure. The geometry that
//! strains is in `stability_geometry`; `docs/stability.md` has the table.

use glam::Vec3;
use hemilux_engine::device::{Selection, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::{Reflectance, Rgb};
use hemilux_engine::render::{Limits, RenderRequest, StopReason};
use hemilux_engine::scene::{Environment, Material, Scene, made};
use hemilux_tests::comparison::largest_relative_deviation;
use hemilux_tests::devices::{Effort, means};
use hemilux_tests::oracle::paths::Walks;
use hemilux_tests::oracle::rays::Generator;
use hemilux_tests::oracle::statistics::Scores;
use hemilux_tests::scenes::{Builder, imported, settings};
use hemilux_tests::stability::*;
use std::f64::consts::PI;
use std::sync::Arc;

fn request(scene: Arc<Scene>, iterations: u64, options: &[(&str, &str)]) -> RenderRequest {
    RenderRequest {
        limits: Limits::iterations(iterations),
        options: options
            .iter()
            .map(|(name, value)| (name.to_string(), value.to_string()))
            .collect(),
        ..RenderRequest::new(scene, "stochastic", [24; 2])
    }
}

/// A closed unit box of one albedo with a lamp of 20 × 20 cm that hangs under the ceiling.
fn lamp_room(albedo: f32, emission: Rgb) -> Arc<PatchedScene> {
    room_with_lamp(albedo, emission, 0.2, 100)
}

fn room_with_lamp(albedo: f32, emission: Rgb, side: f32, patches: usize) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(albedo));
    let lamp = builder.light(Rgb::splat(albedo), emission);
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let corner = Vec3::new(0.45, 0.999, 0.4);
    builder.quad(corner, Vec3::X * side, Vec3::Z * side, lamp);
    // The lamp's back is black; it would take light from the ceiling.
    builder.quad(corner, Vec3::Z * side, Vec3::X * side, wall);
    Arc::new(PatchedScene::new(builder.build(), patches))
}

#[test]
fn uniform_furnace() {
    let scene = imported(&made::furnace(Rgb::splat(0.5), Rgb::ONE));
    let scene = Arc::new(PatchedScene::new(scene, 48));
    on_every_device("uniform furnace, a = .5", |device| {
        let estimate = solved(device, &scene, &settings(32, 8, 1), SHORT);
        let expected = closed_room(emitted(&scene, 0), 0.5, SHORT);
        let total = near(landed(&scene, &estimate, 0, |_| true), expected, 1e-3);
        // E = π L = 2π everywhere.
        let exact = vec![3.0 * 2.0 * PI; estimate.sum.len()];
        let scores = Scores::new(&estimate.sum, &exact);
        assert!(scores.is_chance(), "{scores:?}");
        assert!(!Scores::new(&estimate.sum, &vec![3.6 * 2.0 * PI; exact.len()]).is_chance());
        let worst = largest_relative_deviation(&means(&estimate.sum), exact[0]);
        format!("mean {total:+.1e}, patches {worst:.1e} (z rms {:.2})", scores.rms)
    });
}

#[test]
fn albedo_just_below_one() {
    let scene = imported(&made::furnace(Rgb::splat(0.99), Rgb::ONE));
    let scene = Arc::new(PatchedScene::new(scene, 12));
    let effort = Effort { burn_in: 700, batches: 10, iterations: 20 };
    on_every_device("uniform furnace, a = .99", |device| {
        let estimate = solved(device, &scene, &settings(16, 2, 1), effort);
        let expected = closed_room(emitted(&scene, 0), 0.99, effort);
        let seen = landed(&scene, &estimate, 0, |_| true);
        let deviation = near(seen, expected, 2e-3);
        // L = 1/(1 − .99) = 100 over six walls of 1 m².
        let radiance = seen / (6.0 * PI);
        near(radiance, 100.0, 5e-3);
        format!("L = {radiance:.2} (of 100; {deviation:+.1e} from the sum of its bounces)")
    });
}

/// A closed room that absorbs nothing has no equilibrium: after m iterations there are m times
/// the emitted power. More than 1 is not possible: the import clamps factors with a warning.
#[test]
fn albedo_of_one_and_more() {
    let effort = Effort { burn_in: 0, batches: 4, iterations: 10 };
    let scene = imported(&made::furnace(Rgb::ONE, Rgb::ONE));
    let scene = Arc::new(PatchedScene::new(scene, 12));
    on_every_device("uniform furnace, a = 1", |device| {
        let estimate = solved(device, &scene, &settings(32, 4, 1), effort);
        let expected = closed_room(emitted(&scene, 0), 1.0, effort);
        near(expected, emitted(&scene, 0) * 20.5, 1e-12);
        let deviation = near(landed(&scene, &estimate, 0, |_| true), expected, 2e-3);
        format!("mean power of 40 iterations 20.5 Φ {deviation:+.1e}")
    });
    let over = imported(&made::furnace(Rgb::splat(1.5), Rgb::ONE));
    let clamped = over.warnings.iter().find(|warning| warning.at.contains("baseColorFactor"));
    let clamped = clamped.expect("a warning");
    assert!(clamped.what.contains("clamped"), "{clamped:?}");
    assert_eq!(over.materials[0].base_color, Rgb::ONE);
    println!("| albedo 1.5 | import | {}: {} |", clamped.at, clamped.what);
}

/// No material that a file can hold reflects more than all light.
#[test]
fn diffuse_and_specular_above_one() {
    let mut largest = 0f32;
    let steps = [0.0, 0.3, 0.7, 1.0];
    for metallic in steps {
        for roughness in steps {
            for specular_factor in steps {
                for (ior, tint) in [(1.0, 1.0), (1.5, 1e4), (3.0, 1.0), (1e4, 1e4)] {
                    let material = Material {
                        metallic,
                        roughness,
                        specular_factor,
                        ior,
                        specular_color: Rgb::new(tint, 1.0, 0.0),
                        ..Material::default()
                    };
                    let Reflectance { diffuse, specular, .. } =
                        material.reflectance(&material.appearance(Rgb::ONE));
                    largest = largest.max((diffuse + specular).max_element());
                    assert!(diffuse.min_element() >= 0.0 && specular.min_element() >= 0.0);
                }
            }
        }
    }
    assert!(largest <= 1.0 + 1e-6, "{largest}");
    assert!(largest > 0.99, "the corner of the range was not tried");
    println!("| kd + ks > 1 | materials | largest kd + ks {largest:.7} |");

    // As authored kd .7 + ks .8; what the engine makes of it keeps a closed room in balance.
    let mut builder = Builder::default();
    let mut wall = Material::phong("too much", Rgb::splat(0.7), 0.8, 20.0);
    wall.emission = Rgb::ONE;
    let reflectance = wall.reflectance(&wall.appearance(wall.base_color));
    let wall = builder.material(wall);
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let scene = Arc::new(PatchedScene::new(builder.build(), 600));
    let total = reflectance.diffuse.x + reflectance.specular.x;
    assert!((total - 1.0).abs() < 1e-6, "{total}");
    let walks = Walks::new(&scene);
    let mut generator = Generator::new(2);
    let patches = (0..scene.patches.len()).step_by(12);
    let walked: f64 =
        patches.clone().map(|p| walks.irradiance(p, 500, &mut generator).mean()).sum();
    let walked = walked / patches.count() as f64 / PI;
    on_every_device("kd .7 + ks .8 authored", |device| {
        let effort = Effort { burn_in: 60, batches: 8, iterations: 15 };
        let estimate = solved(device, &scene, &settings(32, 8, 1), effort);
        let seen = landed(&scene, &estimate, 0, |_| true) / (6.0 * PI);
        // Only what a(θ) loses is absorbed, and patches of this size know angles roughly.
        let deviation = near(seen, walked, 0.1);
        format!("kd + ks = {total:.4}; L = {seen:.2}, random walks {walked:.2} ({deviation:+.1e})")
    });
}

/// Nothing sees a convex body but outside: every shot is the emitter's and lands nowhere.
#[test]
fn convex_emitter_alone() {
    let mut builder = Builder::default();
    let light = builder.light(Rgb::splat(0.7), Rgb::splat(5.0));
    builder.cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), false, light);
    let scene = Arc::new(PatchedScene::new(builder.build(), 60));
    on_every_device("convex emitter alone", |device| {
        let estimate = solved(device, &scene, &settings(32, 4, 1), SHORT);
        assert_eq!(checked_largest(&estimate.sum), 0.0);
        assert_eq!(estimate.tally.light_shots, estimate.tally.shots);
        "E = 0 exactly; all shots the light's".into()
    });
}

#[test]
fn no_lights() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.7));
    builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
    let scene = builder.build();
    let patched = Arc::new(PatchedScene::new(scene.clone(), 60));
    on_every_device("no lights", |device| {
        let estimate = solved(device, &patched, &settings(32, 4, 1), SHORT);
        assert_eq!((checked_largest(&estimate.sum), estimate.tally.shots), (0.0, 0));
        let environment = Some(Arc::new(Environment::none()));
        let dark = RenderRequest { environment, ..request(scene.clone(), 5, &[]) };
        let rendered = rendered(device, &dark);
        assert_eq!(rendered.stats.stopped, StopReason::NoLight);
        assert!(rendered.picture.pixels.iter().all(|pixel| *pixel == Rgb::ZERO));
        let warned =
            rendered.stats.warnings.iter().any(|warning| warning.what.contains("gives light"));
        assert!(warned, "{:?}", rendered.stats.warnings);
        "0 shots, black picture, stops at once with a warning".into()
    });
}

/// A lamp of 1 mm² lights a room of 6 m² as one of 4 dm² of the same power.
#[test]
fn light_of_a_millionth_of_the_area() {
    let scene = room_with_lamp(0.5, Rgb::splat(1e6), 1e-3, 100);
    let lamp = (0..scene.patches.len()).filter(|p| scene.patches.emits(*p)).collect::<Vec<_>>();
    let area: f32 = lamp.iter().map(|p| scene.patches.area[*p]).sum();
    assert!((area / 1e-6 - 1.0).abs() < 1e-3, "{area}");
    let phi = emitted(&scene, 0);
    on_every_device("light of 10⁻⁶ of the area", |device| {
        let estimate = solved(device, &scene, &settings(64, 8, 2), SHORT);
        let on_walls = landed(&scene, &estimate, 0, |_| true);
        let deviation = near(on_walls, closed_room(phi, 0.5, SHORT), 2e-3);
        format!("power in the room {deviation:+.1e}")
    });
}

/// Two sealed rooms, a light of 10⁹ in one and of 1 in the other. By power the dim room is never
/// picked, so it stays dark and shows nothing false; by uniform picks both are right.
#[test]
fn two_lights_a_billion_to_one() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.3));
    let bright = builder.light(Rgb::splat(0.3), Rgb::splat(1e9));
    let dim = builder.light(Rgb::splat(0.3), Rgb::ONE);
    for (x, light) in [(0.0, bright), (5.0, dim)] {
        let low = Vec3::X * x;
        let (a, b) = (Vec3::X, Vec3::Z);
        builder.quad(low, b, a, wall).quad(low + Vec3::Y, a, b, light);
        for (corner, u, v) in
            [(low, a, Vec3::Y), (low + b, Vec3::Y, a), (low, Vec3::Y, b), (low + a, b, Vec3::Y)]
        {
            builder.quad(corner, u, v, wall);
        }
    }
    let scene = Arc::new(PatchedScene::new(builder.build(), 24));
    let second = |patch: usize| scene.patches.centroid[patch].x > 3.0;
    let total = closed_room(PI * 1e9, 0.3, SHORT);
    on_every_device("two lights, 10⁹ : 1", |device| {
        let estimate = solved(device, &scene, &settings(32, 8, 3), SHORT);
        let deviation = near(landed(&scene, &estimate, 0, |p| !second(p)), total, 2e-3);
        let dim = landed(&scene, &estimate, 0, second);
        assert!(dim < 0.1 * total, "{dim}");
        format!("bright room {deviation:+.1e}; dim room {dim:.1e} W of 4.5 (never picked)")
    });
    let uniform = ShootingSettings { selection: Selection::Uniform, ..settings(32, 24, 3) };
    uniform_lights(&scene, &uniform, second);
}

fn uniform_lights(
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    second: impl Fn(usize) -> bool,
) {
    let effort = Effort { burn_in: 20, batches: 10, iterations: 6 };
    on_every_device("two lights, 10⁹ : 1, uniform picks", |device| {
        let estimate = solved(device, scene, settings, effort);
        // Each of the 24 patches shoots once an iteration, so all power is shot here too.
        let expected = closed_room(PI, 0.3, effort);
        let bright = landed(scene, &estimate, 0, |p| !second(p));
        let bright = near(bright, 1e9 * expected, 2e-3);
        let dim = near(landed(scene, &estimate, 0, &second), expected, 2e-3);
        format!("bright room {bright:+.1e}, dim room {dim:+.1e}")
    });
}

/// Radiance has no length in it: a scene a million times as large or small looks the same.
#[test]
fn scenes_scaled_by_a_million() {
    let scaled = |factor: f32| {
        let mut scene = (*lamp_room(0.5, Rgb::new(10.0, 8.0, 5.0)).scene).clone();
        scene.vertices.iter_mut().for_each(|vertex| vertex.position *= factor);
        Arc::new(PatchedScene::new(Arc::new(scene), 100))
    };
    let plain = scaled(1.0);
    on_every_device("scene scaled by 10^±6", |device| {
        let reference = solved(device, &plain, &settings(32, 8, 5), SHORT);
        let mut seen = Vec::new();
        for factor in [1e-6f32, 1e6] {
            let scene = scaled(factor);
            assert_eq!(scene.patches.len(), plain.patches.len());
            let estimate = solved(device, &scene, &settings(32, 8, 5), SHORT);
            let expected = closed_room(emitted(&scene, 1), 0.5, SHORT);
            let deviation = near(landed(&scene, &estimate, 1, |_| true), expected, 2e-3);
            let scores = Scores::between(&estimate.sum, &reference.sum);
            assert!(scores.is_chance(), "× {factor}: {scores:?}");
            seen.push(format!("× {factor:e}: power {deviation:+.1e}, z rms {:.2}", scores.rms));
        }
        // By powers of two nothing is rounded, so nothing at all may change.
        for power in [-20, 20] {
            let scene = scaled(2f32.powi(power));
            let estimate = solved(device, &scene, &settings(32, 8, 5), SHORT);
            let same = means(&estimate.sum).iter().zip(means(&reference.sum)).all(|(a, b)| *a == b);
            assert!(same, "× 2^{power} is not the same bit for bit");
        }
        seen.push("× 2^±20: same bits".into());
        seen.join("; ")
    });
}

/// A square that shines into a black room, from one side or both.
#[test]
fn one_sided_and_two_sided_emitters() {
    for two_sided in [false, true] {
        let mut builder = Builder::default();
        let wall = builder.lambertian(Rgb::ZERO);
        let light = builder.material(Material {
            emission: Rgb::ONE,
            double_sided: two_sided,
            ..Material::lambertian("light", Rgb::ZERO)
        });
        builder.cuboid(Vec3::ZERO, Vec3::ONE, true, wall);
        builder.quad(Vec3::new(0.3, 0.5, 0.3), Vec3::Z * 0.4, Vec3::X * 0.4, light);
        let scene = Arc::new(PatchedScene::new(builder.build(), 60));
        let up = |patch: usize| scene.patches.centroid[patch].y > 0.5;
        let down = |patch: usize| scene.patches.centroid[patch].y < 0.5;
        let phi = PI * 0.16;
        on_every_device(
            if two_sided { "two-sided emitter" } else { "one-sided emitter" },
            |device| {
                let effort = Effort { burn_in: 1, ..SHORT };
                let estimate = solved(device, &scene, &settings(64, 8, 1), effort);
                let sides = if two_sided { 2.0 } else { 1.0 };
                let total = near(landed(&scene, &estimate, 0, |_| true), sides * phi, 1e-3);
                let (above, below) = (
                    landed(&scene, &estimate, 0, up) / phi,
                    landed(&scene, &estimate, 0, down) / phi,
                );
                if two_sided {
                    // Patches that straddle the height of the lamp belong to both halves.
                    assert!(above > 0.8 && below > 0.8, "{above} {below}");
                } else {
                    assert!(above > 0.8 && below < 0.2, "{above} {below}");
                }
                format!("power {total:+.1e}; above {above:.2} Φ, below {below:.2} Φ")
            },
        );
    }
}

/// A red and a cyan lamp in a grey room: each channel has its own lamp's power.
#[test]
fn complementary_lights() {
    let mut builder = Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    let red = builder.light(Rgb::splat(0.5), Rgb::new(1.0, 0.0, 0.0));
    let cyan = builder.light(Rgb::splat(0.5), Rgb::new(0.0, 1.0, 1.0));
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    builder.quad(Vec3::ZERO, z, x, wall).quad(y, x, z, wall);
    builder.quad(Vec3::ZERO, x, y, wall).quad(z, y, x, wall);
    builder.quad(Vec3::ZERO, y, z, red).quad(x, z, y, cyan);
    let scene = Arc::new(PatchedScene::new(builder.build(), 60));
    on_every_device("red and cyan lights", |device| {
        let estimate = solved(device, &scene, &settings(32, 8, 4), SHORT);
        let channels = [0, 1, 2].map(|channel| {
            // By luminance: the sum over channels is exact in luminance only.
            let expected = closed_room(emitted(&scene, channel), 0.5, SHORT);
            near(landed(&scene, &estimate, channel, |_| true), expected, 0.05)
        });
        format!("power of R, G, B {:+.1e}, {:+.1e}, {:+.1e}", channels[0], channels[1], channels[2])
    });
}
