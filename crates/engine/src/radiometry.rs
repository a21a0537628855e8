//! Quantities and units: radiance L W/(m²·sr), irradiance E W/m², power Φ W, linear RGB;
//! and the reflectance model of the whole engine, diffuse plus modified Phong
//! (Antal §2.1; f_r = kd/π + ks (n+2)/(2π) cosⁿα).

use std::f64::consts::PI;
use std::sync::OnceLock;

/// A linear RGB triple of any radiometric quantity.
pub type Rgb = glam::Vec3;

/// Weights that fold an RGB power into one number for importance (Rec. 709 luminance).
pub const IMPORTANCE_WEIGHTS: Rgb = Rgb::new(0.2126, 0.7152, 0.0722);

/// Importance of an RGB quantity: Σ_c weight_c·|x_c|.
///
/// Absolute values per channel, because with negative sources a plain sum can cancel to zero
/// while light is still to be sent.
pub fn importance(x: Rgb) -> f32 {
    IMPORTANCE_WEIGHTS.dot(x.abs())
}

/// Diffuse plus modified-Phong reflectance with kd + ks ≤ 1 per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflectance {
    /// Diffuse albedo, dimensionless.
    pub diffuse: Rgb,
    /// Specular albedo at normal incidence, dimensionless.
    pub specular: Rgb,
    /// Phong exponent n of the mirror lobe.
    pub exponent: f32,
}

impl Reflectance {
    /// A Lambertian surface.
    pub const fn lambertian(diffuse: Rgb) -> Self {
        Self { diffuse, specular: Rgb::ZERO, exponent: 1.0 }
    }

    /// Whether the specular lobe reflects anything at all.
    pub fn is_glossy(&self) -> bool {
        self.specular.max_element() > 0.0
    }

    /// Whether it has a lobe that counts as a mirror: patches of ordinary size don't resolve what
    /// it reflects, and light that it gathers makes caustics.
    pub fn is_sharp(&self) -> bool {
        self.is_glossy() && self.exponent > SHARP_EXPONENT
    }

    /// Directional albedo a(θ) for light arriving at the angle θ whose cosine is given:
    /// kd + ks·I_n(θ).
    pub fn albedo(&self, cos_incidence: f32) -> Rgb {
        if self.is_glossy() {
            self.diffuse + self.specular * LobeAlbedo::shared().at(self.exponent, cos_incidence)
        } else {
            self.diffuse
        }
    }

    /// Mean albedo under uniform light from all around: kd + ks·2 ∫ I_n cosθ dcosθ.
    pub fn mean_albedo(&self) -> Rgb {
        if !self.is_glossy() {
            return self.diffuse;
        }
        self.diffuse + self.specular * LobeAlbedo::shared().mean(self.exponent)
    }
}

/// A Phong lobe with a larger exponent is a mirror: half of what it reflects goes within
/// arccos ½^(1/n) of the mirror direction, less than 5° here.
pub const SHARP_EXPONENT: f32 = 200.0;

/// Number of exponent rows of [`LobeAlbedo`]: n + 1 = 2^0, 2^½, … 2^17.
pub const LOBE_ROWS: usize = 35;
/// Number of angle columns of [`LobeAlbedo`]: cosθ = 0 … 1 in equal steps.
pub const LOBE_COLUMNS: usize = 33;

/// Albedo of the modified-Phong lobe, I_n(θ) = (n+2)/(2π) ∫ cosⁿα cosθ_out dω over the upper
/// hemisphere, for ks = 1.
///
/// I_n(0) = 1; towards grazing incidence part of the lobe lies below the horizon and the albedo
/// falls. Tabulated once, bilinear in (log₂(n+1), cosθ); absolute error < 0.01 (see tests).
pub struct LobeAlbedo {
    /// Row-major `LOBE_ROWS × LOBE_COLUMNS`, the layout that the WGSL kernels read.
    pub table: Vec<f32>,
    /// Per row, 2 ∫ I_n cosθ dcosθ.
    means: Vec<f32>,
}

impl LobeAlbedo {
    /// The table, computed at first use.
    pub fn shared() -> &'static LobeAlbedo {
        static TABLE: OnceLock<LobeAlbedo> = OnceLock::new();
        TABLE.get_or_init(|| {
            let mut table = Vec::with_capacity(LOBE_ROWS * LOBE_COLUMNS);
            for row in 0..LOBE_ROWS {
                let exponent = (0.5 * row as f64).exp2() - 1.0;
                let around = around_mirror(exponent);
                for column in 0..LOBE_COLUMNS {
                    let cosine = column as f64 / (LOBE_COLUMNS - 1) as f64;
                    table.push(lobe_over(&around, exponent, cosine) as f32);
                }
            }
            let means = table.chunks(LOBE_COLUMNS).map(mean_of_row).collect();
            LobeAlbedo { table, means }
        })
    }

    /// I_n(θ) by bilinear interpolation.
    pub fn at(&self, exponent: f32, cos_incidence: f32) -> f32 {
        let row = row_of(exponent);
        let column = cos_incidence.clamp(0.0, 1.0) * (LOBE_COLUMNS - 1) as f32;
        let (r, c) = (row as usize, (column as usize).min(LOBE_COLUMNS - 2));
        let (fr, fc) = (row - r as f32, column - c as f32);
        let value = |r: usize, c: usize| self.table[r * LOBE_COLUMNS + c];
        let low = value(r, c) * (1.0 - fc) + value(r, c + 1) * fc;
        let high = value(r + 1, c) * (1.0 - fc) + value(r + 1, c + 1) * fc;
        low * (1.0 - fr) + high * fr
    }
}

