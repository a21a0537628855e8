//! Which children of a wide node a ray meets: `obvhs`'s arithmetic, four boxes at a time, or all
//! eight where the processor has AVX2. Both do the same operations on each box, so the answer has
//! the same bits.

use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::Ray;

/// How boxes are tested.
pub trait Boxes {
    /// The children that `ray` meets, as the bits that `obvhs::traverse!` takes.
    fn met(node: &CwBvhNode, ray: &Ray, oct_inv4: u32) -> u32;
}

/// With what every processor has.
pub struct Baseline;

impl Boxes for Baseline {
    #[inline(always)]
    fn met(node: &CwBvhNode, ray: &Ray, oct_inv4: u32) -> u32 {
        node.intersect_ray(ray, oct_inv4)
    }
}

/// With AVX2. Use only where the processor has it, and only inside functions that are compiled
/// for it.
#[cfg(target_arch = "x86_64")]
pub struct Avx2;

#[cfg(target_arch = "x86_64")]
impl Boxes for Avx2 {
    #[inline(always)]
    fn met(node: &CwBvhNode, ray: &Ray, oct_inv4: u32) -> u32 {
        use glam::Vec3A;
        use std::arch::x86_64::*;

        // Of `obvhs`: nearer boxes count as met.
        const NEAREST: f32 = 0.0001;
        let slope = node.compute_extent() * ray.inv_direction;
        let start = (Vec3A::from(node.p) - ray.origin) * ray.inv_direction;
        let (bits, places) = node.get_child_and_index_bits(oct_inv4);
        // SAFETY: callers see to it that there is AVX2; loads are of eight bytes of an array of
        // eight.
        unsafe {
            // Macros, because closures would be functions that are not compiled for AVX2.
            macro_rules! distance {
                ($planes:expr, $axis:ident) => {{
                    let bytes = _mm_loadl_epi64($planes.as_ptr().cast());
                    let planes = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
                    let scaled = _mm256_mul_ps(planes, _mm256_set1_ps(slope.$axis));
                    _mm256_add_ps(scaled, _mm256_set1_ps(start.$axis))
                }};
            }
            macro_rules! slab {
                ($min:expr, $max:expr, $axis:ident) => {{
                    let backwards = ray.direction.$axis < 0.0;
                    let near = if backwards { &$max } else { &$min };
                    let far = if backwards { &$min } else { &$max };
                    (distance!(near, $axis), distance!(far, $axis))
                }};
            }
            let x = slab!(node.child_min_x, node.child_max_x, x);
            let y = slab!(node.child_min_y, node.child_max_y, y);
            let z = slab!(node.child_min_z, node.child_max_z, z);
            let enter = _mm256_max_ps(x.0, _mm256_max_ps(y.0, z.0));
            let leave = _mm256_min_ps(x.1, _mm256_min_ps(y.1, z.1));
            let enter = _mm256_max_ps(enter, _mm256_set1_ps(NEAREST));
            let leave = _mm256_min_ps(leave, _mm256_set1_ps(ray.tmax));
            let met = _mm256_cmp_ps::<_CMP_LE_OS>(enter, leave);

            let bits = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(bits as i64));
            let places = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(places as i64));
            let placed = _mm256_sllv_epi32(bits, places);
            let chosen = _mm256_and_si256(placed, _mm256_castps_si256(met));
            let half =
                _mm_or_si128(_mm256_castsi256_si128(chosen), _mm256_extracti128_si256::<1>(chosen));
            let quarter = _mm_or_si128(half, _mm_shuffle_epi32::<0b01_00_11_10>(half));
            let all = _mm_or_si128(quarter, _mm_shuffle_epi32::<0b10_11_00_01>(quarter));
            _mm_cvtsi128_si32(all) as u32
        }
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::random::{Numbers, Stream};
    use glam::{Vec3, Vec3A};

    #[target_feature(enable = "avx2")]
    fn with_avx2(node: &CwBvhNode, ray: &Ray, oct_inv4: u32) -> u32 {
        Avx2::met(node, ray, oct_inv4)
    }

    /// Nodes of any content, as most are; some children empty, some inner, some leaves.
    #[test]
    fn eight_boxes_at_a_time_are_met_as_four() {
        if !is_x86_feature_detected!("avx2") {
            println!("skipped: no AVX2");
            return;
        }
        let mut numbers = Numbers::new(3, Stream::Path, 0);
        let mut hits = 0;
        for _ in 0..20_000 {
            let mut byte = || (numbers.uniform() * 256.0) as u8;
            let mut planes = || [0; 8].map(|_| byte());
            let (min, max) = ([planes(), planes(), planes()], [planes(), planes(), planes()]);
            let ordered = |axis: usize, upper: bool| {
                std::array::from_fn(|child| {
                    let (a, b) = (min[axis][child], max[axis][child]);
                    if upper { a.max(b) } else { a.min(b) }
                })
            };
            let kinds = planes();
            let child_meta = std::array::from_fn(|child| match kinds[child] % 3 {
                0 => 0,
                1 => 0b0010_0000 | (24 + child as u8),
                _ => 0b0110_0000 | (3 * child as u8 % 22),
            });
            let node = CwBvhNode {
                p: Vec3::new(-1.0, 2.0, 0.5),
                e: [120, 121, 119],
                child_meta,
                child_min_x: ordered(0, false),
                child_max_x: ordered(0, true),
                child_min_y: ordered(1, false),
                child_max_y: ordered(1, true),
                child_min_z: ordered(2, false),
                child_max_z: ordered(2, true),
                ..CwBvhNode::default()
            };
            let mut number = || 2.0 * numbers.uniform() - 1.0;
            let middle = Vec3A::new(0.0, 4.0, 1.0);
            let origin = middle + 2.0 * Vec3A::new(number(), number(), number());
            let mut direction = Vec3A::new(number(), number(), number());
            if number() > 0.8 {
                direction.y = 0.0;
            }
            let ray = Ray::new(origin, direction.normalize_or(Vec3A::X), 0.0, 2.0 + number());
            let octant = (0..3).map(|axis| u32::from(ray.direction[axis] >= 0.0) << (2 - axis));
            let oct_inv4 = octant.sum::<u32>() * 0x0101_0101;
            let expected = Baseline::met(&node, &ray, oct_inv4);
            // SAFETY: the feature was just detected.
            assert_eq!(unsafe { with_avx2(&node, &ray, oct_inv4) }, expected);
            hits += expected.count_ones();
        }
        assert!(hits > 2_000, "{hits}");
    }
}
