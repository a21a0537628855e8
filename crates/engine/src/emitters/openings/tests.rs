use super::*;
use crate::emitters::DirectLights;
use crate::radiometry::Rgb;
use crate::random::{Numbers, Stream};
use crate::scene::environment::{Environment, PlacedMap, Sky};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made::real::{RealScene, checker, wide_window, window};
use crate::scene::sky_map::SkyMap;
use std::f32::consts::TAU;
use std::sync::Arc;

fn world(scene: RealScene) -> World {
    let imported = import(&scene.glb, &Resources::default(), &ImportLimits::default());
    World::surrounded(Arc::new(imported.expect("valid")), Arc::new(scene.environment))
}

#[test]
fn a_window_is_found_where_it_is() {
    let world = world(window());
    let openings = Openings::find(&world).expect("there is a window");
    // The hole in the wall, 40 × 40 cm.
    assert_eq!(openings.count(), 1, "{:?}", openings.openings);
    let scale = world.rays.scale() as f32;
    let opening = openings.openings[0];
    let middle = opening.corner + 0.5 * (opening.edges[0] + opening.edges[1]);
    let off = (middle - world.rays.place(Vec3::new(2.0, 1.4, 3.6))).abs() / scale;
    assert!(off.x < 0.03 && off.y < 0.03 && off.z < 0.15, "{off} {opening:?}");
    for edge in opening.edges {
        assert!((0.36..0.48).contains(&(edge.length() / scale)), "{opening:?}");
        assert!(edge.z.abs() < 0.01 * scale, "{opening:?}");
    }
    let back = world.rays.place(Vec3::new(2.0, 1.5, 0.001));
    assert!(openings.seen_from(back, Vec3::Z).is_some());
    let outside = world.rays.place(Vec3::new(2.0, 1.5, -0.201));
    assert!(openings.seen_from(outside, Vec3::NEG_Z).is_none());
}

/// The reveal of a window, which sees much of the sky, faces where a wall of the room does, but what it sees
/// says nothing of that: every place of the wall knows the window.
#[test]
fn walls_know_a_window_up_to_its_reveal() {
    let world = world(wide_window());
    let openings = Openings::find(&world).expect("there is a window");
    let all = (0..40).flat_map(|i| (0..40).map(move |j| [i, j].map(|k| (k as f32 + 0.5) / 40.0)));
    let (mut without, mut places) = (0, 0);
    for [along, up] in all {
        let (height, depth) = (2.7 * up, 3.5 * along);
        let walls = [
            (Vec3::new(0.001, height, depth), Vec3::X),
            (Vec3::new(3.999, height, depth), Vec3::NEG_X),
            (Vec3::new(4.0 * along, height, 0.001), Vec3::Z),
        ];
        for (place, normal) in walls {
            places += 1;
            without += u32::from(openings.seen_from(world.rays.place(place), normal).is_none());
        }
    }
    assert_eq!(without, 0, "of {places} places");
}

#[test]
fn there_is_none_in_the_open() {
    assert!(Openings::find(&world(checker())).is_none());
}

#[test]
fn densities_of_directions_add_up_to_one() {
    let edges = [Vec3::new(0.0, 0.0, 0.9), Vec3::new(0.6, 0.0, 0.0)];
    let one = Rectangle { corner: Vec3::new(1.0, 2.0, 0.5), edges };
    let other = Rectangle { corner: Vec3::new(-1.0, 0.4, 0.0), edges };
    let lookout = Lookout::new([one, other].into_iter(), Vec3::ZERO, Vec3::Y).expect("above");
    let mut numbers = Numbers::new(1, Stream::Light, 0);
    const SAMPLES: u32 = 200_000;
    let mut whole = 0.0f64;
    for _ in 0..SAMPLES {
        let mut next = || numbers.uniform();
        let height = 2.0 * next() - 1.0;
        let (sin, cos) = (TAU * next()).sin_cos();
        let across = (1.0 - height * height).sqrt();
        let direction = Vec3::new(across * cos, height, across * sin);
        whole += f64::from(lookout.pdf(direction) * 2.0 * TAU) / f64::from(SAMPLES);
        let direction = lookout.sample(Vec3::new(next(), next(), next()));
        assert!((direction.length() - 1.0).abs() < 1e-5 && lookout.pdf(direction) > 0.0);
    }
    assert!((whole - 1.0).abs() < 0.03, "{whole}");
}

