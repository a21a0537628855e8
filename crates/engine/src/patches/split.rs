//! Conforming bisection of facets: of elongated ones, so that their patches are compact, and of those
//! along which the normals that light them turn.

use super::facet::{Facet, facet_area};
use super::focus::Focus;
use crate::scene::Scene;
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;
use rayon::prelude::*;

/// Longest edge over the height on it beyond which a facet is bisected; a half square has 2.
pub const MAX_ELONGATION: f32 = 4.0;
/// Cosine between the vertices' normals at the ends of an edge below which light may be another one
/// at either end, however alike what is around them: 30°.
const TURNING_COSINE: f32 = 0.866;
/// Bisections of one facet double its pieces; more rounds would not be seen.
const MAX_ROUNDS: usize = 12;
/// The same of facets that reach from what is seen to far away, which are halved in length only in
/// two rounds.
const MAX_FAR_ROUNDS: usize = 64;
/// Facets of a parallel task.
const CHUNK: usize = 1024;
/// Facets are cheap but not free: stop when splitting has added this many.
const MAX_ADDED: usize = 200_000;

/// Bisects the longest edge of every facet that is too large for its distance from what is seen,
/// together with the neighbours at that edge, until none is left.
pub fn split_far(positions: &mut Vec<Vec3>, facets: &mut Vec<Facet>, focus: Focus) {
    split(positions, facets, MAX_FAR_ROUNDS, |positions, facet| {
        let corners = facet.corners.map(|corner| positions[corner as usize]);
        focus.is_too_large(corners).then(|| longest_edge(positions, facet)).flatten()
    });
}

/// Bisects the longest edge of every elongated facet that would hold several patches of
/// `cell_area`, together with the neighbours at that edge, until none is left. In a focus, that is
/// the area of a patch there.
///
/// A facet that is one patch is bisected where the normals that it is lit by turn along an edge longer
/// than a patch's side, as on the long sides of a lampshade whose rims are rounded off: one end looks up,
/// the other down, and no one value is the light of both.
pub fn split_elongated(
    scene: &Scene,
    (positions, facets): (&mut Vec<Vec3>, &mut Vec<Facet>),
    cell_area: f32,
    focus: Option<Focus>,
) {
    split(positions, facets, MAX_ROUNDS, |positions, facet| {
        let corners = facet.corners.map(|corner| positions[corner as usize]);
        let weight = focus.map_or(1.0, |focus| focus.weight_of(corners));
        if facet_area(positions, facet) * weight < 1.5 * cell_area {
            return turning_edge(scene, positions, facet, cell_area / weight);
        }
        (elongation(corners) > MAX_ELONGATION).then(|| longest_edge(positions, facet)).flatten()
    });
}

/// Bisects an edge of every facet that names one, together with the neighbours at that edge, until
/// none is left.
///
/// Edges are split, not facets, so neighbours keep sharing all corners and no crack opens.
fn split(
    positions: &mut Vec<Vec3>,
    facets: &mut Vec<Facet>,
    rounds: usize,
    edge_to_split: impl Fn(&[Vec3], &Facet) -> Option<(u32, u32)> + Sync,
) {
    let limit = facets.len() + MAX_ADDED;
    // A facet that names no edge will not name one until it is a piece of itself.
    let mut is_new = vec![true; facets.len()];
    for _ in 0..rounds {
        let places = &*positions;
        let named = facets.par_iter().zip(&is_new).with_min_len(CHUNK);
        let named = named.map(|(facet, new)| new.then(|| edge_to_split(places, facet)).flatten());
        let named: Vec<Option<(u32, u32)>> = named.collect();
        let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
        let mut at_split = vec![false; positions.len()];
        for (a, b) in named.into_iter().flatten() {
            (at_split[a as usize], at_split[b as usize]) = (true, true);
            middle.entry(key(a, b)).or_insert_with(|| {
                positions.push(0.5 * (positions[a as usize] + positions[b as usize]));
                positions.len() as u32 - 1
            });
        }
        if middle.is_empty() || facets.len() + 2 * middle.len() > limit {
            return;
        }
        let mut all = Vec::with_capacity(facets.len() + 2 * middle.len());
        let mut all_new = Vec::with_capacity(all.capacity());
        for facet in facets.iter() {
            // Most facets have no end of a split edge, hence no split edge.
            if facet.corners.iter().filter(|corner| at_split[**corner as usize]).count() < 2 {
                all.push(*facet);
                all_new.push(false);
            } else {
                all.extend(pieces(facet, &middle));
                all_new.resize(all.len(), true);
            }
        }
        (*facets, is_new) = (all, all_new);
    }
}

