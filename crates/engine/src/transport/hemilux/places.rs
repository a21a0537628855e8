//! Where the fragments of a picture are, eight at a time.

use glam::Vec3;
use rayon::prelude::*;

/// Fragments that are looked at together.
pub const LANES: usize = 8;

type Lanes = [f32; LANES];

/// Places and unit normals of eight fragments, by axis.
pub struct Eight {
    /// Places, ray units.
    pub point: [Lanes; 3],
    /// Unit normals.
    pub normal: [Lanes; 3],
}

/// Where the fragments of a picture are.
#[derive(Default)]
pub struct Places {
    /// In the order of the fragments; what is left over of the last is at the origin.
    pub eights: Vec<Eight>,
}

impl Places {
    /// Of all fragments, place and unit normal each.
    pub fn new<T: Sync>(fragments: &[T], at: impl Fn(&T) -> (Vec3, Vec3) + Sync) -> Self {
        let eight = |fragments: &[T]| {
            let lanes = |of: &dyn Fn((Vec3, Vec3)) -> f32| {
                std::array::from_fn(|lane| fragments.get(lane).map_or(0.0, |one| of(at(one))))
            };
            let axes = [0, 1, 2];
            Eight {
                point: axes.map(|axis| lanes(&|(point, _)| point[axis])),
                normal: axes.map(|axis| lanes(&|(_, normal)| normal[axis])),
            }
        };
        Self { eights: fragments.par_chunks(LANES).with_min_len(128).map(eight).collect() }
    }
}
