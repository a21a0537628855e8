use super::*;
use crate::radiometry::importance;
use crate::random::{Numbers, Stream};
use crate::scene::environment::PlacedMap;
use crate::scene::sky_map::direction_of;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

fn environment(map: SkyMap, rotation: f32) -> Environment {
    let sky = Sky::Map(PlacedMap { map: Arc::new(map), rotation, scale: Rgb::new(1.0, 0.9, 0.7) });
    Environment { sky, ..Environment::default() }
}

/// Soft light from above, two bright panels with sharp edges, and a black part.
fn panels(width: u32, height: u32) -> SkyMap {
    let radiance = |d: Vec3| {
        let soft = 0.2 + 0.3 * (d.y + 1.0);
        let panel = if d.x > 0.7 && d.y.abs() < 0.4 { 12.0 } else { 0.0 };
        let small = if d.z < -0.93 && d.y > 0.1 { 40.0 } else { 0.0 };
        let lit = if d.z > 0.8 { 0.0 } else { soft + panel + small };
        Rgb::new(lit, 0.8 * lit, 0.5 * lit)
    };
    SkyMap::from_fn(width, height, radiance).unwrap()
}

/// A blue sky with a sun of half a degree painted in, which gives four fifths of the light.
fn with_painted_sun() -> SkyMap {
    let sun = Vec3::new(0.5, 0.6, 0.4).normalize();
    let radiance = |d: Vec3| {
        let disk = if (d - sun).length() < 0.0047 { 1.5e5 } else { 0.0 };
        Rgb::new(0.3 + disk, 0.5 + disk, 0.5 + 0.5 * d.y.max(0.0) + 0.8 * disk)
    };
    SkyMap::from_fn(2048, 1024, radiance).unwrap()
}

/// Normals all over the sphere.
fn normals(count: u64) -> Vec<Vec3> {
    let mut numbers = Numbers::new(5, Stream::Gather, 0);
    let one = |_| {
        let y = 2.0 * numbers.uniform() - 1.0;
        let (sin, cos) = (TAU * numbers.uniform()).sin_cos();
        let radius = (1.0 - y * y).sqrt();
        Vec3::new(radius * cos, y, radius * sin).normalize()
    };
    [Vec3::Y, Vec3::NEG_Y, Vec3::X].into_iter().chain((0..count).map(one)).collect()
}

/// Directions of a fine grid with their solid angles.
fn directions(width: u32, height: u32) -> impl Iterator<Item = (Vec3, f64)> {
    (0..height).flat_map(move |y| {
        let edge = |y: u32| (std::f64::consts::PI * f64::from(y) / f64::from(height)).cos();
        let area = std::f64::consts::TAU * (edge(y) - edge(y + 1)) / f64::from(width);
        let v = (y as f32 + 0.5) / height as f32;
        (0..width).map(move |x| (direction_of([(x as f32 + 0.5) / width as f32, v]), area))
    })
}

/// ∫ L max(cosθ, 0) dω in double precision.
fn irradiance(environment: &Environment, normal: Vec3, size: [u32; 2]) -> glam::DVec3 {
    let one = |(direction, area): (Vec3, f64)| {
        let cosine = f64::from(direction.dot(normal).max(0.0));
        environment.radiance(direction).as_dvec3() * (cosine * area)
    };
    directions(size[0], size[1]).map(one).sum()
}

#[test]
fn the_density_integrates_to_one_and_is_nowhere_zero_where_light_comes_from() {
    // The grid's lines are those of the cells: 128 × 124, and 200 × 72.
    for (map, rotation, [width, height]) in
        [(panels(64, 32), 0.0, [1280, 620]), (panels(100, 37), 1.1, [1400, 648])]
    {
        let environment = environment(map, rotation);
        let light = SkyLight::new(&environment).unwrap();
        for normal in normals(12) {
            let mut sum = 0.0;
            for (direction, area) in directions(width, height) {
                let direction = turned(direction, rotation);
                let density = light.pdf(normal, direction);
                sum += f64::from(density) * area;
                let given = environment.radiance(direction) * direction.dot(normal).max(0.0);
                assert!(density > 0.0 || given == Rgb::ZERO, "{normal}: {direction} {given}");
                assert!(density >= 1e-4 * importance(given) || density > 1e-3, "{density} {given}");
            }
            assert!((sum - 1.0).abs() < 5e-3, "{normal}: {sum}");
        }
    }
}