impl LobeAlbedo {
    /// Mean of I_n(θ) over a uniform hemisphere of incident radiance, 2 ∫ I_n cosθ dcosθ.
    pub fn mean(&self, exponent: f32) -> f32 {
        let row = row_of(exponent);
        let (r, fraction) = (row as usize, row.fract());
        self.means[r] * (1.0 - fraction) + self.means[r + 1] * fraction
    }
}

/// Where an exponent is among the rows; below the last one.
fn row_of(exponent: f32) -> f32 {
    (2.0 * (exponent.max(0.0) + 1.0).log2()).min((LOBE_ROWS - 1) as f32 - 1e-3)
}

/// 2 ∫ I cosθ dcosθ of what is linear between the columns.
fn mean_of_row(row: &[f32]) -> f32 {
    let step = 1.0 / (LOBE_COLUMNS - 1) as f32;
    let column = |(k, pair): (usize, &[f32])| {
        // ∫ of the product of two lines.
        let (low, high) = (k as f32 * step, (k + 1) as f32 * step);
        step / 6.0 * (pair[0] * (2.0 * low + high) + pair[1] * (low + 2.0 * high))
    };
    2.0 * row.windows(2).enumerate().map(column).sum::<f32>()
}

/// I_n(θ) by quadrature in f64: the integral over the angle around the mirror direction in
/// closed form, the one over cosⁿ⁺¹α by the midpoint rule.
pub fn lobe_albedo(exponent: f64, cos_incidence: f64) -> f64 {
    lobe_over(&around_mirror(exponent), exponent, cos_incidence)
}

/// Cosine and sine of α at the midpoints of equal steps of cosⁿ⁺¹α.
fn around_mirror(exponent: f64) -> Vec<[f64; 2]> {
    const STEPS: u32 = 256;
    let angle = |step| {
        let cosine = ((f64::from(step) + 0.5) / f64::from(STEPS)).powf(1.0 / (exponent + 1.0));
        [cosine, (1.0 - cosine * cosine).max(0.0).sqrt()]
    };
    (0..STEPS).map(angle).collect()
}

fn lobe_over(around_mirror: &[[f64; 2]], exponent: f64, cos_incidence: f64) -> f64 {
    let cosine = cos_incidence.clamp(0.0, 1.0);
    let sine = (1.0 - cosine * cosine).sqrt();
    // ∫ max(0, a + b cosφ) dφ over the full circle.
    let circle = |[cos_alpha, sin_alpha]: &[f64; 2]| {
        let (a, b) = (cos_alpha * cosine, sin_alpha * sine);
        if a >= b { PI * 2.0 * a } else { 2.0 * (a * (-a / b).acos() + (b * b - a * a).sqrt()) }
    };
    let sum: f64 = around_mirror.iter().map(circle).sum();
    (exponent + 2.0) / (2.0 * PI) / (exponent + 1.0) * sum / around_mirror.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lobe_albedo_is_one_at_normal_incidence_and_falls() {
        for exponent in [1.0, 10.0, 28.0, 1e4] {
            assert!((lobe_albedo(exponent, 1.0) - 1.0).abs() < 2e-3, "n = {exponent}");
            assert!(lobe_albedo(exponent, 0.05) < lobe_albedo(exponent, 0.9));
        }
    }

    #[test]
    fn mean_is_that_over_the_hemisphere() {
        for exponent in [0.3, 20.0, 345.0] {
            let cosines = (0..400).map(|step| (f64::from(step) + 0.5) / 400.0);
            let exact = cosines.map(|c| lobe_albedo(exponent, c) * c).sum::<f64>() / 200.0;
            let table = LobeAlbedo::shared().mean(exponent as f32);
            assert!((exact as f32 - table).abs() < 0.01, "n {exponent}: {table} {exact}");
        }
    }

    #[test]
    fn table_follows_the_quadrature() {
        for exponent in [0.3, 3.7, 20.0, 28.0, 345.0, 5000.0] {
            for cosine in [0.02, 0.13, 0.4, 0.77, 0.99] {
                let exact = lobe_albedo(exponent, cosine) as f32;
                let table = LobeAlbedo::shared().at(exponent as f32, cosine as f32);
                assert!((exact - table).abs() < 0.01, "n {exponent} cos {cosine}: {table} {exact}");
            }
        }
    }

    #[test]
    fn importance_does_not_cancel() {
        assert!(importance(Rgb::new(1.0, -0.2972, 0.0)) > 0.4);
    }
}
