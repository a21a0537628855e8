//! Which of a node's eight boxes, and which of a leaf's eight triangles, a ray may meet: with what
//! every processor has, or eight at a time where it has AVX2. Boxes have a margin for rounding and
//! triangles that pass are tested again, one by one, so both find the same hits.

use super::triangle::{Packet, Sheared, WIDTH};
use glam::{Vec3, Vec3A};

/// The bit that tells places of leaves from places of nodes.
pub const LEAF: u32 = 1 << 31;

/// A node: the boxes of its children, by axis, low planes and high ones, and where they are.
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Node {
    planes: [[[f32; WIDTH]; 2]; 3],
    children: [u32; WIDTH],
}

impl Node {
    /// No children: boxes that no ray meets.
    pub const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [LEAF; WIDTH],
    };

    /// Sets a child.
    pub fn put(&mut self, child: usize, low: Vec3A, high: Vec3A, place: u32) {
        for axis in 0..3 {
            self.planes[axis][0][child] = low[axis];
            self.planes[axis][1][child] = high[axis];
        }
        self.children[child] = place;
    }

    /// Where a child is: a node, or with [`LEAF`] a leaf.
    #[inline(always)]
    pub fn child(&self, child: usize) -> u32 {
        self.children[child]
    }

    /// The nodes among the children.
    pub fn inner(&self) -> impl Iterator<Item = u32> {
        self.children.into_iter().filter(|child| child & LEAF == 0)
    }
}

/// A ray as boxes need it: distances to planes are `plane * inverse + start`.
pub struct Slabs {
    inverse: [f32; 3],
    start: [f32; 3],
    /// By axis, which planes are farther: the high ones (1), or the low ones (0).
    far: [usize; 3],
}

impl Slabs {
    /// The ray from `origin` along the unit `direction`.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        // Finite inverses, so that nothing below is not a number.
        let steep = |d: f32| if d.abs() < 1e-18 { 1e-18f32.copysign(d) } else { d };
        let inverse = direction.map(steep).recip();
        let far = direction.to_array().map(|d| usize::from(d.is_sign_positive()));
        Self { inverse: inverse.to_array(), start: (-origin * inverse).to_array(), far }
    }
}

/// How boxes and triangles are tested.
pub trait Boxes {
    /// The children that a ray meets before `end`, as bits, and at which distances it enters them.
    fn met(node: &Node, ray: &Slabs, end: f32) -> (u32, [f32; WIDTH]);
    /// The triangles that [`Sheared::cross`] may find a crossing with, as bits.
    fn crossed(packet: &Packet, ray: &Sheared, end: f32) -> u32;
}

/// With what every processor has.
pub struct Baseline;

impl Boxes for Baseline {
    #[inline(always)]
    fn met(node: &Node, ray: &Slabs, end: f32) -> (u32, [f32; WIDTH]) {
        let mut enter = [0f32; WIDTH];
        let mut leave = [end; WIDTH];
        for axis in 0..3 {
            let (inverse, start) = (ray.inverse[axis], ray.start[axis]);
            let near = &node.planes[axis][1 - ray.far[axis]];
            let far = &node.planes[axis][ray.far[axis]];
            for child in 0..WIDTH {
                let (from, to) = (near[child] * inverse + start, far[child] * inverse + start);
                enter[child] = if from > enter[child] { from } else { enter[child] };
                leave[child] = if to < leave[child] { to } else { leave[child] };
            }
        }
        let mut bits = 0;
        for child in 0..WIDTH {
            bits |= u32::from(enter[child] <= leave[child]) << child;
        }
        (bits, enter)
    }

    #[inline(always)]
    fn crossed(packet: &Packet, _: &Sheared, _: f32) -> u32 {
        packet.all()
    }
}

/// With AVX2 and fused multiply-adds. Use only where the processor has both, and only inside
/// functions that are compiled for them.
#[cfg(target_arch = "x86_64")]
pub struct Avx2;

