//! Rasterises facets into the item buffer of one hemicube.
//!
//! 1. Corners are brought into the hemicube frame once and classified against the planes that
//!    bound the faces.
//! 2. A facet is set up once: its three edge planes through the eye and its inverse-depth plane.
//! 3. Each face that the facet may touch is filled span by span ([`crate::raster`]).

use crate::hemicube::{FACES, Face, Shot, item};
use crate::patches::PatchedScene;
use crate::raster::{self, PixelPlane, PixelTriangle, Target, centre_range, edge_planes};
use glam::Vec3;

/// Inverse depth of what gives way where depths tie: backs to coincident fronts, and facets that
/// recede.
const GIVES_WAY: f32 = 1.0 - 2e-5;
/// Relative rounding noise of the distance between eye and facet plane.
const PLANE_NOISE: f32 = 4e-7;

/// Buffers of one hemicube; reused from shot to shot.
pub struct Raster {
    resolution: u32,
    /// Item codes, R × 3R.
    pub items: Vec<u32>,
    depth: Vec<f32>,
    corners: Vec<Vec3>,
    codes: Vec<u8>,
    outlines: Vec<Outline>,
}

/// A linear function of the hemicube-frame direction.
type Plane = Vec3;

/// Edge planes of a facet seen from the eye: positive towards its inside, whichever side is
/// seen. Barycentric coordinates of the hit along d are (e0, e1, e2)·d over their sum.
#[derive(Clone, Copy)]
pub struct Setup {
    /// Edge planes opposite to corners 0, 1, 2.
    pub edges: [Plane; 3],
    /// Inverse depth: inverse_depth·d is 1/t of the hit eye + t·d.
    pub inverse_depth: Plane,
    /// Whether the eye sees the back.
    pub back: bool,
}

impl Setup {
    /// Sets up a facet with corners relative to the eye; `None` where the eye lies in its plane.
    #[inline(always)]
    pub fn new(corners: [Vec3; 3], eye_extent: f32) -> Option<Self> {
        let mut edges = edge_planes(corners);
        let volume = corners[0].dot(edges[0]);
        let sum = edges[0] + edges[1] + edges[2];
        let noise = PLANE_NOISE * (eye_extent + corners[0].abs().max_element());
        if volume.abs() <= noise * sum.length() {
            return None;
        }
        let back = volume > 0.0;
        let mut inverse_depth = sum * volume.recip();
        if back {
            inverse_depth *= GIVES_WAY;
        } else {
            edges = [-edges[0], -edges[1], -edges[2]];
        }
        Some(Self { edges, inverse_depth, back })
    }
}

/// Pixel grid of one face of one shot.
#[derive(Clone, Copy)]
pub struct Grid {
    face: Face,
    step: f32,
    first_x: f32,
    first_y: f32,
}

impl Grid {
    /// The grid of a face with the shot's sub-pixel offset.
    pub fn new(face: Face, resolution: u32, shot: &Shot) -> Self {
        let step = 2.0 / resolution as f32;
        let bottom = if face == Face::Top { 1.0 } else { 0.0 };
        Self {
            face,
            step,
            first_x: (0.5 + shot.jitter.x) * step - 1.0,
            first_y: (0.5 + shot.jitter.y) * step - bottom,
        }
    }

    /// Components of a hemicube-frame vector along the face's axis, right and up.
    #[inline(always)]
    pub fn components(&self, v: Vec3) -> (f32, f32, f32) {
        match self.face {
            Face::Top => (v.z, v.x, v.y),
            Face::PlusT => (v.x, v.y, v.z),
            Face::MinusT => (-v.x, -v.y, v.z),
            Face::PlusB => (v.y, -v.x, v.z),
            Face::MinusB => (-v.y, v.x, v.z),
        }
    }

    /// A plane in pixel coordinates.
    #[inline(always)]
    pub fn plane(&self, plane: Plane) -> PixelPlane {
        let (axis, right, up) = self.components(plane);
        PixelPlane {
            per_column: right * self.step,
            per_row: up * self.step,
            constant: axis + right * self.first_x + up * self.first_y,
        }
    }

    /// Face coordinate x of column 0 and its step.
    pub fn x(&self) -> (f32, f32) {
        (self.first_x, self.step)
    }

