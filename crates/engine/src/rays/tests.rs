use super::triangle::{Packet, Sheared};
use super::*;
use crate::radiometry::Rgb;
use crate::random::Numbers;
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made;
use crate::scene::{Material, Triangle, Vertex};

fn scene(corners: &[[Vec3; 3]], double_sided: bool) -> Scene {
    let mut scene = Scene::default();
    scene.materials.push(Material { double_sided, ..Material::default() });
    for corners in corners {
        let first = scene.vertices.len() as u32;
        for position in *corners {
            scene.vertices.push(Vertex::new(position, Vec3::Z));
        }
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: 0 });
    }
    scene
}

fn numbers(seed: u64) -> Numbers {
    Numbers::new(seed, crate::random::Stream::Path, 0)
}

fn point(numbers: &mut Numbers) -> Vec3 {
    Vec3::new(numbers.uniform(), numbers.uniform(), numbers.uniform())
}

fn direction(numbers: &mut Numbers) -> Vec3 {
    loop {
        let at = 2.0 * point(numbers) - 1.0;
        if at.length_squared() <= 1.0 && at.length_squared() > 1e-4 {
            return at.normalize();
        }
    }
}

fn clutter(count: usize, size: f32) -> Vec<[Vec3; 3]> {
    let mut numbers = numbers(5);
    (0..count)
        .map(|_| {
            let at = point(&mut numbers);
            [0; 3].map(|_| at + size * (point(&mut numbers) - 0.5))
        })
        .collect()
}

/// Brute force in double precision.
fn nearest(corners: &[[Vec3; 3]], origin: Vec3, direction: Vec3) -> Option<(usize, f64)> {
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let mut best: Option<(usize, f64)> = None;
    for (index, triangle) in corners.iter().enumerate() {
        let [a, b, c] = triangle.map(|p| p.as_dvec3() - o);
        let edges = [d.dot(c.cross(b)), d.dot(a.cross(c)), d.dot(b.cross(a))];
        let inside = edges.iter().all(|e| *e >= 0.0) || edges.iter().all(|e| *e <= 0.0);
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a) / normal.dot(d);
        if inside && t > 0.0 && best.is_none_or(|(_, other)| t < other) {
            best = Some((index, t));
        }
    }
    best
}

/// Closest hits of a cluttered scene are those of double precision brute force, at any scale.
#[test]
fn closest_hits_are_closest_at_any_scale() {
    for scale in [1.0f32, 1e-6, 1e6] {
        let corners: Vec<[Vec3; 3]> =
            clutter(500, 0.4).iter().map(|t| t.map(|p| p * scale)).collect();
        let rays = Rays::new(&scene(&corners, true));
        let (mut hits, mut off) = (0, 0);
        let mut numbers = numbers(1);
        for _ in 0..5000 {
            let origin = (3.0 * point(&mut numbers) - 1.0) * scale;
            let direction = direction(&mut numbers);
            let expected = nearest(&corners, origin, direction);
            let placed = rays.place(origin);
            let found = rays.closest(Eye::Camera, placed, direction);
            let same = match (expected, found) {
                (None, None) => true,
                (Some((index, t)), Some(hit)) => {
                    let end = rays.place(origin + direction * t as f32);
                    assert!(
                        hit.triangle as usize != index
                            || (placed.distance(end) / hit.distance - 1.0).abs() < 1e-4
                    );
                    hit.triangle as usize == index
                }
                _ => false,
            };
            hits += usize::from(expected.is_some());
            off += usize::from(!same);
            if let Some((_, t)) = expected {
                let beyond = rays.place(origin + direction * (1.01 * t as f32));
                let before = rays.place(origin + direction * (0.99 * t as f32));
                assert!(rays.blocked(placed, beyond, |_| false));
                assert!(!rays.blocked(placed, before, |_| false));
                assert!(!rays.blocked(placed, beyond, |_| true));
            }
        }
        assert!(hits > 500, "{hits}");
        // Edges may go either way.
        assert!(off <= 1, "scale {scale}: {off} of 5000 differ");
    }
}

