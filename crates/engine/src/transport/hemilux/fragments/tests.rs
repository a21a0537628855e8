//! Fragments share out what a pixel sees.

use super::band::SeenPart;
use super::edges::Edges;
use super::*;
use crate::rays::Eye;
use crate::scene::environment::{Environment, Sky};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made::revolved::{ball, revolved};
use crate::scene::{Camera, Material, Scene, Triangle, made};
use crate::surface::Reflection;
use crate::transport::hemilux::specimen::{EMISSION, SEED, Specimen};
use glam::{EulerRot, Mat4, Quat};
use std::f32::consts::PI;

#[test]
fn the_samples_of_a_pixel_are_shared_out() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    assert_eq!(visible.start.len(), (visible.width * visible.height) as usize + 1);
    for pixel in 0..(visible.width * visible.height) as usize {
        let own =
            &visible.fragments[visible.start[pixel] as usize..visible.start[pixel + 1] as usize];
        assert!(own.iter().all(|fragment| fragment.pixel as usize == pixel));
        let share: f32 = own.iter().map(|fragment| fragment.share).sum();
        assert!((share - 1.0).abs() < 1e-5, "pixel {pixel} of a closed room sees {share}");
        assert!((visible.shine[pixel] - Rgb::splat(EMISSION)).abs().max_element() < 1e-5);
    }
}

#[test]
fn lobes_are_there_where_something_is_glossy() {
    let visible = Specimen::new(&made::phong_cornell(), 500).visible();
    let glossy = visible.fragments.iter().filter(|fragment| fragment.glossy).count();
    assert!(glossy > 0 && visible.lobes.len() >= glossy);
    assert!(visible.lobes.iter().all(|lobe| visible.fragments[lobe.fragment as usize].glossy));
    assert!(visible.lobes.is_sorted_by_key(|lobe| visible.fragments[lobe.fragment as usize].pixel));
    assert!(Specimen::furnace().visible().lobes.is_empty());
}

#[test]
fn a_fragment_is_sampled_on_all_its_facets() {
    let specimen = Specimen::new(&made::tessellated_room(20_000), 500);
    let visible = specimen.visible();
    let eye = visible.ray(0, Vec2::ZERO).0;
    let several = |fragment: &&Fragment| !fragment.has_one_facet();
    assert!(visible.fragments.iter().filter(several).count() > 50, "facets are small");
    for fragment in &visible.fragments {
        let samples = (fragment.share * visible.samples() as f32).round() as u32;
        assert_eq!(visible.count(fragment), samples);
        let points: Vec<_> = (0..samples).map(|n| visible.sample_point(fragment, n)).collect();
        // Light changes within a pixel: one facet's middle does not stand for all of it.
        let middle = points.iter().sum::<Vec3>() / samples as f32;
        let reach = points.iter().map(|point| point.distance(middle)).fold(0.0, f32::max);
        let off = fragment.point.distance(middle);
        assert!(off <= 0.1 * reach + 1e-5, "pixel {}: {off} of {reach}", fragment.pixel);
        for (n, point) in points.iter().enumerate() {
            assert!(!points[..n].contains(point), "sample {n} of pixel {}", fragment.pixel);
            let to = *point - eye;
            let hit = specimen.world.rays.closest(Eye::Camera, eye, to.normalize());
            let seen = hit.expect("something is there").distance / to.length();
            assert!((seen - 1.0).abs() < 1e-3, "pixel {} sees {seen} as far", fragment.pixel);
        }
    }
}

