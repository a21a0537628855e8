use super::*;
use crate::scene::environment::{Environment, Sky};
use crate::scene::{Camera, Material, Scene, Triangle, Vertex};
use crate::transport::hemilux::specimen::{SEED, Specimen};
use glam::Vec3;

/// What lobes show together has less variance than what each found, and the same mean; what pixels
/// farther away add is some of that.
#[test]
fn neighbours_share_what_they_found() {
    let specimen = Specimen::new(&crate::scene::made::kitchen(), 2000);
    let (world, cut) = (&specimen.world, specimen.cut.clone());
    let visible = VisibleSurfaces::new(world, cut, &world.scene.cameras[0], [240, 240], 8);
    let found = |is_shared: bool| Gloss::after(&specimen, &visible, is_shared, (4, false));
    let sums = |shown: &[Shown]| {
        let sum = |of: &dyn Fn(&Shown) -> f32| shown.iter().map(of).sum::<f32>();
        [sum(&|own| own.mean.element_sum()), sum(&|own| own.variance)]
    };
    let (alone, together) = (found(false), found(true));
    let near: Vec<Shown> =
        (0..together.len()).map(|lobe| together.with_neighbours(&visible, lobe)).collect();
    let [[mean, variance], [_, near_variance], [shared_mean, shared]] =
        [&alone.shown, &near, &together.shown].map(|shown| sums(shown));
    assert!(alone.len() > 50 && variance > 0.0, "{}", alone.len());
    assert!(near_variance < 0.3 * variance && shared < near_variance, "{near_variance} {shared}");
    // Broad lobes, as of the plaster.
    let less = near.iter().zip(&together.shown).filter(|(n, w)| w.variance < 0.5 * n.variance);
    let less = less.count() as f32 / near.len() as f32;
    assert!(less > 0.3, "{less}");
    assert!((shared_mean / mean - 1.0).abs() < 0.1, "{shared_mean} {mean}");
}

/// After a pass hardly any lobe is left that makes a hundred times as much of the variance as another by a few
/// rays, as where the last ray of a metal ball met a lamp in the mirror.
#[test]
fn outliers_get_more_rays_in_the_same_pass() {
    let specimen = Specimen::new(&crate::scene::made::gallery(), 2000);
    let (world, cut) = (&specimen.world, specimen.cut.clone());
    let visible = VisibleSurfaces::new(world, cut, &world.scene.cameras[0], [100, 100], 8);
    let (mut before, mut after, mut rays) = (0, 0, [0; 2]);
    for number in 1..=4 {
        let seed = Seed { number, ..SEED };
        let outliers = |gloss: &Gloss| {
            let work = gloss.work_of_outliers(&visible).unwrap_or_default();
            work.iter().filter(|work| work.rays > 0).count()
        };
        let begun = || {
            let mut gloss = Gloss::new(world, &visible, true);
            gloss.pass(&specimen.coarse, &visible, (seed, true), f64::INFINITY);
            gloss
        };
        let mut without = begun();
        let work = without.work_by_scatter(&visible, 1.0);
        without.cast((&specimen.coarse, &visible, seed), &work);
        let mut with = begun();
        with.pass(&specimen.coarse, &visible, (seed, true), f64::INFINITY);
        before += outliers(&without);
        after += outliers(&with);
        rays[0] += without.rays();
        rays[1] += with.rays();
    }
    assert!(before >= 8 && 4 * after <= before, "{before} before, {after} after");
    assert!(rays[1] < rays[0] + rays[0] / 20, "{rays:?}");
}

/// A polished floor, darker than what is above it, and slats above that hide half of an even sky.
fn below_slats() -> Specimen {
    let square = |[left, right]: [f32; 2], y: f32, half: f32| {
        [[left, half], [right, half], [right, -half], [left, -half]]
            .map(|[x, z]| Vertex::new(Vec3::new(x, y, z), Vec3::Y))
    };
    let slat = |k: i32| square([k as f32, k as f32 + 0.5], 2.0, 20.0);
    let mut vertices = square([-20.0, 20.0], 0.0, 20.0).to_vec();
    (-20..20).for_each(|k| vertices.extend(slat(k)));
    let of = |first: u32| [[0, 1, 2], [0, 2, 3]].map(|of| of.map(|k: u32| 4 * first + k));
    let all = (0..=40).flat_map(|first| of(first).map(|vertices| (vertices, first)));
    let triangles = all.map(|(vertices, first)| Triangle { vertices, material: first.min(1) });
    let floor = Material { base_color: Rgb::splat(0.5), roughness: 0.3, ..Material::default() };
    let scene = Scene {
        triangles: triangles.collect(),
        vertices,
        materials: vec![
            Material { metallic: 0.0, ..floor },
            Material { double_sided: true, ..Material::lambertian("black", Rgb::ZERO) },
        ],
        cameras: vec![Camera::look_at("eye", Vec3::new(0.0, 1.8, 4.0), Vec3::ZERO, Vec3::Y, 0.7)],
        ..Scene::default()
    };
    let sky = Sky::Uniform(Rgb::ONE);
    Specimen::of(scene, Environment { sky, ..Environment::none() }, 1000)
}

/// Under a sky that is hidden in part a faint lobe that waits shows what is right, though some of those beside
/// it have not found the sky at all.
#[test]
fn lobes_that_wait_are_right_below_slats() {
    let specimen = below_slats();
    let (world, cut) = (&specimen.world, specimen.cut.clone());
    let visible = VisibleSurfaces::new(world, cut, &world.scene.cameras[0], [120, 120], 8);
    let [begun, known] =
        [(1, true), (32, false)].map(|passes| Gloss::after(&specimen, &visible, true, passes));
    let waiting = (0..begun.len()).filter(|lobe| begun.sums[*lobe].rays == 0);
    let waiting: Vec<usize> = waiting.collect();
    let knows = (0..begun.len()).filter(|lobe| begun.sums[*lobe].knows_open_sky()).count();
    let asked = begun.len() - waiting.len();
    assert!(waiting.len() > 2000, "{} of {}", waiting.len(), begun.len());
    assert!(10 * knows < 9 * asked && 4 * knows > asked, "{knows} of {asked} know the sky");
    let sum = |gloss: &Gloss| {
        let shown = waiting.iter().map(|lobe| gloss.reflected(&visible, *lobe)[0].element_sum());
        shown.map(f64::from).sum::<f64>()
    };
    let [few, many] = [&begun, &known].map(sum);
    assert!((few / many - 1.0).abs() < 0.03, "{}", few / many);
}
