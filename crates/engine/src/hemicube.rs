//! The hemicube: faces, pixels, delta form factors, and a shot as a value
//! (Antal §2.2; Rogers §5-17; Cohen and Greenberg 1985).
//!
//! A hemicube of resolution R stands on a point with its frame (tangent, bitangent, normal). The
//! top has R × R pixels, each side R × R/2; all five lie below each other in one item buffer of
//! R columns × 3R rows: top, +t, −t, +b, −b.

use crate::radiometry::Rgb;
use glam::{Vec2, Vec3};
use std::f64::consts::PI;

/// Number of faces.
pub const FACES: usize = 5;

/// A face of the hemicube in the hemicube's own frame: pixel directions are
/// axis + x·right + y·up with x, y ∈ [−1, 1] on top and y ∈ [0, 1] on the sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    /// Around the normal.
    Top,
    /// Around +tangent.
    PlusT,
    /// Around −tangent.
    MinusT,
    /// Around +bitangent.
    PlusB,
    /// Around −bitangent.
    MinusB,
}

impl Face {
    /// All faces in item-buffer order.
    pub const ALL: [Face; FACES] =
        [Face::Top, Face::PlusT, Face::MinusT, Face::PlusB, Face::MinusB];

    /// (axis, right, up) in the hemicube frame (tangent = x, bitangent = y, normal = z).
    pub fn axes(self) -> (Vec3, Vec3, Vec3) {
        match self {
            Face::Top => (Vec3::Z, Vec3::X, Vec3::Y),
            Face::PlusT => (Vec3::X, Vec3::Y, Vec3::Z),
            Face::MinusT => (Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z),
            Face::PlusB => (Vec3::Y, Vec3::NEG_X, Vec3::Z),
            Face::MinusB => (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        }
    }

    /// First row of the face in the item buffer.
    pub fn first_row(self, resolution: u32) -> u32 {
        match self {
            Face::Top => 0,
            Face::PlusT => resolution,
            Face::MinusT => resolution + resolution / 2,
            Face::PlusB => 2 * resolution,
            Face::MinusB => 2 * resolution + resolution / 2,
        }
    }

    /// Rows of the face.
    pub fn rows(self, resolution: u32) -> u32 {
        if self == Face::Top { resolution } else { resolution / 2 }
    }

    /// The face that a direction of the hemicube frame goes through; below the horizon, the side
    /// that it leans to.
    pub fn hit_by(direction: Vec3) -> Face {
        let Vec3 { x, y, z } = direction;
        if z >= x.abs() && z >= y.abs() {
            Face::Top
        } else if x.abs() >= y.abs() {
            if x > 0.0 { Face::PlusT } else { Face::MinusT }
        } else if y > 0.0 {
            Face::PlusB
        } else {
            Face::MinusB
        }
    }

    /// Direction (not normalised, component along the axis 1) of the ray through column `column`
    /// and row `row` of the face, in the hemicube frame; `jitter` in pixels, in [−½, ½).
    pub fn direction(self, resolution: u32, column: u32, row: u32, jitter: Vec2) -> Vec3 {
        let (axis, right, up) = self.axes();
        let step = 2.0 / resolution as f32;
        let x = (column as f32 + 0.5 + jitter.x) * step - 1.0;
        let y = (row as f32 + 0.5 + jitter.y) * step - if self == Face::Top { 1.0 } else { 0.0 };
        axis + x * right + y * up
    }
}

/// Delta form factors of every pixel of the item buffer.
///
/// Not the point values ΔA/(π(x²+y²+1)²) and zΔA/(π(y²+z²+1)²) but their exact integrals over
/// each pixel, so they sum to 1 at every resolution.
pub struct DeltaFormFactors {
    /// R of the hemicube.
    pub resolution: u32,
    /// R × 3R values in item-buffer layout.
    pub values: Vec<f32>,
}

impl DeltaFormFactors {
    /// The table for an even resolution R ≥ 2.
    pub fn new(resolution: u32) -> Self {
        let r = resolution as usize;
        let edge = |i: usize| 2.0 * i as f64 / r as f64 - 1.0;
        let mut values = Vec::with_capacity(3 * r * r);
        for row in 0..r {
            for column in 0..r {
                let f = |i, j| top_primitive(edge(i), edge(j));
                let value = f(column + 1, row + 1) - f(column, row + 1) - f(column + 1, row)
                    + f(column, row);
                values.push(value as f32);
            }
        }
        let side: Vec<f32> = (0..r / 2)
            .flat_map(|row| (0..r).map(move |column| (row, column)))
            .map(|(row, column)| {
                let height = |j: usize| 2.0 * j as f64 / r as f64;
                let f = |i, j| side_primitive(edge(i), height(j));
                (f(column + 1, row + 1) - f(column, row + 1) - f(column + 1, row) + f(column, row))
                    as f32
            })
            .collect();
        for _ in 0..4 {
            values.extend_from_slice(&side);
        }
        Self { resolution, values }
    }
}

/// ∫∫ 1/(π(x²+y²+1)²) dx dy.
fn top_primitive(x: f64, y: f64) -> f64 {
    let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
}

/// ∫∫ z/(π(y²+z²+1)²) dy dz.
fn side_primitive(y: f64, z: f64) -> f64 {
    let a = (1.0 + z * z).sqrt();
    -(y / a).atan() / a / (2.0 * PI)
}

/// Item-buffer codes: 0 for nothing, else 1 + 2·facet + (1 if its back was seen).
pub mod item {
    /// Nothing was seen.
    pub const EMPTY: u32 = 0;

