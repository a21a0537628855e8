//! Shapes: quads, unions of boxes, surfaces of revolution. All are wound counter-clockwise seen
//! from outside.

use glam::{Affine3A, DVec2, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Triangles that share vertices. Without `normals` the surface is flat.
#[derive(Clone, Debug, Default)]
pub(super) struct Mesh {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
}

/// A planar quad, counter-clockwise seen from its front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quad {
    pub corners: [Vec3; 4],
}

impl Quad {
    pub fn center(&self) -> Vec3 {
        self.corners.iter().sum::<Vec3>() / 4.0
    }

    pub fn normal(&self) -> Vec3 {
        let [a, b, c, _] = self.corners;
        (b - a).cross(c - a).normalize()
    }

    /// The same quad seen from the other side.
    pub fn flipped(mut self) -> Self {
        self.corners.reverse();
        self
    }
}

/// A profile of a surface of revolution: points (radius, height) and outward normals, from the
/// bottom up.
pub(super) type Profile = Vec<(DVec2, DVec2)>;

/// Rounds a length to 2⁻²⁰ m. Sines differ by an ulp between platforms; files must not.
fn rounded(x: f64) -> f32 {
    let grid = f64::from(1 << 20);
    // Adding 0 turns −0 into 0.
    ((x * grid).round() / grid + 0.0) as f32
}

impl Mesh {
    /// Flat quads.
    pub fn quads<'q>(quads: impl IntoIterator<Item = &'q Quad>) -> Self {
        let mut mesh = Self::default();
        for quad in quads {
            let base = mesh.positions.len() as u32;
            mesh.positions.extend(quad.corners);
            mesh.triangles.push([base, base + 1, base + 2]);
            mesh.triangles.push([base, base + 2, base + 3]);
        }
        mesh
    }

    /// Texture coordinates by a map of positions.
    pub fn with_uvs(mut self, map: impl Fn(Vec3) -> Vec2) -> Self {
        self.uvs = self.positions.iter().map(|position| map(*position)).collect();
        self
    }

    /// Moves every vertex. The transform must not mirror or scale unevenly.
    pub fn moved(mut self, transform: Affine3A) -> Self {
        for position in &mut self.positions {
            let moved = transform.transform_point3(*position);
            *position = moved.to_array().map(|x| rounded(f64::from(x))).into();
        }
        for normal in &mut self.normals {
            let turned = transform.transform_vector3(*normal).normalize();
            *normal = turned.to_array().map(|x| rounded(f64::from(x))).into();
        }
        self
    }

    /// Moves by an offset.
    pub fn at(self, offset: Vec3) -> Self {
        self.moved(Affine3A::from_translation(offset))
    }

    /// Adds the triangles of another mesh of the same kind.
    pub fn add(&mut self, other: Mesh) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|index| index + base)));
    }

    /// A smooth surface of revolution around +Y. Points on the axis close it.
    pub fn revolved(profile: &Profile, slices: u32) -> Self {
        let mut mesh = Self::default();
        let mut rings = Vec::new();
        for (point, normal) in profile {
            let on_axis = point.x == 0.0;
            let columns = if on_axis { 1 } else { slices };
            rings.push((mesh.positions.len() as u32, on_axis));
            for column in 0..columns {
                let (sin, cos) = (TAU * f64::from(column) / f64::from(slices)).sin_cos();
                let around =
                    |v: &DVec2| Vec3::new(rounded(v.x * cos), rounded(v.y), rounded(-v.x * sin));
                mesh.positions.push(around(point));
                let flat = if on_axis { DVec2::new(0.0, normal.y.signum()) } else { *normal };
                mesh.normals.push(around(&flat.normalize()));
            }
        }
        for pair in rings.windows(2) {
            let ((low, low_on_axis), (high, high_on_axis)) = (pair[0], pair[1]);
            for column in 0..slices {
                let next = (column + 1) % slices;
                let place = |ring: u32, on_axis: bool, column: u32| {
                    if on_axis { ring } else { ring + column }
                };
                let [a, b] = [column, next].map(|c| place(low, low_on_axis, c));
                let [d, c] = [column, next].map(|c| place(high, high_on_axis, c));
                if !low_on_axis {
                    mesh.triangles.push([a, b, c]);
                }
                if !high_on_axis {
                    mesh.triangles.push([a, c, d]);
                }
            }
        }
        mesh
    }

    /// A sphere around the origin.
    pub fn sphere(radius: f32, stacks: u32, slices: u32) -> Self {
        Self::spheroid(radius, radius, stacks, slices)
    }

    /// An ellipsoid of revolution around the origin: radius across and half height.
    pub fn spheroid(radius: f32, half_height: f32, stacks: u32, slices: u32) -> Self {
        let (r, h) = (f64::from(radius), f64::from(half_height));
        let profile = arc(stacks, -0.5 * PI, 0.5 * PI)
            .into_iter()
            .map(|unit| (unit * DVec2::new(r, h), (unit / DVec2::new(r, h)).normalize()))
            .collect();
        Self::revolved(&profile, slices)
    }

    /// A closed cylinder with hemispherical ends, standing around the origin from `low` to `high`.
    pub fn capsule(radius: f32, low: f32, high: f32, stacks: u32, slices: u32) -> Self {
        let (r, low, high) = (f64::from(radius), f64::from(low), f64::from(high));
        let mut profile = Profile::new();
        for (center, from, to) in [(low + r, -0.5 * PI, 0.0), (high - r, 0.0, 0.5 * PI)] {
            for unit in arc(stacks, from, to) {
                profile.push((unit * r + DVec2::new(0.0, center), unit));
            }
        }
        Self::revolved(&profile, slices)
    }

    /// A flat-ended closed cylinder with rounded edges, from `low` to `high`.
    pub fn drum(radius: f32, low: f32, high: f32, edge: f32, slices: u32) -> Self {
        let (r, low, high, e) =
            (f64::from(radius), f64::from(low), f64::from(high), f64::from(edge));
        let mut profile = vec![(DVec2::new(0.0, low), DVec2::NEG_Y)];
        for (center, from, to) in [(low + e, -0.5 * PI, 0.0), (high - e, 0.0, 0.5 * PI)] {
            for unit in arc(4, from, to) {
                profile.push((unit * e + DVec2::new(r - e, center), unit));
            }
        }
        profile.push((DVec2::new(0.0, high), DVec2::Y));
        Self::revolved(&profile, slices)
    }
}

