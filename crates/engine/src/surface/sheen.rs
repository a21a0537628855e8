//! Sheen, as KHR_materials_sheen has it: fibres that stand on a surface (Conty Estevez and Kulla 2017,
//! "Production friendly microfacet sheen BRDF"), whose normals are distributed as
//! D = (2 + 1/α) sin^(1/α)θ / 2π; what lies below is dimmed by 1 − E(v), E being the albedo of the fibres
//! and v the direction to the viewer, which is the simpler one of the extension's two formulas.

use super::angle_table::AngleTable;
use crate::radiometry::Rgb;
use crate::scene::{LEAST_SHEEN_ROUGHNESS, Layers};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Steps of the integral of an albedo, in height and around.
const STEPS: [usize; 2] = [64, 32];
/// Least cosine to the normal by which values are divided.
const LEAST_COSINE: f32 = 1e-3;

/// The fibres on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// Their colour.
    pub color: Rgb,
    /// How far they lean, roughness².
    alpha: f32,
}

impl Sheen {
    /// Of these layers.
    pub fn new(layers: &Layers) -> Self {
        let roughness = layers.sheen_roughness.clamp(LEAST_SHEEN_ROUGHNESS, 1.0);
        Self { color: layers.sheen_color.clamp(Rgb::ZERO, Rgb::ONE), alpha: roughness * roughness }
    }

    /// Whether there are any.
    pub fn is_there(&self) -> bool {
        self.color != Rgb::ZERO
    }

    /// Density of directions that are picked evenly over the hemisphere, 1/sr.
    pub const PDF: f32 = FRAC_1_PI / 2.0;

    /// f_r, 1/sr, for the cosines of viewer and source, above the horizon, and of the angle between
    /// normal and half vector.
    pub fn evaluate(&self, cosines: [f32; 2], half: f32) -> Rgb {
        self.color * white(self.alpha, cosines, half)
    }

    /// Albedo towards a viewer at an angle of that cosine.
    pub fn albedo(&self, cosine: f32) -> Rgb {
        if self.is_there() { self.color * white_albedo(self.alpha, cosine) } else { Rgb::ZERO }
    }

    /// What is left of light from below towards a viewer at an angle of that cosine.
    pub fn left(&self, cosine: f32) -> f32 {
        if !self.is_there() {
            return 1.0;
        }
        (1.0 - self.color.max_element() * white_albedo(self.alpha, cosine)).max(0.0)
    }
}

/// f_r of white fibres.
fn white(alpha: f32, [viewer, source]: [f32; 2], half: f32) -> f32 {
    let [viewer, source] = [viewer, source].map(|cosine| cosine.clamp(LEAST_COSINE, 1.0));
    let inverse = 1.0 / alpha;
    let sine_square = (1.0 - half * half).clamp(0.0, 1.0);
    let distribution = (2.0 + inverse) * sine_square.powf(0.5 * inverse) / TAU;
    let masking = 1.0 + lambda(alpha, viewer) + lambda(alpha, source);
    distribution / (masking * 4.0 * viewer * source)
}

/// The paper's fit of Smith's Λ.
fn lambda(alpha: f32, cosine: f32) -> f32 {
    if cosine < 0.5 {
        fit(alpha, cosine).exp()
    } else {
        (2.0 * fit(alpha, 0.5) - fit(alpha, 1.0 - cosine)).exp()
    }
}

/// The paper's fit of ln Λ below cosθ = ½.
fn fit(alpha: f32, cosine: f32) -> f32 {
    let share = (1.0 - alpha) * (1.0 - alpha);
    let mix = |at_one: f32, at_zero: f32| at_one + (at_zero - at_one) * share;
    let [a, b, c] = [mix(21.5473, 25.3245), mix(3.829_87, 3.324_35), mix(0.198_23, 0.168_01)];
    a / (1.0 + b * cosine.powf(c)) + mix(-1.9776, -1.273_93) * cosine + mix(-4.320_54, -4.859_67)
}

/// E of white fibres.
fn white_albedo(alpha: f32, cosine: f32) -> f32 {
    static TABLE: AngleTable<1> = AngleTable::new(integral);
    TABLE.at(alpha, cosine)[0]
}

/// ∫ f_r cosθ dω of white fibres, by the midpoint rule.
fn integral(alpha: f32, cosine: f32) -> [f32; 1] {
    let alpha = alpha.max(LEAST_SHEEN_ROUGHNESS * LEAST_SHEEN_ROUGHNESS);
    let viewer = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let mut sum = 0.0;
    for row in 0..STEPS[0] {
        // Steps that are finer towards the horizon.
        let root = (row as f32 + 0.5) / STEPS[0] as f32;
        let height = root * root;
        let across = (1.0 - height * height).max(0.0).sqrt();
        for column in 0..STEPS[1] {
            let (sin, cos) = (PI * (column as f32 + 0.5) / STEPS[1] as f32).sin_cos();
            let half = viewer + Vec3::new(across * cos, across * sin, height);
            let half = half.normalize_or(Vec3::Z).z;
            sum += white(alpha, [cosine, height], half) * height * 2.0 * root;
        }
    }
    [sum * TAU / (STEPS[0] * STEPS[1]) as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheen(roughness: f32) -> Sheen {
        let layers = Layers { sheen_color: Rgb::ONE, sheen_roughness: roughness, ..Layers::NONE };
        Sheen::new(&layers)
    }

    /// The extension's own listing at one place, in double precision.
    #[test]
    fn values_are_those_of_the_extension() {
        let (alpha, viewer, source, half) = (0.36f64, 0.3f64, 0.8f64, 0.6f64);
        let share = (1.0 - alpha).powi(2);
        let l = |x: f64| {
            let mix = |x: f64, y: f64| x * (1.0 - share) + y * share;
            let [a, b] = [mix(21.5473, 25.3245), mix(3.82987, 3.32435)];
            let [c, d, e] =
                [mix(0.19823, 0.16801), mix(-1.97760, -1.27393), mix(-4.32054, -4.85967)];
            a / (1.0 + b * x.powf(c)) + d * x + e
        };
        let masking = 1.0 + l(viewer).exp() + (2.0 * l(0.5) - l(1.0 - source)).exp();
        let distribution =
            (2.0 + 1.0 / alpha) * (1.0 - half * half).powf(0.5 / alpha) / std::f64::consts::TAU;
        let expected = distribution / (masking * 4.0 * viewer * source);
        let found = sheen(0.6).evaluate([viewer as f32, source as f32], half as f32).x;
        assert!((f64::from(found) / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    }

    /// Albedos at a few places, by the midpoint rule in double precision elsewhere.
    #[test]
    fn albedos_are_those_of_the_integral() {
        for (roughness, cosine, expected) in [
            (0.25, 0.25, 0.2443),
            (0.4, 0.1, 0.5432),
            (0.5, 0.5, 0.1879),
            (0.75, 0.25, 0.4816),
            (1.0, 1.0, 0.1638),
        ] {
            let found = sheen(roughness).albedo(cosine).x;
            assert!((found - expected).abs() < 0.01, "{roughness} {cosine}: {found}, {expected}");
        }
    }
}
