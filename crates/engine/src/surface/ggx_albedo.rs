//! What microfacets reflect altogether, tabulated at first use: the lobe of [`super::ggx`] has no
//! closed form for it.
//!
//! With Schlick's term the lobe's albedo is F0·N + F90·G, where N and G are the integrals of
//! D·V·cosθ with 1 − (1 − v·h)⁵ and with (1 − v·h)⁵ (Karis 2013, "Real shading in Unreal Engine 4").
//! They depend on roughness and the viewer's angle alone; the diffuse part's loss on the angle.

use super::distribution::{density_of_visible, distribution_and_visibility, visible_normal};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::OnceLock;

/// Rows of the table, by roughness √α from 0 to 1 in equal steps.
const ROWS: usize = 48;
/// Columns, by √cosθ from 0 to 1 in equal steps: the albedo changes fastest at grazing angles.
const COLUMNS: usize = 48;
/// Samples of each entry in either direction.
const SAMPLES: usize = 24;
/// Steps of the integral over cosθ of a mean.
const MEAN_STEPS: usize = 256;

/// What a lobe reflects of white light from all around, by the two terms of Schlick's formula.
#[derive(Clone, Copy, Debug, Default)]
pub struct LobeShares {
    /// Factor of F0.
    pub normal: f32,
    /// Factor of F90.
    pub grazing: f32,
}

struct Tables {
    /// Row by row.
    lobes: Vec<LobeShares>,
    /// Means over the hemisphere, a row each.
    means: Vec<LobeShares>,
    /// ∫ (1 − v·h)⁵ cosθ/π dω by column.
    losses: Vec<f32>,
    mean_loss: f32,
}

impl LobeShares {
    /// Towards a viewer at an angle of that cosine, for microfacets of width `alpha`.
    pub fn at(alpha: f32, cosine: f32) -> Self {
        let (row, down) = place(alpha.sqrt(), ROWS);
        let (column, across) = place(cosine.max(0.0).sqrt(), COLUMNS);
        let lobes = &tables().lobes;
        let of_row = |row: usize| {
            let first = row * COLUMNS + column;
            lobes[first].lerp(lobes[first + 1], across)
        };
        of_row(row).lerp(of_row(row + 1), down)
    }

    /// The mean over the hemisphere, weighed by cosθ/π.
    pub fn mean(alpha: f32) -> Self {
        let (row, down) = place(alpha.sqrt(), ROWS);
        let means = &tables().means;
        means[row].lerp(means[row + 1], down)
    }

    fn lerp(self, other: Self, share: f32) -> Self {
        let mix = |a: f32, b: f32| a + (b - a) * share;
        Self { normal: mix(self.normal, other.normal), grazing: mix(self.grazing, other.grazing) }
    }
}

/// Mean of (1 − v·h)⁵ over sources that are picked by the cosine, for a viewer at an angle of that
/// cosine: the share of F90 − F0 that the diffuse part loses.
pub fn diffuse_loss(cosine: f32) -> f32 {
    let (column, across) = place(cosine.max(0.0).sqrt(), COLUMNS);
    let losses = &tables().losses;
    losses[column] + (losses[column + 1] - losses[column]) * across
}

/// The mean of [`diffuse_loss`] over the hemisphere, weighed by cosθ/π.
pub fn mean_diffuse_loss() -> f32 {
    tables().mean_loss
}

/// Where a number in [0, 1] lies between the entries of a table with so many.
fn place(at: f32, count: usize) -> (usize, f32) {
    let at = at.clamp(0.0, 1.0) * (count - 1) as f32;
    let first = (at as usize).min(count - 2);
    (first, at - first as f32)
}

fn tables() -> &'static Tables {
    static TABLES: OnceLock<Tables> = OnceLock::new();
    TABLES.get_or_init(|| {
        let number = |index: usize, count: usize| index as f32 / (count - 1) as f32;
        let entry = |index: usize| {
            let roughness = number(index / COLUMNS, ROWS);
            lobe_shares((roughness * roughness).max(1e-3), cosine_of(index % COLUMNS))
        };
        let lobes: Vec<LobeShares> =
            (0..ROWS * COLUMNS).into_par_iter().with_min_len(64).map(entry).collect();
        let means = lobes.chunks(COLUMNS).map(mean_of_row).collect();
        let losses: Vec<f32> = (0..COLUMNS).map(|column| loss(cosine_of(column))).collect();
        let rows: Vec<LobeShares> =
            losses.iter().map(|loss| LobeShares { normal: *loss, grazing: 0.0 }).collect();
        let mean_loss = mean_of_row(&rows).normal;
        Tables { lobes, means, losses, mean_loss }
    })
}

/// Cosine of a column; the first one stands for the limit at grazing angles.
fn cosine_of(column: usize) -> f32 {
    (column as f32 / (COLUMNS - 1) as f32).powi(2).max(1e-4)
}

/// 2 ∫ f(cosθ) cosθ dcosθ of what is linear between the columns.
fn mean_of_row(row: &[LobeShares]) -> LobeShares {
    let mut sum = LobeShares::default();
    for step in 0..MEAN_STEPS {
        let cosine = (step as f32 + 0.5) / MEAN_STEPS as f32;
        let (column, across) = place(cosine.sqrt(), COLUMNS);
        let here = row[column].lerp(row[column + 1], across);
        let weight = 2.0 * cosine / MEAN_STEPS as f32;
        sum.normal += here.normal * weight;
        sum.grazing += here.grazing * weight;
    }
    sum
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
fn lobe_shares(alpha: f32, cosine: f32) -> LobeShares {
    let viewer = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let mut sum = LobeShares::default();
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
        let grazing = (1.0 - viewer.dot(half).clamp(0.0, 1.0)).powi(5);
        sum.normal += value * (1.0 - grazing);
        sum.grazing += value * grazing;
    }
    let count = (SAMPLES * SAMPLES) as f32;
    LobeShares { normal: sum.normal / count, grazing: sum.grazing / count }
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
