//! Which facets bound closed bodies that no light can get into: their backs are never seen.

use super::facet::Facet;
use crate::scene::Scene;
use foldhash::{HashMap, HashMapExt};
use glam::{DVec3, Vec3};

/// Pairs of emissive facet and body that are looked at; beyond, every back is drawn.
const MAX_PAIRS: usize = 50_000_000;

/// For each facet, whether it belongs to a closed, outward-facing body without anything that lets light
/// in, that has no emitter of another body and no light without extent in its bounding box, and that does
/// not emit inwards itself.
///
/// Light outside such a body meets fronts only, so rasterisers may skip facets that face away.
/// Everywhere else backs must be drawn: they stop light.
pub fn facets_of_dark_closed_bodies(
    scene: &Scene,
    positions: &[Vec3],
    facets: &[Facet],
) -> Vec<bool> {
    let body_of = connect(facets);
    let bodies = body_of.iter().max().map_or(0, |last| last + 1);
    let mut closed = vec![true; bodies];
    let mut volume = vec![0f64; bodies];
    let mut bounds = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); bodies];

    let mut directed: HashMap<(u32, u32), u32> = HashMap::new();
    for facet in facets {
        for (a, b) in edges(facet) {
            *directed.entry((a, b)).or_default() += 1;
        }
    }
    for (facet, &body) in facets.iter().zip(&body_of) {
        let material = scene.material_of(facet.source);
        let is_clear = material.clear_share() > 0.0;
        closed[body] &= !material.has_holes() && !material.is_translucent() && !is_clear;
        for (a, b) in edges(facet) {
            closed[body] &= directed[&(a, b)] == 1 && directed.get(&(b, a)) == Some(&1);
        }
        let [a, b, c] = facet.corners.map(|p| positions[p as usize]);
        let origin = positions[facets[0].corners[0] as usize];
        let relative = |p: Vec3| -> DVec3 { (p - origin).as_dvec3() };
        volume[body] += relative(a).dot(relative(b).cross(relative(c))) / 6.0;
        let (low, high) = &mut bounds[body];
        *low = low.min(a).min(b).min(c);
        *high = high.max(a).max(b).max(c);
    }
    let mut dark: Vec<bool> = (0..bodies).map(|b| closed[b] && volume[b] > 0.0).collect();
    for (body, (low, high)) in bounds.iter().enumerate() {
        let is_in = |at: Vec3| at.cmpge(*low).all() && at.cmple(*high).all();
        dark[body] &= !scene.lights.iter().any(|light| is_in(light.position));
    }
    let emits = |facet: &Facet| scene.material_of(facet.source).emits();
    if facets.iter().filter(|f| emits(f)).count().saturating_mul(bodies) > MAX_PAIRS {
        return vec![false; facets.len()];
    }
    for (facet, &own) in facets.iter().zip(&body_of) {
        if !emits(facet) {
            continue;
        }
        // A two-sided emitter lights its own inside.
        let two_sided = scene.material_of(facet.source).double_sided;
        let corners = facet.corners.map(|p| positions[p as usize]);
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        for body in 0..bodies {
            let (body_low, body_high) = bounds[body];
            let overlaps = low.cmple(body_high).all() && high.cmpge(body_low).all();
            if overlaps && (body != own || two_sided) {
                dark[body] = false;
            }
        }
    }
    body_of.iter().map(|&body| dark[body]).collect()
}

fn edges(facet: &Facet) -> [(u32, u32); 3] {
    let [a, b, c] = facet.corners;
    [(a, b), (b, c), (c, a)]
}

/// Numbers the edge-connected bodies from 0 and says which each facet belongs to.
fn connect(facets: &[Facet]) -> Vec<usize> {
    let mut parent: Vec<usize> = (0..facets.len()).collect();
    fn root(parent: &mut [usize], mut at: usize) -> usize {
        while parent[at] != at {
            parent[at] = parent[parent[at]];
            at = parent[at];
        }
        at
    }
    let mut first_at: HashMap<(u32, u32), usize> = HashMap::new();
    for (index, facet) in facets.iter().enumerate() {
        for (a, b) in edges(facet) {
            let other = *first_at.entry((a.min(b), a.max(b))).or_insert(index);
            let (x, y) = (root(&mut parent, index), root(&mut parent, other));
            parent[x] = y;
        }
    }
    let mut number: HashMap<usize, usize> = HashMap::new();
    (0..facets.len())
        .map(|index| {
            let root = root(&mut parent, index);
            let next = number.len();
            *number.entry(root).or_insert(next)
        })
        .collect()
}
