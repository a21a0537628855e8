//! What is visible from where, by rays through every facet of a scene: f64, brute force, no
//! rasterisation. To light, the back of a one-sided surface is black and opaque.

use glam::DVec3;
use hemilux_engine::patches::{NO_PATCH, PatchedScene};
use std::f64::consts::TAU;

/// Kronecker sequence in four dimensions from the powers of 1/g, g⁵ = g + 1 (a generalised
/// golden ratio), moved by a random shift: evenly spread and unbiased.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    shift: [f64; 4],
}

impl Sequence {
    /// The sequence with the shift of a seed.
    pub fn new(seed: u64) -> Self {
        let mut generator = Generator::new(seed);
        Self { shift: [(); 4].map(|()| generator.uniform()) }
    }

    /// Point number `index` in the unit cube of four dimensions.
    pub fn point(&self, index: u64) -> [f64; 4] {
        const ROOT: f64 = 1.167_303_978_261_418_7;
        let mut power = 1.0;
        self.shift.map(|shift| {
            power /= ROOT;
            (shift + power * (index + 1) as f64).fract()
        })
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Generator {
    state: u64,
}

impl Generator {
    /// The generator of a seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// Uniform number in [0, 1) with 53 bits.
    pub fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A direction about `normal` whose density is cosθ/π.
pub fn cosine_direction(normal: DVec3, u: f64, v: f64) -> DVec3 {
    let helper = if normal.x.abs() < 0.5 { DVec3::X } else { DVec3::Y };
    let tangent = helper.cross(normal).normalize();
    let bitangent = normal.cross(tangent);
    let (sine, azimuth) = (u.sqrt(), TAU * v);
    tangent * (sine * azimuth.cos())
        + bitangent * (sine * azimuth.sin())
        + normal * (1.0 - u).sqrt()
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hit {
    /// Nothing.
    Nothing,
    /// The back of a one-sided surface.
    Black,
    /// A patch.
    Patch {
        /// Index of the patch.
        patch: usize,
        /// Where.
        point: DVec3,
    },
}

struct Wall {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
    divisions: u32,
    front: usize,
    back: Option<usize>,
}

impl Wall {
    /// Distance along the ray in lengths of `direction`, barycentric coordinates, and whether the
    /// back was met.
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64, f64, bool)> {
        let slope = self.normal.dot(direction);
        if slope == 0.0 {
            return None;
        }
        let to_corner = self.corner - origin;
        let t = self.normal.dot(to_corner) / slope;
        let [a, b] = self.edges;
        let cross = to_corner.cross(direction);
        let (u, v) = (b.dot(cross) / slope, -a.dot(cross) / slope);
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        inside.then_some((t, u, v, slope > 0.0))
    }
}

/// Cells of a triangle are numbered by columns of constant ⌊u·n⌋; column c has 2(n − c) − 1.
fn cell_number(divisions: u32, u: f64, v: f64) -> usize {
    let n = divisions as usize;
    let (x, y) = (u * n as f64, v * n as f64);
    let column = (x as usize).min(n - 1);
    let row = (y as usize).min(n - 1 - column);
    let before: usize = (0..column).map(|c| 2 * (n - c) - 1).sum();
    let across = x.fract() + y.fract() > 1.0 && row < n - 1 - column;
    before + 2 * row + usize::from(across)
}

/// A patch as the oracle sees it.
struct Element {
    corners: [DVec3; 3],
    normal: DVec3,
    wall: usize,
}

/// A scene for rays.
pub struct World {
    walls: Vec<Wall>,
    elements: Vec<Element>,
    size: f64,
}

impl World {
    /// The facets and patches of a scene.
    pub fn new(scene: &PatchedScene) -> Self {
        let mut elements: Vec<Option<Element>> = (0..scene.patches.len()).map(|_| None).collect();
        let mut walls = Vec::new();
        let mut size = 0f64;
        for (index, facet) in scene.facets.iter().enumerate() {
            let [a, b, c] = facet.corners.map(|p| scene.positions[p as usize].as_dvec3());
            size = size.max(a.abs().max(b.abs()).max(c.abs()).max_element());
            let edges = [b - a, c - a];
            let normal = edges[0].cross(edges[1]);
            let back = (facet.back != NO_PATCH).then_some(facet.back as usize);
            let (front, n) = (facet.front as usize, facet.divisions);
            walls.push(Wall { corner: a, edges, normal, divisions: n, front, back });
            let at = |i: u32, j: u32| {
                a + (edges[0] * f64::from(i) + edges[1] * f64::from(j)) / f64::from(n)
            };
            let mut place = |corners: [DVec3; 3]| {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0 - a;
                // Barycentric coordinates of the middle tell the cell's number.
                let square = normal.length_squared();
                let u = middle.cross(edges[1]).dot(normal) / square;
                let v = edges[0].cross(middle).dot(normal) / square;
                let cell = cell_number(n, u, v);
                for (first, side) in [(Some(front), 1.0), (back, -1.0)] {
                    if let Some(first) = first {
                        let normal = normal.normalize() * side;
                        elements[first + cell] = Some(Element { corners, normal, wall: index });
                    }
                }
            };
            for i in 0..n {
                for j in 0..n - i {
                    place([at(i, j), at(i + 1, j), at(i, j + 1)]);
                    if i + j + 1 < n {
                        place([at(i + 1, j + 1), at(i, j + 1), at(i + 1, j)]);
                    }
                }
            }
        }
        let elements = elements.into_iter().map(|e| e.expect("every patch is a cell")).collect();
        Self { walls, elements, size }
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether there is no patch.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Unit normal of a patch.
    pub fn normal(&self, patch: usize) -> DVec3 {
        self.elements[patch].normal
    }

    /// Area of a patch.
    pub fn area(&self, patch: usize) -> f64 {
        let [a, b, c] = self.elements[patch].corners;
        0.5 * (b - a).cross(c - a).length()
    }

    /// A point of a patch, uniform over its area for two uniform numbers.
    pub fn point(&self, patch: usize, u: f64, v: f64) -> DVec3 {
        let [a, b, c] = self.elements[patch].corners;
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        a + u * (b - a) + v * (c - a)
    }

    /// What a ray from a point of `patch` meets first. A front wins over a back at the same place.
    pub fn cast(&self, patch: usize, origin: DVec3, direction: DVec3) -> Hit {
        self.meet(Some(self.elements[patch].wall), origin, direction)
    }

    /// What a ray from anywhere meets first, as light meets it.
    pub fn look(&self, origin: DVec3, direction: DVec3) -> Hit {
        self.meet(None, origin, direction)
    }

    fn meet(&self, skip: Option<usize>, origin: DVec3, direction: DVec3) -> Hit {
        let near = 1e-9 * self.size / direction.length();
        let mut best: Option<(f64, usize, f64, f64, bool)> = None;
        for (index, wall) in self.walls.iter().enumerate() {
            if Some(index) == skip {
                continue;
            }
            let Some((t, u, v, back)) = wall.meet(origin, direction) else { continue };
            if t <= near {
                continue;
            }
            let nearer = best.is_none_or(|(other, .., other_back)| {
                let tie = (t - other).abs() <= 1e-9 * other;
                if tie { other_back && !back } else { t < other }
            });
            if nearer {
                best = Some((t, index, u, v, back));
            }
        }
        let Some((t, index, u, v, back)) = best else { return Hit::Nothing };
        let wall = &self.walls[index];
        let Some(first) = (if back { wall.back } else { Some(wall.front) }) else {
            return Hit::Black;
        };
        let patch = first + cell_number(wall.divisions, u, v);
        Hit::Patch { patch, point: origin + t * direction }
    }

    /// F from `patch` to every patch, and the share of its hemisphere that is black or empty:
    /// the share of `count` cosine-distributed rays.
    pub fn form_factors(&self, patch: usize, count: u64, seed: u64) -> (Vec<f64>, f64) {
        let sequence = Sequence::new(seed.wrapping_add(0x1000_0001 * patch as u64));
        let (mut seen, mut lost) = (vec![0u64; self.len()], 0u64);
        for index in 0..count {
            let [a, b, c, d] = sequence.point(index);
            let direction = cosine_direction(self.normal(patch), c, d);
            match self.cast(patch, self.point(patch, a, b), direction) {
                Hit::Patch { patch, .. } => seen[patch] += 1,
                Hit::Black | Hit::Nothing => lost += 1,
            }
        }
        let share = |rays: u64| rays as f64 / count as f64;
        (seen.into_iter().map(share).collect(), share(lost))
    }
}
