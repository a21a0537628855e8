//! How the normals of microfacets are distributed, which of them are seen, and how these are sampled:
//! Trowbridge's and Reitz' distribution ("GGX", Walter et al. 2007) with Smith's height-correlated
//! masking (Heitz 2014).

use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// √(α² + (1 − α²) cos²θ), of which Smith's masking is made.
#[inline]
fn slant(alpha: f32, cosine: f32) -> f32 {
    let square = alpha * alpha;
    (square + (1.0 - square) * cosine * cosine).sqrt()
}

/// D and V of microfacets for the cosines of viewer, source and the angle between normal and half
/// vector, of which `sine_square` is 1 − cos².
#[inline]
pub fn distribution_and_visibility(
    alpha: f32,
    [viewer, source]: [f32; 2],
    sine_square: f32,
) -> [f32; 2] {
    let square = alpha * alpha;
    let spread = sine_square + square * (1.0 - sine_square);
    let distribution = square / (PI * spread * spread);
    let shadowed = source * slant(alpha, viewer) + viewer * slant(alpha, source);
    [distribution, 0.5 / shadowed.max(f32::MIN_POSITIVE)]
}

/// Density per solid angle of a source that is sampled by the visible microfacets.
#[inline]
pub fn density_of_visible(alpha: f32, viewer: f32, distribution: f32) -> f32 {
    distribution / (2.0 * (viewer + slant(alpha, viewer)))
}

/// What masking leaves of light that facets which the viewer sees send out at a cosine on the same
/// side: height-correlated masking of both ways over that of the viewer's, G₂/G₁.
#[inline]
pub fn masked_further(alpha: f32, [viewer, beyond]: [f32; 2]) -> f32 {
    let both = beyond * slant(alpha, viewer) + viewer * slant(alpha, beyond);
    beyond * (viewer + slant(alpha, viewer)) / both.max(f32::MIN_POSITIVE)
}

/// The same of light that goes on on the other side, where masking knows nothing of the heights
/// before: G₁.
#[inline]
pub fn masked_beyond(alpha: f32, beyond: f32) -> f32 {
    2.0 * beyond / (beyond + slant(alpha, beyond))
}

/// The normal of a microfacet that a viewer sees, in coordinates in which the surface's normal is
/// +Z, for two uniform numbers (Dupuy and Benyoub 2023, by spherical caps).
#[inline]
pub fn visible_normal(alpha: f32, viewer: Vec3, xi: [f32; 2]) -> Vec3 {
    visible_normal_of([alpha; 2], viewer, xi)
}

/// The same of microfacets that have other widths along X and Y.
#[inline]
pub fn visible_normal_of(widths: [f32; 2], viewer: Vec3, xi: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(viewer.x * widths[0], viewer.y * widths[1], viewer.z);
    let stretched = stretched.normalize_or(Vec3::Z);
    let height = (1.0 - xi[0]) * (1.0 + stretched.z) - stretched.z;
    let across = (1.0 - height * height).max(0.0).sqrt();
    let (sin, cos) = (TAU * xi[1]).sin_cos();
    let half = Vec3::new(across * cos, across * sin, height) + stretched;
    Vec3::new(half.x * widths[0], half.y * widths[1], half.z.max(0.0)).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area of all microfacets, projected onto the surface, is the surface's: ∫ D cosθ dω = 1.
    #[test]
    fn microfacets_cover_the_surface() {
        const STEPS: u32 = 200_000;
        for alpha in [0.05f32, 0.3, 1.0] {
            let of_step = |step: u32| {
                let height = (f64::from(step) + 0.5) / f64::from(STEPS);
                let sine_square = (1.0 - height * height) as f32;
                let [distribution, _] = distribution_and_visibility(alpha, [1.0; 2], sine_square);
                f64::from(distribution) * height
            };
            let sum = (0..STEPS).map(of_step).sum::<f64>();
            let covered = sum * std::f64::consts::TAU / f64::from(STEPS);
            assert!((covered - 1.0).abs() < 5e-3, "{alpha}: {covered}");
        }
    }

    /// Sampled normals are unit vectors that the viewer sees.
    #[test]
    fn seen_normals_face_the_viewer() {
        let viewer = Vec3::new(0.8, 0.0, 0.6);
        for alpha in [0.1f32, 0.5, 1.0] {
            for k in 0..1000 {
                let xi = [(k as f32 + 0.5) / 1000.0, (k as f32 * 0.618_034).fract()];
                let normal = visible_normal(alpha, viewer, xi);
                assert!((normal.length() - 1.0).abs() < 1e-5 && normal.z >= 0.0);
                assert!(viewer.dot(normal) > -1e-4, "{alpha}: {normal}");
            }
        }
    }
}