/// A ball of triangles with common corners has no gap, wherever rays start and go.
#[test]
fn closed_bodies_leak_nothing() {
    let (rings, sectors) = (40, 60);
    let at = |ring: usize, sector: usize| {
        let theta = ring as f32 / rings as f32 * std::f32::consts::PI;
        let phi = (sector % sectors) as f32 / sectors as f32 * std::f32::consts::TAU;
        let radius = if ring == 0 || ring == rings { 0.0 } else { theta.sin() };
        Vec3::new(radius * phi.cos(), radius * phi.sin(), theta.cos()) * 3.7 + 11.0
    };
    let mut corners = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let (a, b) = (at(ring, sector), at(ring + 1, sector));
            let (c, d) = (at(ring + 1, sector + 1), at(ring, sector + 1));
            corners.push([a, b, c]);
            corners.push([a, c, d]);
        }
    }
    let rays = Rays::new(&scene(&corners, true));
    let mut numbers = numbers(2);
    for i in 0..200_000 {
        let origin = 11.0 + 2.0 * (point(&mut numbers) - 0.5);
        // Every second ray goes exactly towards a corner or the middle of an edge.
        let direction = if i % 2 == 0 {
            direction(&mut numbers)
        } else {
            let triangle = corners[(numbers.uniform() * corners.len() as f32) as usize];
            let end = if i % 4 == 1 { triangle[0] } else { 0.5 * (triangle[0] + triangle[1]) };
            (end - origin).normalize()
        };
        assert!(
            rays.closest(Eye::Light, rays.place(origin), direction).is_some(),
            "leak from {origin} to {direction}"
        );
    }
}

/// Rays that start on a wall don't meet it, nor its other half, at any angle and scale.
#[test]
fn surfaces_do_not_shade_themselves() {
    for (scale, shift) in [(1.0f32, 0.0f32), (1e-6, 0.0), (1e6, 0.0), (1.0, 300.0)] {
        let place = |x: f32, y: f32| Vec3::new(x, y, 0.3 * x - 0.2 * y) * scale + shift;
        let (a, b, c, d) = (place(-5.0, -3.0), place(5.0, -3.0), place(5.0, 3.0), place(-5.0, 3.0));
        let corners = [[a, b, c], [a, c, d]];
        let built = scene(&corners, true);
        let rays = Rays::new(&built);
        let mut numbers = numbers(3);
        for _ in 0..50_000 {
            let triangle = (numbers.uniform() * 2.0) as u32;
            let root = numbers.uniform().sqrt();
            let (u, v) = (1.0 - root, root * numbers.uniform());
            let corners = rays.corners(&built, triangle).0;
            let spot = Spot::new(corners, unit_normal(corners), u, v);
            let mut away = direction(&mut numbers);
            // A third of the rays graze.
            if numbers.uniform() < 0.3 {
                let flat = away - away.dot(spot.normal) * spot.normal;
                away = (flat + 1e-3 * spot.normal).normalize();
            }
            let side = spot.normal * away.dot(spot.normal).signum();
            let hit = rays.closest(Eye::Light, spot.off_surface(side), away);
            assert!(hit.is_none(), "scale {scale}, shift {shift}: {hit:?}");
        }
    }
}

/// Fronts win over coincident backs; cameras look through backs, light doesn't.
#[test]
fn backs_are_black_to_light_and_invisible_to_cameras() {
    let front = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let back = [Vec3::ZERO, Vec3::Y, Vec3::X];
    let behind = [0, 1, 2].map(|i| front[i] - Vec3::Z);
    let rays = Rays::new(&scene(&[back, front, behind], false));
    let origin = rays.place(Vec3::new(0.21, 0.3, 1.7));
    let down = Vec3::new(0.01, -0.02, -1.0).normalize();
    for eye in [Eye::Camera, Eye::Light] {
        let hit = rays.closest(eye, origin, down).unwrap();
        assert_eq!((hit.triangle, hit.back), (1, false));
    }
    let one_sided = Rays::new(&scene(&[back, behind], false));
    let to_light = one_sided.closest(Eye::Light, origin, down).unwrap();
    assert_eq!((to_light.triangle, to_light.back), (0, true));
    let to_camera = one_sided.closest(Eye::Camera, origin, down).unwrap();
    assert_eq!((to_camera.triangle, to_camera.back), (1, false));
    let two_sided = Rays::new(&scene(&[back, behind], true));
    let to_camera = two_sided.closest(Eye::Camera, origin, down).unwrap();
    assert_eq!((to_camera.triangle, to_camera.back), (0, true));
}

/// From far away rays still hit a thing of a millionth of the distance.
#[test]
fn far_cameras_see_small_scenes() {
    let corners = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let rays = Rays::new(&scene(&corners, false));
    let origin = Vec3::new(3e5, 2e5, 1e6);
    for (at, inside) in [(0.3, true), (0.45, true), (0.6, false)] {
        let direction = (Vec3::new(at, at, 0.0) - origin).as_dvec3().normalize().as_vec3();
        // A direction in single precision is off by 6·10⁻⁸ of the distance.
        let start = rays.approach(origin, direction);
        let hit = start.and_then(|start| rays.closest(Eye::Camera, start, direction));
        assert_eq!(hit.is_some(), inside, "at {at}");
    }
    assert!(rays.approach(origin, Vec3::X).is_none());
}

