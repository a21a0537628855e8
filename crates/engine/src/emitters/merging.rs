//! Quadrilaterals that make up a larger one: a lamp of a thousand quads is one light then, whose
//! light without occlusion is known in closed form.

use crate::radiometry::Rgb;
use foldhash::{HashMap, HashMapExt};
use glam::Vec3;

/// Sine of the angle up to which edges count as one line.
const STRAIGHT: f32 = 1e-4;
/// Bits of a corner's coordinates, to find equal ones.
type Key = [u32; 3];

/// A flat emitter of one radiance, ray units.
pub struct FlatEmitter {
    /// Three corners or four, counter-clockwise as seen from the front.
    pub corners: Vec<Vec3>,
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Whether the back shines too.
    pub two_sided: bool,
    /// The scene's triangles that it is made of.
    pub triangles: Vec<u32>,
}

fn key(place: Vec3) -> Key {
    (place + 0.0).to_array().map(f32::to_bits)
}

/// Joins quadrilaterals that share an edge and whose other edges go on in one line: first along their
/// first edges, so that a grid becomes strips, then along the others.
pub fn join(emitters: Vec<FlatEmitter>) -> Vec<FlatEmitter> {
    let mut all: Vec<Option<FlatEmitter>> = emitters.into_iter().map(Some).collect();
    for edge in [0, 1] {
        join_along(&mut all, edge);
    }
    all.into_iter().flatten().collect()
}

/// Joins each with those beyond its edge of that number, as far as that goes.
fn join_along(all: &mut [Option<FlatEmitter>], edge: usize) {
    let mut at_edge: HashMap<(Key, Key), usize> = HashMap::new();
    for (index, own) in all.iter().enumerate() {
        let Some(own) = own.as_ref().filter(|own| own.corners.len() == 4) else { continue };
        for k in 0..4 {
            at_edge.insert((key(own.corners[k]), key(own.corners[(k + 1) % 4])), index);
        }
    }
    for index in 0..all.len() {
        while let Some(other) = beyond(all, &at_edge, index, edge) {
            let Some(theirs) = all[other].take() else { break };
            let Some(own) = &mut all[index] else { break };
            let [p, q] = [own.corners[edge], own.corners[(edge + 1) % 4]];
            // Theirs go q, p, t, u: u comes before q.
            let Some(first) = theirs.corners.iter().position(|corner| key(*corner) == key(p))
            else {
                break;
            };
            let [t, u] = [1, 2].map(|k| theirs.corners[(first + k) % 4]);
            (own.corners[edge], own.corners[(edge + 1) % 4]) = (t, u);
            own.triangles.extend(theirs.triangles);
            at_edge.remove(&(key(p), key(q)));
            at_edge.remove(&(key(q), key(p)));
            for k in 0..4 {
                let from = (key(own.corners[k]), key(own.corners[(k + 1) % 4]));
                at_edge.insert(from, index);
            }
        }
    }
}

/// The one beyond an edge with which an emitter makes a quadrilateral.
fn beyond(
    all: &[Option<FlatEmitter>],
    at_edge: &HashMap<(Key, Key), usize>,
    index: usize,
    edge: usize,
) -> Option<usize> {
    let own = all[index].as_ref().filter(|own| own.corners.len() == 4)?;
    let [p, q, r, s] = [0, 1, 2, 3].map(|k| own.corners[(edge + k) % 4]);
    let other = *at_edge.get(&(key(q), key(p)))?;
    let theirs = all[other].as_ref().filter(|_| other != index)?;
    if theirs.radiance != own.radiance || theirs.two_sided != own.two_sided {
        return None;
    }
    let first = theirs.corners.iter().position(|corner| key(*corner) == key(p))?;
    let [t, u, last] = [1, 2, 3].map(|k| theirs.corners[(first + k) % 4]);
    let goes_on = |from: Vec3, by: Vec3, to: Vec3| {
        let (before, after) = (by - from, to - by);
        let most = STRAIGHT * before.length() * after.length();
        before.dot(after) > 0.0 && before.cross(after).length() <= most
    };
    (key(last) == key(q) && goes_on(s, p, t) && goes_on(r, q, u)).then_some(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of squares, of which some are of another radiance.
    fn grid(side: u32, is_dim: impl Fn(u32, u32) -> bool) -> Vec<FlatEmitter> {
        let at = |x: u32, y: u32| Vec3::new(x as f32 * 0.7, 3.0, y as f32 * 1.3);
        let squares = (0..side * side).map(|index| {
            let (x, y) = (index % side, index / side);
            FlatEmitter {
                corners: vec![at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)],
                radiance: if is_dim(x, y) { Rgb::splat(0.5) } else { Rgb::ONE },
                two_sided: false,
                triangles: vec![2 * index, 2 * index + 1],
            }
        });
        squares.collect()
    }

    fn area(emitter: &FlatEmitter) -> f32 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| emitter.corners[k]);
        0.5 * (c - a).cross(d - b).length()
    }

    #[test]
    fn a_grid_becomes_one_quadrilateral() {
        let joined = join(grid(20, |_, _| false));
        assert_eq!(joined.len(), 1);
        assert_eq!(joined[0].triangles.len(), 800);
        assert!((area(&joined[0]) / (400.0 * 0.7 * 1.3) - 1.0).abs() < 1e-4);
        let [a, b, c, _] = [0, 1, 2, 3].map(|k| joined[0].corners[k]);
        assert!((b - a).cross(c - a).y < 0.0, "it has turned over");
    }

    #[test]
    fn only_what_shines_alike_is_joined_and_nothing_is_lost() {
        let joined = join(grid(9, |x, y| x == 4 && y == 4));
        assert!(joined.len() > 2 && joined.len() < 40, "{}", joined.len());
        let total: f32 = joined.iter().map(area).sum();
        assert!((total / (81.0 * 0.7 * 1.3) - 1.0).abs() < 1e-4);
        let dim: Vec<_> = joined.iter().filter(|one| one.radiance != Rgb::ONE).collect();
        assert!(dim.len() == 1 && dim[0].triangles.len() == 2);
        let mut triangles: Vec<u32> = joined.iter().flat_map(|one| one.triangles.clone()).collect();
        triangles.sort_unstable();
        assert_eq!(triangles, (0..162).collect::<Vec<u32>>());
    }

    /// A bent strip, and squares that are shifted against each other, stay apart.
    #[test]
    fn what_makes_no_quadrilateral_stays() {
        let mut bent = grid(2, |_, _| false);
        for emitter in &mut bent {
            for corner in &mut emitter.corners {
                corner.y += if corner.x > 1.0 { 0.3 } else { 0.0 };
            }
        }
        assert_eq!(join(bent).len(), 2);
    }
}