/// Where a scene lies far from the origin, corners of facets that are cut out of triangles are rounded off
/// the triangles' planes. Rays start above these all the same, or a surface would lie in its own shadow.
#[test]
fn far_from_the_origin_points_lie_above_their_triangles() {
    let mut scene = import(&made::cornell(), &Resources::new(), &ImportLimits::default()).unwrap();
    let moved = Mat4::from_rotation_translation(
        Quat::from_euler(EulerRot::XYZ, 0.4, 1.1, -0.7),
        Vec3::new(137.3, -61.7, 89.1),
    );
    for vertex in &mut scene.vertices {
        vertex.position = moved.transform_point3(vertex.position);
        vertex.normal = moved.transform_vector3(vertex.normal);
    }
    for camera in &mut scene.cameras {
        camera.to_world = moved * camera.to_world;
    }
    let specimen = Specimen::of(scene, Environment::none(), 500);
    let (visible, world) = (specimen.visible(), &specimen.world);
    let (mut points, mut cut, mut below) = (0, 0, 0);
    for fragment in &visible.fragments {
        let (facet, _) = item::decode(fragment.code).expect("a facet");
        let source = visible.cut.source(FacetIndex(facet));
        let [corner, ..] = world.rays.corners(&world.scene, source).0.map(Vec3::as_dvec3);
        let normal = visible.flat_normal(fragment).as_dvec3();
        let whole = [Vec2::ZERO, Vec2::X, Vec2::Y];
        cut += u32::from(whole.map(|at| visible.cut.to_source(FacetIndex(facet), at)) != whole);
        // By its own corners.
        let own = visible.cut.corners(FacetIndex(facet)).map(|corner| world.rays.place(corner));
        let spot = Spot::new(own, unit_normal(own), 0.3, 0.3);
        let start = spot.off_surface(visible.flat_normal(fragment)).as_dvec3();
        below += u32::from(normal.dot(start - corner) <= 0.0);
        for n in 0..if fragment.has_one_facet() { visible.count(fragment) } else { 0 } {
            let above = normal.dot(visible.sample_point(fragment, n).as_dvec3() - corner);
            assert!(above > 0.0, "pixel {} is {above} above", fragment.pixel);
            points += 1;
        }
    }
    assert!(points > 1000 && cut > 30, "{points} points, {cut} fragments of cut facets");
    assert!(below > 0, "rounding matters here");
}

#[test]
fn each_sample_is_in_one_square() {
    for count in [1, 3, 16, 64] {
        let samples = sample_pattern(count);
        for along in SQUARES {
            let all: Vec<u64> = squares(along, &samples).iter().map(|own| own.samples).collect();
            assert_eq!(all.iter().map(|own| own.count_ones()).sum::<u32>(), count);
            assert_eq!(all.iter().fold(0, |all, own| all | own).count_ones(), count);
        }
    }
}

