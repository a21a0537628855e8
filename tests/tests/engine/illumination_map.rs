//! Caustics: what is in the illumination map, and whether pictures that read it are those that
//! path tracing makes.

use glam::{DVec3, Vec3};
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{
    CameraChoice, ExplicitCamera, Limits, RenderRequest, Rendered, StopReason,
};
use hemilux_engine::scene::{Material, Scene, made};
use hemilux_engine::transport::{METHODS, find};
use hemilux_tests::oracle::quadrature::Rule;
use hemilux_tests::oracle::statistics::{Moments, Scores};
use hemilux_tests::rendering::rendered;
use hemilux_tests::scenes::{Builder, imported};
use std::f64::consts::PI;
use std::sync::Arc;

const MAP: &str = "illumination-map";

fn request(scene: &Arc<Scene>, method: &str, size: u32, iterations: u64) -> RenderRequest {
    RenderRequest {
        limits: Limits::iterations(iterations),
        ..RenderRequest::new(scene.clone(), method, [size; 2])
    }
}

/// Sets what the request's method has; requests of several methods are made alike.
fn set(request: &mut RenderRequest, name: &str, value: &str) {
    if find(&request.method, name).is_some() {
        request.options.insert(name.into(), value.into());
    }
}

fn look(eye: [f32; 3], target: [f32; 3], up: [f32; 3], yfov_degrees: f32) -> CameraChoice {
    CameraChoice::Explicit(ExplicitCamera { eye, target, up, yfov_degrees })
}

/// A made scene without its walls, so that paths are short, and with a lamp three times as wide,
/// so that paths find it by chance.
fn outdoors(bytes: &[u8]) -> Arc<Scene> {
    let mut scene = imported(bytes);
    let Scene { triangles, materials, vertices, .. } = Arc::make_mut(&mut scene);
    let is = |material: u32, name: &str| materials[material as usize].name == name;
    triangles.retain(|triangle| !is(triangle.material, "plaster"));
    let lamp = triangles.iter().filter(|triangle| is(triangle.material, "lamp"));
    let mut lamp: Vec<u32> = lamp.flat_map(|triangle| triangle.vertices).collect();
    lamp.sort_unstable();
    lamp.dedup();
    let sum: Vec3 = lamp.iter().map(|vertex| vertices[*vertex as usize].position).sum();
    let center = sum / lamp.len() as f32;
    for vertex in lamp {
        let position = &mut vertices[vertex as usize].position;
        *position = center + 3.0 * (*position - center);
    }
    scene
}

/// Power on diffuse surfaces as traced, and what the map says that there is.
fn fluxes(rendered: &Rendered) -> (f64, f64) {
    let figures = &rendered.stats.diagnostics;
    (figures["caustic_flux_landed_watts"], figures["caustic_flux_in_map_watts"])
}

#[test]
fn the_map_has_the_flux_that_was_traced() {
    for (bytes, texels) in
        [(made::ring(), "1000000"), (made::ring(), "1"), (made::glass(), "30000")]
    {
        let mut request = request(&imported(&bytes), MAP, 24, 3);
        set(&mut request, "light_rays", "100000");
        set(&mut request, "map_texels", texels);
        let rendered = rendered(&request);
        let (landed, mapped) = fluxes(&rendered);
        println!("{landed} W landed, {mapped} W in the map of {texels} texels");
        assert!(landed > 0.01);
        assert!((mapped / landed - 1.0).abs() < 1e-5, "{mapped} of {landed} W");
    }
}

