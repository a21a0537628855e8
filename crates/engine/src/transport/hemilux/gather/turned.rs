//! How much more or less indirect light places get that normal maps turn.

use super::by_direction::{ByDirection, COUNT};
use super::record::Record;
use super::splat::{LocalFit, splat};
use crate::radiometry::Rgb;
use crate::transport::hemilux::fragments::VisibleSurfaces;
use rayon::prelude::*;

/// Cosine between smooth and shading normal from which on they are taken as the same.
const SAME_NORMAL: f32 = 0.9998;

/// Factors of the irradiance of fragments for where their shading normals face, by what the records around
/// them have seen; none where there are no normal maps.
pub fn factors(visible: &VisibleSurfaces, records: &[Record]) -> Vec<Rgb> {
    if !records.iter().any(|record| record.by_direction.is_some()) {
        return Vec::new();
    }
    let contribution = |record: &Record| {
        let seen = record.by_direction.as_ref().map(|seen| seen.per_ray(record.rays));
        LocalFit::even(seen.unwrap_or([0.0; 3 * COUNT]))
    };
    // The factor is the same whatever the weights add up to.
    let seen = splat(visible, records, contribution, |sums, _| ByDirection::of(sums));
    let factor = |(index, seen): (usize, &ByDirection)| {
        let fragment = &visible.fragments[index];
        let (smooth, facing) = (fragment.normal, fragment.shading_normal);
        if smooth.dot(facing) < SAME_NORMAL { seen.factor(facing, smooth) } else { Rgb::ONE }
    };
    seen.par_iter().enumerate().with_min_len(1024).map(factor).collect()
}
