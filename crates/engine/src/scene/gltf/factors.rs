//! Numbers of a material, kept to their ranges.

use super::warnings::Warnings;
use crate::radiometry::Rgb;

/// A number within a range; clamped with a warning where it lies outside.
pub(super) fn factor(
    value: f32,
    at: &str,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> f32 {
    if range.contains(&value) {
        return value;
    }
    let (low, high) = range.into_inner();
    warnings.push(at, format!("{value:e} is outside {low}…{high}; it is clamped"));
    value.clamp(low, high)
}

/// Colour factors within a range; clamped with a warning where one lies outside.
pub(super) fn color(
    values: [f32; 3],
    at: &str,
    range: std::ops::RangeInclusive<f32>,
    warnings: &mut Warnings,
) -> Rgb {
    Rgb::from_array(values.map(|value| factor(value, at, range.clone(), warnings)))
}
