//! Cuts of facets along the lines where other surfaces stand on them or pass through them.
//!
//! A floor goes on under the wall that stands on it. A patch that lies on both sides of the wall has
//! one value for both, and so brings the light of the one room into the other. What abuts, cuts:
//! facets end at such lines, and the pieces on either side of one share no corners, so that no value
//! is interpolated across it (docs/decisions/0056).

use super::facet::{Facet, facet_area};
use super::focus::Focus;
use crate::scene::nearby::pairs_nearby;
use foldhash::{HashMap, HashMapExt};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Share of a patch's side within which a surface stands on another: a wall that ends a little above
/// the floor lets hardly any light through.
const REACH: f32 = 0.4;
/// Surfaces that meet at less than this angle's cosine lie on each other, or are one curved surface.
const STEEP_COSINE: f32 = 0.7;
/// Contacts are of one line if they are within this share of a patch's side of it.
const SAME_LINE: f32 = 0.1;
/// Least length of what stands along a line, in sides of a patch: light goes round anything shorter.
const LEAST_LENGTH: f32 = 1.0;
/// Least width of a piece, in sides of a patch.
const LEAST_WIDTH: f32 = 0.15;
/// Most lines, and most pieces, of a facet.
const MOST_LINES: usize = 16;
const MOST_PIECES: usize = 48;

/// Where something stands on a facet: a piece of a line in its plane.
#[derive(Clone, Copy)]
struct Contact {
    /// A point of it.
    point: Vec3,
    /// Unit direction of the line.
    along: Vec3,
    /// Where it begins and ends, as distances from the point.
    ends: [f32; 2],
}

/// A line across a facet, with all that stands on it.
struct Line {
    point: Vec3,
    along: Vec3,
    /// Unit vector in the facet's plane, across the line.
    across: Vec3,
    /// Where what stands on it begins and ends.
    stretches: Vec<[f32; 2]>,
}

impl Line {
    fn new(contact: &Contact, normal: Vec3) -> Self {
        Self {
            point: contact.point,
            along: contact.along,
            across: normal.cross(contact.along),
            stretches: vec![contact.ends],
        }
    }

    /// Takes a contact in that lies on it.
    fn take(&mut self, contact: &Contact, width: f32) -> bool {
        let middle = contact.point + contact.along * (0.5 * (contact.ends[0] + contact.ends[1]));
        let on = (middle - self.point).dot(self.across).abs() <= width
            && contact.along.dot(self.across).abs() < 0.05;
        if on {
            let at = |end: f32| (contact.point + contact.along * end - self.point).dot(self.along);
            let [a, b] = contact.ends.map(at);
            self.stretches.push([a.min(b), a.max(b)]);
        }
        on
    }

    /// Joins stretches that overlap.
    fn join(&mut self) {
        self.stretches.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut joined: Vec<[f32; 2]> = Vec::with_capacity(self.stretches.len());
        for stretch in &self.stretches {
            match joined.last_mut() {
                Some(last) if stretch[0] <= last[1] => last[1] = last[1].max(stretch[1]),
                _ => joined.push(*stretch),
            }
        }
        self.stretches = joined;
    }

    /// Length of what stands on it between two places.
    fn covered(&self, [from, to]: [f32; 2]) -> f32 {
        let within = |stretch: &[f32; 2]| (stretch[1].min(to) - stretch[0].max(from)).max(0.0);
        self.stretches.iter().map(within).sum()
    }

    /// How far a point is on the one side of it.
    fn side(&self, point: Vec3) -> f32 {
        (point - self.point).dot(self.across)
    }
}

/// A facet that is large enough to be cut.
#[derive(Clone)]
struct Large {
    facet: u32,
    corners: [Vec3; 3],
    normal: Vec3,
    /// Side of a patch there.
    side: f32,
}

/// The lines along which a facet, by its number, is to be cut.
pub struct Cuts(Vec<(Large, Vec<Line>)>);

