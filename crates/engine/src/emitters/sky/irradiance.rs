//! Irradiance of the whole sky by normal.
//!
//! As a function of a vector x of any length, F(x) = ∫ L max(x·ω, 0) dω is convex, and where
//! everything above x's horizon has the moment V, F(x) = V·x and V is F's gradient too. Between nodes of
//! a grid, interpolation of F lies above it and interpolation of the planes that touch it at the
//! nodes lies below it, by equal amounts where F is quadratic: their mean has an error of third
//! order. The points of the grid are on a cube, where coordinates are flat.

use super::cells::{Cells, Cone, Given, Moment, Moments};
use super::cube::{OnCube, point};
use crate::radiometry::{IMPORTANCE_WEIGHTS, Rgb};
use glam::Vec3;
use rayon::prelude::*;

/// Steps of the grid along the side of a face of the cube.
const STEPS: usize = 32;
/// Nodes along the side.
const SIDE: usize = STEPS + 1;
/// Parts of the sky's flux that count as a point: those that give more than this share of all.
const POINT_SHARE: f32 = 1.0 / 64.0;
/// Fewest columns and rows of the coarsest level.
const COARSEST: [usize; 2] = [8, 4];
/// Bytes of the table.
pub const BYTES: usize = 6 * SIDE * SIDE * size_of::<Moment>();

/// Irradiance by normal.
pub struct Irradiance {
    /// By face, then both coordinates: the moment of all that is above the horizon.
    nodes: Vec<Moment>,
    /// What is so bright that the grid would smooth its setting.
    points: Vec<Spot>,
}

impl Irradiance {
    /// The table for a sky.
    pub fn new(cells: &Cells, moments: Moments) -> Self {
        let [columns, rows] = moments.parts.map(|parts| parts.count);
        let total: f32 = moments.given.iter().map(|given| given.flux).sum();
        let mut points = Vec::new();
        let leaves: Vec<Part> = (moments.given.iter().enumerate())
            .map(|(part, given)| {
                let corners = cells.corners(moments.parts, [part % columns, part / columns]);
                let mut part = Part::new(corners, Spot::new(given));
                if given.flux > POINT_SHARE * total {
                    points.push(part.spot);
                    part.spot = Spot::NONE;
                }
                part
            })
            .collect();
        let levels = levels(leaves, [columns, rows]);
        let nodes = (0..6 * SIDE * SIDE)
            .into_par_iter()
            .map(|node| {
                let at = [node / SIDE % SIDE, node % SIDE].map(coordinate);
                above_horizon(&levels, point(node / (SIDE * SIDE), at))
            })
            .collect();
        Self { nodes, points }
    }

    /// Irradiance of a plane with a unit normal.
    pub fn at(&self, normal: Vec3) -> Rgb {
        let OnCube { face, at, point: x, length } = OnCube::new(normal);
        let [a, b] = at.map(|x| 0.5 * (x + 1.0) * STEPS as f32);
        let [i, j] = [a, b].map(|x| (x as usize).min(STEPS - 1));
        let [s, t] = [a - i as f32, b - j as f32];
        let mut sum = Rgb::ZERO;
        for (i, j, weight) in [
            (i, j, (1.0 - s) * (1.0 - t)),
            (i, j + 1, (1.0 - s) * t),
            (i + 1, j, s * (1.0 - t)),
            (i + 1, j + 1, s * t),
        ] {
            let node = point(face, [coordinate(i), coordinate(j)]);
            let moment = &self.nodes[(face * SIDE + i) * SIDE + j];
            // The value at the node and the plane that touches it there, half and half.
            sum += *moment * ((node + x) * (0.5 * weight));
        }
        let spread = (sum * length).max(Rgb::ZERO);
        self.points.iter().fold(spread, |sum, spot| sum + spot.irradiance(normal))
    }

    /// Bytes that it takes.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Moment>() + self.points.len() * size_of::<Spot>()
    }
}

/// Coordinate of a node across a face.
fn coordinate(step: usize) -> f32 {
    2.0 * step as f32 / STEPS as f32 - 1.0
}

/// Light from about one direction.
#[derive(Clone, Copy)]
struct Spot {
    moment: Moment,
    /// Unit vector to its middle.
    middle: Vec3,
    /// Half its width, radians: that of the uniform strip whose directions spread as much.
    half: f32,
}