#[cfg(target_arch = "x86_64")]
impl Boxes for Avx2 {
    #[inline(always)]
    fn met(node: &Node, ray: &Slabs, end: f32) -> (u32, [f32; WIDTH]) {
        use std::arch::x86_64::*;
        // SAFETY: callers see to it that there are the features; loads are of eight numbers of
        // arrays of eight.
        unsafe {
            // A macro, because closures would be functions that are not compiled for AVX2.
            macro_rules! slab {
                ($axis:literal) => {{
                    let inverse = _mm256_set1_ps(ray.inverse[$axis]);
                    let start = _mm256_set1_ps(ray.start[$axis]);
                    let planes = &node.planes[$axis];
                    let near = _mm256_load_ps(planes[1 - ray.far[$axis]].as_ptr());
                    let far = _mm256_load_ps(planes[ray.far[$axis]].as_ptr());
                    (_mm256_fmadd_ps(near, inverse, start), _mm256_fmadd_ps(far, inverse, start))
                }};
            }
            let (x, y, z) = (slab!(0), slab!(1), slab!(2));
            let enter = _mm256_max_ps(_mm256_max_ps(x.0, y.0), z.0);
            let leave = _mm256_min_ps(_mm256_min_ps(x.1, y.1), z.1);
            let enter = _mm256_max_ps(enter, _mm256_setzero_ps());
            let leave = _mm256_min_ps(leave, _mm256_set1_ps(end));
            let met = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave));
            let mut distances = [0f32; WIDTH];
            _mm256_storeu_ps(distances.as_mut_ptr(), enter);
            (met as u32, distances)
        }
    }

    #[inline(always)]
    fn crossed(packet: &Packet, ray: &Sheared, end: f32) -> u32 {
        use std::arch::x86_64::*;
        let [x, y, z] = ray.axes;
        // SAFETY: as above.
        unsafe {
            let [origin_x, origin_y, origin_z] = [
                _mm256_set1_ps(ray.origin[0]),
                _mm256_set1_ps(ray.origin[1]),
                _mm256_set1_ps(ray.origin[2]),
            ];
            let shear_x = _mm256_set1_ps(ray.shear_x);
            let shear_y = _mm256_set1_ps(ray.shear_y);
            // As in `Sheared::cross`, without fused operations, so that signs are the same.
            macro_rules! corner {
                ($corner:literal) => {{
                    let corner = &packet.corners[$corner];
                    let dz = _mm256_sub_ps(_mm256_load_ps(corner[z].as_ptr()), origin_z);
                    let dx = _mm256_sub_ps(_mm256_load_ps(corner[x].as_ptr()), origin_x);
                    let dy = _mm256_sub_ps(_mm256_load_ps(corner[y].as_ptr()), origin_y);
                    let dx = _mm256_sub_ps(dx, _mm256_mul_ps(shear_x, dz));
                    let dy = _mm256_sub_ps(dy, _mm256_mul_ps(shear_y, dz));
                    (dx, dy, dz)
                }};
            }
            macro_rules! edge {
                ($a:expr, $b:expr, $c:expr, $d:expr) => {
                    _mm256_sub_ps(_mm256_mul_ps($a, $b), _mm256_mul_ps($c, $d))
                };
            }
            let (a, b, c) = (corner!(0), corner!(1), corner!(2));
            let u = edge!(c.0, b.1, c.1, b.0);
            let v = edge!(a.0, c.1, a.1, c.0);
            let w = edge!(b.0, a.1, b.1, a.0);
            let zero = _mm256_setzero_ps();
            let least = _mm256_min_ps(_mm256_min_ps(u, v), w);
            let most = _mm256_max_ps(_mm256_max_ps(u, v), w);
            let inside = _mm256_or_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(least, zero),
                _mm256_cmp_ps::<_CMP_LE_OQ>(most, zero),
            );
            // Edges of 0 are computed again there, exactly: that changes signs only at corners that
            // the ray passes in rounding's reach, of slivers, whose crossings count as too near.
            if _mm256_movemask_ps(inside) == 0 {
                return 0;
            }
            let sum = _mm256_add_ps(_mm256_add_ps(u, v), w);
            let depth = _mm256_add_ps(_mm256_mul_ps(u, a.2), _mm256_mul_ps(v, b.2));
            let depth = _mm256_add_ps(depth, _mm256_mul_ps(w, c.2));
            let depth = _mm256_mul_ps(depth, _mm256_set1_ps(ray.scale_z));
            // Depth and sum have one sign where the crossing is ahead.
            let sign = _mm256_and_ps(sum, _mm256_set1_ps(-0.0));
            let depth = _mm256_xor_ps(depth, sign);
            let reach = _mm256_mul_ps(_mm256_xor_ps(sum, sign), _mm256_set1_ps(end * 1.0001 + 1.0));
            let met = _mm256_and_ps(inside, _mm256_cmp_ps::<_CMP_GE_OQ>(depth, zero));
            let met = _mm256_and_ps(met, _mm256_cmp_ps::<_CMP_LE_OQ>(depth, reach));
            _mm256_movemask_ps(met) as u32 & packet.all()
        }
    }
}