/// Hostile heaps of triangles take neither long nor deep trees.
#[test]
fn heaps_are_built_quickly() {
    let start = std::time::Instant::now();
    let same = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 100_000];
    let nested: Vec<_> = (0..50_000)
        .map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p * 0.9f32.powi(i % 700)))
        .collect();
    for corners in [same, nested, clutter(1, 1.0), Vec::new()] {
        let rays = Rays::new(&scene(&corners, true));
        let origin = rays.place(Vec3::new(1e-3, 1e-3, 1.0));
        let hit = rays.closest(Eye::Light, origin, Vec3::NEG_Z);
        assert_eq!(hit.is_some(), corners.len() > 1);
    }
    assert!(start.elapsed().as_secs_f64() < 5.0, "{:?}", start.elapsed());
}

/// Rays along the axes, whatever the sign of their zeros, meet the walls of a room.
#[test]
fn rays_along_the_axes_meet_the_walls() {
    let scene = made::furnace(Rgb::ONE, Rgb::ONE);
    let scene = import(&scene, &Resources::default(), &ImportLimits::default());
    let scene = scene.expect("it loads");
    let rays = Rays::new(&scene);
    let (low, high) = scene.bounds().expect("there are triangles");
    let start = rays.place(low + Vec3::new(0.1, 0.2, 0.3) * (high - low));
    for zero in [0.0f32, -0.0] {
        for direction in [Vec3::NEG_X, Vec3::X, Vec3::NEG_Y, Vec3::Y, Vec3::NEG_Z, Vec3::Z] {
            let along = |x: f32| if x == 0.0 { zero } else { x };
            let direction = Vec3::from_array(direction.to_array().map(along));
            assert!(rays.closest(Eye::Light, start, direction).is_some(), "{direction:?}");
            let end = start + direction * (high - low).length() * rays.scale() as f32;
            assert!(rays.blocked(start, end, |_| false), "{direction:?}");
        }
    }
}

/// Eight at a time meet what one at a time meets, to the bit: in clutter, on walls along the axes,
/// through common edges and corners, and in heaps of the same triangle.
#[test]
fn eights_meet_what_ones_meet() {
    let mut all = clutter(300, 0.5);
    all.extend(clutter(40, 0.5).into_iter().map(|[a, b, c]| {
        let flat = |p: Vec3| Vec3::new(p.x, p.y, 0.5);
        [flat(a), flat(b), flat(c)]
    }));
    all.extend([[Vec3::ZERO, Vec3::X, Vec3::Y]; 30]);
    let rays = Rays::new(&scene(&all, false));
    let mut numbers = numbers(9);
    let mut hits = 0;
    for round in 0..20_000 {
        let origin = rays.place(3.0 * point(&mut numbers) - 1.0);
        let target = match round % 4 {
            0 => all[round % all.len()][round % 3],
            1 => 0.5 * (all[round % all.len()][0] + all[round % all.len()][1]),
            _ => point(&mut numbers),
        };
        let direction = match round % 5 {
            0 => [Vec3::X, -Vec3::Y, Vec3::Z][round % 3],
            1 => Vec3::new(0.6, -0.0, -0.8),
            _ => (rays.place(target) - origin).normalize(),
        };
        let eye = if round % 2 == 0 { Eye::Camera } else { Eye::Light };
        let [one, best] = [
            rays.closest_by::<Baseline>(eye, origin, direction, None),
            rays.closest(eye, origin, direction),
        ]
        .map(|hit| hit.map(|hit| (hit.distance, hit.u, hit.v, hit.back, hit.triangle)));
        // Which of several at one place is met first is the order's to say.
        let at = |hit: Option<(f32, f32, f32, bool, u32)>| hit.map(|hit| hit.0);
        assert_eq!(at(one), at(best), "{origin} {direction}");
        if one.is_some_and(|hit| hit.4 < 300) && best.is_some_and(|hit| hit.4 < 300) {
            assert_eq!(one, best, "{origin} {direction}");
        }
        hits += usize::from(one.is_some());
        let (between, distance) =
            (rays.place(target) - origin, (rays.place(target) - origin).length());
        let (towards, end) = (between / distance, distance * SHORT_OF_END);
        let blocked = rays.blocked_by::<Baseline>(origin, towards, end, |_| false);
        assert_eq!(blocked, rays.blocked(origin, rays.place(target), |_| false), "{origin}");
    }
    assert!((5_000..19_000).contains(&hits), "{hits}");
}

