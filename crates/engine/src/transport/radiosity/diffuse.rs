//! What the radiosity methods share: the scene without its lobes, hemicubes on patches, and the
//! irradiance that they cause.

use crate::device::{Device, ShootingSettings};
use crate::hemicube::Shot;
use crate::measurement::Solution;
use crate::patches::{PatchIndex, PatchedScene};
use crate::radiometry::{Rgb, importance};
use crate::random::{Stream, uniform};
use crate::render::RenderError;
use crate::sampling::frame;
use crate::scene::{Material, Scene, Warning};
use crate::transport::job::Job;
use crate::transport::options::MeshSettings;
use crate::transport::settled;
use crate::transport::solver::Solver;
use glam::Vec2;
use std::f32::consts::{GOLDEN_RATIO, PI, TAU};
use std::ops::ControlFlow;
use std::sync::Arc;

/// The scene in patches, and what they do before any of them has shot.
pub struct Lit {
    /// The scene.
    pub scene: Arc<PatchedScene>,
    /// Irradiance E⁰ of every patch by light that no patch sends.
    pub irradiance: Vec<Rgb>,
    /// Radiance that every patch has to shoot at first: what it emits and what it reflects of that
    /// light, L^e + ρ E⁰/π.
    pub source: Vec<Rgb>,
}

/// Cuts, announces and lights the scene as a method shows it that knows diffuse reflection only.
/// Breaks with what [`crate::transport::Method::begin`] is to return where there is nothing to be
/// shot.
pub fn cut_diffuse<'a>(
    job: &mut Job<'_>,
    device: &dyn Device,
) -> Result<ControlFlow<Option<Box<dyn Solver + 'a>>, Lit>, RenderError> {
    let (scene, warnings) = diffuse_scene(&job.request.scene);
    let patches = MeshSettings::new(&job.settings).patches;
    let scene = job.cut(scene, patches, device.description().to_string(), |_| warnings);
    Ok(settled::begin(job, &scene)?.map_continue(|found| Lit::new(scene, found)))
}

impl Lit {
    fn new(scene: Arc<PatchedScene>, found: Option<Vec<Rgb>>) -> Self {
        let patches = &scene.patches;
        let mut source = patches.emission.clone();
        if let Some(found) = &found {
            for ((source, albedo), found) in source.iter_mut().zip(&patches.diffuse).zip(found) {
                *source += *albedo * *found / PI;
            }
        }
        let irradiance = found.unwrap_or_else(|| vec![Rgb::ZERO; patches.len()]);
        Self { scene, irradiance, source }
    }
}

/// The scene with every glossy material made Lambertian in its base colour, and a warning for
/// each.
fn diffuse_scene(scene: &Arc<Scene>) -> (Arc<Scene>, Vec<Warning>) {
    let glossy =
        |material: &Material| material.reflectance(&material.appearance(Rgb::ONE)).is_glossy();
    if !scene.materials.iter().any(glossy) {
        return (scene.clone(), Vec::new());
    }
    let mut warnings = Vec::new();
    let mut diffuse = Scene::clone(scene);
    for (index, material) in diffuse.materials.iter_mut().enumerate() {
        if glossy(material) {
            let name = &material.name;
            warnings.push(Warning::new(
                format!("materials[{index}]"),
                format!("{name:?} is glossy; this method shows it as diffuse in its base colour"),
            ));
            (material.metallic, material.specular_factor) = (0.0, 0.0);
        }
    }
    (Arc::new(diffuse), warnings)
}

/// A point for a hemicube on a patch.
pub enum Point {
    /// The centroid, without azimuth or jitter.
    Centroid,
    /// The given number of a sequence that is well spread over the patch, shifted by the seed.
    Spread(u64),
    /// Uniformly random with random azimuth and jitter, by the number of the shot.
    Random(u64),
}

/// A hemicube that stands on a patch and sends unit radiance.
pub fn shot_from(
    scene: &PatchedScene,
    settings: &ShootingSettings,
    patch: usize,
    point: &Point,
) -> Shot {
    let normal = scene.patches.normal[patch];
    let draw = |stream, counter| uniform(settings.seed, stream, counter);
    let (position, azimuth, jitter) = match point {
        Point::Centroid => (scene.patches.centroid[patch], 0.0, Vec2::ZERO),
        Point::Spread(number) => {
            let shift = Vec2::new(draw(Stream::PointU, 0), draw(Stream::PointV, 0));
            // The additive recurrence of the plastic number.
            let xi = (shift + Vec2::new(0.754_877_7, 0.569_840_3) * *number as f32).fract();
            let turn = (*number as f32 * GOLDEN_RATIO).fract();
            (scene.point_on_patch(PatchIndex(patch as u32), xi), TAU * turn, Vec2::ZERO)
        }
        Point::Random(counter) => {
            let xi = Vec2::new(draw(Stream::PointU, *counter), draw(Stream::PointV, *counter));
            let jitter =
                Vec2::new(draw(Stream::JitterX, *counter), draw(Stream::JitterY, *counter)) - 0.5;
            let azimuth = TAU * draw(Stream::Azimuth, *counter);
            (scene.point_on_patch(PatchIndex(patch as u32), xi), azimuth, jitter)
        }
    };
    let (tangent, bitangent) = frame(normal, azimuth);
    Shot { patch: patch as u32, position, tangent, bitangent, normal, jitter, ..Shot::default() }
}

/// Adds the irradiance that a patch's radiance causes by its form factors Σ ΔF:
/// E_i += π·L_j·A_j/A_i·ΣΔF_i.
pub fn add_irradiance(
    scene: &PatchedScene,
    irradiance: &mut [Rgb],
    patch: usize,
    radiance: Rgb,
    form_factors: &[f32],
) {
    let areas = &scene.patches.area;
    let power = radiance * (PI * areas[patch]);
    for ((total, form_factor), area) in irradiance.iter_mut().zip(form_factors).zip(areas) {
        if *form_factor > 0.0 {
            *total += power * (form_factor / area);
        }
    }
}

/// Importance of the power that a patch of this radiance sends.
pub fn power(scene: &PatchedScene, patch: usize, radiance: Rgb) -> f32 {
    importance(PI * scene.patches.area[patch] * radiance)
}

/// Importance of the power that all patches of these radiances send.
pub fn total_power(scene: &PatchedScene, radiance: &[Rgb]) -> f64 {
    radiance.iter().enumerate().map(|(i, l)| f64::from(power(scene, i, *l))).sum()
}

/// The solution of this irradiance.
pub fn solution(irradiance: &[Rgb]) -> Solution {
    Solution { irradiance: irradiance.to_vec(), glossy: Vec::new() }
}
