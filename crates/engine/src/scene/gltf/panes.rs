//! Panes: clear bodies with two flat parallel faces that are much wider than they are thick, such as a
//! window's. Light leaves them in the direction that it came in, beside its line by less than their thickness.
//! Both faces are taken as sheets that bend nothing, so that sky and sun are found through them by shadow
//! rays, as through a pane that is modelled as one sheet, and not by caustics and rays that chance bends.

use crate::radiometry::Rgb;
use crate::scene::{Material, Scene};
use glam::{DVec3, Vec3};
use std::collections::{BTreeMap, HashMap};

/// Most thickness, over the area of a face divided by its diagonal: of a square a fiftieth of a side.
const MOST_THICKNESS: f64 = 0.03;
/// Most that a face leans, as the sine of the angle between it and the pane.
const MOST_LEAN: f64 = 1e-3;
/// How far corners may be off a face, over the thickness.
const MOST_UNEVEN: f64 = 0.01;
/// Most area of the rim, over that of a face.
const MOST_RIM: f64 = 0.25;
/// How far the areas of both faces may differ, over one of them.
const MOST_AREA_APART: f64 = 0.02;

/// Takes the panes among a scene's listed triangles as two sheets each.
pub fn straighten(scene: &mut Scene) {
    let solid = |material: &Material| {
        material.volume.is_some() && material.clear_share() > 0.0 && material.roughness == 0.0
    };
    if !scene.materials.iter().any(solid) {
        return;
    }
    // In the order of their numbers: so have the sheets' materials.
    let mut of_materials: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (number, triangle) in scene.triangles.iter().enumerate() {
        if solid(&scene.materials[triangle.material as usize]) {
            of_materials.entry(triangle.material).or_default().push(number);
        }
    }
    for (number, own) in of_materials {
        // Panes of one thickness, in hundredths of a millimetre, share a material.
        let mut sheets: HashMap<i64, u32> = HashMap::new();
        for body in bodies(scene, own) {
            let Some(thickness) = thickness(scene, &body) else { continue };
            let hundredths = (thickness * 1e5).round();
            let sheet = *sheets.entry(hundredths as i64).or_insert_with(|| {
                let sheet = as_sheet(&scene.materials[number as usize], (hundredths * 1e-5) as f32);
                scene.materials.push(sheet);
                scene.materials.len() as u32 - 1
            });
            body.into_iter().for_each(|triangle| scene.triangles[triangle].material = sheet);
        }
    }
}

/// A face of a pane of that material, metres thick, as a sheet: half of the pane's absorption is its own.
fn as_sheet(material: &Material, thickness: f32) -> Material {
    let mut sheet = Material { volume: None, dispersion: 0.0, ..material.clone() };
    if let Some(volume) = material.volume.filter(|volume| volume.attenuation_distance.is_finite()) {
        let share = 0.5 * thickness / volume.attenuation_distance;
        sheet.base_color *= volume.attenuation_color.max(Rgb::ZERO).map(|left| left.powf(share));
    }
    sheet
}

/// Listed triangles, by their numbers, in the bodies that they bound: what shares a corner's place is of one
/// body.
fn bodies(scene: &Scene, own: Vec<usize>) -> Vec<Vec<usize>> {
    let mut places: HashMap<[u32; 3], usize> = HashMap::new();
    // Each place's body is that of a place before it, or its own.
    let mut before: Vec<usize> = Vec::new();
    let mut corners = Vec::with_capacity(own.len());
    for triangle in &own {
        let ids = positions(scene, *triangle).map(|place| {
            // No two zeros are apart.
            let bits = (place + Vec3::ZERO).to_array().map(f32::to_bits);
            *places.entry(bits).or_insert_with(|| {
                before.push(before.len());
                before.len() - 1
            })
        });
        for other in &ids[1..] {
            let [a, b] = [ids[0], *other].map(|id| first(&mut before, id));
            before[a.max(b)] = a.min(b);
        }
        corners.push(ids[0]);
    }
    let mut number_of: HashMap<usize, usize> = HashMap::new();
    let mut bodies: Vec<Vec<usize>> = Vec::new();
    for (triangle, corner) in own.into_iter().zip(corners) {
        let number = *number_of.entry(first(&mut before, corner)).or_insert_with(|| {
            bodies.push(Vec::new());
            bodies.len() - 1
        });
        bodies[number].push(triangle);
    }
    bodies
}

/// The first place of a body.
fn first(before: &mut [usize], mut place: usize) -> usize {
    while before[place] != place {
        before[place] = before[before[place]];
        place = before[place];
    }
    place
}

fn positions(scene: &Scene, triangle: usize) -> [Vec3; 3] {
    scene.triangles[triangle].vertices.map(|vertex| scene.vertices[vertex as usize].position)
}