impl Spot {
    /// No light.
    const NONE: Self = Self { moment: Moment::ZERO, middle: Vec3::Y, half: 1e-4 };

    /// About what a small part of the sky gives.
    fn new(Given { moment, flux }: &Given) -> Self {
        let sum = moment.transpose() * IMPORTANCE_WEIGHTS;
        // The mean of 1 − cosα to the middle, α² / 2, of a spread in two directions.
        let beyond = (1.0 - sum.length() / flux.max(f32::MIN_POSITIVE)).max(0.0);
        let half = (3.0 * beyond).sqrt().max(1e-4);
        Self { moment: *moment, middle: sum.normalize_or(Vec3::Y), half }
    }

    /// The moment of what a horizon leaves of it.
    fn above(&self, normal: Vec3) -> Moment {
        let height = self.middle.dot(normal);
        if height >= self.half {
            return self.moment;
        }
        if height <= -self.half {
            return Moment::ZERO;
        }
        let share = 0.5 * (height + self.half) / self.half;
        // The middle of what is left is higher up.
        let higher = 0.5 * (self.half - height);
        let more = self.moment * self.middle * (share * higher);
        self.moment * share + Moment::from_cols(more * normal.x, more * normal.y, more * normal.z)
    }

    /// Irradiance of a plane with a unit normal.
    fn irradiance(&self, normal: Vec3) -> Rgb {
        (self.above(normal) * normal).max(Rgb::ZERO)
    }
}

/// A rectangle of the sky.
#[derive(Clone, Copy)]
struct Part {
    /// Its light; of the finest level with how it spreads.
    spot: Spot,
    /// Its first and its last corner on the map.
    corners: [[f32; 2]; 2],
    /// Unit vector to its middle.
    axis: Vec3,
    /// Sine of the angle within which all of it is from there.
    sine: f32,
}

impl Part {
    fn new(corners: [[f32; 2]; 2], spot: Spot) -> Self {
        let cone = Cone::new(corners);
        Self { spot, corners, axis: cone.axis, sine: cone.radius.min(1.57).sin() }
    }
}

/// A grid of parts.
struct Level {
    columns: usize,
    parts: Vec<Part>,
}

/// Coarser and coarser grids, each of two by two parts of the one before it.
fn levels(leaves: Vec<Part>, [mut columns, mut rows]: [usize; 2]) -> Vec<Level> {
    let mut levels = vec![Level { columns, parts: leaves }];
    while columns > COARSEST[0] && rows > COARSEST[1] {
        let finer = &levels[levels.len() - 1];
        let half = columns / 2;
        let joined = |at: usize| {
            let first = 2 * (at / half) * columns + 2 * (at % half);
            let four = [first, first + 1, first + columns, first + columns + 1];
            let four = four.map(|part| finer.parts[part]);
            let moment = four.iter().fold(Moment::ZERO, |sum, part| sum + part.spot.moment);
            let corners = [four[0].corners[0], four[3].corners[1]];
            Part::new(corners, Spot { moment, ..Spot::NONE })
        };
        let parts = (0..half * (rows / 2)).map(joined).collect();
        (columns, rows) = (half, rows / 2);
        levels.push(Level { columns, parts });
    }
    levels
}

/// The moment of all light from above a horizon, down to whole parts of the finest level.
fn above_horizon(levels: &[Level], normal: Vec3) -> Moment {
    let normal = normal.normalize();
    let coarsest = levels.len() - 1;
    let mut open: Vec<(usize, usize)> =
        (0..levels[coarsest].parts.len()).map(|part| (coarsest, part)).collect();
    let mut sum = Moment::ZERO;
    while let Some((level, at)) = open.pop() {
        let Level { columns, parts } = &levels[level];
        let part = &parts[at];
        let height = part.axis.dot(normal);
        if height >= part.sine {
            sum += part.spot.moment;
        } else if level == 0 {
            sum += part.spot.above(normal);
        } else if height > -part.sine {
            let finer = level - 1;
            let first = 4 * (at / columns) * columns + 2 * (at % columns);
            let below = first + 2 * columns;
            open.extend([first, first + 1, below, below + 1].map(|part| (finer, part)));
        }
    }
    sum
}