/// Mean and variance of a surface's light by one shadow ray each.
fn one_ray(lights: &DirectLights, world: &World, point: Vec3, normal: Vec3) -> (f64, f64) {
    const SAMPLES: u64 = 40_000;
    let mut numbers = Numbers::new(5, Stream::Light, 0);
    let (mut sum, mut squares) = (0.0f64, 0.0f64);
    for _ in 0..SAMPLES {
        let xi = Vec3::new(numbers.uniform(), numbers.uniform(), numbers.uniform());
        let sample = lights.sample_by_shadow_ray(world, point, normal, xi);
        let light = f64::from(importance(sample.irradiance(0.0)));
        sum += light;
        squares += light * light;
    }
    let mean = sum / SAMPLES as f64;
    (mean, squares / SAMPLES as f64 - mean * mean)
}

/// By way of openings arrives what arrives without them, with a fraction of the noise.
#[test]
fn light_through_a_window_is_the_same_with_less_noise() {
    let mut scene = window();
    scene.environment.sun = None;
    let world = world(scene);
    let lights = DirectLights::new(&world).expect("there is a sky");
    let plain = DirectLights::new(&world).expect("there is a sky").without_openings();
    let places = [
        (Vec3::new(2.0, 1.5, 0.001), Vec3::Z),
        (Vec3::new(1.0, 0.001, 2.0), Vec3::Y),
        (Vec3::new(3.999, 1.0, 1.5), Vec3::NEG_X),
    ];
    for (place, normal) in places {
        let point = world.rays.place(place);
        let (mean, variance) = one_ray(&lights, &world, point, normal);
        let (other, other_variance) = one_ray(&plain, &world, point, normal);
        let deviation = ((variance + other_variance) / 40_000.0).sqrt();
        assert!((mean - other).abs() < 3.5 * deviation, "{place}: {mean} {other} ± {deviation}");
        assert!(5.0 * variance < other_variance, "{place}: {variance} {other_variance}");
    }
}

/// Of two directions the brighter is picked more often, and yet as much arrives in the mean, with less noise, from
/// a sky that is bright behind one corner of a window.
#[test]
fn two_directions_to_pick_from_have_the_same_mean_and_less_noise() {
    let glow = Vec3::new(0.4, 0.8, 0.3).normalize();
    let map = SkyMap::from_fn(128, 64, |direction| {
        Rgb::new(1.0, 0.7, 0.5) * (1.0 + 60.0 * f32::from(direction.dot(glow) > 0.995))
    });
    let map = Arc::new(map.expect("it shines"));
    let sky = Sky::Map(PlacedMap { map, rotation: 0.0, scale: Rgb::ONE });
    let sky = SkyLight::new(&Environment { sky, ..Environment::none() }).expect("it shines");
    let edges = [Vec3::new(0.0, 0.0, 0.9), Vec3::new(0.6, 0.0, 0.0)];
    let rectangle = |corner| Rectangle { corner, edges };
    let both = [Vec3::new(0.4, 1.2, 0.0), Vec3::new(-1.0, 0.4, -0.8)].map(rectangle);
    let lookout = Lookout::new(both.into_iter(), Vec3::ZERO, Vec3::Y).expect("above");
    // What is seen of the sky: all that is through an opening, and a part beside them.
    let arrives = |(direction, density): (Vec3, f32)| {
        let is_seen = lookout.pdf(direction) > 0.0 || direction.x < -0.8;
        let light = importance(sky.radiance(direction)) * direction.y.max(0.0) / density;
        if is_seen && density > 0.0 { f64::from(light) } else { 0.0 }
    };
    const SAMPLES: u32 = 200_000;
    let mut numbers = Numbers::new(1, Stream::Light, 0);
    let (mut sums, mut squares) = ([0.0; 2], [0.0; 2]);
    for _ in 0..SAMPLES {
        let mut next = || numbers.uniform();
        let xi = [0, 1].map(|_| Vec3::new(next(), next(), next()));
        let one = sample_sky(&sky, Some(&lookout), Vec3::Y, xi[0]);
        let of_two = sample_sky_of_two(&sky, &lookout, Vec3::Y, (xi, next()));
        for (k, drawn) in [one, of_two].into_iter().enumerate() {
            let light = arrives(drawn);
            sums[k] += light;
            squares[k] += light * light;
        }
    }
    let means = sums.map(|sum| sum / f64::from(SAMPLES));
    let variance = |k: usize| squares[k] / f64::from(SAMPLES) - means[k] * means[k];
    let deviation = ((variance(0) + variance(1)) / f64::from(SAMPLES)).sqrt();
    assert!((means[0] - means[1]).abs() < 3.5 * deviation, "{means:?} ± {deviation}");
    assert!(deviation < 0.01 * means[0], "{means:?} ± {deviation}");
    assert!(1.3 * variance(1) < variance(0), "{} {}", variance(1), variance(0));
}
