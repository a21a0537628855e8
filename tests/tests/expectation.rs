//! What iteration converges to, against systems that are solved densely, and what one iteration
//! expects to do, against one application of the transport operator.

use glam::{DVec3, Vec2, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Device, Faces, KnownLight, Selection, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::{Rgb, lobe_albedo};
use hemilux_engine::scene::Material;
use hemilux_tests::devices::{Effort, Estimate, all, estimate, means};
use hemilux_tests::oracle::paths::Walks;
use hemilux_tests::oracle::quadrature::Rule;
use hemilux_tests::oracle::radiosity::Radiosity;
use hemilux_tests::oracle::rays::{Generator, Hit, Sequence, World, cosine_direction};
use hemilux_tests::oracle::rooms;
use hemilux_tests::oracle::statistics::{Moments, Scores, chi_square};
use hemilux_tests::oracle::view_factors::{by_contour, point_to_polygon};
use hemilux_tests::scenes::{Builder, settings};
use hemilux_tests::twins::shot_at;
use std::cell::RefCell;
use std::f64::consts::PI;
use std::sync::Arc;

/// How far an estimate is from a dense solution.
#[derive(Debug)]
struct Agreement {
    scores: Scores,
    /// Relative deviation of the area-weighted mean.
    mean: f64,
}

impl Agreement {
    fn new(system: &Radiosity, solution: &[Moments], estimate: &Estimate) -> Self {
        let scores = Scores::between(&estimate.sum, solution);
        let mean = system.mean(&means(&estimate.sum)) / system.mean(&means(solution)) - 1.0;
        Self { scores, mean }
    }

    fn holds(&self) -> bool {
        self.scores.is_chance() && self.mean.abs() < 0.01
    }
}

#[test]
fn iteration_converges_to_the_dense_solution() {
    let mut device = CpuDevice::new(None).expect("threads");
    let effort = Effort { burn_in: 60, batches: 40, iterations: 100 };
    for (name, scene) in [
        ("closed box", rooms::closed()),
        ("box with a block", rooms::with_block()),
        ("open box", rooms::open()),
        ("two rooms", rooms::two_rooms()),
    ] {
        assert!(scene.patches.len() <= 220, "{name}: {} patches", scene.patches.len());
        let system = Radiosity::by_rays(&scene, 2_000, 99);
        let solution = Radiosity::solve_by_rays(&scene, 2_000, 8);
        let estimate = estimate(&mut device, &scene, &settings(64, 8, 4), effort);
        let agreement = Agreement::new(&system, &solution, &estimate);
        println!("{name}, {} patches: {agreement:?}", scene.patches.len());
        assert!(agreement.holds(), "{name}: {agreement:?}");

        // Planted: 2 % too much light; the neighbours' light; form factors read the wrong way.
        let planted = |wrong: &[f64]| {
            let wrong: Vec<Moments> = wrong.iter().copied().map(Moments::exact).collect();
            !Agreement::new(&system, &wrong, &estimate).holds()
        };
        let brighter: Vec<f64> = solution.iter().map(|e| 1.02 * e.mean()).collect();
        assert!(planted(&brighter), "{name}: 2 % too much passed");
        let mut rotated = means(&solution);
        rotated.rotate_right(1);
        assert!(planted(&rotated), "{name}: the neighbours' light passed");
        let n = system.len();
        let transposed =
            (0..n).map(|i| (0..n).map(|j| system.form_factors[j][i]).collect()).collect();
        let wrong = Radiosity::new(&scene, transposed, system.lost.clone()).solve_sum();
        assert!(planted(&wrong), "{name}: F_ji passed for F_ij");
    }
}

/// Form factors between the three faces of a corner by contour integrals.
fn corner_system(scene: &PatchedScene) -> Radiosity {
    let rule = Rule::graded(10, 25);
    let faces: Vec<Vec<DVec3>> = scene
        .facets
        .iter()
        .map(|facet| {
            facet.corners.iter().map(|p| scene.positions[*p as usize].as_dvec3()).collect()
        })
        .collect();
    let factors: Vec<Vec<f64>> = (0..3)
        .map(|i| {
            let factor =
                |j: usize| if i == j { 0.0 } else { by_contour(&faces[i], &faces[j], &rule) };
            (0..3).map(factor).collect()
        })
        .collect();
    let lost = factors.iter().map(|row| 1.0 - row.iter().sum::<f64>()).collect();
    Radiosity::new(scene, factors, lost)
}

/// The switches that leave the expectation as it is, one line each.
fn unbiased(scene: &PatchedScene, system: &Radiosity) -> Vec<(&'static str, ShootingSettings)> {
    let base = |k| settings(32, k, 0);
    let faces = |faces| ShootingSettings { faces, ..base(4) };
    let known =
        |closed| ShootingSettings { known: Some(constant(scene, system, closed)), ..base(4) };
    vec![
        ("one shot", base(1)),
        ("two shots", base(2)),
        ("eight shots", base(8)),
        ("no random azimuth", ShootingSettings { random_azimuth: false, ..base(4) }),
        ("no jitter", ShootingSettings { jitter: false, ..base(4) }),
        ("independent picks", ShootingSettings { stratified: false, ..base(4) }),
        ("uniform picks", ShootingSettings { selection: Selection::Uniform, ..base(4) }),
        ("faces of specular shooters", faces(Faces::Specular)),
        ("top and one side", faces(Faces::TopAndSide)),
        ("the paper's faces", faces(Faces::Randomised)),
        ("known constant", known(false)),
        ("known constant as if closed", known(true)),
    ]
}

/// A constant radiance that is known, with the irradiance that it causes: π V_i K, or π K as if
/// the scene were closed.
fn constant(scene: &PatchedScene, system: &Radiosity, closed: bool) -> Arc<KnownLight> {
    let radiance = Rgb::new(0.6, 0.9, 1.4);
    let visible = |i: usize| if closed { 1.0 } else { 1.0 - system.lost[i] as f32 };
    let patches = 0..scene.patches.len();
    let irradiance =
        patches.clone().map(|i| radiance * (visible(i) * std::f32::consts::PI)).collect();
    Arc::new(KnownLight { radiance: patches.map(|_| radiance).collect(), irradiance })
}

/// Mean irradiance of one channel after `count` iterations, known light included: with L = K + ΔL
/// the iteration starts at ΔL = L^e − K + kd E_K/π and keeps that as its source.
fn expected(
    system: &Radiosity,
    channel: usize,
    count: usize,
    known: Option<&KnownLight>,
) -> Vec<f64> {
    let Some(known) = known else { return system.iterated(channel, count) };
    let own = |values: &[Rgb], i: usize| f64::from(values[i].to_array()[channel]);
    let patches = 0..system.len();
    let sources: Vec<f64> = patches
        .clone()
        .map(|i| {
            let reflected = system.albedo[i][channel] * own(&known.irradiance, i);
            system.emitted[i][channel] - PI * own(&known.radiance, i) + reflected
        })
        .collect();
    let mut irradiance = vec![0.0; system.len()];
    for _ in 0..count {
        let sent: Vec<f64> = patches
            .clone()
            .map(|i| sources[i] + system.albedo[i][channel] * irradiance[i])
            .collect();
        irradiance = system.transport(&sent);
    }
    patches.map(|i| irradiance[i] + own(&known.irradiance, i)).collect()
}

/// E[T*] = T: over many seeds the first three iterations have the means of T L^e, T L(1), T L(2).
#[test]
fn one_iteration_expects_one_application_of_the_transport_operator() {
    const SEEDS: u64 = 1000;
    const ITERATIONS: usize = 3;
    let scene = rooms::corner();
    assert_eq!(scene.patches.len(), 3);
    let system = corner_system(&scene);
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    for (name, settings) in unbiased(&scene, &system) {
        let known = settings.known.as_deref();
        let after = |count: usize| -> Vec<f64> {
            let channels = [0, 1, 2].map(|channel| expected(&system, channel, count, known));
            (0..3).map(|patch| channels.iter().map(|e| e[patch]).sum()).collect()
        };
        let right: Vec<f64> = (1..=ITERATIONS).flat_map(after).collect();
        let mut seen = vec![Moments::default(); 3 * ITERATIONS];
        for seed in 0..SEEDS {
            let settings = ShootingSettings { seed, ..settings.clone() };
            let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
            for moments in seen.chunks_mut(3) {
                shooting.iterate(1).expect("iterates");
                let sums = shooting.drain().expect("drains");
                for (moments, e) in moments.iter_mut().zip(&sums.irradiance) {
                    moments.push(f64::from(e.element_sum()));
                }
            }
        }
        let scores = Scores::new(&seen, &right);
        let errors = seen.iter().zip(&right).map(|(m, e)| m.standard_error() / e);
        let error = errors.sum::<f64>() / right.len() as f64;
        println!("{name}: {scores:.2?}, standard error {:.1} %", 100.0 * error);
        assert!(scores.is_chance(), "{name}: {scores:?}");
        // Planted: a bounce more than there were iterations, 15 % too little, and with known
        // light the expectation without it.
        let late: Vec<f64> = (2..=ITERATIONS + 1).flat_map(after).collect();
        let planted = [
            ("a bounce too many", late),
            ("15 % too little", right.iter().map(|e| 0.85 * e).collect()),
        ];
        for (what, wrong) in planted {
            assert!(!Scores::new(&seen, &wrong).is_chance(), "{name}: {what} passed");
        }
    }
}

/// A closed box whose walls all shine, each in its own colour.
fn coloured_furnace() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let walls = [
        (Vec3::ZERO, z, x, Rgb::new(1.0, 0.0, 0.0)),
        (y, x, z, Rgb::new(0.0, 1.0, 0.0)),
        (Vec3::ZERO, x, y, Rgb::new(0.0, 0.0, 3.0)),
        (z, y, x, Rgb::new(0.2, 0.2, 0.2)),
        (Vec3::ZERO, y, z, Rgb::new(2.0, 1.0, 0.0)),
        (x, z, y, Rgb::ZERO),
    ];
    for (corner, u, v, emission) in walls {
        let wall = builder.light(Rgb::new(0.8, 0.5, 0.3), emission);
        builder.quad(corner, u, v, wall);
    }
    Arc::new(PatchedScene::new(builder.build(), 48))
}