/// Batches of any size, into lists that held something else before.
#[test]
fn many_meet_what_each_meets() {
    let rays = Rays::new(&scene(&clutter(300, 0.3), false));
    let mut numbers = numbers(3);
    let mut place = || rays.place(3.0 * point(&mut numbers) - 1.0);
    let segments: Vec<Segment> =
        (0..2000).map(|_| Segment { from: place(), to: place() }).collect();
    let towards = |segment: &Segment| Ray {
        origin: segment.from,
        direction: (segment.to - segment.from).normalize(),
    };
    let batch: Vec<Ray> = segments.iter().map(towards).collect();
    let (mut hits, mut blocked) = (vec![None; 3], vec![true; 5]);
    let told = |hit: Option<Hit>| hit.map(|hit| format!("{hit:?}"));
    // Each segment passes what another one is stopped by.
    let passes = |segment: usize, triangle: u32| (segment + triangle as usize).is_multiple_of(2);
    let (mut met, mut passed) = (0, 0);
    for count in [2000, 1, 0, 7] {
        for eye in [Eye::Camera, Eye::Light] {
            rays.closest_many(eye, &batch[..count], &mut hits);
            assert_eq!(hits.len(), count);
            for (ray, hit) in batch.iter().zip(&hits) {
                assert_eq!(told(*hit), told(rays.closest(eye, ray.origin, ray.direction)));
                met += usize::from(hit.is_some());
            }
        }
        rays.blocked_many(&segments[..count], passes, &mut blocked);
        assert_eq!(blocked.len(), count);
        for (index, (Segment { from, to }, blocked)) in segments.iter().zip(&blocked).enumerate() {
            let skip = |triangle| passes(index, triangle);
            assert_eq!(*blocked, rays.blocked(*from, *to, skip));
            passed += usize::from(*blocked != rays.blocked(*from, *to, |_| false));
        }
    }
    assert!(met > 500 && passed > 100, "{met} {passed}");
}

/// No triangle is dropped that one by one would be met: rays along the middle of slivers, where
/// edge functions are 0 or rounded to either side of it, at corners, and behind its start.
#[test]
fn what_eights_drop_nobody_meets() {
    let mut numbers = numbers(4);
    let (mut met, mut dropped) = (0, 0);
    for _ in 0..100_000 {
        let mut number = || 2e5 * numbers.uniform() - 1e5;
        let mut packet = Packet::EMPTY;
        for lane in 0..8 {
            let at = |along: f32, z: f32| Vec3::new(0.7 * along, 0.3 * along, z);
            let mut corners = [at(number(), 5e5), at(number(), 5e5), at(number(), 5e5)];
            match lane {
                0..3 => {}
                3 => corners[0] = at(0.0, number()),
                _ => corners[2] = Vec3::new(number(), number(), number()),
            }
            packet.push(0, corners, true);
        }
        let sheared = Sheared::new(Vec3::ZERO, Vec3::Z);
        let kept = passing(&packet, &sheared, 6e5);
        for lane in 0..8 {
            let crosses = sheared.cross(&packet, lane, 6e5).is_some();
            assert!(!crosses || kept >> lane & 1 == 1, "{:?}", packet.corners(lane));
            met += usize::from(crosses);
            dropped += usize::from(kept >> lane & 1 == 0);
        }
    }
    println!("{met} met, {dropped} dropped");
    assert!(met > 10_000, "{met}");
}

/// What the best test of this processor lets through.
fn passing(packet: &Packet, ray: &Sheared, end: f32) -> u32 {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn with_avx2(packet: &Packet, ray: &Sheared, end: f32) -> u32 {
            boxes::Avx2::crossed(packet, ray, end)
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features were detected.
            return unsafe { with_avx2(packet, ray, end) };
        }
    }
    Baseline::crossed(packet, ray, end)
}

/// Small triangles far apart part their leaves most, and so fill them least.
#[test]
fn scenes_take_no_more_than_is_asked_for() {
    for size in [1e-4, 0.02, 0.5] {
        let all = clutter(5_000, size);
        let rays = Rays::new(&scene(&all, true));
        let packets = rays.listed.leaves() * size_of::<Packet>();
        // Boxes and both trees take 200 more a triangle.
        let bytes = packets + 200 * all.len();
        assert!(bytes as u64 <= Rays::needed_bytes(all.len() as u64), "{size}: {bytes}");
    }
}