/// Where others stand on facets over more than the side of a patch of `cell_area`, or in a focus of
/// what is such a patch there.
pub fn find_contacts(
    positions: &[Vec3],
    facets: &[Facet],
    cell_area: f32,
    focus: Option<Focus>,
) -> Cuts {
    let large = large_facets(positions, facets, cell_area, focus);
    let of_large = |large: &Large| (large.corners, REACH * large.side);
    let all: Vec<[Vec3; 3]> = facets.iter().map(|facet| corners_of(positions, facet)).collect();
    let big: Vec<([Vec3; 3], f32)> = large.iter().map(of_large).collect();
    let touches = |own: u32, other: u32| {
        let own = &large[own as usize];
        let heights = own.heights(all[other as usize]);
        is_within(heights, REACH * own.side)
    };
    let mut pairs = pairs_nearby(&big, &all, &touches);
    pairs.sort_unstable();
    let groups: Vec<&[(u32, u32)]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
    let cut = |group: &[(u32, u32)]| {
        let own = &large[group[0].0 as usize];
        let shape = &facets[own.facet as usize];
        let others = group.iter().map(|(_, other)| *other as usize);
        let others = others.filter(|other| !is_neighbour(shape, &facets[*other]));
        let contacts = others.filter_map(|other| contact(own, all[other]));
        let lines = lines_of(own, contacts);
        (!lines.is_empty()).then(|| (own.clone(), lines))
    };
    Cuts(groups.into_par_iter().filter_map(cut).collect())
}

/// Cuts facets along the lines that were found for them.
pub fn cut_at_contacts(positions: &mut Vec<Vec3>, facets: &mut Vec<Facet>, cuts: &Cuts) {
    let mut cutter = Cutter { positions, middle: HashMap::new() };
    let mut pieces: HashMap<u32, Vec<Facet>> = HashMap::new();
    for (own, lines) in &cuts.0 {
        pieces.insert(own.facet, cutter.cut(facets[own.facet as usize], lines, own.side));
    }
    if !pieces.is_empty() {
        let all = facets.iter().enumerate();
        *facets = all
            .flat_map(|(index, facet)| {
                pieces.remove(&(index as u32)).unwrap_or_else(|| vec![*facet])
            })
            .collect();
    }
}

fn corners_of(positions: &[Vec3], facet: &Facet) -> [Vec3; 3] {
    facet.corners.map(|corner| positions[corner as usize])
}

/// Facets of at least half a patch.
fn large_facets(
    positions: &[Vec3],
    facets: &[Facet],
    cell_area: f32,
    focus: Option<Focus>,
) -> Vec<Large> {
    let large = |(index, facet): (usize, &Facet)| {
        let corners = corners_of(positions, facet);
        let own = cell_area / focus.map_or(1.0, |focus| focus.weight_of(corners));
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let is_large = facet_area(positions, facet) >= 0.5 * own && normal != Vec3::ZERO;
        let side = (2.0 * own).sqrt();
        is_large.then_some(Large { facet: index as u32, corners, normal, side })
    };
    facets.iter().enumerate().filter_map(large).collect()
}

/// Whether two facets share an edge.
fn is_neighbour(one: &Facet, other: &Facet) -> bool {
    one.corners.iter().filter(|corner| other.corners.contains(corner)).count() >= 2
}

impl Large {
    /// How high a triangle's corners are above its plane.
    fn heights(&self, triangle: [Vec3; 3]) -> [f32; 3] {
        triangle.map(|corner| self.normal.dot(corner - self.corners[0]))
    }
}

/// Whether anything between such heights is within reach of height 0, and anything is beyond.
fn is_within(heights: [f32; 3], reach: f32) -> bool {
    let lowest = heights.iter().copied().fold(f32::INFINITY, f32::min);
    let highest = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    lowest <= reach && highest >= -reach && (lowest < -reach || highest > reach)
}

/// Where a triangle stands on a facet or passes through it.
fn contact(own: &Large, triangle: [Vec3; 3]) -> Option<Contact> {
    let [a, b, c] = triangle;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let reach = REACH * own.side;
    let heights = own.heights(triangle);
    let is_steep = own.normal.dot(normal).abs() < STEEP_COSINE;
    if !is_within(heights, reach) || !is_steep {
        return None;
    }
    let along = own.normal.cross(normal).normalize_or_zero();
    // Where it is nearest to the plane, and how far it goes along the line within reach of it.
    let within = between_heights(triangle, heights, reach);
    let nearest = within.iter().min_by(|p, q| p.1.abs().total_cmp(&q.1.abs()))?;
    let point = nearest.0 - own.normal * nearest.1;
    let places = within.iter().map(|(corner, _)| (*corner - point).dot(along));
    let [from, to] = places
        .fold([f32::INFINITY, f32::NEG_INFINITY], |[from, to], at| [from.min(at), to.max(at)]);
    (along != Vec3::ZERO && to > from).then_some(Contact { point, along, ends: [from, to] })
}

