//! Angles by their sines and cosines, without a call of the system's library: faster by far where
//! they are found millions of times, and the same bits on every system.

use glam::Vec4;
use std::f32::consts::{FRAC_PI_2, PI};

/// Coefficients of arctan x = x + x³ (…) for |x| ≤ 1, the highest power of x² first (Abramowitz and
/// Stegun 4.4.49: to 2·10⁻⁸ before rounding).
const SERIES: [f32; 8] = [
    0.002_866_225_7,
    -0.016_165_737,
    0.042_909_614,
    -0.075_289_64,
    0.106_562_64,
    -0.142_089,
    0.199_935_51,
    -0.333_331_45,
];

/// atan2(sine, cosine) of four for sine ≥ 0, to 10⁻⁶; 0 of both gives no number.
#[inline]
pub fn angles_of(sine: Vec4, cosine: Vec4) -> Vec4 {
    let (low, high) = (sine.min(cosine.abs()), sine.max(cosine.abs()));
    let x = low / high;
    let s = x * x;
    let series = SERIES[1..].iter().fold(Vec4::splat(SERIES[0]), |sum, c| sum * s + *c);
    let inner = x + x * s * series;
    let outer = Vec4::splat(FRAC_PI_2) - inner;
    let first = Vec4::select(sine.cmpgt(cosine.abs()), outer, inner);
    let obtuse = cosine.cmplt(Vec4::ZERO);
    Vec4::select(obtuse, Vec4::splat(PI) - first, first)
}

/// atan2(sine, cosine) in (−π, π], to 10⁻⁶; 0 of both.
#[inline]
pub fn angle_of(sine: f32, cosine: f32) -> f32 {
    let (up, along) = (sine.abs(), cosine.abs());
    let x = up.min(along) / up.max(along).max(f32::MIN_POSITIVE);
    let s = x * x;
    let series = SERIES[1..].iter().fold(SERIES[0], |sum, c| sum * s + *c);
    let inner = x + x * s * series;
    let first = if up > along { FRAC_PI_2 - inner } else { inner };
    let upper = if cosine < 0.0 { PI - first } else { first };
    if sine < 0.0 { -upper } else { upper }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_atan2() {
        for step in 0..=1000 {
            let at = f64::from(step) / 1000.0 * std::f64::consts::PI;
            let (sine, cosine) = (at.sin().max(0.0) as f32, at.cos() as f32);
            let found = angles_of(Vec4::splat(sine), Vec4::splat(cosine)).x;
            assert!((f64::from(found) - at).abs() < 1e-6, "{at}");
            for (sine, at) in [(sine, at), (-sine, -at)] {
                let exact = f64::from(sine).atan2(f64::from(cosine));
                let found = f64::from(angle_of(sine, cosine));
                assert!((found - exact).abs() < 5e-7, "{at}: {found}");
                assert!((f64::from(angle_of(1e-9 * sine, 1e-9 * cosine)) - exact).abs() < 5e-7);
            }
        }
        assert_eq!(angle_of(0.0, 0.0), 0.0);
        assert_eq!([angle_of(0.0, -1.0), angle_of(1.0, 0.0)], [PI, FRAC_PI_2]);
    }
}
