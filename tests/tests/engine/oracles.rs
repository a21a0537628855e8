//! View factors by every route against each other, against exact values, and against the device.

use glam::{DVec3, Vec2, Vec3};
use hemilux_engine::device::Device;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::patches::{PatchIndex, PatchedScene};
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::Material;
use hemilux_tests::oracle::quadrature::Rule;
use hemilux_tests::oracle::rays::{Hit, Sequence, World};
use hemilux_tests::oracle::view_factors::*;
use hemilux_tests::scenes::{self, settings};
use hemilux_tests::skips::{partly_skipped, shared};
use hemilux_tests::twins::{Builder, shot_at};
use std::sync::Arc;

fn points(corners: &[[f64; 3]]) -> Vec<DVec3> {
    corners.iter().map(|corner| DVec3::from_array(*corner)).collect()
}

/// A pair of flat polygons that see each other whole.
struct Pair {
    name: String,
    sender: Vec<DVec3>,
    receiver: Vec<DVec3>,
    /// Digits known from elsewhere.
    exact: f64,
    /// By the formulas of Howell's catalogue.
    closed_form: Option<f64>,
}

/// Pairs whose view factors are exact: C-11 and C-14 of Howell, *A Catalog of Radiation Heat
/// Transfer Configuration Factors*, evaluated with 15 digits; the last by adding receivers.
fn catalogue() -> Vec<Pair> {
    let floor = |x: f64, y: f64| points(&[[0., 0., 0.], [x, 0., 0.], [x, y, 0.], [0., y, 0.]]);
    let opposite =
        |x: f64, y: f64, z: f64| points(&[[0., y, z], [x, y, z], [x, 0., z], [0., 0., z]]);
    let wall = |low: f64, high: f64| {
        points(&[[0., 0., low], [0., 1., low], [0., 1., high], [0., 0., high]])
    };
    let pair = |name: &str, sender, receiver, exact, closed_form| Pair {
        name: name.into(),
        sender,
        receiver,
        exact,
        closed_form: Some(closed_form),
    };
    let square = || floor(1.0, 1.0);
    let mut pairs: Vec<Pair> = [
        (0.1, 0.826_994_522_397_257),
        (0.5, 0.415_253_283_577_147),
        (1.0, 0.199_824_895_698_387),
        (2.0, 0.068_589_588_818_552_4),
        (10.0, 0.003_162_056_838_757_6),
    ]
    .into_iter()
    .map(|(gap, exact)| {
        let closed_form = parallel_rectangles(1.0, 1.0, gap);
        let name = format!("parallel squares, gap {gap}");
        pair(&name, square(), opposite(1.0, 1.0, gap), exact, closed_form)
    })
    .collect();
    pairs.push(pair(
        "parallel 2 × 1",
        floor(2.0, 1.0),
        opposite(2.0, 1.0, 1.0),
        0.285_875_384_850_715,
        parallel_rectangles(2.0, 1.0, 1.0),
    ));
    pairs.push(pair(
        "perpendicular squares, shared edge",
        square(),
        wall(0.0, 1.0),
        0.200_043_776_075_403,
        perpendicular_rectangles(1.0, 1.0, 1.0),
    ));
    pairs.push(pair(
        "perpendicular 1 × 2, shared edge",
        square(),
        wall(0.0, 2.0),
        0.232_852_602_795_362,
        perpendicular_rectangles(1.0, 1.0, 2.0),
    ));
    pairs.push(pair(
        "perpendicular strip with a gap",
        square(),
        wall(0.5, 1.5),
        0.076_136_640_422_677_8,
        perpendicular_strip(1.0, 1.0, 0.5, 1.5),
    ));
    pairs
}

/// The pairs of the shared reference file, where that is there.
fn reference_pairs() -> Vec<Pair> {
    let [bytes] = match shared(["reference/view-factors.json"]) {
        Ok(files) => files,
        Err(why) => {
            partly_skipped(&why);
            return Vec::new();
        }
    };
    let value: serde_json::Value = serde_json::from_slice(&bytes).expect("JSON");
    let polygon = |value: &serde_json::Value| -> Vec<DVec3> {
        let corners: Vec<[f64; 3]> = serde_json::from_value(value.clone()).expect("corners");
        points(&corners)
    };
    let pairs = value.as_array().expect("a list").iter().map(|entry| Pair {
        name: entry["name"].as_str().expect("a name").into(),
        sender: polygon(&entry["emitter"]),
        receiver: polygon(&entry["receiver"]),
        exact: entry["quadrature"].as_f64().expect("a number"),
        closed_form: entry["closed_form"].as_str().map(|text| text.parse().expect("a number")),
    });
    pairs.collect()
}

