//! Whether a ray crosses a triangle (Woop, Benthin, Wald 2013): in coordinates in which the ray is
//! the axis, the crossing is a question of the signs of three edge functions in the plane. Two
//! triangles with a common edge compute the same value for it but for the sign.

use glam::Vec3;

/// Corners of a triangle, ray units.
pub type Corners = [[f32; 3]; 3];

/// A ray that goes most along axis `Z`, as a shear that makes it the axis.
pub struct Sheared<const Z: usize> {
    origin: [f32; 3],
    shear_x: f32,
    shear_y: f32,
    scale_z: f32,
}

/// Where a ray crosses a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// Distance in lengths of the direction.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
    /// Whether the front faces the ray's origin.
    pub front: bool,
}

/// (1 + ε)ⁿ − 1, at most, for single precision.
const fn gamma(n: i32) -> f32 {
    let n = n as f32 * 0.5 * f32::EPSILON;
    n / (1.0 - n)
}

impl<const Z: usize> Sheared<Z> {
    const X: usize = (Z + 1) % 3;
    const Y: usize = (Z + 2) % 3;

    /// The ray from `origin` along `direction`, whose component `Z` is its largest.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let d = direction.to_array();
        Self {
            origin: origin.to_array(),
            shear_x: d[Self::X] / d[Z],
            shear_y: d[Self::Y] / d[Z],
            scale_z: 1.0 / d[Z],
        }
    }

    /// The crossing with a triangle at a distance that is certainly above 0 and below `end`.
    #[inline(always)]
    pub fn cross(&self, corners: &Corners, end: f32) -> Option<Crossing> {
        let relative = |corner: &[f32; 3]| {
            let z = corner[Z] - self.origin[Z];
            let x = corner[Self::X] - self.origin[Self::X];
            let y = corner[Self::Y] - self.origin[Self::Y];
            (x - self.shear_x * z, y - self.shear_y * z, self.scale_z * z)
        };
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] =
            [relative(&corners[0]), relative(&corners[1]), relative(&corners[2])];
        let (mut u, mut v, mut w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        if u == 0.0 || v == 0.0 || w == 0.0 {
            // The products differ by less than single precision can tell; double is exact.
            let edge = |a: f32, b: f32, c: f32, d: f32| {
                (f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d)) as f32
            };
            (u, v, w) = (edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        if sum == 0.0 {
            return None;
        }
        let over = 1.0 / sum;
        let t = (u * az + v * bz + w * cz) * over;
        if !(t > 0.0 && t < end) {
            return None;
        }
        // Bound of the rounding error of t, so that a ray never meets the surface it starts on.
        let largest = |a: f32, b: f32, c: f32| a.abs().max(b.abs()).max(c.abs());
        let (x, y, z) = (largest(ax, bx, cx), largest(ay, by, cy), largest(az, bz, cz));
        let (error_x, error_y, error_z) = (gamma(5) * (x + z), gamma(5) * (y + z), gamma(3) * z);
        let error_edge = 2.0 * (gamma(2) * x * y + error_y * x + error_x * y);
        let edge = largest(u, v, w);
        let error = 3.0 * (gamma(3) * edge * z + error_edge * z + error_z * edge) * over.abs();
        if t <= error {
            return None;
        }
        Some(Crossing { t, u: v * over, v: w * over, front: (sum > 0.0) == (self.scale_z > 0.0) })
    }
}
