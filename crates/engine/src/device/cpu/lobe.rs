//! cosⁿα for many pixels at once: x^n = 2^(n·log₂x) by polynomials that vectorise.

/// log₂ x for x > 0; absolute error < 4·10⁻⁷ and relative error < 10⁻⁶ near 1, where large
/// exponents need it.
#[inline(always)]
pub fn log2(x: f32) -> f32 {
    // x = 2^e·m with m in [√½, √2).
    let bits = x.to_bits() as i32;
    let e = (bits - 0x3f35_04f3) >> 23;
    let m = f32::from_bits((bits - (e << 23)) as u32);
    // log₂ m = 2/ln2·atanh(s), s = (m−1)/(m+1).
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series =
        2.885_39 + s2 * (0.961_796_7 + s2 * (0.577_078 + s2 * (0.412_198_6 + s2 * 0.320_598_9)));
    e as f32 + s * series
}

/// 2^x for x ≤ 0; 2⁻¹²⁶ below −126; relative error < 3·10⁻⁷.
#[inline(always)]
pub fn exp2(x: f32) -> f32 {
    let x = x.max(-126.0);
    let whole = (x + 0.5).floor();
    let f = x - whole;
    let p = 1.0
        + f * (std::f32::consts::LN_2
            + f * (0.240_226_5
                + f * (0.055_504_1 + f * (0.009_618_13 + f * (0.001_333_356 + f * 1.540_353e-4)))));
    // SAFETY: whole is in [−126, 0], so the conversion is in range.
    let e = unsafe { whole.to_int_unchecked::<i32>() };
    let scale = f32::from_bits(((e + 127) << 23) as u32);
    p * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_match_the_library() {
        for exponent in [1.0f32, 10.0, 28.0, 1000.0] {
            for i in 1..2000 {
                let x = i as f32 / 2000.0;
                let exact = f64::from(x).powf(f64::from(exponent));
                let ours = f64::from(exp2(exponent * log2(x)));
                let tolerance = 1e-6 * f64::from(exponent).max(4.0) * exact + 1e-30;
                assert!((ours - exact).abs() < tolerance, "{x}^{exponent}: {ours} {exact}");
            }
        }
    }
}