#[test]
fn samples_have_the_density_that_they_say() {
    let environment = environment(panels(100, 37), -2.3);
    let light = SkyLight::new(&environment).unwrap();
    for normal in normals(5) {
        let mut numbers = Numbers::new(9, Stream::Gather, 1);
        let n = 40_000;
        // Bins of the directions in world space, which are not the cells.
        let bin = |d: Vec3| {
            let on = cube::OnCube::new(d);
            let [a, b] = on.at.map(|x| ((0.5 * x + 0.5) * 5.0).min(4.0) as usize);
            (on.face * 5 + a) * 5 + b
        };
        let mut counts = [0.0f64; 150];
        for _ in 0..n {
            let (direction, density) = light.sample(normal, [numbers.uniform(), numbers.uniform()]);
            assert!((direction.length() - 1.0).abs() < 1e-5);
            let again = light.pdf(normal, direction);
            assert!((density - again).abs() <= 1e-6 * density, "{density} {again}");
            counts[bin(direction)] += 1.0;
        }
        let mut expected = [0.0f64; 150];
        for (direction, area) in directions(2400, 1200) {
            expected[bin(direction)] +=
                f64::from(light.pdf(normal, direction)) * area * f64::from(n);
        }
        let many = counts.iter().zip(expected).filter(|(_, e)| *e > 20.0);
        let (chi, bins) = many.fold((0.0, 0.0), |(chi, bins), (count, expected)| {
            (chi + (count - expected).powi(2) / expected, bins + 1.0)
        });
        // The mean and four standard deviations of χ².
        assert!(chi < bins + 4.0 * (2.0f64 * bins).sqrt(), "{normal}: χ² {chi} of {bins}");
        assert!(bins > 10.0);
    }
}

#[test]
fn a_uniform_sky_gives_pi_times_its_radiance() {
    let radiance = Rgb::new(2.0, 1.0, 0.5);
    let environment = Environment { sky: Sky::Uniform(radiance), ..Environment::default() };
    let light = SkyLight::new(&environment).unwrap();
    for normal in normals(300) {
        let error = (light.unoccluded(normal) / radiance - PI).abs().max_element();
        assert!(error < 1e-3 * PI, "{normal}: {error}");
    }
}

#[test]
fn irradiance_is_exact_within_a_fifth_of_a_percent() {
    let skies = [
        (environment(panels(64, 32), 0.4), [1024, 512]),
        (environment(panels(256, 128), 0.0), [1024, 512]),
        (Environment::studio(), [1024, 512]),
        (environment(with_painted_sun(), 0.0), [2048, 1024]),
    ];
    for (sky, (environment, size)) in skies.into_iter().enumerate() {
        let light = SkyLight::new(&environment).unwrap();
        let (mut worst, mut squares, count) = (0.0f64, 0.0, 20);
        for normal in normals(count) {
            let exact = irradiance(&environment, normal, size);
            let error = ((light.unoccluded(normal).as_dvec3() - exact) / exact).abs().max_element();
            worst = worst.max(error);
            squares += error * error;
        }
        let rms = (squares / count as f64).sqrt();
        println!("sky {sky}: worst {worst}, rms {rms}");
        assert!(worst < 4e-3 && rms < 2e-3, "sky {sky}: worst {worst}, rms {rms}");
    }
}

#[test]
fn one_bright_texel_gives_radiance_times_solid_angle_times_cosine() {
    let (width, height) = (256, 128);
    let mut texels = vec![Rgb::ZERO; (width * height) as usize];
    let (x, y) = (40, 50);
    texels[y * width as usize + x] = Rgb::splat(1000.0);
    let map = SkyMap::new(width, height, texels).unwrap();
    let environment = environment(map, 0.7);
    let light = SkyLight::new(&environment).unwrap();
    let [u, v] = [(x as f32 + 0.5) / width as f32, y as f32 / (height - 1) as f32];
    let direction = turned(direction_of([u, v]), 0.7);
    let area = TAU / width as f32 * PI / (height - 1) as f32 * (PI * v).sin();
    for normal in normals(100) {
        let exact = 1000.0 * area * direction.dot(normal).max(0.0);
        let found = light.unoccluded(normal).x;
        // At the horizon, light between the texel's centre and its neighbours' is not all on a side.
        let allowed = if direction.dot(normal).abs() > 0.04 { 1e-3 } else { 6e-3 };
        assert!((found - exact).abs() < allowed * 1000.0 * area, "{normal}: {found} {exact}");
        // The texel is smaller than the samples' spread: each sample hits what shines.
        let cosine = direction.dot(normal);
        if cosine > 0.1 {
            let estimate = estimates(&light, normal, 256);
            assert!((estimate.mean / f64::from(0.97 * exact)).ln().abs() < 0.15, "{normal}");
        }
    }
}

struct Estimates {
    mean: f64,
    /// Standard deviation of one over the mean.
    spread: f64,
}

