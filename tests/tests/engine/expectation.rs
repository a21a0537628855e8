//! What iteration converges to, against systems that are solved densely, and what one iteration
//! expects to do, against one application of the transport operator.

use glam::{DVec3, Vec2, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{
    Device, Faces, KnownLight, Selection, ShootingSettings, Substitute, VarianceReduction,
};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_tests::devices::{Effort, Estimate, all, estimate, means};
use hemilux_tests::oracle::quadrature::Rule;
use hemilux_tests::oracle::radiosity::Radiosity;
use hemilux_tests::oracle::rays::Sequence;
use hemilux_tests::oracle::rooms;
use hemilux_tests::oracle::statistics::{Moments, Scores, chi_square};
use hemilux_tests::oracle::view_factors::{area_and_normal, by_contour, point_to_polygon};
use hemilux_tests::scenes::{Builder, settings};
use hemilux_tests::twins::shot_at;
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
        let estimate = estimate(&mut device, &scene, &settings(32, 8, 4), effort);
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

fn corners_of(scene: &PatchedScene, facet: usize) -> Vec<DVec3> {
    let corners = scene.facets[facet].corners;
    corners.iter().map(|p| scene.positions[*p as usize].as_dvec3()).collect()
}

/// Form factors between the three faces of a corner by contour integrals.
fn corner_system(scene: &PatchedScene) -> Radiosity {
    let rule = Rule::graded(10, 25);
    let faces: Vec<Vec<DVec3>> = (0..3).map(|facet| corners_of(scene, facet)).collect();
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

/// Mean irradiance after one iteration of one shot with reduced variance, from its definition:
/// transfers whose F = min(1, A_j F_{y→Ai}/A_i) exceeds 2M p_j come times 0 or times p_j.
/// Also the share of the irradiance that transfers which are left whole would bring.
fn reduced(scene: &PatchedScene, system: &Radiosity, rule: VarianceReduction) -> (Vec<f64>, f64) {
    const STEPS: usize = 300;
    let faces: Vec<Vec<DVec3>> = (0..3).map(|facet| corners_of(scene, facet)).collect();
    let luminance = |e: &[f64; 3]| 0.2126 * e[0] + 0.7152 * e[1] + 0.0722 * e[2];
    let power = |j: usize| system.area[j] * luminance(&system.emitted[j]);
    let total: f64 = (0..3).map(power).sum();
    let (mut irradiance, mut whole, mut all) = (vec![0.0; 3], 0.0, 0.0);
    for j in 0..3 {
        let probability = power(j) / total;
        let limit = 2.0 * rule.shots.expect("M") as f64 * probability;
        let factor = match rule.substitute {
            Substitute::Zero => 0.0,
            Substitute::Mean => probability,
        };
        let [a, b, c] = [faces[j][0], faces[j][1], faces[j][2]];
        let (_, normal) = area_and_normal(&faces[j]);
        let sent: f64 = system.emitted[j].iter().sum();
        // The form factor jumps over the limit somewhere: many plain points do.
        for s in 0..STEPS {
            for t in 0..STEPS {
                let [s, t] = [s, t].map(|k| (k as f64 + 0.5) / STEPS as f64);
                let y = a + s * ((1.0 - t) * (b - a) + t * (c - a));
                let share = 2.0 * s / (STEPS * STEPS) as f64;
                for i in (0..3).filter(|i| *i != j) {
                    let ratio = system.area[j] / system.area[i];
                    let f = point_to_polygon(y, normal, &faces[i]);
                    let kept = (ratio * f).min(1.0) <= limit;
                    let light = share * sent * ratio * f;
                    irradiance[i] += light * if kept { 1.0 } else { factor };
                    whole += if kept { light } else { 0.0 };
                    all += light;
                }
            }
        }
    }
    (irradiance, whole / all)
}

/// Reduced variance is biased by what its rule says.
#[test]
fn reduced_variance_expects_what_its_rule_leaves() {
    const SEEDS: u64 = 3000;
    let scene = rooms::corner();
    let system = corner_system(&scene);
    let plain: Vec<f64> = {
        let channels = [0, 1, 2].map(|channel| system.iterated(channel, 1));
        (0..3).map(|patch| channels.iter().map(|e| e[patch]).sum()).collect()
    };
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    for substitute in [Substitute::Zero, Substitute::Mean] {
        let rule = VarianceReduction { substitute, shots: Some(1) };
        let (right, whole) = reduced(&scene, &system, rule);
        assert!(whole > 0.2 && whole < 0.95, "the rule does nothing or all: {whole}");
        let mut seen = vec![Moments::default(); 3];
        for seed in 0..SEEDS {
            let settings =
                ShootingSettings { variance_reduction: Some(rule), ..settings(64, 1, seed) };
            let mut shooting = device.begin(scene.clone(), &settings).expect("begins");
            shooting.iterate(1).expect("iterates");
            let sums = shooting.drain().expect("drains");
            for (moments, e) in seen.iter_mut().zip(&sums.irradiance) {
                moments.push(f64::from(e.element_sum()));
            }
        }
        let scores = Scores::new(&seen, &right);
        println!("{substitute:?}: {scores:.2?}, {:.0} % left whole", 100.0 * whole);
        assert!(scores.is_chance(), "{substitute:?}: {scores:?}");
        assert!(!Scores::new(&seen, &plain).is_chance(), "{substitute:?}: no bias is seen");
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