/// Patches shoot with probability p_j: at first in proportion to the power that they emit, then to
/// what they emit and reflect; or all alike.
#[test]
fn shooters_are_picked_with_their_probability() {
    const SEEDS: u64 = 4000;
    let scene = coloured_furnace();
    let patches = &scene.patches;
    let count = patches.len();
    // Rec. 709 luminance.
    let luminance = |rgb: DVec3| rgb.abs().dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let normalised = |power: Vec<f64>| -> Vec<f64> {
        let total: f64 = power.iter().sum();
        power.iter().map(|power| power / total).collect()
    };
    let by_power = |irradiance: &[Rgb]| {
        let power = |i: usize| {
            let (emission, albedo) =
                (patches.emission[i].as_dvec3(), patches.diffuse[i].as_dvec3());
            let sent = PI * emission + albedo * irradiance[i].as_dvec3();
            luminance(sent) * f64::from(patches.area[i])
        };
        normalised((0..count).map(power).collect())
    };
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    for (shots, stratified, selection) in [
        (1, true, Selection::Power),
        (4, false, Selection::Power),
        (4, true, Selection::Power),
        (1, true, Selection::Uniform),
        (4, false, Selection::Uniform),
    ] {
        let mut picked = vec![vec![0u64; count]; 2];
        let mut probability = vec![vec![0.0; count]; 2];
        for seed in 0..SEEDS {
            let settings = ShootingSettings { stratified, selection, ..settings(8, shots, seed) };
            let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
            let mut irradiance = vec![Rgb::ZERO; count];
            for (picked, probability) in picked.iter_mut().zip(&mut probability) {
                let p = match selection {
                    Selection::Power => by_power(&irradiance),
                    Selection::Uniform => vec![1.0 / count as f64; count],
                };
                probability.iter_mut().zip(p).for_each(|(sum, p)| *sum += p / SEEDS as f64);
                shooting.iterate(1).expect("iterates");
                let shooters = shooting.shooters().expect("shooters");
                assert_eq!(shooters.len(), shots as usize);
                shooters.iter().for_each(|shooter| picked[*shooter as usize] += 1);
                irradiance = shooting.drain().expect("drains").irradiance;
            }
        }
        for (iteration, (picked, probability)) in picked.iter().zip(&probability).enumerate() {
            let name = format!(
                "{selection:?}, K = {shots}, stratified {stratified}, iteration {iteration}"
            );
            let score = chi_square(picked, probability);
            // Systematic picks are more even than chance; independent ones are just chance.
            println!("{name}: {score:+.2}");
            assert!(score < 4.0, "{name}: {score}");
            assert!(stratified || score > -4.0, "{name}: {score}: too even");
            let planted = match selection {
                Selection::Power => vec![1.0 / count as f64; count],
                Selection::Uniform => by_power(&vec![Rgb::ZERO; count]),
            };
            assert!(chi_square(picked, &planted) > 20.0, "{name}: other probabilities passed");
        }
    }
}