fn estimates(light: &SkyLight, normal: Vec3, n: u64) -> Estimates {
    let mut numbers = Numbers::new(3, Stream::Gather, 2);
    let values: Vec<f64> = (0..n)
        .map(|_| {
            let (direction, density) = light.sample(normal, [numbers.uniform(), numbers.uniform()]);
            let given = light.radiance(direction) * direction.dot(normal).max(0.0);
            f64::from(importance(given) / density)
        })
        .collect();
    let mean = values.iter().sum::<f64>() / n as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
    Estimates { mean, spread: variance.sqrt() / mean }
}

#[test]
fn sampling_agrees_with_the_table_and_spreads_little() {
    for (name, environment, most) in [
        ("uniform", Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::default() }, 0.45),
        ("studio", Environment::studio(), 0.45),
        ("panels", environment(panels(256, 128), 0.3), 0.7),
        ("sun", environment(with_painted_sun(), 0.0), 1.0),
    ] {
        let light = SkyLight::new(&environment).unwrap();
        let (mut squares, normals) = (0.0, normals(30));
        for normal in &normals {
            let exact = f64::from(importance(light.unoccluded(*normal)));
            let n = 20_000;
            let found = estimates(&light, *normal, n);
            let error = (found.mean / exact - 1.0).abs();
            let allowed = 4.0 * found.spread / (n as f64).sqrt() + 4e-3;
            assert!(error < allowed, "{name}, {normal}: {error}, {allowed}");
            squares += found.spread * found.spread;
        }
        let spread = (squares / normals.len() as f64).sqrt();
        println!("{name}: spread {spread}");
        assert!(spread < most, "{name}: {spread}");
    }
}

/// Sampling by luminance alone has the spread √(∫L · ∫L cos²⁺ / E² − 1).
#[test]
fn the_product_spreads_far_less_than_luminance_alone() {
    let environment = environment(panels(256, 128), 0.0);
    let light = SkyLight::new(&environment).unwrap();
    for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::new(0.2, 0.5, -0.6).normalize()] {
        let moments = directions(512, 256).fold([0.0; 3], |[all, first, second], (d, area)| {
            let given = f64::from(importance(environment.radiance(d))) * area;
            let cosine = f64::from(d.dot(normal).max(0.0));
            [all + given, first + given * cosine, second + given * cosine * cosine]
        });
        let by_light = (moments[0] * moments[2] / (moments[1] * moments[1]) - 1.0).sqrt();
        let product = estimates(&light, normal, 20_000).spread;
        assert!(product < 0.6 * by_light, "{normal}: {product} against {by_light}");
    }
}

#[test]
fn skies_that_shine_from_below_give_nothing_to_what_looks_up() {
    let map = SkyMap::from_fn(64, 32, |d| if d.y < -0.6 { Rgb::ONE } else { Rgb::ZERO }).unwrap();
    let light = SkyLight::new(&environment(map, 0.0)).unwrap();
    assert_eq!(light.sample(Vec3::Y, [0.3, 0.4]).1, 0.0);
    assert_eq!(light.unoccluded(Vec3::Y), Rgb::ZERO);
    assert!(light.sample(Vec3::NEG_Y, [0.3, 0.4]).1 > 0.0);
    assert!(SkyLight::new(&Environment::none()).is_none());
}

#[test]
fn tables_take_the_memory_that_was_said_and_no_more() {
    for (map, most) in
        [(panels(64, 32), 5 << 20), (panels(1, 1), 5 << 20), (panels(3000, 1500), 16 << 20)]
    {
        let environment = environment(map, 0.0);
        let said = SkyLight::needed_bytes(&environment);
        let taken = SkyLight::new(&environment).unwrap().bytes();
        assert!(taken <= said + 4096 && said <= most, "{taken} {said}");
    }
}

#[test]
#[ignore = "a measurement"]
fn seconds() {
    for (name, environment) in [
        ("uniform", Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::default() }),
        ("256", environment(panels(256, 128), 0.0)),
        ("2048", environment(panels(2048, 1024), 0.0)),
        ("8192", environment(panels(8192, 4096), 0.0)),
    ] {
        let start = std::time::Instant::now();
        let light = SkyLight::new(&environment).unwrap();
        let made = start.elapsed();
        let start = std::time::Instant::now();
        let mut numbers = Numbers::new(3, Stream::Gather, 2);
        let n = 1_000_000;
        let sum: f32 =
            (0..n).map(|_| light.sample(Vec3::Y, [numbers.uniform(), numbers.uniform()]).1).sum();
        let sampled = start.elapsed() / n;
        let start = std::time::Instant::now();
        let normals = normals(1000);
        let all: Rgb = (0..1000).flat_map(|_| &normals).map(|n| light.unoccluded(*n)).sum();
        let looked = start.elapsed() / 1_000_000;
        println!("{name}: {made:?}, sample {sampled:?}, irradiance {looked:?} ({sum} {all})");
    }
}