fn relative(value: f64, exact: f64) -> f64 {
    (value / exact - 1.0).abs()
}

#[test]
fn closed_forms_quadratures_and_references_agree() {
    let (fine, coarse) = (Rule::graded(10, 30), Rule::graded(6, 10));
    for pair in catalogue().into_iter().chain(reference_pairs()) {
        let Pair { name, sender, receiver, exact, closed_form } = &pair;
        if let Some(closed_form) = closed_form {
            assert!(relative(*closed_form, *exact) < 1e-11, "{name}: {closed_form}");
        }
        let contour = by_contour(sender, receiver, &fine);
        let back = by_contour(receiver, sender, &fine);
        let lambert = by_lambert(sender, receiver, &coarse);
        println!(
            "{name}: contour {:+.1e}, Lambert {:+.1e}",
            contour / exact - 1.0,
            lambert / exact - 1.0
        );
        assert!(relative(contour, *exact) < 1e-9, "{name}: contour {contour}, exact {exact}");
        assert!(relative(lambert, *exact) < 1e-6, "{name}: Lambert {lambert}, exact {exact}");
        // A_i F_ij = A_j F_ji.
        let ratio = area_and_normal(receiver).0 / area_and_normal(sender).0;
        assert!(relative(back * ratio, *exact) < 1e-9, "{name}: reciprocity");
    }
}

/// The same comparisons with the errors that they are there to find.
#[test]
fn comparisons_of_view_factors_see_planted_errors() {
    let pairs = catalogue();
    let shared_edge = &pairs[6];
    // A plain rule misses the logarithm at the shared edge.
    let plain = by_contour(&shared_edge.sender, &shared_edge.receiver, &Rule::gauss(6));
    assert!(relative(plain, shared_edge.exact) > 1e-6, "{plain}");
    // A receiver that is a thousandth too high, or turned round.
    let mut moved = shared_edge.receiver.clone();
    moved.iter_mut().for_each(|corner| corner.z *= 1.001);
    let fine = Rule::graded(10, 30);
    assert!(relative(by_contour(&shared_edge.sender, &moved, &fine), shared_edge.exact) > 1e-5);
    moved.reverse();
    assert_eq!(by_lambert(&shared_edge.sender, &moved, &Rule::gauss(4)), 0.0);
    // Nothing but the pair's own closed form fits.
    assert!(relative(parallel_rectangles(1.0, 1.0, 1.001), pairs[2].exact) > 1e-4);
    assert!(relative(perpendicular_rectangles(1.0, 1.001, 1.0), shared_edge.exact) > 1e-4);
}

/// A scene of flat polygons, each of its own material, patch numbers of the first.
fn scene_of(polygons: &[&[DVec3]], patches: usize) -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    for polygon in polygons {
        let material = builder.material(Material::lambertian("grey", Rgb::splat(0.5)));
        for edge in polygon[1..].windows(2) {
            builder.triangle([polygon[0], edge[0], edge[1]].map(|p| p.as_vec3()), material);
        }
    }
    builder.cut(patches)
}

/// Patches of the polygon that was added as number `index`.
fn patches_of(scene: &PatchedScene, index: u32) -> Vec<usize> {
    let material = |patch: usize| {
        let facet = &scene.facets[scene.patches.facet[patch] as usize];
        scene.scene.triangles[facet.source as usize].material
    };
    (0..scene.patches.len()).filter(|patch| material(*patch) == index).collect()
}

/// F between polygons 0 and 1 of a scene by rays.
fn by_rays(scene: &PatchedScene, rays: u64) -> f64 {
    let world = World::new(scene);
    let (senders, receivers) = (patches_of(scene, 0), patches_of(scene, 1));
    let total: f64 = senders.iter().map(|patch| world.area(*patch)).sum();
    let sum: f64 = senders
        .iter()
        .map(|&patch| {
            let (row, _) = world.form_factors(patch, rays, 7);
            world.area(patch) * receivers.iter().map(|r| row[*r]).sum::<f64>()
        })
        .sum();
    sum / total
}