/// Longest edge of a triangle over its height there.
pub fn elongation([a, b, c]: [Vec3; 3]) -> f32 {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    longest * longest / (b - a).cross(c - a).length()
}

fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

fn longest_edge(positions: &[Vec3], facet: &Facet) -> Option<(u32, u32)> {
    let edges = (0..3).map(|i| {
        let (a, b) = (facet.corners[i], facet.corners[(i + 1) % 3]);
        (positions[a as usize].distance(positions[b as usize]), a, b)
    });
    edges.max_by(|x, y| x.0.total_cmp(&y.0)).map(|(_, a, b)| (a, b))
}

/// The longest edge of those whose square is above `least`, in square metres, along which the normals
/// between the vertices turn.
fn turning_edge(
    scene: &Scene,
    positions: &[Vec3],
    facet: &Facet,
    least: f32,
) -> Option<(u32, u32)> {
    let corners = facet.corners.map(|corner| positions[corner as usize]);
    let square = |i: usize| corners[i].distance_squared(corners[(i + 1) % 3]);
    if (0..3).all(|i| square(i) <= least) {
        return None;
    }
    let triangle = scene.triangle(facet.source);
    let normals = facet.source_uv.map(|at| {
        scene.interpolate(&triangle, at.x, at.y, |vertex| vertex.normal).normalize_or_zero()
    });
    let edges = (0..3)
        .filter(|i| square(*i) > least && normals[*i].dot(normals[(*i + 1) % 3]) < TURNING_COSINE);
    let longest = edges.max_by(|i, j| square(*i).total_cmp(&square(*j)))?;
    Some((facet.corners[longest], facet.corners[(longest + 1) % 3]))
}

/// The facet cut at the middles of its marked edges: 1 to 4 pieces.
fn pieces(facet: &Facet, middle: &HashMap<(u32, u32), u32>) -> Vec<Facet> {
    let [a, b, c] = facet.corners;
    let [ua, ub, uc] = facet.source_uv;
    let mark = |p: u32, q: u32| middle.get(&key(p, q)).copied();
    let make = |corners: [(u32, glam::Vec2); 3]| Facet {
        corners: corners.map(|corner| corner.0),
        source_uv: corners.map(|corner| corner.1),
        ..*facet
    };
    // Walk round the boundary, then fan from a corner whose both edges are whole or, failing
    // that, cut the corner triangles off.
    let (ab, bc, ca) = (mark(a, b), mark(b, c), mark(c, a));
    let (a, b, c) = ((a, ua), (b, ub), (c, uc));
    let half = |m: u32, p: (u32, glam::Vec2), q: (u32, glam::Vec2)| (m, 0.5 * (p.1 + q.1));
    match (ab, bc, ca) {
        (None, None, None) => vec![*facet],
        (Some(m), None, None) => one_edge(&make, a, b, c, half(m, a, b)),
        (None, Some(m), None) => one_edge(&make, b, c, a, half(m, b, c)),
        (None, None, Some(m)) => one_edge(&make, c, a, b, half(m, c, a)),
        (Some(m), Some(n), None) => two_edges(&make, a, b, c, half(m, a, b), half(n, b, c)),
        (None, Some(m), Some(n)) => two_edges(&make, b, c, a, half(m, b, c), half(n, c, a)),
        (Some(n), None, Some(m)) => two_edges(&make, c, a, b, half(m, c, a), half(n, a, b)),
        (Some(m), Some(n), Some(o)) => {
            let (m, n, o) = (half(m, a, b), half(n, b, c), half(o, c, a));
            vec![make([a, m, o]), make([m, b, n]), make([o, n, c]), make([m, n, o])]
        }
    }
}

type Corner = (u32, glam::Vec2);

/// Edge pq is split at m; r is opposite.
fn one_edge(
    make: &impl Fn([Corner; 3]) -> Facet,
    p: Corner,
    q: Corner,
    r: Corner,
    m: Corner,
) -> Vec<Facet> {
    vec![make([p, m, r]), make([m, q, r])]
}

