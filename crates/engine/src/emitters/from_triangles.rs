//! From emissive triangles to polygon lights: closed bodies shine outwards only, and pairs of
//! triangles merge into convex quadrilaterals.

use super::merging::{self, FlatEmitter};
use super::polygon::PolygonLight;
use crate::radiometry::Rgb;
use crate::rays::{Eye, Rays};
use crate::scene::{Material, Scene};
use glam::Vec3;
use std::collections::HashMap;

/// Most tests of a triangle against a body's bounding box; scenes that need more keep both sides of
/// their lamps. It bounds the time of the preparation.
const MOST_TESTS: usize = 50_000_000;

/// With more polygons than this, those that make up larger ones are joined.
const FEW_LIGHTS: usize = 64;

/// An emissive triangle of one radiance, ray units.
#[derive(Clone, Copy)]
pub struct UntexturedEmitter {
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
    /// Counter-clockwise as seen from the front.
    pub corners: [Vec3; 3],
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Whether the back shines too.
    pub two_sided: bool,
}

/// The bits of a corner's coordinates, to find equal ones.
type Key = [u32; 3];

fn key(place: Vec3) -> Key {
    (place + 0.0).to_array().map(f32::to_bits)
}

impl UntexturedEmitter {
    fn edges(&self) -> [(Key, Key); 3] {
        let [a, b, c] = self.corners.map(key);
        [(a, b), (b, c), (c, a)]
    }
}

/// The triangles of a scene that emit and have no emissive texture.
pub fn untextured(scene: &Scene, rays: &Rays) -> impl Iterator<Item = UntexturedEmitter> {
    let is_untextured =
        |material: &Material| material.emits() && material.emission_texture.is_none();
    scene.triangles_of(is_untextured).filter_map(|triangle| {
        let material = scene.material_of(triangle);
        let (corners, area) = rays.corners(scene, triangle);
        let (radiance, two_sided) = (material.emission, material.double_sided);
        (area > 0.0).then_some(UntexturedEmitter { triangle, corners, radiance, two_sided })
    })
}

/// Makes the triangles of closed two-sided bodies one-sided, shining outwards, unless something is
/// inside the body: half of the samples would go to the inside, of which no light comes out
/// (docs/decisions/0020).
pub fn shine_outwards_only(triangles: &mut [UntexturedEmitter], scene: &Scene, rays: &Rays) {
    let bodies = bodies(triangles);
    if bodies.is_empty() || bodies.len() * scene.triangle_count() > MOST_TESTS {
        return;
    }
    let mut body_of = HashMap::new();
    for (number, body) in bodies.iter().enumerate() {
        body_of.extend(body.members.iter().map(|member| (triangles[*member].triangle, number)));
    }
    // Something is in a body that a corner of it is in ...
    let mut empty = vec![true; bodies.len()];
    for index in triangles_near(scene, rays, &bodies) {
        let own = body_of.get(&index);
        let corners = rays.corners(scene, index).0;
        for (number, body) in bodies.iter().enumerate() {
            let inside = |p: &Vec3| p.cmpgt(body.low).all() && p.cmplt(body.high).all();
            if own != Some(&number) && corners.iter().any(inside) {
                empty[number] = false;
            }
        }
    }
    // What shines inwards gets out of paper.
    let is_translucent = |member: &usize| {
        let material = scene.triangle(triangles[*member].triangle).material;
        scene.materials[material as usize].is_translucent()
    };
    for (number, body) in bodies.iter().enumerate() {
        empty[number] &= !body.members.iter().any(is_translucent);
    }
    for (number, body) in bodies.iter().enumerate().filter(|(number, _)| empty[*number]) {
        // ... or that hides its sides from each other.
        let seen = |member: &usize| {
            let [a, b, c] = triangles[*member].corners;
            let normal = (b - a).cross(c - a).normalize_or_zero() * body.outward;
            let inwards = (body.high - body.low).length() * 1e-4 * -normal;
            let hit = rays.closest(Eye::Light, (a + b + c) / 3.0 + inwards, -normal);
            hit.is_some_and(|hit| body_of.get(&hit.triangle) == Some(&number))
        };
        if !body.members.iter().all(seen) {
            continue;
        }
        for member in &body.members {
            let one = &mut triangles[*member];
            one.two_sided = false;
            if body.outward < 0.0 {
                one.corners.swap(1, 2);
            }
        }
    }
}