/// A one-sided light that shines into a mirror, and the floor behind it: what the floor gets is
/// the light of the image behind the mirror, times the albedo of a modified Phong lobe, cosθ where
/// it is sharp: ∫ L cosθ_floor cosθ_image cosθ_mirror/r² dA.
fn mirrored_light() -> (Arc<Scene>, impl Fn(DVec3) -> f64) {
    const RADIANCE: f32 = 10.0;
    let mut builder = Builder::default();
    let floor = builder.lambertian(Rgb::splat(0.5));
    let light = builder.light(Rgb::ZERO, Rgb::splat(RADIANCE));
    let mirror = builder.material(Material::metal("mirror", Rgb::ONE, 1e5));
    builder.quad(Vec3::new(-3.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 5.0, floor);
    // Faces +x.
    builder.quad(Vec3::new(1.0, 1.0, -0.3), Vec3::Y * 0.5, Vec3::Z * 0.6, light);
    // Faces −x, just large enough for what the camera sees.
    builder.quad(Vec3::new(2.0, 0.6, -0.6), Vec3::Z * 1.2, Vec3::Y * 0.65, mirror);
    let rule = Rule::gauss(6);
    let irradiance = move |point: DVec3| {
        let at = |y: f64, z: f64| {
            let way = DVec3::new(3.0, y, z) - point;
            // Light and mirror are parallel.
            way.y * way.x * way.x / way.length().powi(5)
        };
        let over_z = |y: f64| rule.integrate(|t| 0.6 * at(y, 0.6 * t - 0.3));
        f64::from(RADIANCE) * rule.integrate(|t| 0.5 * over_z(1.0 + 0.5 * t))
    };
    (builder.build(), irradiance)
}

#[test]
fn a_plane_mirror_shows_the_floor_an_image_of_the_light() {
    const SIZE: u32 = 16;
    let (scene, irradiance) = mirrored_light();
    let (height, yfov) = (4.0f64, 22.0f64);
    for (method, iterations, allowed) in [(MAP, 60, 0.03), ("ray-traced", 8_000, 0.3)] {
        let mut request = request(&scene, method, SIZE, iterations);
        request.camera =
            look([-0.8, height as f32, 0.0], [-0.8, 0.0, 0.0], [0.0, 0.0, -1.0], yfov as f32);
        // The image is smooth, so large cells do.
        set(&mut request, "light_rays", "50000");
        set(&mut request, "map_texels", "3000");
        let rendered = rendered(&request);
        let half = height * (0.5 * yfov.to_radians()).tan();
        // Means over blocks of 4 × 4 pixels.
        let mut ratios = Vec::new();
        for block in 0..16 {
            let (mut seen, mut expected) = (0.0, 0.0);
            for index in 0..16 {
                let column = 4 * (block % 4) + index % 4;
                let row = 4 * (block / 4) + index / 4;
                let across = (f64::from(column) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
                let down = (f64::from(row) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
                let point = DVec3::new(-0.8 + half * across, 0.0, half * down);
                expected += irradiance(point) * 0.5 / PI;
                seen += f64::from(rendered.picture.pixels[(row * SIZE + column) as usize].y);
            }
            ratios.push(seen / expected);
        }
        println!("{method}: {ratios:.4?}");
        for ratio in &ratios {
            assert!((ratio - 1.0).abs() < allowed, "{method}: {ratios:.4?}");
        }
        let mean = ratios.iter().sum::<f64>() / 16.0;
        println!("{method}: mean {mean:.4}");
        assert!((mean - 1.0).abs() < 0.25 * allowed, "{method}: {mean}");
    }
}

/// In a closed room that is uniformly bright everything is, behind clear glass as well: no light
/// is lost or gained at its surfaces, and the map and the camera's walks share it without rest.
#[test]
fn glass_in_a_furnace_is_invisible() {
    let mut builder = Builder::default();
    let wall = builder.light(Rgb::splat(0.5), Rgb::ONE);
    builder.cuboid(Vec3::ZERO, Vec3::splat(3.0), true, wall);
    let glass = builder.material(Material::glass("glass", 1.5));
    builder.cuboid(Vec3::new(1.0, 0.4, 0.7), Vec3::new(2.0, 1.4, 1.5), false, glass);
    let sheet =
        Material { volume: None, transmission: 0.8, ..Material::glass("sheet and paint", 1.5) };
    // What is not clear of it is a white furnace wall, too: opaque, and no brighter or darker.
    let sheet = builder.material(Material {
        base_color: Rgb::ONE,
        specular_factor: 0.0,
        double_sided: true,
        ..sheet
    });
    builder.quad(Vec3::new(0.3, 0.3, 2.0), Vec3::X, Vec3::Y, sheet);
    let scene = builder.build();
    for (method, iterations) in [("ray-traced", 300), (MAP, 150)] {
        let mut request = request(&scene, method, 24, iterations);
        request.camera = look([1.5, 1.2, 2.8], [1.3, 0.8, 0.5], [0.0, 1.0, 0.0], 60.0);
        set(&mut request, "light_rays", "20000");
        set(&mut request, "map_texels", "5000");
        let rendered = rendered(&request);
        let blocks = blocks(&rendered.picture, 8);
        println!("{method}: {blocks:.4?}");
        for block in blocks {
            assert!((block / 2.0 - 1.0).abs() < 0.02, "{method}: {block}");
        }
    }
}

/// Means of square blocks of a picture, over the channels.
fn blocks(picture: &Picture, side: u32) -> Vec<f64> {
    let across = picture.width / side;
    let mut sums = vec![0.0; (across * (picture.height / side)) as usize];
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (column, row) = (index as u32 % picture.width, index as u32 / picture.width);
        sums[(row / side * across + column / side) as usize] += f64::from(pixel.element_sum());
    }
    sums.iter().map(|sum| sum / f64::from(3 * side * side)).collect()
}

/// Means and scatter of blocks over seeds.
fn replicas(request: &RenderRequest, seeds: u64) -> Vec<Moments> {
    let mut means = vec![Moments::default(); 16];
    for seed in 0..seeds {
        let rendered = rendered(&RenderRequest { seed, ..request.clone() });
        let blocks = blocks(&rendered.picture, request.width / 4);
        for (mean, block) in means.iter_mut().zip(blocks) {
            mean.push(block);
        }
    }
    means
}

fn scaled(means: &[Moments], factor: f64) -> Vec<Moments> {
    means.iter().map(|mean| mean.scaled(factor)).collect()
}

/// The floor where the caustic is, by both methods; and the comparison finds a caustic that is a
/// fifth too bright, and one that is not there.
#[test]
fn pictures_are_those_of_path_tracing() {
    for (name, bytes, camera, share) in [
        (
            "ring",
            made::ring(),
            look([1.6, 1.2, 1.9], [1.62, 0.0, 1.56], [0.0, 1.0, 0.0], 30.0),
            0.1,
        ),
        (
            "glass",
            made::glass(),
            look([1.6, 1.6, 2.2], [1.6, 0.0, 1.66], [0.0, 1.0, 0.0], 40.0),
            0.1,
        ),
    ] {
        let scene = outdoors(&bytes);
        let with = |method: &str, iterations: u64, options: &[(&str, &str)]| {
            let mut request = request(&scene, method, 16, iterations);
            request.camera = camera.clone();
            options.iter().for_each(|(option, value)| set(&mut request, option, value));
            request
        };
        let traced = replicas(&with("ray-traced", 600, &[]), 12);
        let mapped = replicas(&with(MAP, 24, &[("light_rays", "16384")]), 12);
        let sum = |means: &[Moments]| means.iter().map(Moments::mean).sum::<f64>();
        let scores = Scores::between(&mapped, &traced);
        println!("{name}: {scores:?}, {:.4} and {:.4}", sum(&mapped), sum(&traced));
        let noise: Vec<f64> = traced.iter().map(|m| m.standard_error() / m.mean()).collect();
        let z: Vec<f64> = mapped.iter().zip(&traced).map(|(m, t)| m.z(t)).collect();
        println!("noise of the path-traced blocks: {noise:.3?}, z {z:.1?}");
        assert!(scores.is_chance(), "{name}: {scores:?}");
        // Without what mirrors and glass send on, but with their shadows.
        let mut dark = Scene::clone(&scene);
        for material in &mut dark.materials {
            if material.casts_caustics() {
                *material = Material::lambertian("black", Rgb::ZERO);
            }
        }
        let mut without = with("ray-traced", 400, &[]);
        without.scene = Arc::new(dark);
        let without = replicas(&without, 4);
        let caustic = 1.0 - sum(&without) / sum(&traced);
        println!("{name}: {:.1} % of the light is caustic or mirrored", 100.0 * caustic);
        assert!(caustic > share, "{name}: there is hardly a caustic to compare");
        assert!(!Scores::between(&without, &traced).is_chance(), "{name}: a missing caustic");
        assert!(!Scores::between(&scaled(&mapped, 1.2), &traced).is_chance(), "{name}: a factor");
    }
}

/// Where all light is in the map, passes hardly differ from each other, and yet the estimate is
/// what pictures of other seeds differ by.
#[test]
fn the_estimated_error_knows_the_maps_share() {
    const SEEDS: u64 = 16;
    let (scene, _) = mirrored_light();
    let mut request = request(&scene, MAP, 16, 24);
    request.camera = look([-0.8, 4.0, 0.0], [-0.8, 0.0, 0.0], [0.0, 0.0, -1.0], 22.0);
    set(&mut request, "light_rays", "2000");
    set(&mut request, "map_texels", "3000");
    let rendered: Vec<Rendered> =
        (0..SEEDS).map(|seed| rendered(&RenderRequest { seed, ..request.clone() })).collect();
    let (mut squares, mut sum) = (0.0, 0.0);
    for pixel in 0..256 {
        let values = rendered.iter().map(|r| r.picture.pixels[pixel].as_dvec3());
        let mean = values.clone().sum::<DVec3>() / SEEDS as f64;
        let deviations: f64 = values.map(|value| (value - mean).length_squared()).sum();
        squares += deviations / (SEEDS - 1) as f64;
        sum += mean.element_sum();
    }
    let scatter = (squares / 768.0).sqrt() / (sum / 768.0);
    let estimates = rendered.iter().filter_map(|r| r.stats.figures.estimated_error);
    let estimate = (estimates.map(|e| e * e).sum::<f64>() / SEEDS as f64).sqrt();
    println!("estimated {estimate:.4}, scatter {scatter:.4}");
    assert!((0.8..1.25).contains(&(estimate / scatter)), "{estimate} {scatter}");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let scene = imported(&made::glass());
    let mut request = request(&scene, MAP, 20, 3);
    set(&mut request, "light_rays", "9000");
    let bits = |request: &RenderRequest| {
        let pixels = rendered(request).picture.pixels;
        pixels.iter().flat_map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    let first = bits(&request);
    assert_eq!(first, bits(&request));
    request.seed = 2;
    assert_ne!(first, bits(&request));
}

/// Patches cannot show caustics, and say so; rays can. Every method that there is has to be one or the
/// other.
#[test]
fn methods_on_patches_say_that_they_miss_caustics() {
    const SHOW_CAUSTICS: [&str; 3] = ["ray-traced", MAP, "hemilux"];
    assert!(SHOW_CAUSTICS.iter().all(|method| METHODS.contains(method)));
    for (bytes, material) in [(made::ring(), "gold"), (made::glass(), "clear glass")] {
        let scene = imported(&bytes);
        for method in METHODS {
            let mut request = request(&scene, method, 8, 1);
            set(&mut request, "patches", "200");
            set(&mut request, "hemicube_resolution", "16");
            let stats = rendered(&request).stats;
            let said = stats.warnings.iter().any(|warning| {
                warning.what.contains("cannot show its caustics")
                    && warning.what.contains(material)
                    && warning.what.contains(MAP)
            });
            // `auto` is the method that it picked.
            let shows = SHOW_CAUSTICS.contains(&stats.plan.method.as_str());
            assert_eq!(said, !shows, "{method}, {material}: {:?}", stats.warnings);
        }
    }
}

#[test]
fn scenes_without_mirrors_are_path_traced_and_say_so() {
    let scene = imported(&made::cornell());
    let mapped = rendered(&request(&scene, MAP, 16, 2));
    assert_eq!(mapped.stats.stopped, StopReason::Iterations);
    assert!(mapped.stats.warnings.iter().any(|w| w.what.contains("no caustics to map")));
    assert_eq!(mapped.picture, rendered(&request(&scene, "ray-traced", 16, 2)).picture);
}

/// A mirror over the lamp, and neither floor nor camera where light is: nothing hangs.
#[test]
fn time_ends_a_job_in_the_middle_of_a_pass() {
    let scene = imported(&made::ring());
    let mut request = request(&scene, MAP, 400, 1_000_000);
    request.limits = Limits::seconds(0.5);
    set(&mut request, "light_rays", "20000");
    let stats = rendered(&request).stats;
    assert_eq!(stats.stopped, StopReason::TimeBudget);
    assert!(stats.figures.iterations >= 1);
}
