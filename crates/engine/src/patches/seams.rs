//! Seams where a facet hides what continues behind it: a wall under a ceiling that goes on into
//! the next room. On the seam both have the same depth, and rounding would let light through.

use super::facet::Facet;
use crate::scene::Scene;
use foldhash::{HashMap, HashMapExt};
use glam::{DVec3, Vec3};

/// Heights below this share of the facet's size are rounding.
const FLAT: f64 = 1e-5;

/// For each facet, whether a neighbour at a shared edge hides it from an eye in front of both:
/// it lies behind the neighbour's plane, and the neighbour in front of its own.
///
/// Rasterisers put such facets a little farther away, so that the hiding one wins at the seam.
pub fn facets_that_recede(scene: &Scene, positions: &[Vec3], facets: &[Facet]) -> Vec<bool> {
    let mut at_edge: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for (index, facet) in facets.iter().enumerate() {
        let [a, b, c] = facet.corners;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            at_edge.entry((p.min(q), p.max(q))).or_default().push(index as u32);
        }
    }
    let place = |corner: u32| positions[corner as usize].as_dvec3();
    // Sine of the angle at which `other` leaves the plane of `facet` at their edge.
    let height = |facet: u32, other: u32, edge: (u32, u32)| {
        let [a, b, c] = facets[facet as usize].corners.map(place);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let corners = facets[other as usize].corners;
        let apex = corners.into_iter().find(|corner| *corner != edge.0 && *corner != edge.1);
        let relative: DVec3 = apex.map_or(DVec3::ZERO, |apex| place(apex) - place(edge.0));
        normal.dot(relative) / relative.length().max(f64::MIN_POSITIVE)
    };
    let two_sided = |facet: u32| {
        let material = scene.triangle(facets[facet as usize].source).material;
        scene.materials[material as usize].double_sided
    };
    let mut recedes = vec![false; facets.len()];
    for (edge, around) in &at_edge {
        // Two facets that share an edge with nobody else leave no room behind one of them.
        if around.len() < 3 {
            continue;
        }
        for &front in around {
            for &behind in around {
                let seen_past = front != behind && height(behind, front, *edge) > FLAT;
                let offset = if seen_past { height(front, behind, *edge) } else { 0.0 };
                if offset < -FLAT || (two_sided(front) && offset > FLAT) {
                    recedes[behind as usize] = true;
                }
            }
        }
    }
    recedes
}
