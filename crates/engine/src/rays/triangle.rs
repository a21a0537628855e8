//! Whether a ray crosses a triangle (Woop, Benthin, Wald 2013): in coordinates in which the ray is
//! the axis, the crossing is a question of the signs of three edge functions in the plane. Two
//! triangles with a common edge compute the same value for it but for the sign.

use glam::Vec3;

/// Triangles of a leaf at most, and boxes of a node: as many as are tested together.
pub const WIDTH: usize = 8;

/// The unit normal of a triangle's front.
pub fn unit_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a).normalize_or(Vec3::Z)
}

/// The triangles of a leaf: by corner and axis, the coordinates of each.
#[repr(C, align(32))]
pub struct Packet {
    pub(super) corners: [[[f32; WIDTH]; 3]; 3],
    /// Indices into [`crate::scene::Scene::triangles`].
    pub triangles: [u32; WIDTH],
    /// Bits of those whose backs are there for light and cameras: they reflect, or let light out.
    pub two_sided: u32,
    count: u32,
    normals: [Vec3; WIDTH],
}

impl Packet {
    /// No triangles.
    pub const EMPTY: Self = Self {
        corners: [[[0.0; WIDTH]; 3]; 3],
        triangles: [0; WIDTH],
        two_sided: 0,
        count: 0,
        normals: [Vec3::ZERO; WIDTH],
    };

    /// Adds one to fewer than [`WIDTH`].
    pub fn push(&mut self, triangle: u32, corners: [Vec3; 3], two_sided: bool) {
        let lane = self.count as usize;
        for (corner, at) in corners.iter().enumerate() {
            (0..3).for_each(|axis| self.corners[corner][axis][lane] = at[axis]);
        }
        self.triangles[lane] = triangle;
        self.normals[lane] = unit_normal(corners);
        self.two_sided |= u32::from(two_sided) << lane;
        self.count += 1;
    }

    /// A bit for each triangle.
    #[inline(always)]
    pub fn all(&self) -> u32 {
        (1 << self.count) - 1
    }

    /// The corners of one.
    #[inline]
    pub fn corners(&self, lane: usize) -> [Vec3; 3] {
        let [a, b, c] = &self.corners;
        let corner = |[x, y, z]: &[[f32; WIDTH]; 3]| Vec3::new(x[lane], y[lane], z[lane]);
        [corner(a), corner(b), corner(c)]
    }

    /// The unit normal of one's front.
    pub fn normal(&self, lane: usize) -> Vec3 {
        self.normals[lane]
    }
}

/// A ray as a shear that makes it the axis along which it goes most.
pub struct Sheared {
    /// Axes of space that are x, y and z after the shear.
    pub(super) axes: [usize; 3],
    pub(super) origin: [f32; 3],
    pub(super) shear_x: f32,
    pub(super) shear_y: f32,
    pub(super) scale_z: f32,
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

impl Sheared {
    /// The ray from `origin` along `direction`.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let Vec3 { x, y, z } = direction.abs();
        // Without branches: nothing foretells where the next ray goes.
        let along = if x.max(y) > z { usize::from(y >= x) } else { 2 };
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][along];
        let (direction, origin) = (direction.to_array(), origin.to_array());
        let d = axes.map(|axis: usize| direction[axis]);
        Self {
            axes,
            origin: axes.map(|axis| origin[axis]),
            shear_x: d[0] / d[2],
            shear_y: d[1] / d[2],
            scale_z: 1.0 / d[2],
        }
    }

    /// Bits that tell the ray from others.
    #[inline]
    pub fn key(&self) -> u32 {
        let numbers = [self.shear_x, self.shear_y, self.scale_z].into_iter().chain(self.origin);
        numbers.fold(0, |key: u32, number| {
            (key.rotate_left(5) ^ number.to_bits()).wrapping_mul(0x9e37_79b1)
        })
    }

    /// The crossing with a triangle at a distance that is certainly above 0 and below `end`.
    #[inline(always)]
    pub fn cross(&self, packet: &Packet, lane: usize, end: f32) -> Option<Crossing> {
        let relative = |corner: &[[f32; WIDTH]; 3]| {
            let [x, y, z] = self.axes;
            let x = corner[x][lane] - self.origin[0];
            let y = corner[y][lane] - self.origin[1];
            let z = corner[z][lane] - self.origin[2];
            (x - self.shear_x * z, y - self.shear_y * z, self.scale_z * z)
        };
        let corners = &packet.corners;
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
        const GAMMA: [f32; 6] = [0.0, gamma(1), gamma(2), gamma(3), gamma(4), gamma(5)];
        let (error_x, error_y, error_z) = (GAMMA[5] * (x + z), GAMMA[5] * (y + z), GAMMA[3] * z);
        let error_edge = 2.0 * (GAMMA[2] * x * y + error_y * x + error_x * y);
        let edge = largest(u, v, w);
        let error = 3.0 * (GAMMA[3] * edge * z + error_edge * z + error_z * edge) * over.abs();
        if t <= error {
            return None;
        }
        Some(Crossing { t, u: v * over, v: w * over, front: (sum > 0.0) == (self.scale_z > 0.0) })
    }
}
