use super::*;
use crate::radiometry::Rgb;
use crate::random::{Numbers, Stream};
use crate::scene::{Material, Scene};
use glam::{DQuat, Vec2};

/// A bent sheet of 32 triangles in two materials.
fn sheet() -> (Vec<Vertex>, Vec<Triangle>) {
    let mut vertices = Vec::new();
    for index in 0..25 {
        let (x, y) = ((index % 5) as f32 / 4.0, (index / 5) as f32 / 4.0);
        let at = Vec3::new(x, y, x * x - 0.5 * y);
        let normal = Vec3::new(-2.0 * x, 0.5, 1.0).normalize();
        vertices.push(Vertex {
            uv: [Vec2::new(x, y); 2],
            color: Rgb::new(x, y, 1.0),
            alpha: y,
            tangent: Vec3::new(1.0, 0.0, 2.0 * x).normalize().extend(-1.0),
            ..Vertex::new(at, normal)
        });
    }
    let mut triangles = Vec::new();
    for cell in 0..16u32 {
        let first = cell / 4 * 5 + cell % 4;
        for vertices in [[first, first + 1, first + 6], [first, first + 6, first + 5]] {
            triangles.push(Triangle { vertices, material: cell % 2 });
        }
    }
    (vertices, triangles)
}

/// Sheets and a smaller shape behind some triangles that are listed.
fn scene(count: u32) -> Scene {
    let mut scene = Scene {
        materials: vec![
            Material::lambertian("dull", Rgb::splat(0.5)),
            Material { emission: Rgb::ONE, ..Material::lambertian("lit", Rgb::splat(0.5)) },
        ],
        ..Scene::default()
    };
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    scene.vertices.extend(corners.map(|corner| Vertex::new(corner - 9.0, Vec3::Z)));
    scene.triangles.push(Triangle { vertices: [0, 1, 2], material: 0 });
    let mut instances = Instances::default();
    let (vertices, triangles) = sheet();
    let corner = [0, 1, 6, 5].map(|index: usize| vertices[index]);
    let two = [[0, 1, 2], [0, 2, 3]].map(|vertices| Triangle { vertices, material: 0 });
    let small = instances.add_shape(corner.into(), two.into());
    let large = instances.add_shape(vertices, triangles);
    let mut numbers = Numbers::new(1, Stream::Gather, 0);
    for _ in 0..count {
        let mut number = || f64::from(numbers.uniform()) - 0.5;
        let turn = DQuat::from_xyzw(number(), number(), number(), number()).normalize();
        let size = DVec3::new(number(), 2.0 * number(), 1.0 + number());
        let at = 8.0 * DVec3::new(number(), number(), number());
        let shape = if number() < 0.0 { small } else { large };
        let to_world = DAffine3::from_scale_rotation_translation(size, turn, at);
        assert!(instances.add(shape, to_world));
    }
    instances.finish();
    scene.instances = instances.into();
    scene
}

#[test]
fn numbers_are_found_in_ranges_of_any_size() {
    let mut numbers = Numbers::new(2, Stream::Gather, 0);
    for rounds in [1, 2, 7, 300] {
        let mut numbering = Numbering::default();
        for _ in 0..rounds {
            let size = 1 + (numbers.uniform().powi(6) * 5000.0) as u32;
            numbering.first.push(numbering.end() + size);
        }
        numbering.finish();
        for index in 0..rounds {
            let range = numbering.range(index);
            for number in [range.start, (range.start + range.end) / 2, range.end - 1] {
                assert_eq!(numbering.find(number), index, "{number}");
            }
        }
    }
}

/// Triangles of instances are where their transforms put them, whoever asks, and front is front.
#[test]
fn numbers_name_the_same_triangles_as_in_the_flattened_scene() {
    let scene = scene(60);
    let flat = scene.flattened();
    assert_eq!(flat.triangles.len(), scene.triangle_count());
    assert_eq!(flat.vertices.len(), scene.vertex_count());
    assert_eq!(scene.bounds(), flat.bounds());
    assert_eq!(scene.emissive_triangles(), flat.emissive_triangles());
    assert!(scene.instances.all().iter().any(|own| own.mirrored));
    let mut turned = 0;
    for index in 0..scene.triangle_count() as u32 {
        let (own, listed) = (scene.triangle(index), flat.triangles[index as usize]);
        assert_eq!(own, listed);
        assert_eq!(scene.corners(&own), flat.corners(&listed));
        assert_eq!(
            own.vertices.map(|vertex| scene.vertex(vertex)),
            flat.of_corners(&listed, |v| *v)
        );
        assert_eq!(scene.base_color(&own, 0.2, 0.3), flat.base_color(&listed, 0.2, 0.3));
        let (a, b) = (scene.shading_normal(&own, 0.2, 0.3), flat.shading_normal(&listed, 0.2, 0.3));
        assert_eq!(a, b);
        let [a, b, c] = flat.corners(&listed);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let [given, ..] = flat.of_corners(&listed, |vertex| vertex.normal);
        turned += u32::from(given.dot(normal) <= 0.0);
        for vertex in flat.of_corners(&listed, |vertex| *vertex) {
            let along = vertex.tangent.truncate();
            assert!(along == Vec3::ZERO || along.dot(vertex.normal).abs() < 1e-5);
        }
    }
    assert!(turned < 20, "{turned} normals are behind");
}

#[test]
fn what_is_kept_once_is_counted_once() {
    let scene = scene(60);
    assert_eq!(scene.unique_count(), 1 + 2 + 32);
    let unique: Vec<u32> = scene.unique_triangles().collect();
    assert_eq!(unique.len(), scene.unique_count());
    for (place, triangle) in unique.iter().enumerate() {
        assert_eq!(scene.unique(*triangle), place);
    }
    let emits: Vec<u32> = scene.triangles_of(Material::emits).collect();
    assert_eq!(emits.len(), scene.emissive_triangles());
    assert!(emits.iter().all(|triangle| scene.triangle(*triangle).material == 1));
    let kept = scene.unique_count() + 2 * 60 + emits.len();
    assert_eq!(scene.kept_triangles(), kept as u64);
}

/// Boxes of instances hold them, and of what has many parts hardly more.
#[test]
fn boxes_hold_what_they_are_of() {
    let scene = scene(60);
    for own in scene.instances.all() {
        let shape = scene.instances.shape_of(own);
        let (low, high) = own.box_around(shape);
        let all = shape.vertices.iter().map(|vertex| own.point(vertex.position));
        let (least, most) = all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(least, most), at| {
            assert!((at + 1e-5).cmpge(low).all() && (at - 1e-5).cmple(high).all());
            (least.min(at), most.max(at))
        });
        let more = ((high - low) - (most - least)).max_element();
        let is_in_parts = shape.triangles.len() > 2;
        assert!(!is_in_parts || more < 0.35 * (most - least).length(), "{more} {least} {most}");
    }
}

#[test]
fn more_triangles_than_have_numbers_are_refused() {
    let mut instances = Instances::default();
    let (vertices, triangles) = sheet();
    let triangles = triangles.repeat(1 << 18);
    let shape = instances.add_shape(vertices, triangles);
    let most = MOST_INSTANCED_TRIANGLES >> 23;
    assert!((0..most).all(|_| instances.add(shape, DAffine3::IDENTITY)));
    assert!(!instances.add(shape, DAffine3::IDENTITY));
}