/// The triangles that may have a corner in a body's box: all that are listed, and those of instances
/// that are near one.
fn triangles_near<'a>(
    scene: &'a Scene,
    rays: &'a Rays,
    bodies: &'a [Body],
) -> impl Iterator<Item = u32> + 'a {
    let listed = scene.triangles.len() as u32;
    let instances = &scene.instances;
    let is_near = move |instance: &u32| {
        let own = &instances.all()[*instance as usize];
        let shape = instances.shape_of(own);
        let (low, high) = own.box_around(shape);
        let (low, high) = (rays.place(low), rays.place(high));
        let meets = |body: &Body| body.low.cmple(high).all() && low.cmple(body.high).all();
        bodies.iter().any(meets)
    };
    let near = (0..instances.all().len() as u32).filter(is_near);
    let numbers = move |instance| instances.triangles_of(instance).map(move |own| listed + own);
    (0..listed).chain(near.flat_map(numbers))
}

/// A closed surface of emissive triangles with its bounding box.
struct Body {
    members: Vec<usize>,
    low: Vec3,
    high: Vec3,
    /// 1 where fronts face outwards, −1 where backs do.
    outward: f32,
}

/// The closed surfaces of two-sided triangles: each edge belongs to two of them, once in either
/// direction.
fn bodies(triangles: &[UntexturedEmitter]) -> Vec<Body> {
    let mut at_edge: HashMap<(Key, Key), Option<usize>> = HashMap::new();
    for (index, one) in triangles.iter().enumerate().filter(|(_, one)| one.two_sided) {
        for edge in one.edges() {
            at_edge.entry(edge).and_modify(|twice| *twice = None).or_insert(Some(index));
        }
    }
    let across = |(p, q): (Key, Key)| at_edge.get(&(q, p)).copied().flatten();
    let mut visited = vec![false; triangles.len()];
    let mut bodies = Vec::new();
    for first in 0..triangles.len() {
        if visited[first] || !triangles[first].two_sided {
            continue;
        }
        visited[first] = true;
        let (mut members, mut next, mut closed) = (vec![first], 0, true);
        while let Some(member) = members.get(next).copied() {
            next += 1;
            for (p, q) in triangles[member].edges() {
                // An edge that is there twice in one direction belongs to nothing closed.
                closed &= at_edge.get(&(p, q)).copied().flatten().is_some();
                match across((p, q)) {
                    None => closed = false,
                    Some(other) if visited[other] => {}
                    Some(other) => {
                        visited[other] = true;
                        members.push(other);
                    }
                }
            }
        }
        let corners = || members.iter().flat_map(|member| triangles[*member].corners);
        let low = corners().fold(Vec3::INFINITY, Vec3::min);
        let high = corners().fold(Vec3::NEG_INFINITY, Vec3::max);
        let middle = 0.5 * (low + high);
        let volume = |member: &usize| {
            let [a, b, c] = triangles[*member].corners.map(|corner| corner - middle);
            a.dot(b.cross(c))
        };
        let volume: f32 = members.iter().map(volume).sum();
        if closed && volume != 0.0 {
            bodies.push(Body { members, low, high, outward: volume.signum() });
        }
    }
    bodies
}

/// Adds a polygon light for each triangle, or for two that share an edge, lie in one plane, emit
/// the same and form a convex quadrilateral: that halves the edges to sum over in Lambert's
/// formula. Where there are many, quadrilaterals are joined to larger ones. `of_triangle` gets each
/// triangle's light, as in [`super::polygons::PolygonLights`].
pub fn merge_into_polygons(
    triangles: &[UntexturedEmitter],
    lights: &mut Vec<PolygonLight>,
    of_triangle: &mut HashMap<u32, u32>,
) {
    let mut flat = in_pairs(triangles);
    if flat.len() > FEW_LIGHTS {
        flat = merging::join(flat);
    }
    for FlatEmitter { corners, radiance, two_sided, triangles } in flat {
        let number = lights.len() as u32;
        of_triangle.extend(triangles.into_iter().map(|triangle| (triangle, number)));
        let light = PolygonLight::new(&corners, radiance, two_sided);
        lights.push(light.unwrap_or_else(PolygonLight::dark));
    }
}