    /// Face coordinate y of a row.
    pub fn y(&self, row: u32) -> f32 {
        self.first_y + self.step * row as f32
    }
}

/// Bits of a corner's place: below the horizon; on the negative side of x−y, x+y, z−x, z+x,
/// z−y, z+y.
mod place {
    pub const BELOW: u8 = 1;
    pub const X_LESS_Y: u8 = 2;
    pub const X_LESS_MINUS_Y: u8 = 4;
    pub const Z_LESS_X: u8 = 8;
    pub const Z_LESS_MINUS_X: u8 = 16;
    pub const Z_LESS_Y: u8 = 32;
    pub const Z_LESS_MINUS_Y: u8 = 64;
}

#[inline(always)]
fn classify(v: Vec3) -> u8 {
    use place::*;
    let bit = |condition: bool, bit: u8| u8::from(condition) * bit;
    bit(v.z < 0.0, BELOW)
        | bit(v.x < v.y, X_LESS_Y)
        | bit(v.x < -v.y, X_LESS_MINUS_Y)
        | bit(v.z < v.x, Z_LESS_X)
        | bit(v.z < -v.x, Z_LESS_MINUS_X)
        | bit(v.z < v.y, Z_LESS_Y)
        | bit(v.z < -v.y, Z_LESS_MINUS_Y)
}

/// Whether a facet lies outside one of the planes that bound a face; `all` and `any` are the
/// corners' places combined.
#[inline(always)]
fn outside(face: Face, all: u8, any: u8) -> bool {
    use place::*;
    let negative = |bits: u8| all & bits != 0;
    let positive = |bits: u8| !any & bits != 0;
    match face {
        Face::Top => negative(Z_LESS_X | Z_LESS_MINUS_X | Z_LESS_Y | Z_LESS_MINUS_Y),
        Face::PlusT => negative(BELOW | X_LESS_Y | X_LESS_MINUS_Y) || positive(Z_LESS_X),
        Face::MinusT => negative(BELOW) || positive(X_LESS_Y | X_LESS_MINUS_Y | Z_LESS_MINUS_X),
        Face::PlusB => negative(BELOW | X_LESS_MINUS_Y) || positive(X_LESS_Y | Z_LESS_Y),
        Face::MinusB => negative(BELOW | X_LESS_Y) || positive(X_LESS_MINUS_Y | Z_LESS_MINUS_Y),
    }
}

/// What the inner loop reads of a facet: corners, and whether its back may be skipped.
#[derive(Clone, Copy)]
struct Outline {
    corners: [u32; 3],
    cull_back: u32,
    /// Factor of the inverse depth.
    nearness: f32,
}

impl Raster {
    /// Buffers for hemicubes of resolution R over a scene.
    pub fn new(resolution: u32, scene: &PatchedScene) -> Self {
        let pixels = 3 * (resolution * resolution) as usize;
        let outlines = scene.facets.iter().map(|facet| Outline {
            corners: facet.corners,
            cull_back: u32::from(facet.cull_back),
            nearness: if facet.recedes { GIVES_WAY } else { 1.0 },
        });
        Self {
            resolution,
            items: vec![item::EMPTY; pixels],
            depth: vec![0.0; pixels],
            corners: vec![Vec3::ZERO; scene.positions.len()],
            codes: vec![0; scene.positions.len()],
            outlines: outlines.collect(),
        }
    }

    /// Corners of a facet relative to the eye in the hemicube frame of the last shot.
    #[inline(always)]
    pub fn corners_of(&self, [a, b, c]: [u32; 3]) -> [Vec3; 3] {
        [self.corners[a as usize], self.corners[b as usize], self.corners[c as usize]]
    }

