//! The laws that every model of reflection keeps, for the tests of the models.

use super::reflection::{Reflection, Scattered, direction_about};
use crate::radiometry::Rgb;
use crate::random::{Numbers, Stream};
use glam::Vec3;
use std::f32::consts::TAU;

/// What must hold of a reflection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// The mean factor of sampled directions is the albedo, where shading and geometric normals are
    /// the same, and no more than that elsewhere, even where the shading normal faces away.
    Furnace,
    /// The directional albedo's mean is the mean albedo.
    MeanAlbedo,
    /// The density's integral over the hemisphere is the share of picks that are above the horizon,
    /// so at most 1.
    PdfIntegral,
    /// What sampling says of a direction is what evaluation and density say of it.
    SamplePdf,
    /// Viewer and source may change places.
    Reciprocity,
}

impl Law {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Furnace, Self::MeanAlbedo, Self::PdfIntegral, Self::SamplePdf, Self::Reciprocity];
}

/// Sampled directions of each viewer.
const SAMPLES: u32 = 20_000;
/// Points of the hemisphere, in height and around, at which a density is added up.
const GRID: [u32; 2] = [300, 600];
/// What tabulated albedos may be off by ([`crate::radiometry::LobeAlbedo`]), and sums over the grid.
const TABLE: f32 = 0.01;
const SUM: f32 = 3e-3;
/// Standard errors that chance is allowed.
const CHANCE: f32 = 4.5;

/// The laws that a reflection breaks.
pub fn broken(reflection: &impl Reflection) -> Vec<Law> {
    broken_within(reflection, TABLE)
}

/// The same of one whose albedos may be off by `table`.
pub fn broken_within(reflection: &impl Reflection, table: f32) -> Vec<Law> {
    let side = reflection.side();
    let mut found = Vec::new();
    let mut check = |law, kept: bool| {
        if !kept && !found.contains(&law) {
            found.push(law);
        }
    };
    let mut numbers = Numbers::new(11, Stream::Path, 0);
    for cosine in [0.95, 0.6, 0.25] {
        let viewer = direction_about(side.normal, cosine, numbers.uniform());
        if side.shading_normal.dot(viewer) <= 0.0 {
            continue;
        }
        let sampled = sampled(reflection, viewer, &mut numbers);
        check(Law::SamplePdf, sampled.consistent);
        let integral = pdf_integral(reflection, viewer);
        let kept = (integral - sampled.above).abs() < SUM + CHANCE * sampled.above_error;
        check(Law::PdfIntegral, integral < 1.0 + SUM && kept);
        if side.normal == side.shading_normal {
            let off = (sampled.mean - reflection.albedo(viewer)).abs();
            check(Law::Furnace, off.cmple(sampled.error * CHANCE + table).all());
        }
        for _ in 0..1000 {
            let source = direction_about(side.normal, numbers.uniform(), numbers.uniform());
            let there = reflection.evaluate(viewer, source).both();
            let back = reflection.evaluate(source, viewer).both();
            check(Law::Reciprocity, (there - back).abs().cmple(1e-4 * there.max(back)).all());
        }
    }
    if side.normal != side.shading_normal {
        check(Law::Furnace, is_bounded_behind(reflection, &mut numbers));
    }
    let off = (mean_of_albedo(reflection) - reflection.mean_albedo()).abs();
    check(Law::MeanAlbedo, off.cmple(Rgb::splat(table)).all());
    found
}

/// Whether no more is sampled than the albedo says, for a viewer low above the surface where the
/// shading normal leans away from it.
fn is_bounded_behind(reflection: &impl Reflection, numbers: &mut Numbers) -> bool {
    let side = reflection.side();
    let away = -side.shading_normal.reject_from(side.normal).normalize();
    let viewer = (away + 0.1 * side.normal).normalize();
    let Sampled { mean, error, .. } = sampled(reflection, viewer, numbers);
    (mean - reflection.albedo(viewer)).cmple(error * CHANCE + TABLE).all()
}

/// What the sampled directions say together.
struct Sampled {
    /// Mean factor and its standard error.
    mean: Rgb,
    error: Rgb,
    /// Share of the picks that were above the horizon, and its standard error.
    above: f32,
    above_error: f32,
    /// Whether factors and densities are those of evaluation.
    consistent: bool,
}

fn sampled(reflection: &impl Reflection, viewer: Vec3, numbers: &mut Numbers) -> Sampled {
    let share = reflection.diffuse_share(viewer);
    let (mut sum, mut squares, mut above, mut consistent) = (Rgb::ZERO, Rgb::ZERO, 0.0, true);
    for _ in 0..SAMPLES {
        let diffusely = numbers.uniform() < share;
        let xi = [numbers.uniform(), numbers.uniform()];
        let scattered = reflection.sample(viewer, share, diffusely, xi);
        let Some(Scattered { direction, factor, pdf }) = scattered else { continue };
        let cosine = reflection.side().shading_normal.dot(direction);
        let value = reflection.evaluate(viewer, direction).times(Rgb::splat(cosine / pdf));
        consistent &= pdf == reflection.pdf(viewer, direction, share) && factor == value;
        sum += factor.both();
        squares += factor.both() * factor.both();
        above += 1.0;
    }
    let count = SAMPLES as f32;
    let (mean, above) = (sum / count, above / count);
    let variance = (squares / count - mean * mean).max(Rgb::ZERO) / count;
    let above_error = (above * (1.0 - above) / count).sqrt();
    Sampled { mean, error: variance.map(f32::sqrt), above, above_error, consistent }
}

/// ∫ pdf dω over the hemisphere of the geometric normal.
fn pdf_integral(reflection: &impl Reflection, viewer: Vec3) -> f32 {
    let share = reflection.diffuse_share(viewer);
    let normal = reflection.side().normal;
    let middle = |step: u32, steps: u32| (step as f32 + 0.5) / steps as f32;
    let of_height = |row: u32| {
        let around = (0..GRID[1]).map(|column| {
            let source = direction_about(normal, middle(row, GRID[0]), middle(column, GRID[1]));
            f64::from(reflection.pdf(viewer, source, share))
        });
        around.sum::<f64>()
    };
    let sum: f64 = (0..GRID[0]).map(of_height).sum();
    sum as f32 * TAU / (GRID[0] * GRID[1]) as f32
}

/// 2 ∫ albedo cosθ dcosθ, about the shading normal.
fn mean_of_albedo(reflection: &impl Reflection) -> Rgb {
    let steps = 200;
    let cosines = (0..steps).map(|step| (step as f32 + 0.5) / steps as f32);
    let normal = reflection.side().shading_normal;
    let of_cosine = |cosine| reflection.albedo(direction_about(normal, cosine, 0.0)) * cosine;
    cosines.map(of_cosine).sum::<Rgb>() * (2.0 / steps as f32)
}
