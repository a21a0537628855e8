//! Meshes that instances share are met, lit and shown as their copies are.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::random::{Numbers, Stream};
use hemilux_engine::rays::{Eye, Rays};
use hemilux_engine::render::{CameraChoice, ExplicitCamera, Limits, RenderRequest, Unobserved};
use hemilux_engine::scene::instances::Instances;
use hemilux_engine::scene::{Alpha, Material, Scene, Triangle, Vertex};
use hemilux_engine::transport::render;
use hemilux_tests::scenes::Builder;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// A ball about the origin whose stacks have the materials in turn, half transparent to the sides
/// by its vertices' alpha.
fn ball(stacks: u32, slices: u32, materials: &[u32]) -> (Vec<Vertex>, Vec<Triangle>) {
    let mut vertices = Vec::new();
    for stack in 0..=stacks {
        for slice in 0..=slices {
            let polar = PI * stack as f32 / stacks as f32;
            let round = TAU * (slice % slices) as f32 / slices as f32;
            let (sine, cosine) = polar.sin_cos();
            let normal = Vec3::new(sine * round.cos(), cosine, sine * round.sin());
            let alpha = if slice % 4 < 2 { 1.0 } else { 0.2 };
            vertices.push(Vertex { alpha, ..Vertex::new(normal, normal) });
        }
    }
    let mut triangles = Vec::new();
    for stack in 0..stacks {
        let material = materials[stack as usize % materials.len()];
        for slice in 0..slices {
            let a = stack * (slices + 1) + slice;
            let [b, c, d] = [a + 1, a + slices + 1, a + slices + 2];
            if stack > 0 {
                triangles.push(Triangle { vertices: [a, b, c], material });
            }
            if stack + 1 < stacks {
                triangles.push(Triangle { vertices: [b, d, c], material });
            }
        }
    }
    (vertices, triangles)
}

/// A room with a lamp, and in it balls that are turned, stretched and mirrored: dull, glossy and
/// masked ones, and a few that shine. One is out of its place by `off`.
fn room(off: f64) -> Scene {
    let mut builder = Builder::default();
    let white = builder.lambertian(Rgb::splat(0.7));
    let lamp = builder.light(Rgb::ZERO, Rgb::splat(12.0));
    let red = builder.lambertian(Rgb::new(0.7, 0.2, 0.15));
    let glossy = builder.material(Material {
        specular_factor: 1.0,
        roughness: 0.4,
        ..Material::lambertian("glossy", Rgb::splat(0.4))
    });
    let net = builder.material(Material {
        alpha: Alpha::Mask { cutoff: 0.5 },
        double_sided: true,
        ..Material::lambertian("net", Rgb::new(0.2, 0.6, 0.3))
    });
    let glow = builder.light(Rgb::splat(0.5), Rgb::new(1.5, 1.2, 0.6));
    let side = 6.0;
    let (x, y, z) = (Vec3::X * side, Vec3::Y * side, Vec3::Z * side);
    builder.quad(Vec3::ZERO, z, x, white);
    builder.quad(Vec3::ZERO, x, y, white);
    builder.quad(Vec3::ZERO, y, z, red);
    builder.quad(x, z, y, white);
    builder.quad(y, x, z, white);
    builder.quad(Vec3::new(2.2, 5.9, 2.2), Vec3::X * 1.6, Vec3::Z * 1.6, lamp);
    let mut scene = Arc::unwrap_or_clone(builder.build());
    let mut instances = Instances::default();
    let shapes = [(16, 20, vec![red, glossy]), (10, 12, vec![net]), (4, 5, vec![glow])];
    let shapes = shapes.map(|(stacks, slices, materials)| {
        let (vertices, triangles) = ball(stacks, slices, &materials);
        instances.add_shape(vertices, triangles)
    });
    let mut numbers = Numbers::new(4, Stream::Gather, 0);
    for index in 0..48u32 {
        let mut number = || f64::from(numbers.uniform());
        let turn = DQuat::from_xyzw(number(), number() - 0.5, number(), number()).normalize();
        let mut size = DVec3::new(0.25, 0.2 + 0.3 * number(), 0.25);
        if index % 3 == 0 {
            size.x = -size.x;
        }
        let shape = if index % 8 == 7 { 2 } else { (index % 2) as usize };
        if shape == 2 {
            size *= 0.3;
        }
        let mut at = 0.5 + 5.0 * DVec3::new(number(), 0.7 * number(), number());
        if index == 20 {
            at.x += off;
        }
        let to_world = DAffine3::from_scale_rotation_translation(size, turn, at);
        assert!(instances.add(shapes[shape], to_world));
    }
    instances.finish();
    scene.instances = Arc::new(instances);
    scene
}