/// Unit vectors on an arc, both ends included and exact on the axes.
fn arc(steps: u32, from: f64, to: f64) -> Vec<DVec2> {
    (0..=steps)
        .map(|step| {
            let (sin, cos) = (from + (to - from) * f64::from(step) / f64::from(steps)).sin_cos();
            let snapped = |x: f64| if x.abs() < 1e-12 { 0.0 } else { x };
            DVec2::new(snapped(cos), snapped(sin))
        })
        .collect()
}

/// A smooth profile through control points (radius, height), `steps` segments between two points;
/// a closed one where the first point is the last. Normals point to the right of the way, so a
/// solid's outside is drawn from the bottom up.
pub(super) fn spline(points: &[[f64; 2]], steps: u32) -> Profile {
    let points: Vec<DVec2> = points.iter().copied().map(DVec2::from_array).collect();
    let chords: Vec<DVec2> = points.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let is_closed = points.first() == points.last();
    // Directions by the parabola through three neighbours, lengths by the shorter chord: next to
    // nothing overshoots, however unevenly the points lie.
    let tangent = |index: usize| {
        let (before, after) = match index {
            0 if is_closed => (chords[chords.len() - 1], chords[0]),
            0 => return chords[0],
            last if last == chords.len() && is_closed => (chords[last - 1], chords[0]),
            last if last == chords.len() => return chords[last - 1],
            _ => (chords[index - 1], chords[index]),
        };
        let along = before.normalize() * after.length() + after.normalize() * before.length();
        along.normalize() * before.length().min(after.length())
    };
    let mut profile = Profile::new();
    for (segment, chord) in chords.iter().enumerate() {
        let (from, to) = (tangent(segment), tangent(segment + 1));
        let is_last = segment + 1 == chords.len();
        for step in 0..steps + u32::from(is_last) {
            let t = f64::from(step) / f64::from(steps);
            let (square, cube) = (3.0 * *chord - 2.0 * from - to, from + to - 2.0 * *chord);
            let at = points[segment] + t * (from + t * (square + t * cube));
            let along = from + t * (2.0 * square + 3.0 * t * cube);
            // The last point exactly: one on the axis must not miss it by a rounding error.
            let at = if step == steps { points[segment + 1] } else { at };
            profile.push((at, DVec2::new(along.y, -along.x).normalize()));
        }
    }
    profile
}

/// The boundary between filled and empty cells of a grid, seen from the empty side; what lies
/// outside the grid is empty. Watertight and without T-junctions by construction.
pub(super) fn boundary(lines: [&[f32]; 3], filled: impl Fn([usize; 3]) -> bool) -> Vec<Quad> {
    let cells = lines.map(|line| line.len() - 1);
    let mut quads = Vec::new();
    for x in 0..cells[0] {
        for y in 0..cells[1] {
            for z in 0..cells[2] {
                let cell = [x, y, z];
                if !filled(cell) {
                    continue;
                }
                for axis in 0..3 {
                    for positive in [false, true] {
                        let mut neighbour = cell;
                        neighbour[axis] =
                            if positive { cell[axis] + 1 } else { cell[axis].wrapping_sub(1) };
                        if neighbour[axis] >= cells[axis] || !filled(neighbour) {
                            quads.push(cell_face(lines, cell, axis, positive));
                        }
                    }
                }
            }
        }
    }
    quads
}

fn cell_face(lines: [&[f32]; 3], cell: [usize; 3], axis: usize, positive: bool) -> Quad {
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |along_b: usize, along_c: usize| {
        let mut index = cell;
        index[axis] += usize::from(positive);
        index[b] += along_b;
        index[c] += along_c;
        Vec3::new(lines[0][index[0]], lines[1][index[1]], lines[2][index[2]])
    };
    let quad = Quad { corners: [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)] };
    if positive { quad } else { quad.flipped() }
}

/// An axis-aligned box, by two opposite corners.
pub(super) type Block = ([f32; 3], [f32; 3]);

/// The outside of a union of boxes; faces that lie on the floor `y = 0` are left out.
pub(super) fn union_of(blocks: &[Block]) -> Mesh {
    let lines: [Vec<f32>; 3] = std::array::from_fn(|axis| {
        let mut line: Vec<f32> = blocks.iter().flat_map(|b| [b.0[axis], b.1[axis]]).collect();
        line.sort_by(f32::total_cmp);
        line.dedup();
        line
    });
    let quads = boundary([&lines[0], &lines[1], &lines[2]], |cell| {
        blocks.iter().any(|(low, high)| {
            (0..3).all(|axis| {
                lines[axis][cell[axis]] >= low[axis] && lines[axis][cell[axis] + 1] <= high[axis]
            })
        })
    });
    Mesh::quads(quads.iter().filter(|quad| quad.corners.iter().any(|corner| corner.y != 0.0)))
}
