//! Glossy reflection against oracles that know the albedo at every angle and no patches.

use glam::{DVec3, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Faces, KnownLight, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::{Rgb, lobe_albedo};
use hemilux_engine::scene::Material;
use hemilux_tests::devices::{Effort, estimate};
use hemilux_tests::oracle::paths::Walks;
use hemilux_tests::oracle::rays::{Generator, Hit, Sequence, World, cosine_direction};
use hemilux_tests::scenes::{Builder, settings};
use std::cell::RefCell;
use std::f64::consts::PI;
use std::sync::Arc;

/// A closed box whose floor is glossy; all other walls shine and reflect nothing.
fn glossy_floor(specular: f32, exponent: f32) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let floor = builder.material(Material::phong("floor", Rgb::splat(0.1), specular, exponent));
    let wall = builder.light(Rgb::ZERO, Rgb::ONE);
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    builder.quad(Vec3::ZERO, z, x, floor).quad(y, x, z, wall);
    builder.quad(Vec3::ZERO, x, y, wall).quad(z, y, x, wall);
    builder.quad(Vec3::ZERO, y, z, wall).quad(x, z, y, wall);
    Arc::new(PatchedScene::new(builder.build(), 900))
}

/// What a glossy floor under walls of radiance 1 sends, as mean irradiance of the walls.
struct Reflected {
    /// With the albedo a(θ) at the angle of each ray.
    by_ray: f64,
    /// With the albedo at the angle seen from the patch's centroid, which is where a patch keeps
    /// the directions that its light comes from: what iteration expects.
    by_centroid: f64,
    /// With kd + ks at every angle, which is wrong.
    constant: f64,
    /// What the walls receive of each other.
    direct: f64,
}

impl Reflected {
    fn new(scene: &PatchedScene) -> Self {
        const RAYS: u64 = 1000;
        let (world, patches) = (World::new(scene), &scene.patches);
        let mut sums = [0.0; 4];
        let mut wall_area = 0.0;
        for patch in 0..world.len() {
            let floor = patches.is_glossy(patch);
            let albedo = |direction: DVec3| {
                let cosine = direction.normalize().dot(world.normal(patch));
                let [kd, ks] = [patches.diffuse[patch].x, patches.specular[patch].x];
                let exponent = f64::from(patches.exponent[patch]);
                f64::from(kd) + f64::from(ks) * table(exponent, cosine)
            };
            let share = PI * world.area(patch) / RAYS as f64;
            let sequence = Sequence::new(patch as u64);
            for index in 0..RAYS {
                let [a, b, c, d] = sequence.point(index);
                let direction = cosine_direction(world.normal(patch), c, d);
                let hit = world.cast(patch, world.point(patch, a, b), direction);
                let Hit::Patch { patch: hit, point } = hit else { panic!("a hole: {hit:?}") };
                if floor {
                    let from_centroid = point - patches.centroid[patch].as_dvec3();
                    sums[0] += share * albedo(direction);
                    sums[1] += share * albedo(from_centroid);
                    sums[2] += share * albedo(world.normal(patch));
                } else if !patches.is_glossy(hit) {
                    sums[3] += share;
                }
            }
            if !floor {
                wall_area += world.area(patch);
            }
        }
        let [by_ray, by_centroid, constant, direct] = sums.map(|sum| sum / wall_area);
        Self { by_ray, by_centroid, constant, direct }
    }
}

/// [`lobe_albedo`] from a table in f64 of the last exponent: the quadrature is slow.
fn table(exponent: f64, cosine: f64) -> f64 {
    const STEPS: usize = 256;
    thread_local! {
        static LAST: RefCell<(f64, Vec<f64>)> = const { RefCell::new((f64::NAN, Vec::new())) };
    }
    LAST.with_borrow_mut(|(of, values)| {
        if *of != exponent {
            let at = |i: usize| lobe_albedo(exponent, i as f64 / STEPS as f64);
            (*of, *values) = (exponent, (0..=STEPS).map(at).collect());
        }
        let at = cosine.clamp(0.0, 1.0) * STEPS as f64;
        let low = (at as usize).min(STEPS - 1);
        values[low] + (at - low as f64) * (values[low + 1] - values[low])
    })
}