/// F between polygons 0 and 1 of a scene by the device's hemicubes on `count` points of the first.
fn by_hemicubes(scene: &Arc<PatchedScene>, count: u64) -> f64 {
    let mut device = CpuDevice::new(None).expect("threads");
    let mut shooting = device.begin(scene.clone(), &settings(64, 1, 0)).expect("begins");
    let (senders, receivers) = (patches_of(scene, 0), patches_of(scene, 1));
    let total: f32 = senders.iter().map(|patch| scene.patches.area[*patch]).sum();
    let sequence = Sequence::new(5);
    let mut sum = 0.0;
    for &patch in &senders {
        let shots: Vec<_> = (0..count)
            .map(|index| {
                let [a, b, turn, jitter] = sequence.point(index).map(|x| x as f32);
                let position = scene.point_on_patch(PatchIndex(patch as u32), Vec2::new(a, b));
                let jitter = Vec2::new(jitter - 0.5, (7.0 * jitter).fract() - 0.5);
                shot_at(position, scene.patches.normal[patch], turn, jitter)
            })
            .collect();
        let traces = shooting.trace(&shots).expect("traces");
        let seen: f64 = traces
            .iter()
            .flat_map(|trace| receivers.iter().map(|r| f64::from(trace.form_factor[*r])))
            .sum();
        sum += f64::from(scene.patches.area[patch] / total) * seen / count as f64;
    }
    sum
}

#[test]
fn rays_and_hemicubes_give_the_exact_view_factors() {
    // The shared file has the catalogue's pairs again, and others without a closed form.
    let others = reference_pairs().into_iter().filter(|pair| pair.closed_form.is_none());
    for pair in catalogue().into_iter().chain(others) {
        let Pair { name, sender, receiver, exact, .. } = &pair;
        let scene = scene_of(&[sender, receiver], 12);
        let (rays, hemicubes) = (by_rays(&scene, 20_000), by_hemicubes(&scene, 1000));
        println!(
            "{name}: rays {:+.1e}, hemicubes {:+.1e}",
            rays / exact - 1.0,
            hemicubes / exact - 1.0
        );
        // Three standard errors that as many independent rays would have.
        let rays_in_all = (20_000 * patches_of(&scene, 0).len()) as f64;
        let allow_rays = 3.0 * ((1.0 - exact) / (exact * rays_in_all)).sqrt();
        // Small factors are seen by few pixels.
        let allow_pixels = 2e-3 + 2e-5 / exact;
        assert!(relative(rays, *exact) < allow_rays, "{name}: {rays}, exact {exact}");
        assert!(relative(hemicubes, *exact) < allow_pixels, "{name}: {hemicubes}, exact {exact}");
    }
}