/// The triangles, two at a time where they make a convex quadrilateral.
fn in_pairs(triangles: &[UntexturedEmitter]) -> Vec<FlatEmitter> {
    let mut flat = Vec::new();
    let mut at_edge: HashMap<(Key, Key), usize> = HashMap::new();
    for (index, one) in triangles.iter().enumerate() {
        at_edge.extend(one.edges().map(|edge| (edge, index)));
    }
    let mut used = vec![false; triangles.len()];
    for (index, one) in triangles.iter().enumerate() {
        let UntexturedEmitter { triangle, corners, radiance, two_sided } = one;
        if used[index] {
            continue;
        }
        used[index] = true;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let pair = (0..3).find_map(|k| {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            let other = *at_edge.get(&(key(q), key(p)))?;
            let theirs = &triangles[other];
            if used[other] || theirs.radiance != *radiance || theirs.two_sided != *two_sided {
                return None;
            }
            let apex =
                theirs.corners.iter().copied().find(|c| key(*c) != key(p) && key(*c) != key(q))?;
            let opposite = corners[(k + 2) % 3];
            // p, apex, q, opposite goes round; it must be flat and turn left everywhere.
            let around = [p, apex, q, opposite];
            let flat = normal.dot(apex - p).abs() <= 1e-5 * (apex - p).length();
            let convex = (0..4).all(|i| {
                let (a, b, c) = (around[i], around[(i + 1) % 4], around[(i + 2) % 4]);
                (b - a).cross(c - b).dot(normal) > 0.0
            });
            (flat && convex).then_some((other, around))
        });
        let (radiance, two_sided) = (*radiance, *two_sided);
        let (corners, triangles) = match pair {
            Some((other, around)) => {
                used[other] = true;
                (around.to_vec(), vec![*triangle, triangles[other].triangle])
            }
            None => (corners.to_vec(), vec![*triangle]),
        };
        flat.push(FlatEmitter { corners, radiance, two_sided, triangles });
    }
    flat
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;

    /// How many of the triangles that shine do so to both sides.
    fn two_sided(scene: &Scene, flip: bool) -> (usize, usize) {
        let rays = Rays::new(scene);
        let mut all: Vec<UntexturedEmitter> = (0..scene.triangles.len() as u32)
            .map(|index| {
                let material = scene.material_of(index);
                let mut corners = rays.corners(scene, index).0;
                if flip {
                    corners.swap(1, 2);
                }
                let (radiance, two_sided) = (material.emission, material.double_sided);
                UntexturedEmitter { triangle: index, corners, radiance, two_sided }
            })
            .filter(|one| one.radiance != Rgb::ZERO)
            .collect();
        shine_outwards_only(&mut all, scene, &rays);
        // Those of one side now face outwards: away from the middle of all, for a single body.
        let middle = all.iter().flat_map(|one| one.corners).sum::<Vec3>() / (3 * all.len()) as f32;
        for one in all.iter().filter(|one| !one.two_sided && all.len() == 264) {
            let [a, b, c] = one.corners;
            assert!((b - a).cross(c - a).dot(a - middle) > 0.0, "it faces inwards");
        }
        (all.iter().filter(|one| one.two_sided).count(), all.len())
    }

    #[test]
    fn closed_bodies_shine_outwards_unless_something_is_in_them() {
        let made = |glb: &[u8]| import(glb, &Resources::default(), &ImportLimits::default());
        let shade = made(&made::shade()).unwrap();
        assert_eq!(two_sided(&shade, false), (0, 264));
        assert_eq!(two_sided(&shade, true), (0, 264));
        assert_eq!(two_sided(&made(&made::hall()).unwrap(), false), (0, 360));
        // A rectangle is no body.
        assert_eq!(two_sided(&made(&made::blinds()).unwrap(), false), (2, 2));
        // Nor does a room shine outwards that all the rest is in.
        let mut sky = shade.clone();
        for material in sky.materials.iter_mut().filter(|material| !material.emits()) {
            if material.name.contains("wall") || material.name.contains("floor") {
                material.emission = Rgb::ONE;
            }
        }
        assert_eq!(two_sided(&sky, false), (12, 276));
    }
}
