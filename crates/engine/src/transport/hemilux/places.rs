//! Places and normals of a picture's fragments, eight at a time for vector instructions.

use glam::Vec3;
use rayon::prelude::*;

/// Fragments that are computed together: floats in a 256-bit register.
pub const LANES: usize = 8;

type Lanes = [f32; LANES];

/// Places and unit normals of eight fragments, by axis.
pub struct EightPlaces {
    /// Places, ray units.
    pub point: [Lanes; 3],
    /// Unit normals.
    pub normal: [Lanes; 3],
}

/// Places and unit normals of all fragments of a picture.
#[derive(Default)]
pub struct FragmentPlaces {
    /// In the order of the fragments; unused lanes of the last eight are zero.
    pub eights: Vec<EightPlaces>,
}

impl FragmentPlaces {
    /// Of all fragments, place and unit normal each.
    pub fn new<T: Sync>(fragments: &[T], at: impl Fn(&T) -> (Vec3, Vec3) + Sync) -> Self {
        let eight = |fragments: &[T]| {
            let lanes = |of: &dyn Fn((Vec3, Vec3)) -> f32| {
                std::array::from_fn(|lane| fragments.get(lane).map_or(0.0, |one| of(at(one))))
            };
            let axes = [0, 1, 2];
            EightPlaces {
                point: axes.map(|axis| lanes(&|(point, _)| point[axis])),
                normal: axes.map(|axis| lanes(&|(_, normal)| normal[axis])),
            }
        };
        Self { eights: fragments.par_chunks(LANES).with_min_len(128).map(eight).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_kept_in_their_order() {
        let at = |k: &u32| (Vec3::splat(*k as f32), Vec3::X * *k as f32);
        for count in [0u32, 1, 8, 19] {
            let numbers: Vec<u32> = (1..=count).collect();
            let places = FragmentPlaces::new(&numbers, at);
            assert_eq!(places.eights.len(), numbers.len().div_ceil(LANES));
            for (index, number) in numbers.iter().enumerate() {
                let (eight, lane) = (&places.eights[index / LANES], index % LANES);
                assert_eq!(eight.point.map(|axis| axis[lane]), at(number).0.to_array());
                assert_eq!(eight.normal.map(|axis| axis[lane]), at(number).1.to_array());
            }
        }
    }
}