    /// Code of a facet's front or back.
    pub fn encode(facet: u32, back: bool) -> u32 {
        1 + 2 * facet + u32::from(back)
    }

    /// Facet and whether its back was seen; `None` for [`EMPTY`].
    pub fn decode(code: u32) -> Option<(u32, bool)> {
        let code = code.checked_sub(1)?;
        Some((code >> 1, code & 1 == 1))
    }
}

/// One hemicube shot: from where, with what radiance. The irradiance of receiver i is
/// E_i = scale·π/A_i·(diffuse·Σ ΔF + lobe·Σ ΔF cosⁿα) over the pixels that see i (Antal eq. 8
/// without its second cosine: the pixel Jacobian already holds it).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// The shooting patch j.
    pub patch: u32,
    /// The point y on it.
    pub position: Vec3,
    /// Hemicube frame in world space: unit tangent.
    pub tangent: Vec3,
    /// Hemicube frame in world space: unit bitangent.
    pub bitangent: Vec3,
    /// Hemicube frame in world space: unit normal of the patch (geometric).
    pub normal: Vec3,
    /// Sub-pixel offset of all rays, pixels in [−½, ½).
    pub jitter: Vec2,
    /// Per face: 0 to leave it out, else the inverse of its probability.
    pub face_weights: [f32; FACES],
    /// Direction-independent part of the radiance, L^e + E·kd/π; where a part K of the light is
    /// known ([`crate::device::KnownLight`]), the same without K.
    pub diffuse: Rgb,
    /// K of the shooter: glossy receivers reflect it too.
    pub known: Rgb,
    /// Radiance at the peak of the Phong lobe, E·ks(n+2)/(2π); zero without one.
    pub lobe: Rgb,
    /// World-space mirror direction of the lobe.
    pub lobe_axis: Vec3,
    /// Phong exponent n of the lobe.
    pub exponent: f32,
    /// p_j, the probability with which the patch is picked.
    pub probability: f32,
    /// A_j/(p_j K).
    pub scale: f32,
}

impl Default for Shot {
    /// Unit radiance from patch 0 at the origin along +z through all faces.
    fn default() -> Self {
        Self {
            patch: 0,
            position: Vec3::ZERO,
            tangent: Vec3::X,
            bitangent: Vec3::Y,
            normal: Vec3::Z,
            jitter: Vec2::ZERO,
            face_weights: [1.0; FACES],
            diffuse: Rgb::ONE,
            known: Rgb::ZERO,
            lobe: Rgb::ZERO,
            lobe_axis: Vec3::Z,
            exponent: 1.0,
            probability: 1.0,
            scale: 1.0,
        }
    }
}

impl Shot {
    /// Whether per-pixel lobe weights are needed.
    pub fn has_lobe(&self) -> bool {
        self.lobe != Rgb::ZERO
    }

    /// Brings a world-space direction into the hemicube frame.
    pub fn to_frame(&self, direction: Vec3) -> Vec3 {
        Vec3::new(
            self.tangent.dot(direction),
            self.bitangent.dot(direction),
            self.normal.dot(direction),
        )
    }

    /// Brings a direction of the hemicube frame into world space.
    pub fn to_world(&self, direction: Vec3) -> Vec3 {
        self.tangent * direction.x + self.bitangent * direction.y + self.normal * direction.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delta_form_factors_sum_to_one_face_by_face() {
        for resolution in [8u32, 32, 256] {
            let table = DeltaFormFactors::new(resolution);
            for face in Face::ALL {
                let start = (face.first_row(resolution) * resolution) as usize;
                let length = (face.rows(resolution) * resolution) as usize;
                let sum: f64 =
                    table.values[start..start + length].iter().map(|v| f64::from(*v)).sum();
                let exact = if face == Face::Top { 0.554_136 } else { 0.111_466 };
                assert!((sum - exact).abs() < 1e-5, "{face:?} at {resolution}: {sum}");
            }
            let total: f64 = table.values.iter().map(|v| f64::from(*v)).sum();
            assert!((total - 1.0).abs() < 1e-6, "R = {resolution}: {total}");
        }
    }

    #[test]
    fn delta_form_factors_are_cosine_times_solid_angle_over_pi() {
        let table = DeltaFormFactors::new(64);
        for face in Face::ALL {
            for (column, row) in [(0, 0), (31, 7), (63, 31)] {
                let d = face.direction(64, column, row, Vec2::ZERO);
                let (cosine, along) = (d.normalize().z, d.dot(face.axes().0) / d.length());
                let pixel = f64::from(2.0 / 64.0f32).powi(2);
                let expected = f64::from(cosine) * f64::from(along).powi(3) * pixel / PI;
                let at = ((face.first_row(64) + row) * 64 + column) as usize;
                let value = f64::from(table.values[at]);
                assert!((value - expected).abs() < 2e-2 * expected, "{face:?} {column},{row}");
            }
        }
    }

    #[test]
    fn faces_are_right_handed_and_meet_what_they_look_at() {
        for face in Face::ALL {
            let (axis, right, up) = face.axes();
            assert_eq!(right.cross(up), axis);
            assert_eq!(Face::hit_by(axis + 0.9 * right + 0.4 * up), face);
        }
    }
}