/// Shares of rays between random places that meet something else, or are blocked otherwise, in one
/// scene than in the other, whose triangles have the same numbers.
fn differing(one: &Scene, other: &Scene) -> [f32; 2] {
    const RAYS: usize = 40_000;
    let (one, other) = (Rays::of(&Arc::new(one.clone())), Rays::of(&Arc::new(other.clone())));
    let mut numbers = Numbers::new(7, Stream::Gather, 0);
    let mut count = [0; 2];
    for index in 0..RAYS {
        let mut place = || 6.0 * Vec3::new(numbers.uniform(), numbers.uniform(), numbers.uniform());
        let [from, to] = [place(), place()];
        let eye = if index % 2 == 0 { Eye::Light } else { Eye::Camera };
        let [a, b] = [&one, &other].map(|rays| {
            let (from, to) = (rays.place(from), rays.place(to));
            let hit = rays.closest(eye, from, (to - from).normalize());
            (hit, hit.map(|hit| rays.spot(&hit)), rays.blocked(from, to, |_| false))
        });
        let alike = match ((a.0, a.1), (b.0, b.1)) {
            ((None, _), (None, _)) => true,
            ((Some(a), Some(spot)), (Some(b), Some(other_spot))) => {
                let near = one.scale() as f32 * 1e-3;
                a.triangle == b.triangle
                    && a.back == b.back
                    && (a.distance - b.distance).abs() < near
                    && (a.u - b.u).abs().max((a.v - b.v).abs()) < 0.02
                    && spot.point.distance(other_spot.point) < near
                    && spot.normal.dot(other_spot.normal) > 0.999
            }
            _ => false,
        };
        count[0] += usize::from(!alike);
        count[1] += usize::from(a.2 != b.2);
    }
    count.map(|count| count as f32 / RAYS as f32)
}

/// Through two levels a ray meets what it meets where everything is listed, but for edges that
/// rounding moves.
#[test]
fn rays_meet_the_same_through_two_levels() {
    let shared = room(0.0);
    let flat = shared.flattened();
    assert!(shared.triangle_count() > 10_000 && flat.instances.is_empty());
    let [hits, blocked] = differing(&shared, &flat);
    println!("{hits} of the hits differ, {blocked} of the shadows");
    assert!(hits < 2e-4 && blocked < 2e-4, "{hits} {blocked}");
    // A ball that is elsewhere, by a twentieth of its size, is found out.
    let [hits, _] = differing(&room(0.02), &flat);
    assert!(hits > 1e-3, "{hits}");
}

fn picture(scene: Scene, method: &str, iterations: u64) -> Picture {
    by_threads(scene, method, iterations, 2)
}

fn by_threads(scene: Scene, method: &str, iterations: u64, threads: usize) -> Picture {
    let request = RenderRequest {
        camera: CameraChoice::Explicit(ExplicitCamera {
            eye: [5.6, 3.6, 5.6],
            target: [1.5, 1.6, 1.5],
            up: [0.0, 1.0, 0.0],
            yfov_degrees: 60.0,
        }),
        limits: Limits::iterations(iterations),
        seed: 3,
        ..RenderRequest::new(Arc::new(scene), method, [64, 48])
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let mut device = CpuDevice::new(Some(threads)).expect("threads");
    pool.install(|| render(&mut device, &request, &mut Unobserved)).expect("it renders").picture
}

/// Root of the mean squared difference of the pixels, over the mean.
fn difference(one: &Picture, other: &Picture) -> f32 {
    let pairs = one.pixels.iter().zip(&other.pixels);
    let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    let count = (3 * one.pixels.len()) as f32;
    (squares / count).sqrt() / mean(other)
}

fn mean(picture: &Picture) -> f32 {
    let sum: Rgb = picture.pixels.iter().sum();
    sum.element_sum() / (3 * picture.pixels.len()) as f32
}

/// Both methods show shared meshes as their copies; the noise of path tracing is the same but where
/// rounding changes a path.
#[test]
fn pictures_are_those_of_copies() {
    let shared = room(0.0);
    let flat = shared.flattened();
    for (method, iterations, most) in [("ray-traced", 32, 0.01), ("hemilux", 6, 0.02)] {
        let [of_shared, of_flat, of_other] = [shared.clone(), flat.clone(), room(0.3)]
            .map(|scene| picture(scene, method, iterations));
        let ratio = mean(&of_shared) / mean(&of_flat);
        let off = difference(&of_shared, &of_flat);
        let planted = difference(&of_other, &of_flat);
        println!("{method}: {off:.4} off, mean ratio {ratio:.4}, planted error {planted:.4}");
        assert!((ratio - 1.0).abs() < 0.01, "{method}: {ratio}");
        assert!(off < most && planted > 1.2 * off, "{method}: {off} {planted}");
    }
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    let [alone, together] = [1, 3].map(|threads| by_threads(room(0.0), "hemilux", 2, threads));
    assert_eq!(alone, together);
    assert_ne!(alone, picture(room(0.01), "hemilux", 2), "what is elsewhere looks the same");
}