/// A scene in which each triangle is cut into four, so many times over.
fn divided(scene: &Scene, times: u32) -> Scene {
    let mut scene = scene.clone();
    for _ in 0..times {
        let whole = std::mem::take(&mut scene.triangles);
        for triangle in whole {
            let [a, b, c] = triangle.vertices;
            let mut middle = |one: u32, other: u32| {
                let [one, other] = [one, other].map(|at| scene.vertices[at as usize]);
                let mut middle = one;
                middle.position = 0.5 * (one.position + other.position);
                middle.uv = [0, 1].map(|set| 0.5 * (one.uv[set] + other.uv[set]));
                scene.vertices.push(middle);
                scene.vertices.len() as u32 - 1
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
            scene.triangles.extend(parts.map(|vertices| Triangle { vertices, ..triangle }));
        }
    }
    scene
}

/// What pixels show of a checker is the same whether they see one facet or several, though parts of pixels
/// read fewer places of textures. (Farther away than half the picture facets are finer than samples.)
#[test]
fn textures_are_read_on_all_parts_of_a_pixel() {
    let glb = made::checker(4.0);
    let scene = import(&glb, &Resources::new(), &ImportLimits::default()).expect("valid");
    let albedos = |scene: Scene| {
        let surroundings = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
        let Specimen { world, cut, .. } = Specimen::of(scene, surroundings, 500);
        let camera = &world.scene.cameras[0];
        let visible = VisibleSurfaces::new(&world, cut, camera, [24, 20], MOST_SAMPLES);
        let parts = visible.fragments.len();
        let pixels = (visible.width * visible.height) as usize;
        let mut all = vec![0.0; pixels / 2];
        let near = |fragment: &&Fragment| fragment.pixel as usize >= pixels / 2;
        for fragment in visible.fragments.iter().filter(near) {
            all[fragment.pixel as usize - pixels / 2] +=
                fragment.share * importance(fragment.diffuse);
        }
        (all, visible.groups.len(), parts)
    };
    let (whole, _, _) = albedos(scene.clone());
    let (cut, groups, parts) = albedos(divided(&scene, 8));
    assert!(
        groups.max(parts) > 4 * whole.len(),
        "{groups} groups, {parts} parts: facets are small"
    );
    let square =
        |off: &dyn Fn(usize) -> f32| -> f32 { (0..whole.len()).map(|k| off(k).powi(2)).sum() };
    let off = (square(&|k| cut[k] - whole[k]) / square(&|k| whole[k])).sqrt();
    assert!(off < 0.03, "{off}");
    let mean = cut.iter().sum::<f32>() / whole.iter().sum::<f32>();
    assert!((mean - 1.0).abs() < 0.004, "{mean}");
}

/// Where the two sides of a tube meet at its outline, their depths are alike, and those of triangles that
/// are seen edge-on are hard to tell; no inside is seen all the same.
#[test]
fn the_inside_of_a_tube_does_not_show_at_its_outline() {
    const SLICES: u32 = 16;
    let material = Material { double_sided: true, ..Material::lambertian("both", Rgb::ONE) };
    let mut tube = revolved(&[[0.02, -1.1], [0.02, 1.2]], SLICES, material);
    let (mut seen, mut shown) = (0, 0.0);
    for number in 0..24 {
        // Nearly in the plane of one of its sides, and a little behind that.
        let half = PI / SLICES as f32;
        let distance = 0.02 * half.cos() - 1e-6 * 1.6f32.powi(number);
        let angle = 3.0 * half + (distance / 1.3).acos();
        let eye = Vec3::new(angle.cos(), 0.1, angle.sin()) * 1.3;
        tube.cameras = vec![Camera::look_at("aside", eye, Vec3::ZERO, Vec3::Y, 0.4)];
        let specimen = Specimen::of(tube.clone(), Environment::studio(), 500);
        let camera = &specimen.world.scene.cameras[0];
        let cut = specimen.cut.clone();
        let visible = VisibleSurfaces::new(&specimen.world, cut, camera, [96, 96], 64);
        seen += visible.fragments.len();
        let backs = visible.fragments.iter().filter(|fragment| {
            let group =
                visible.groups[fragment.groups[0] as usize..fragment.groups[1] as usize].iter();
            let codes = group.map(|group| group.code).chain([fragment.code]);
            codes.filter_map(item::decode).any(|(_, back)| back)
        });
        shown += backs.map(|fragment| fragment.share).sum::<f32>();
    }
    // A hair-thin crack may be hit between triangles of which one is cut.
    assert!(shown < 0.05, "inside of {shown} pixels");
    assert!(seen > 24 * 500, "{seen}");
}

/// Where a ball bends away from the camera, what is told of its lobe's albedo is the mean over all of its
/// fragment, which that of a few rays' places is not.
#[test]
fn albedo_at_an_outline_is_that_of_all_of_it() {
    const SIDE: u32 = 32;
    let material = Material { metallic: 1.0, roughness: 0.6, ..Material::default() };
    let mut ball = ball(24, material);
    let eye = Vec3::new(1.0, 2.0, 4.0);
    ball.cameras.push(Camera::look_at("test", eye, Vec3::ZERO, Vec3::Y, 0.6));
    let surroundings = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
    let specimen = Specimen::of(ball, surroundings, 500);
    let (mut visible, world) = (specimen.visible(), &specimen.world);
    Edges::new(&visible).pass(&mut visible, SEED, 512, &|_, _, _| Rgb::ZERO);
    let (mut off, mut by_rays, mut count) = (0.0, 0.0, 0.0);
    for lobe in &visible.lobes {
        let fragment = visible.of_lobe(lobe);
        let Some(told) = fragment.lobe_albedo.filter(|_| fragment.share > 0.1) else { continue };
        let at = |n: u32| (n as f32 + 0.5) / SIDE as f32 - 0.5;
        let albedo_at = |n: u32| {
            let place = Vec2::new(at(n % SIDE), at(n / SIDE));
            let code = visible.seen_at(fragment, place, 0)?;
            let seen = SeenPart::at(place, 0.1);
            Some(visible.fragment_of(world, fragment.pixel, code, seen)?.0.lobe_albedo?.x)
        };
        let all: Vec<f32> = (0..SIDE * SIDE).filter_map(albedo_at).collect();
        let of_ray = |n: u32| {
            let surface = visible.surface(world, lobe, (n, n)).lobe_only();
            surface.reflection().albedo(visible.frame.towards_eye(surface.spot.point)).x
        };
        let exact = all.iter().sum::<f32>() / all.len() as f32;
        let square = |value: f32| (value / exact - 1.0) * (value / exact - 1.0);
        off += square(told.x);
        by_rays += square((0..6).map(of_ray).sum::<f32>() / 6.0);
        count += 1.0;
    }
    let [off, by_rays] = [off, by_rays].map(|sum: f32| (sum / count).sqrt());
    assert!(count > 20.0 && off < 0.05 && by_rays > 2.5 * off, "{off} {by_rays} {count}");
}