    /// Renders the faces of a shot that have a weight; the others stay empty.
    #[inline(always)]
    pub fn render(&mut self, scene: &PatchedScene, shot: &Shot) {
        self.items.fill(item::EMPTY);
        for (face, _) in Face::ALL.iter().zip(shot.face_weights).filter(|(_, w)| *w > 0.0) {
            let start = (face.first_row(self.resolution) * self.resolution) as usize;
            let pixels = (face.rows(self.resolution) * self.resolution) as usize;
            self.depth[start..start + pixels].fill(0.0);
        }
        for ((corner, code), position) in
            self.corners.iter_mut().zip(&mut self.codes).zip(&scene.positions)
        {
            *corner = shot.to_frame(*position - shot.position);
            *code = classify(*corner);
        }
        let extent = shot.position.abs().max_element();
        let grids = Face::ALL.map(|face| Grid::new(face, self.resolution, shot));
        let drawn = shot.face_weights.map(|weight| weight > 0.0);
        for index in 0..self.outlines.len() {
            let outline = self.outlines[index];
            let [a, b, c] = outline.corners;
            let codes = [self.codes[a as usize], self.codes[b as usize], self.codes[c as usize]];
            let all = codes[0] & codes[1] & codes[2];
            if all & place::BELOW != 0 {
                continue;
            }
            let corners = self.corners_of(outline.corners);
            if outline.cull_back != 0 && corners[0].dot(corners[1].cross(corners[2])) > 0.0 {
                continue;
            }
            let mut facet = VisibleFacet {
                index: index as u32,
                all,
                any: codes[0] | codes[1] | codes[2],
                corners,
                extent,
                nearness: outline.nearness,
                setup: None,
            };
            // Unrolled by hand, so that each face's axes are constants.
            self.draw::<0>(&grids, &drawn, &mut facet);
            self.draw::<1>(&grids, &drawn, &mut facet);
            self.draw::<2>(&grids, &drawn, &mut facet);
            self.draw::<3>(&grids, &drawn, &mut facet);
            self.draw::<4>(&grids, &drawn, &mut facet);
        }
    }

    /// Fills the pixels of one face that see the facet nearer than anything before.
    #[inline(always)]
    fn draw<const FACE: usize>(
        &mut self,
        grids: &[Grid; FACES],
        drawn: &[bool; FACES],
        facet: &mut VisibleFacet,
    ) {
        let face = Face::ALL[FACE];
        if !drawn[FACE] || outside(face, facet.all, facet.any) {
            return;
        }
        let grid = Grid { face, ..grids[FACE] };
        let (width, face_rows) = (self.resolution, face.rows(self.resolution));
        // Most facets of a dense mesh lie between pixel centres: nothing to set up.
        let Some(rows) = rows_of(&grid, &facet.corners, width, face_rows) else { return };
        if facet.setup.is_none() {
            facet.setup = Setup::new(facet.corners, facet.extent);
        }
        let Some(setup) = &facet.setup else { return };
        let start = (face.first_row(width) * width) as usize;
        let pixels = start..start + (face_rows * width) as usize;
        let mut target = Target {
            width,
            first_row: 0,
            items: &mut self.items[pixels.clone()],
            depth: &mut self.depth[pixels],
        };
        let [e0, e1, e2] = &setup.edges;
        let triangle = PixelTriangle {
            edges: [grid.plane(*e0), grid.plane(*e1), grid.plane(*e2)],
            nearness: grid.plane(setup.inverse_depth * facet.nearness),
            rows,
            code: item::encode(facet.index, setup.back),
        };
        raster::fill(&mut target, &triangle);
    }
}

/// A facet of which a part lies above the hemicube's horizon. Its edge planes are computed when the
/// first face needs them.
struct VisibleFacet {
    index: u32,
    /// Places that all corners share, and places that any has.
    all: u8,
    any: u8,
    corners: [Vec3; 3],
    extent: f32,
    nearness: f32,
    setup: Option<Setup>,
}

/// Rows whose centres may see the facet, `None` where no centre can; all rows where the facet
/// reaches behind the face's plane.
#[inline(always)]
fn rows_of(grid: &Grid, corners: &[Vec3; 3], columns: u32, rows: u32) -> Option<(u32, u32)> {
    let (mut x, mut y) = ([0f32; 3], [0f32; 3]);
    let scale = grid.step.recip();
    for i in 0..3 {
        let (axis, right, up) = grid.components(corners[i]);
        if axis <= 1e-12 {
            return Some((0, rows));
        }
        let inverse = axis.recip();
        x[i] = (right * inverse - grid.first_x) * scale;
        y[i] = (up * inverse - grid.first_y) * scale;
    }
    let (first_column, end_column) = centre_range(x, columns);
    let (first_row, end_row) = centre_range(y, rows);
    (first_column < end_column && first_row < end_row).then_some((first_row, end_row))
}
