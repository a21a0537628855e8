//! What lobes of microfacets reflect over a part of a surface, of light from one direction: a polished surface
//! mirrors a small light in parts of it that single places would find by luck.
//!
//! Microfacets that reflect a light have the half vector as their normal. Its slope, h/(n·h) − n for the normal n,
//! changes over the surface as that bends and the viewer's direction turns; over a small part it does so about
//! linearly, so that the slopes there fill a parallelogram. The mean of Trowbridge's and Reitz' distribution over
//! such a one has a closed form ([`mean_over`]).

use glam::{DVec2, Vec2, Vec3};
use std::f64::consts::PI;

/// Least width of a parallelogram, in that of the distribution.
const LEAST_WIDTH: f64 = 0.02;
/// Distance from the middle of the distribution, in the length of the parallelogram's sides together, beyond which
/// the distribution is all but even over it.
const FAR: f64 = 6.0;

/// A slope of each lobe of microfacets that a surface may have, its base's and its coat's: by the normal of the
/// lobe, a vector across that.
pub type Slopes = [Vec3; 2];

/// How the slopes change along the two sides of a part of the surface, of each lobe.
pub type SlopeChanges = [[Vec3; 2]; 2];

/// Slope of the half vector of two unit vectors about a unit normal.
pub fn slope_about(normal: Vec3, viewer: Vec3, source: Vec3) -> Vec3 {
    let half = (viewer + source).normalize_or(normal);
    half / normal.dot(half).max(1e-3) - normal
}

/// By how much more microfacets reflect of light between two unit vectors on the mean over a part of the surface than
/// at its middle: `sides` say how the half vector's slope changes. The distribution has these widths along the first
/// two axes, the tangents; the third is the normal.
pub fn gain_over(
    (widths, [tangent, bitangent, normal]): ([f32; 2], [Vec3; 3]),
    (viewer, source): (Vec3, Vec3),
    sides: [Vec3; 2],
) -> f32 {
    let flat = |slope: Vec3| Vec2::new(tangent.dot(slope), bitangent.dot(slope));
    let (slope, sides) = (flat(slope_about(normal, viewer, source)), sides.map(flat));
    let scaled = |slope: Vec2| slope.as_dvec2() / Vec2::from_array(widths).as_dvec2();
    let (middle, sides_scaled) = (scaled(slope), sides.map(scaled));
    if is_even(middle, sides_scaled) {
        return 1.0;
    }
    // A solid angle of half vectors is cos³ of a square of slopes, and that facets are slanted counts once more: what
    // reflects most counts, which is nearest to the middle of the distribution.
    let nearest = (slope.length() - 0.5 * (sides[0].length() + sides[1].length())).max(0.0);
    let slant = (1.0 + nearest * nearest) / (1.0 + slope.length_squared());
    (mean_over(middle, sides_scaled) / at(middle)) as f32 * slant * slant
}

/// Whether the distribution is about the same all over a parallelogram.
fn is_even(middle: DVec2, [one, other]: [DVec2; 2]) -> bool {
    let reach = one.length() + other.length();
    reach <= LEAST_WIDTH || middle.length() > FAR * reach
}

/// The distribution of slopes, these in its width.
fn at(slope: DVec2) -> f64 {
    (1.0 + slope.length_squared()).powi(-2) / PI
}

/// Mean over a parallelogram, of such a middle and such sides, of 1/(π (1 + r²)²): the distribution of slopes where
/// these are measured in its width.
fn mean_over(middle: DVec2, [mut one, mut other]: [DVec2; 2]) -> f64 {
    if other.length_squared() > one.length_squared() {
        (one, other) = (other, one);
    }
    if is_even(middle, [one, other]) {
        return at(middle);
    }
    let along = one.normalize();
    let width = along.perp_dot(other);
    if width.abs() < LEAST_WIDTH {
        // All but a line.
        other += along.perp() * (LEAST_WIDTH.copysign(width) - width);
    }
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(x, y)| middle + one * x + other * y);
    let covered: f64 = (0..4).map(|k| between(corners[k], corners[(k + 1) % 4])).sum();
    covered.abs() / one.perp_dot(other).abs()
}

/// Integral of 1/(π (1 + r²)²) over the triangle of the origin and a side, negative where that runs clockwise.
///
/// With the distance d of the line and places t along it, that is ½/π ∫ R²/(1 + R²) dφ with R = d/cos φ, t = d tan φ:
/// d/(2π √(1 + d²)) times the difference of atan(t/√(1 + d²)).
fn between(from: DVec2, to: DVec2) -> f64 {
    let along = (to - from).normalize_or_zero();
    let distance = from.perp_dot(along);
    let width = (1.0 + distance * distance).sqrt();
    let angle = (to.dot(along) / width).atan() - (from.dot(along) / width).atan();
    distance / width * angle / (2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean by so many places along each side.
    fn by_places(middle: DVec2, [one, other]: [DVec2; 2]) -> f64 {
        const STEPS: u32 = 2000;
        let place = |step: u32| (f64::from(step) + 0.5) / f64::from(STEPS) - 0.5;
        let row = |y: u32| -> f64 {
            let value = |x: u32| super::at(middle + one * place(x) + other * place(y));
            (0..STEPS).map(value).sum()
        };
        (0..STEPS).map(row).sum::<f64>() / f64::from(STEPS * STEPS)
    }

    /// Around, beside and far from the middle, small and large, thin, and either way round.
    #[test]
    fn means_over_parallelograms_are_those_of_many_places() {
        for size in [0.01, 0.3, 3.0, 60.0] {
            for shape in [
                [DVec2::new(1.0, 0.2), DVec2::new(-0.3, 0.8)],
                [DVec2::new(-0.3, 0.8), DVec2::new(1.0, 0.2)],
                [DVec2::new(1.0, 0.0), DVec2::new(0.5, 0.001)],
                [DVec2::new(0.4, 0.3), DVec2::ZERO],
            ] {
                let sides = shape.map(|side| side * size);
                for middle in
                    [0.0, 0.3, 0.8, 5.0, 40.0].map(|far| DVec2::new(0.6, -0.8) * far * size)
                {
                    let (found, exact) = (mean_over(middle, sides), by_places(middle, sides));
                    assert!(
                        (found / exact - 1.0).abs() < 0.02,
                        "{middle} {sides:?}: {found} {exact}"
                    );
                }
            }
        }
    }

    /// All of the plane is covered once.
    #[test]
    fn a_large_square_covers_the_distribution() {
        let side = 1e5;
        let sides = [DVec2::X * side, DVec2::Y * side];
        let covered = mean_over(DVec2::new(3.0, -7.0), sides) * side * side;
        assert!((covered - 1.0).abs() < 1e-6, "{covered}");
    }
}