/// Thickness of a body, metres, if it is a pane.
fn thickness(scene: &Scene, body: &[usize]) -> Option<f64> {
    let crossed = |triangle: &usize| {
        let [a, b, c] = positions(scene, *triangle).map(|place| place.as_dvec3());
        (b - a).cross(c - a)
    };
    let largest = body.iter().map(crossed).max_by(|a, b| a.length().total_cmp(&b.length()))?;
    let normal = largest.try_normalize()?;
    // Area, and least and largest height, of the face to either side.
    let mut faces = [(0.0, f64::INFINITY, f64::NEG_INFINITY); 2];
    let mut rim = 0.0;
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let across = normal.any_orthonormal_pair();
    for triangle in body {
        let cross = crossed(triangle);
        let area = 0.5 * cross.length();
        let leans = cross.cross(normal).length() > 2.0 * area * MOST_LEAN;
        let (sum, least, most) = &mut faces[usize::from(cross.dot(normal) < 0.0)];
        for place in positions(scene, *triangle).map(|place| place.as_dvec3()) {
            let height = place.dot(normal);
            let along = DVec3::new(place.dot(across.0), place.dot(across.1), height);
            (low, high) = (low.min(along), high.max(along));
            if !leans && area > 0.0 {
                (*least, *most) = (least.min(height), most.max(height));
            }
        }
        *(if leans { &mut rim } else { sum }) += area;
    }
    let [(front, front_low, front_high), (back, back_low, back_high)] = faces;
    let thickness = front_low - back_high;
    let width = front / (high - low).truncate().length();
    let is_even = (front_high - front_low).max(back_high - back_low) <= MOST_UNEVEN * thickness;
    let is_between = high.z - low.z <= (1.0 + 2.0 * MOST_UNEVEN) * thickness;
    let is_pane = thickness > 0.0
        && is_even
        && is_between
        && rim <= MOST_RIM * front
        && (front - back).abs() <= MOST_AREA_APART * front
        && thickness <= MOST_THICKNESS * width;
    is_pane.then_some(thickness)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Triangle, Vertex, Volume};
    use glam::Quat;

    /// Corners of the sides of a cube, counter-clockwise seen from outside: bits are x, y and z.
    const SIDES: [[u8; 4]; 6] =
        [[4, 5, 7, 6], [1, 0, 2, 3], [5, 1, 3, 7], [0, 4, 6, 2], [6, 7, 3, 2], [0, 1, 5, 4]];

    /// Adds a box of glass of that size at a place, the front of which leans by `lean` metres.
    fn add(scene: &mut Scene, at: Vec3, size: Vec3, lean: f32) {
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, -0.2);
        for side in SIDES {
            let first = scene.vertices.len() as u32;
            for corner in side {
                let [x, y, z] = [0, 1, 2].map(|axis| f32::from(corner >> axis & 1));
                let place = Vec3::new(x, y, z) * size + Vec3::Z * (lean * x * z);
                scene.vertices.push(Vertex::new(at + turn * place, Vec3::Z));
            }
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                let vertices = [first + a, first + b, first + c];
                scene.triangles.push(Triangle { vertices, material: 0 });
            }
        }
    }

    fn glass() -> Scene {
        let (attenuation_color, attenuation_distance) = (Rgb::new(0.25, 1.0, 0.0), 0.01);
        let volume = Some(Volume { attenuation_color, attenuation_distance });
        let glass = Material { volume, ..Material::glass("glass", 1.5) };
        Scene { materials: vec![glass], ..Scene::default() }
    }

    fn sheets(scene: &Scene) -> usize {
        let of =
            |triangle: &&Triangle| scene.materials[triangle.material as usize].volume.is_none();
        scene.triangles.iter().filter(of).count()
    }

    #[test]
    fn panes_become_sheets_and_other_bodies_stay() {
        let mut scene = glass();
        add(&mut scene, Vec3::ZERO, Vec3::new(0.4, 0.5, 0.006), 0.0);
        add(&mut scene, Vec3::X * 3.0, Vec3::new(0.4, 0.5, 0.1), 0.0);
        add(&mut scene, Vec3::X * 6.0, Vec3::new(0.4, 0.5, 0.006), 0.002);
        add(&mut scene, Vec3::X * 9.0, Vec3::new(0.04, 0.04, 0.006), 0.0);
        // Another like the first.
        add(&mut scene, Vec3::X * 12.0, Vec3::new(0.4, 0.5, 0.006), 0.0);
        straighten(&mut scene);
        assert_eq!(sheets(&scene), 24, "the first and the last are panes");
        assert_eq!(scene.materials.len(), 2, "which share a material");
        assert!(scene.triangles[..12].iter().all(|triangle| triangle.material == 1));
        assert!(scene.triangles[12..48].iter().all(|triangle| triangle.material == 0));
        // Both faces together let through what 6 mm do, absorption in a centimetre as given.
        let tint = scene.materials[1].base_color;
        let both = tint * tint;
        assert!(
            (both.x - 0.25f32.powf(0.6)).abs() < 1e-3 && both.y == 1.0 && both.z == 0.0,
            "{both}"
        );
    }

    #[test]
    fn what_is_rough_or_a_sheet_already_stays_as_it_is() {
        for change in [
            (|material: &mut Material| material.roughness = 0.2) as fn(&mut Material),
            |material| material.transmission = 0.0,
        ] {
            let mut scene = glass();
            change(&mut scene.materials[0]);
            add(&mut scene, Vec3::ZERO, Vec3::new(0.4, 0.5, 0.006), 0.0);
            straighten(&mut scene);
            assert_eq!((sheets(&scene), scene.materials.len()), (0, 1));
        }
    }
}