/// Corners, with their heights, of the part of a triangle that is no higher and no deeper than
/// `reach`, and places where it passes through height 0.
fn between_heights(corners: [Vec3; 3], heights: [f32; 3], reach: f32) -> Vec<(Vec3, f32)> {
    let mut found = Vec::with_capacity(12);
    for k in 0..3 {
        let (p, q) = (corners[k], corners[(k + 1) % 3]);
        let (from, to) = (heights[k], heights[(k + 1) % 3]);
        if from.abs() <= reach {
            found.push((p, from));
        }
        for level in [-reach, 0.0, reach] {
            if (from < level) != (to < level) {
                found.push((p.lerp(q, (level - from) / (to - from)), level));
            }
        }
    }
    found
}

/// The lines along which much stands, those along which most does first.
fn lines_of(own: &Large, contacts: impl Iterator<Item = Contact>) -> Vec<Line> {
    let width = SAME_LINE * own.side;
    let mut lines: Vec<Line> = Vec::new();
    for contact in contacts {
        if !lines.iter_mut().any(|line| line.take(&contact, width)) {
            lines.push(Line::new(&contact, own.normal));
        }
    }
    lines.iter_mut().for_each(Line::join);
    let length = |line: &Line| chord(line, own.corners).map_or(0.0, |chord| line.covered(chord));
    let mut lines: Vec<(f32, Line)> = lines.into_iter().map(|line| (length(&line), line)).collect();
    lines.retain(|(length, _)| *length >= LEAST_LENGTH * own.side);
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    lines.truncate(MOST_LINES);
    lines.into_iter().map(|(_, line)| line).collect()
}

/// Where a line enters and leaves a triangle in its plane.
fn chord(line: &Line, corners: [Vec3; 3]) -> Option<[f32; 2]> {
    let sides = corners.map(|corner| line.side(corner));
    let mut ends = [f32::INFINITY, f32::NEG_INFINITY];
    for k in 0..3 {
        let (from, to) = (sides[k], sides[(k + 1) % 3]);
        if (from < 0.0) != (to < 0.0) {
            let place = corners[k].lerp(corners[(k + 1) % 3], from / (from - to));
            let at = (place - line.point).dot(line.along);
            ends = [ends[0].min(at), ends[1].max(at)];
        }
    }
    (ends[0] < ends[1]).then_some(ends)
}

/// Cuts facets and remembers the corners that this makes.
struct Cutter<'a> {
    positions: &'a mut Vec<Vec3>,
    /// New corners by the edge that they lie on, the line's number and its side.
    middle: HashMap<(u32, u32, u32, bool), u32>,
}

impl Cutter<'_> {
    /// The pieces of a facet.
    fn cut(&mut self, facet: Facet, lines: &[Line], side: f32) -> Vec<Facet> {
        let mut pieces = vec![facet];
        self.middle.clear();
        for (number, line) in lines.iter().enumerate() {
            if pieces.len() > MOST_PIECES {
                break;
            }
            let all = std::mem::take(&mut pieces);
            for piece in all {
                match self.is_cut(&piece, line, side) {
                    true => pieces.extend(self.halves(&piece, line, number as u32)),
                    false => pieces.push(piece),
                }
            }
        }
        pieces
    }

    /// Whether a line is worth a cut of this piece.
    fn is_cut(&self, piece: &Facet, line: &Line, side: f32) -> bool {
        let corners = corners_of(self.positions, piece);
        let Some(chord) = chord(line, corners) else { return false };
        let sides = corners.map(|corner| line.side(corner));
        let [one, other] =
            [sides.iter().copied().fold(0.0, f32::max), -sides.iter().copied().fold(0.0, f32::min)];
        let least = LEAST_WIDTH * side;
        let long = chord[1] - chord[0];
        let covered = line.covered(chord);
        one > least && other > least && covered > 0.0 && covered >= (0.5 * side).min(0.5 * long)
    }

    /// A piece cut along a line: a triangle on the one side, two on the other.
    fn halves(&mut self, piece: &Facet, line: &Line, number: u32) -> Vec<Facet> {
        let sides = corners_of(self.positions, piece).map(|corner| line.side(corner) < 0.0);
        // The corner that is alone on its side.
        let lone =
            (0..3).find(|k| sides[*k] != sides[(*k + 1) % 3] && sides[*k] != sides[(*k + 2) % 3]);
        let Some(lone) = lone else { return vec![*piece] };
        let order = [lone, (lone + 1) % 3, (lone + 2) % 3];
        let [a, b, c] = order.map(|k| (piece.corners[k], piece.source_uv[k]));
        let make = |corners: [(u32, Vec2); 3]| Facet {
            corners: corners.map(|corner| corner.0),
            source_uv: corners.map(|corner| corner.1),
            ..*piece
        };
        let mut at = |p: (u32, Vec2), q: (u32, Vec2), below: bool| {
            self.corner_between(p, q, line, (number, below))
        };
        let (own, others) = (sides[lone], !sides[lone]);
        let [m, n] = [at(a, b, own), at(a, c, own)];
        let [o, p] = [at(a, b, others), at(a, c, others)];
        vec![make([a, m, n]), make([o, b, c]), make([o, c, p])]
    }

    /// The corner on a side of a line between two others.
    fn corner_between(
        &mut self,
        p: (u32, Vec2),
        q: (u32, Vec2),
        line: &Line,
        (number, below): (u32, bool),
    ) -> (u32, Vec2) {
        // From the lower corner, so that pieces on both sides of an edge find the same place.
        let (low, high) = if p.0 < q.0 { (p, q) } else { (q, p) };
        let [from, to] = [low, high].map(|end| self.positions[end.0 as usize]);
        let share = (line.side(from) / (line.side(from) - line.side(to))).clamp(0.0, 1.0);
        let key = (low.0, high.0, number, below);
        let corner = *self.middle.entry(key).or_insert_with(|| {
            self.positions.push(from.lerp(to, share));
            self.positions.len() as u32 - 1
        });
        (corner, low.1.lerp(high.1, share))
    }
}