/// Edges pq and qr are split at m and n.
fn two_edges(
    make: &impl Fn([Corner; 3]) -> Facet,
    p: Corner,
    q: Corner,
    r: Corner,
    m: Corner,
    n: Corner,
) -> Vec<Facet> {
    vec![make([m, q, n]), make([p, m, n]), make([p, n, r])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::PatchedScene;
    use crate::radiometry::Rgb;
    use crate::scene::{Material, Scene, Triangle, Vertex};
    use std::sync::Arc;

    fn strip(length: f32) -> Arc<Scene> {
        let corner = |x: f32, y: f32| Vertex::new(Vec3::new(x, y, 0.0), Vec3::Z);
        Arc::new(Scene {
            vertices: vec![
                corner(0.0, 0.0),
                corner(length, 0.0),
                corner(length, 1.0),
                corner(0.0, 1.0),
            ],
            triangles: vec![
                Triangle { vertices: [0, 1, 2], material: 0 },
                Triangle { vertices: [0, 2, 3], material: 0 },
            ],
            materials: vec![Material::lambertian("grey", Rgb::splat(0.5))],
            ..Scene::default()
        })
    }

    #[test]
    fn elongated_facets_are_cut_conformingly_and_keep_their_area() {
        let patched = PatchedScene::new(strip(40.0), 400);
        let area: f32 = patched.patches.area.iter().sum();
        assert!((area - 40.0).abs() < 1e-3, "{area}");
        assert!(patched.facets.len() > 10, "{}", patched.facets.len());
        // Every inner edge has both its sides: no corner of a facet lies inside another's edge.
        for facet in &patched.facets {
            for i in 0..3 {
                let a = patched.positions[facet.corners[i] as usize];
                let b = patched.positions[facet.corners[(i + 1) % 3] as usize];
                for p in &patched.positions {
                    let on_line = (b - a).cross(*p - a).length() < 1e-4 * (b - a).length();
                    let t = (*p - a).dot(b - a) / (b - a).length_squared();
                    assert!(!(on_line && t > 1e-3 && t < 1.0 - 1e-3), "crack at {p}");
                }
            }
        }
        for facet in &patched.facets {
            for (corner, uv) in facet.corners.iter().zip(facet.source_uv) {
                let triangle = &patched.scene.triangle(facet.source);
                let p = patched.scene.interpolate(triangle, uv.x, uv.y, |v| v.position);
                assert!(p.distance(patched.positions[*corner as usize]) < 1e-4);
            }
        }
    }

    /// The middle of the long edge rounds onto the opposite corner.
    #[test]
    fn bisection_leaves_no_piece_without_area() {
        let mut scene = (*strip(1.0)).clone();
        let corners = [(0.0, 1.0), (1000.0, 1.0 + 0.5f32.powi(23)), (500.0, 1.0)];
        for (vertex, (x, y)) in scene.vertices.iter_mut().zip(corners) {
            vertex.position = Vec3::new(x, y, 0.0);
        }
        scene.triangles.truncate(1);
        let patched = PatchedScene::new(Arc::new(scene), 400);
        assert!(patched.patches.area.iter().all(|area| *area > 0.0));
    }

    /// A strip as narrow as a fifth of a patch, whose normals are rounded off at both ends.
    #[test]
    fn facets_end_where_normals_turn() {
        let facets = |tilt: f32| {
            let mut scene = (*strip(5.0)).clone();
            for vertex in &mut scene.vertices {
                let end = (vertex.position.x - 2.5).signum();
                vertex.normal = Vec3::new(end * tilt, 0.0, 1.0).normalize();
            }
            PatchedScene::new(Arc::new(scene), 1)
        };
        assert_eq!(facets(0.0).facets.len(), 2);
        // 11° each.
        assert_eq!(facets(0.2).facets.len(), 2);
        let turned = facets(1.0);
        assert!(turned.facets.len() >= 6, "{}", turned.facets.len());
        let area: f32 = turned.patches.area.iter().sum();
        assert!((area - 5.0).abs() < 1e-4, "{area}");
    }

    #[test]
    fn compact_facets_stay_whole() {
        assert_eq!(PatchedScene::new(strip(1.0), 400).facets.len(), 2);
    }
}
