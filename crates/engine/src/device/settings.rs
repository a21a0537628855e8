//! How shots are made: every switch of stochastic hemicube iteration (Antal §2.2 to §2.6).

use super::viewpoint::Viewpoint;
use crate::patches::PatchedScene;
use crate::radiometry::{Rgb, importance};
use std::f32::consts::PI;
use std::sync::Arc;

/// How shots are made.
#[derive(Clone, Debug, PartialEq)]
pub struct ShootingSettings {
    /// Hemicube resolution R: the top has R × R pixels, each side R × R/2. Even, ≥ 8.
    pub resolution: u32,
    /// Shots per iteration K ≥ 1.
    pub shots_per_iteration: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How shooters are picked.
    pub selection: Selection,
    /// Pick the K shooters of an iteration by systematic sampling; otherwise independently.
    pub stratified: bool,
    /// Shoot from a uniform random point of the patch; otherwise from its centroid, which is
    /// biased.
    pub random_point: bool,
    /// Turn each hemicube by a random azimuth.
    pub random_azimuth: bool,
    /// Move each hemicube's rays by a random sub-pixel offset.
    pub jitter: bool,
    /// Which faces of a hemicube are shot through.
    pub faces: Faces,
    /// What to do about transfers that are too seldom and too strong.
    pub variance_reduction: Option<VarianceReduction>,
    /// The part of the light that is known beforehand; the iteration carries the rest.
    pub known: Option<Arc<KnownLight>>,
    /// The viewer, where glossy reflection towards it is to be averaged.
    pub viewpoint: Option<Viewpoint>,
}

impl Default for ShootingSettings {
    /// Everything unbiased; nothing known, no viewer.
    fn default() -> Self {
        Self {
            resolution: 256,
            shots_per_iteration: 8,
            seed: 0,
            selection: Selection::Power,
            stratified: true,
            random_point: true,
            random_azimuth: true,
            jitter: true,
            faces: Faces::All,
            variance_reduction: None,
            known: None,
            viewpoint: None,
        }
    }
}

/// With which probability p_j patch j shoots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// In proportion to the power that it would shoot (Antal §2.4).
    Power,
    /// The same for all.
    Uniform,
}

/// Which faces of a hemicube are shot through (Antal §2.3, §2.4). Whatever is left out is made up
/// for by the weight of what is not, so every choice has the same expectation.
///
/// A shooter is *highly specular* where its lobe carries more power than it emits and reflects
/// diffusely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Faces {
    /// All five.
    All,
    /// Of a highly specular shooter one: the face that the mirror direction hits with probability
    /// .6, each other with .1. All five of any other shooter.
    Specular,
    /// The top, and one of the four sides.
    TopAndSide,
    /// The paper's rule: one face of a highly specular shooter, the top and one side of any other.
    Randomised,
}

/// Probability of the face that the mirror direction hits, of a highly specular shooter.
pub const MIRROR_FACE_PROBABILITY: f32 = 0.6;
/// Probability of each other face.
pub const OTHER_FACE_PROBABILITY: f32 = 0.1;

/// Trades noise for bias (Antal §2.5, eq. 9): where p_j < F_{Ai→Aj}/(2M), patch j is so seldom
/// picked, and then shoots so much into patch i, that its transfer does more harm than good. With
/// F_{Ai→Aj} = min(1, A_j F_{y→Ai}/A_i); the paper mixes up the two form factors, which differ by
/// the ratio of the areas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VarianceReduction {
    /// What to put in place of such a transfer.
    pub substitute: Substitute,
    /// M, the shots of the whole run; `None` where that is not known beforehand: then the shots
    /// so far, so that the bias vanishes as the run goes on.
    pub shots: Option<u64>,
}

/// What stands in for a transfer that is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Substitute {
    /// Nothing.
    Zero,
    /// Its expectation over the choice of shooters: the transfer without the division by p_j.
    Mean,
}

/// A part K of the radiance that is known, per patch and the same in all directions. With
/// L = K + ΔL the iteration solves ΔL = L^e − K + kd·E_K/π + T_d ΔL + T_s L: lobes reflect the
/// whole radiance, so K may be anything and nothing has to be known about its glossy reflection.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownLight {
    /// K, W/(m²·sr), of every patch.
    pub radiance: Vec<Rgb>,
    /// E_K, the irradiance that K causes on every patch, W/m².
    pub irradiance: Vec<Rgb>,
}

/// Radiance that each patch sends by itself: L^e, or L^e − K + kd·E_K/π with a known part K.
pub fn sources(scene: &PatchedScene, settings: &ShootingSettings) -> Vec<Rgb> {
    let patches = &scene.patches;
    let Some(known) = &settings.known else { return patches.emission.clone() };
    (0..patches.len())
        .map(|i| {
            let reflected = patches.diffuse[i] * known.irradiance[i] / PI;
            patches.emission[i] - known.radiance[i] + reflected
        })
        .collect()
}

/// Importance of the known light that glossy receivers reflect, per patch that sends it: its
/// power times the scene's mean specular albedo. Added to the power by which shooters are picked,
/// it lets patches shoot whose ΔL is zero. Empty where nothing is known or glossy.
pub fn known_power(scene: &PatchedScene, settings: &ShootingSettings) -> Vec<f32> {
    let patches = &scene.patches;
    let area: f64 = patches.area.iter().map(|area| f64::from(*area)).sum();
    let specular = patches.area.iter().zip(&patches.specular);
    let specular: f64 =
        specular.map(|(area, specular)| f64::from(area * importance(*specular))).sum();
    match &settings.known {
        Some(known) if specular > 0.0 => {
            let share = (specular / area) as f32;
            let power = patches.area.iter().zip(&known.radiance);
            power.map(|(area, radiance)| share * importance(PI * area * radiance)).collect()
        }
        _ => Vec::new(),
    }
}