/// A screen half way between two squares, a half as wide, hides what its shadow covers: what is
/// left follows from point-to-polygon factors, the screen taken off where it covers.
#[test]
fn a_screen_hides_what_it_covers() {
    let floor = points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    let top = points(&[[0., 1., 1.], [1., 1., 1.], [1., 0., 1.], [0., 0., 1.]]);
    // The screen's front looks at the floor; seen from a floor point, it projects onto the plane
    // of the top as a square of its size doubled about that point.
    let low = 0.3;
    let high = 0.7;
    let screen = points(&[[low, high, 0.5], [high, high, 0.5], [high, low, 0.5], [low, low, 0.5]]);
    let rule = Rule::graded(6, 6);
    let hidden = rule.integrate(|x| {
        rule.integrate(|y| {
            let shadow = |c: f64, at: f64| (2.0 * c - at).clamp(0.0, 1.0);
            let (x0, x1) = (shadow(low, x), shadow(high, x));
            let (y0, y1) = (shadow(low, y), shadow(high, y));
            let shadow = points(&[[x0, y1, 1.], [x1, y1, 1.], [x1, y0, 1.], [x0, y0, 1.]]);
            point_to_polygon(DVec3::new(x, y, 0.0), DVec3::Z, &shadow)
        })
    });
    let exact = parallel_rectangles(1.0, 1.0, 1.0) - hidden;
    assert!(hidden > 0.05, "{hidden}");
    let scene = scene_of(&[&floor, &top, &screen], 30);
    let (rays, hemicubes) = (by_rays(&scene, 20_000), by_hemicubes(&scene, 1000));
    println!("exact {exact:.6}, rays {rays:.6}, hemicubes {hemicubes:.6}");
    assert!(relative(rays, exact) < 5e-3, "{rays} {exact}");
    assert!(relative(hemicubes, exact) < 5e-3, "{hemicubes} {exact}");
    // Turned round, the screen shows its black back but hides the same.
    let turned: Vec<_> = screen.iter().rev().copied().collect();
    let scene = scene_of(&[&floor, &top, &turned], 30);
    let (rays, hemicubes) = (by_rays(&scene, 20_000), by_hemicubes(&scene, 1000));
    assert!(relative(rays, exact) < 5e-3, "{rays} {exact}");
    assert!(relative(hemicubes, exact) < 5e-3, "{hemicubes} {exact}");
    // A wrong screen is found out.
    let scene = scene_of(&[&floor, &top], 30);
    assert!(relative(by_rays(&scene, 4_000), exact) > 0.05);
    assert!(relative(by_hemicubes(&scene, 40), exact) > 0.05);
}

/// Rays meet what they should: fronts, backs of two-sided surfaces, black backs, nothing.
#[test]
fn rays_know_the_sides_of_surfaces() {
    let mut builder = Builder::default();
    let one_sided = builder.material(Material::lambertian("one-sided", Rgb::splat(0.5)));
    let two_sided = builder
        .material(Material { double_sided: true, ..Material::lambertian("two", Rgb::splat(0.5)) });
    builder.grid(Vec3::ZERO, [Vec3::X, Vec3::Y], 1, |_, _| one_sided);
    // Above the floor's halves: both look up, so the floor sees their backs.
    builder.triangle([Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::ONE], one_sided);
    builder.triangle([Vec3::new(0.0, 0.0, 1.0), Vec3::ONE, Vec3::new(0.0, 1.0, 1.0)], two_sided);
    let scene = builder.cut(1);
    let world = World::new(&scene);
    assert_eq!(world.len(), 5);
    let up = |x, y| world.cast(0, DVec3::new(x, y, 0.0), DVec3::Z);
    assert_eq!(up(0.7, 0.2), Hit::Black);
    assert!(
        matches!(up(0.2, 0.7), Hit::Patch { patch: 4, point } if point.z == 1.0),
        "{:?}",
        up(0.2, 0.7)
    );
    assert_eq!(up(1.2, 0.7), Hit::Nothing);
    assert_eq!(world.normal(4), DVec3::NEG_Z);
    let back_front = [3, 4].map(|patch| world.form_factors(patch, 2000, 1));
    assert!(back_front[0].1 == 1.0 && back_front[1].1 < 1.0);
}

/// The oracle numbers patches as the engine does: cells of every facet have the engine's
/// centroids and areas.
#[test]
fn rays_and_engine_mean_the_same_patches() {
    let mut builder = scenes::Builder::default();
    let wall = builder.lambertian(Rgb::splat(0.5));
    builder.cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), true, wall);
    let scene = PatchedScene::new(builder.build(), 200);
    let world = World::new(&scene);
    for patch in 0..world.len() {
        let centre = (0..3).map(|k| world.point(patch, [0., 1., 0.][k], [0., 0., 1.][k]));
        let centre = centre.sum::<DVec3>() / 3.0;
        assert!(centre.distance(scene.patches.centroid[patch].as_dvec3()) < 1e-5, "{patch}");
        assert!(relative(world.area(patch), f64::from(scene.patches.area[patch])) < 1e-5);
        assert!(world.normal(patch).dot(scene.patches.normal[patch].as_dvec3()) > 0.999_999);
        let (row, lost) = world.form_factors(patch, 500, 3);
        assert!(relative(row.iter().sum::<f64>(), 1.0) < 1e-9, "a ray left the closed box");
        assert_eq!(lost, 0.0);
    }
}
