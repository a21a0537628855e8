//! What microfacets reflect altogether, tabulated at first use: the lobe of [`super::ggx`] has no
//! closed form for it.
//!
//! With Schlick's term the lobe's albedo is F0·N + F90·G, where N and G are the integrals of
//! D·V·cosθ with 1 − (1 − v·h)⁵ and with (1 − v·h)⁵ (Karis 2013, "Real shading in Unreal Engine 4").
//! They depend on roughness and the viewer's angle alone; the diffuse part's loss on the angle.

use super::angle_table::{AngleRow, AngleTable};
use super::distribution::{density_of_visible, distribution_and_visibility, visible_normal};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;
use std::sync::OnceLock;

/// Samples of each entry in either direction.
const SAMPLES: usize = 24;

/// Both terms of [`LobeShares`].
static LOBES: AngleTable<2> = AngleTable::new(lobe_shares);

/// What a lobe reflects of white light from all around, by the two terms of Schlick's formula.
#[derive(Clone, Copy, Debug, Default)]
pub struct LobeShares {
    /// Factor of F0.
    pub normal: f32,
    /// Factor of F90.
    pub grazing: f32,
}

impl LobeShares {
    /// Towards a viewer at an angle of that cosine, for microfacets of width `alpha`.
    pub fn at(alpha: f32, cosine: f32) -> Self {
        let [normal, grazing] = LOBES.at(alpha, cosine);
        Self { normal, grazing }
    }

    /// The mean over the hemisphere, weighed by cosθ/π.
    pub fn mean(alpha: f32) -> Self {
        let [normal, grazing] = LOBES.mean(alpha);
        Self { normal, grazing }
    }
}

/// Mean of (1 − v·h)⁵ over sources that are picked by the cosine, for a viewer at an angle of that
/// cosine: the share of F90 − F0 that the diffuse part loses.
pub fn diffuse_loss(cosine: f32) -> f32 {
    losses().at(cosine)[0]
}

/// The mean of [`diffuse_loss`] over the hemisphere, weighed by cosθ/π.
pub fn mean_diffuse_loss() -> f32 {
    losses().mean()[0]
}

/// ∫ (1 − v·h)⁵ cosθ/π dω.
fn losses() -> &'static AngleRow<1> {
    static LOSSES: OnceLock<AngleRow<1>> = OnceLock::new();
    LOSSES.get_or_init(|| AngleRow::new(|cosine| [loss(cosine)]))
}

/// Points that fill the unit square evenly.
fn points() -> impl Iterator<Item = Vec2> {
    const CELLS: usize = SAMPLES * SAMPLES;
    // Rows of a rank-1 lattice (the golden ratio) are better spread than a grid.
    (0..CELLS).map(|k| {
        let along = (k as f64 + 0.5) / CELLS as f64;
        let across = (k as f64 * 0.618_033_988_749_894_9 + 0.25).fract();
        Vec2::new(along as f32, across as f32)
    })
}

/// By sampling the visible microfacets: what is left is V·D·cosθ over their density, of a factor
/// between 0 and 1.
fn lobe_shares(alpha: f32, cosine: f32) -> [f32; 2] {
    let viewer = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let [mut normal, mut grazing] = [0.0; 2];
    for at in points() {
        let half = visible_normal(alpha, viewer, at.to_array());
        let source = 2.0 * viewer.dot(half) * half - viewer;
        if source.z <= 0.0 {
            continue;
        }
        let sine_square = half.x * half.x + half.y * half.y;
        let [distribution, visibility] =
            distribution_and_visibility(alpha, [cosine, source.z], sine_square);
        let density = density_of_visible(alpha, cosine, distribution);
        let value = distribution * visibility * source.z / density;
        let share = (1.0 - viewer.dot(half).clamp(0.0, 1.0)).powi(5);
        normal += value * (1.0 - share);
        grazing += value * share;
    }
    [normal, grazing].map(|sum| sum / (SAMPLES * SAMPLES) as f32)
}

/// Mean of (1 − v·h)⁵ over sources by the cosine.
fn loss(cosine: f32) -> f32 {
    let viewer = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let of_point = |at: Vec2| {
        let (across, height) = (at.x.sqrt(), (1.0 - at.x).max(0.0).sqrt());
        let (sin, cos) = (TAU * at.y).sin_cos();
        let half = (viewer + Vec3::new(across * cos, across * sin, height)).normalize_or(Vec3::Z);
        (1.0 - viewer.dot(half).clamp(0.0, 1.0)).powi(5)
    };
    points().map(of_point).sum::<f32>() / (SAMPLES * SAMPLES) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Both integrals by the midpoint rule over the sources, in double precision.
    fn exact(alpha: f64, cosine: f64) -> [f64; 3] {
        const STEPS: [usize; 2] = [2000, 400];
        let viewer = glam::DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let square = alpha * alpha;
        let slant = |z: f64| (square + (1.0 - square) * z * z).sqrt();
        let mut sum = [0.0; 3];
        for row in 0..STEPS[0] {
            let z = (row as f64 + 0.5) / STEPS[0] as f64;
            for column in 0..STEPS[1] {
                let angle = 2.0 * PI * (column as f64 + 0.5) / STEPS[1] as f64;
                let across = (1.0 - z * z).sqrt();
                let source = glam::DVec3::new(across * angle.cos(), across * angle.sin(), z);
                let half = (viewer + source).normalize();
                let d = square / (PI * (half.z * half.z * (square - 1.0) + 1.0).powi(2));
                let visible = 0.5 / (z * slant(cosine) + cosine * slant(z));
                let grazing = (1.0 - viewer.dot(half)).powi(5);
                let weight = 2.0 * PI / (STEPS[0] * STEPS[1]) as f64;
                sum[0] += d * visible * z * (1.0 - grazing) * weight;
                sum[1] += d * visible * z * grazing * weight;
                sum[2] += grazing * z / PI * weight;
            }
        }
        sum
    }

    #[test]
    fn tables_follow_the_integrals() {
        for roughness in [0.42f32, 0.6, 0.83, 1.0] {
            for cosine in [0.07f32, 0.25, 0.52, 0.9] {
                let alpha = roughness * roughness;
                let [normal, grazing, loss] = exact(f64::from(alpha), f64::from(cosine));
                let found = LobeShares::at(alpha, cosine);
                for (found, exact) in
                    [(found.normal, normal), (found.grazing, grazing), (diffuse_loss(cosine), loss)]
                {
                    let off = (f64::from(found) - exact).abs();
                    assert!(off < 0.004, "{roughness} {cosine}: {found} {exact}");
                }
            }
        }
    }

    #[test]
    fn nothing_reflects_more_than_it_gets() {
        for row in 0..=20 {
            for column in 0..=20 {
                let shares = LobeShares::at(row as f32 / 20.0, column as f32 / 20.0);
                assert!(shares.normal >= 0.0 && shares.grazing >= 0.0);
                assert!(shares.normal + shares.grazing <= 1.001, "{shares:?}");
            }
        }
    }
}