#[cfg(test)]
mod tests {
    use crate::patches::PatchedScene;
    use crate::scene::gltf::{ImportLimits, Resources, import};
    use crate::scene::made;
    use glam::Vec3;
    use std::sync::Arc;

    /// A room with a wall across it whose ends go on outside.
    fn divided(thickness: f32) -> Arc<crate::scene::Scene> {
        let glb = made::divided_room(thickness, 0.0);
        Arc::new(import(&glb, &Resources::default(), &ImportLimits::default()).unwrap())
    }

    #[test]
    fn no_patch_lies_on_both_sides_of_a_wall() {
        for thickness in [0.01, 0.1] {
            let scene = divided(thickness);
            let wall = made::DIVIDED_AT;
            let straddle = |cut: &PatchedScene| {
                let reaches = |facet: &&super::Facet| {
                    let xs = facet.corners.map(|corner| cut.positions[corner as usize].x);
                    let least = xs.iter().copied().fold(f32::INFINITY, f32::min);
                    let most = xs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                    least < wall - 0.02 && most > wall + thickness + 0.02
                };
                cut.facets.iter().filter(reaches).count()
            };
            let whole = PatchedScene::new(scene.clone(), 3000);
            assert!(straddle(&whole) > 0, "the test tests nothing");
            let cut = PatchedScene::for_rays(scene, 3000, None);
            assert_eq!(straddle(&cut), 0);
            let area = |cut: &PatchedScene| cut.patches.area.iter().sum::<f32>();
            assert!((area(&cut) / area(&whole) - 1.0).abs() < 1e-4);
        }
    }

    /// Every place of a cut triangle lies in a piece, at the same point of the world.
    #[test]
    fn pieces_fill_their_triangle() {
        let cut = PatchedScene::for_rays(divided(0.1), 3000, None);
        let mut looked_at = 0;
        for triangle in 0..cut.scene.triangle_count() as u32 {
            for (u, v) in [(0.1, 0.2), (0.7, 0.2), (0.33, 0.33), (0.02, 0.9), (0.48, 0.51)] {
                let (facet, at) = cut.place_on_triangle(triangle, u, v).expect("it is there");
                assert!(at.min_element() > -1e-3 && at.x + at.y < 1.001, "{at}");
                let facet = &cut.facets[facet.at()];
                assert_eq!(facet.source, triangle);
                let place: Vec3 = cut.point(facet, at.x, at.y);
                let own = cut.scene.triangle(triangle);
                let expected = cut.scene.interpolate(&own, u, v, |vertex| vertex.position);
                assert!(place.distance(expected) < 1e-3);
                looked_at += 1;
            }
        }
        assert!(looked_at > 100);
    }
}