/// ΣΔF of a shot is what its hemisphere shows of surfaces: all in a closed box; in an open one
/// all but the opening's point-to-polygon factor.
#[test]
fn delta_form_factors_sum_to_the_visible_share() {
    let (open, closed) = (rooms::open(), rooms::closed());
    // Seen from inside, z = 1 turns left this way round.
    let opening = [[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]].map(DVec3::from_array);
    let sequence = Sequence::new(3);
    let shots: Vec<_> = (0..24)
        .map(|index| {
            let [a, b, turn, jitter] = sequence.point(index).map(|x| x as f32);
            let (position, normal) = match index % 4 {
                0 => (Vec3::new(a, 0.0, b), Vec3::Y),
                1 => (Vec3::new(0.0, a, b), Vec3::X),
                2 => (Vec3::new(1.0, a, b), Vec3::NEG_X),
                _ => (Vec3::new(a, b, 0.0), Vec3::Z),
            };
            shot_at(position, normal, turn, Vec2::splat(jitter - 0.5))
        })
        .collect();
    for (name, mut device) in all() {
        let mut sums = |scene: &Arc<PatchedScene>| -> Vec<f64> {
            let mut shooting = device.begin(scene.clone(), &settings(256, 1, 0)).expect("begins");
            let traces = shooting.trace(&shots).expect("traces");
            let sum = |f: &Vec<f32>| f.iter().map(|f| f64::from(*f)).sum();
            traces.iter().map(|trace| sum(&trace.form_factor)).collect()
        };
        let (in_open, in_closed) = (sums(&open), sums(&closed));
        let (mut worst_open, mut worst_closed, mut most_hidden) = (0f64, 0f64, 0f64);
        for ((shot, open), closed) in shots.iter().zip(in_open).zip(in_closed) {
            let hidden =
                point_to_polygon(shot.position.as_dvec3(), shot.normal.as_dvec3(), &opening);
            worst_open = worst_open.max((open - (1.0 - hidden)).abs());
            worst_closed = worst_closed.max((closed - 1.0).abs());
            most_hidden = most_hidden.max(hidden);
        }
        println!("{name}: |ΣΔF − share| ≤ {worst_open:.1e} open, {worst_closed:.1e} closed");
        assert!(worst_closed < 1e-4, "{name}: {worst_closed}");
        // A row of pixels more or less at the opening's edges.
        assert!(worst_open < 4e-3, "{name}: {worst_open}");
        assert!(most_hidden > 0.2, "the opening is hardly seen");
    }
}

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
        let effort = Effort { burn_in: 20, batches: 20, iterations: 100 };
        let estimate = estimate(&mut device, &scene, &settings(128, 8, 2), effort);
        let (mut sum, mut area) = (0.0, 0.0);
        for patch in (0..scene.patches.len()).filter(|p| !scene.patches.is_glossy(*p)) {
            let own = f64::from(scene.patches.area[patch]);
            sum += own * estimate.channels[0][patch].mean();
            area += own;
        }
        let reflected = sum / area - expected.direct;
        let [centroid, ray, constant] =
            [expected.by_centroid, expected.by_ray, expected.constant].map(|e| reflected / e - 1.0);
        println!(
            "ks {specular}, n {exponent}: {centroid:+.4} of a(θ) at centroids, {ray:+.4} of a(θ), {constant:+.4} of kd + ks"
        );
        assert!(centroid.abs() < 0.01, "ks {specular}, n {exponent}: {centroid}");
        // One direction a patch costs this much where light falls in at short distance.
        assert!(ray.abs() < 0.03, "ks {specular}, n {exponent}: {ray}");
        assert!(constant.abs() > 0.1, "ks {specular}, n {exponent}: a constant albedo passed");
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
    let estimate = estimate(&mut device, &scene, &settings(64, 8, 9), effort);
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