/// Walls of radiance 1 light a glossy floor, and all that it reflects lands on them: a(θ) of what
/// falls on it. With ks alone, as if the albedo did not fall with the angle, it would be more.
#[test]
fn a_glossy_floor_reflects_by_its_albedo_at_each_angle() {
    let mut device = CpuDevice::new(None).expect("threads");
    for (specular, exponent) in [(0.6, 8.0), (0.8, 60.0)] {
        let scene = glossy_floor(specular, exponent);
        let expected = Reflected::new(&scene);
        let direct = expected.direct;
        let base = settings(64, 8, 2);
        let faces = |faces| ShootingSettings { faces, ..base.clone() };
        // Closed, so a constant K causes the irradiance πK everywhere.
        let patches = scene.patches.len();
        let known = KnownLight {
            radiance: vec![Rgb::splat(0.6); patches],
            irradiance: vec![Rgb::splat(0.6 * std::f32::consts::PI); patches],
        };
        let switches = [
            ("none", base.clone()),
            ("faces of specular shooters", faces(Faces::Specular)),
            ("the paper's faces", faces(Faces::Randomised)),
            ("known constant", ShootingSettings { known: Some(Arc::new(known)), ..base.clone() }),
        ];
        for (switch, settings) in switches {
            let plain = switch == "none";
            // A face in ten, ten times as bright, is noisy.
            let iterations = if plain { 100 } else { 120 };
            let effort = Effort { burn_in: 5, batches: 20, iterations };
            let estimate = estimate(&mut device, &scene, &settings, effort);
            let (mut sum, mut area) = (0.0, 0.0);
            for patch in (0..patches).filter(|p| !scene.patches.is_glossy(*p)) {
                let own = f64::from(scene.patches.area[patch]);
                sum += own * estimate.channels[0][patch].mean();
                area += own;
            }
            let error = estimate.landed[0].standard_error() / area / expected.by_centroid;
            let [centroid, ray, constant] =
                [expected.by_centroid, expected.by_ray, expected.constant]
                    .map(|e| (sum / area - direct) / e - 1.0);
            let name = format!("ks {specular}, n {exponent}, {switch}");
            println!(
                "{name}: {centroid:+.4} ± {error:.4} of a(θ) at centroids, {ray:+.4} of a(θ), \
                 {constant:+.4} of kd + ks"
            );
            let bound = if plain { 0.01 } else { 0.01 + 4.0 * error };
            assert!(centroid.abs() < bound, "{name}: {centroid}");
            assert!(error < 0.03, "{name}: {error}");
            // One direction a patch costs this much where light falls in at short distance.
            assert!(!plain || ray.abs() < 0.03, "{name}: {ray}");
            assert!(constant.abs() > 0.1, "{name}: a constant albedo passed");
        }
    }
}

/// Irradiance of the walls of a closed box that all shine, reflect diffusely and glossily, against
/// random walks.
#[test]
fn a_glossy_furnace_is_as_bright_as_random_walks_say() {
    let mut device = CpuDevice::new(None).expect("threads");
    let mut builder = Builder::default();
    let material = |emission: f32| Material {
        emission: Rgb::splat(emission),
        ..Material::phong("wall", Rgb::splat(0.2), 0.5, 10.0)
    };
    let (dim, bright) = (builder.material(material(0.5)), builder.material(material(2.0)));
    builder.cuboid(Vec3::ZERO, Vec3::new(1.0, 1.3, 0.8), true, dim);
    let mut scene = (*builder.build()).clone();
    for triangle in &mut scene.triangles[..2] {
        triangle.material = bright;
    }
    let scene = Arc::new(PatchedScene::new(Arc::new(scene), 1500));
    let walks = Walks::new(&scene);
    let mut generator = Generator::new(1);
    let effort = Effort { burn_in: 60, batches: 20, iterations: 100 };
    let estimate = estimate(&mut device, &scene, &settings(32, 8, 9), effort);
    for normal in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
        let (mut walked, mut shot, mut area) = (0.0, 0.0, 0.0);
        for patch in 0..scene.patches.len() {
            if scene.patches.normal[patch].dot(normal) > 0.9 {
                let own = f64::from(scene.patches.area[patch]);
                walked += own * walks.irradiance(patch, 200, &mut generator).mean();
                shot += own * estimate.channels[0][patch].mean();
                area += own;
            }
        }
        let deviation = shot / walked - 1.0;
        println!("{normal}: walks {:.4}, shots {:+.4}", walked / area, deviation);
        assert!(deviation.abs() < 0.03, "{normal}: {deviation}");
    }
}
