//! Light that is known before the iteration starts, because patches can't send it (sky, sun, lights
//! without extent) or so that the iteration has less to carry: the direct light of the emitters
//! ("first shot") and a constant radiance (Antal §2.6).

use crate::device::cpu::visible_share;
use crate::device::{Device, DeviceError, KnownLight, ShootingSettings};
use crate::hemicube::Shot;
use crate::patches::{PatchIndex, PatchedScene};
use crate::radiometry::{Rgb, importance};
use crate::random::{Stream, uniform};
use crate::sampling::frame;
use glam::Vec2;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// How the constant radiance L̄ is taken out of the solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConstantRadiance {
    /// Not at all.
    Off,
    /// As printed: source L^e + (a − 1) L̄. True in closed scenes only.
    Printed,
    /// For any scene: source L^e + (a·V_i − 1) L̄ with V_i = Σ_j F_ij, the share of what patch i
    /// sees that are patches.
    Corrected,
}

/// Hemicube resolution of the visible share; its error is that of a fraction of a pixel's row.
const VISIBILITY_RESOLUTION: u32 = 64;
/// Fewest and most first shots; in between, one for every emitting patch.
const FIRST_SHOTS: (usize, usize) = (256, 4096);
/// First shots that are traced together.
const TRACED_TOGETHER: usize = 16;
/// Scenes that absorb less of their light than this get a constant as if they absorbed it: any
/// constant is right, and without absorption there is no equilibrium.
const LEAST_ABSORPTION: f32 = 0.01;

/// What is to be known.
pub struct Beforehand {
    /// The constant radiance.
    pub constant: ConstantRadiance,
    /// Whether the emitters' direct light is to be found.
    pub first_shot: bool,
    /// Irradiance of every patch by light that no patch sends, if there is such light.
    pub patchless: Option<Vec<Rgb>>,
}

/// Finds the known part; `None` where nothing is asked for.
///
/// # Errors
/// Where the device fails.
pub fn known_light(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    beforehand: Beforehand,
) -> Result<Option<KnownLight>, DeviceError> {
    let Beforehand { constant, first_shot, patchless } = beforehand;
    if constant == ConstantRadiance::Off && !first_shot && patchless.is_none() {
        return Ok(None);
    }
    let patches = &scene.patches;
    // What the emitters do: they are known, and so is what they light directly.
    let mut known = if first_shot {
        KnownLight {
            radiance: patches.emission.clone(),
            irradiance: direct_light(device, scene, settings)?,
        }
    } else {
        let dark = vec![Rgb::ZERO; patches.len()];
        KnownLight { radiance: dark.clone(), irradiance: dark }
    };
    // Light that no patch sends is no part of the radiance, so only diffuse reflection knows of it.
    if let Some(patchless) = &patchless {
        known.irradiance.iter_mut().zip(patchless).for_each(|(sum, found)| *sum += *found);
    }
    // A constant on top, for what is left.
    if constant != ConstantRadiance::Off {
        let visible = match constant {
            ConstantRadiance::Corrected => visible_share(scene, VISIBILITY_RESOLUTION),
            _ => vec![1.0; patches.len()],
        };
        let left = |i: usize| match first_shot {
            true => albedo(scene, i) * known.irradiance[i] / PI,
            false => match &patchless {
                Some(found) => patches.emission[i] + albedo(scene, i) * found[i] / PI,
                None => patches.emission[i],
            },
        };
        let radiance = equilibrium(scene, left, &visible);
        for (i, visible) in visible.iter().enumerate() {
            known.radiance[i] += radiance;
            known.irradiance[i] += PI * visible * radiance;
        }
    }
    Ok(Some(known))
}

/// Albedo of a patch under uniform light.
pub(super) fn albedo(scene: &PatchedScene, patch: usize) -> Rgb {
    scene.patches.albedo[patch]
}

/// L̄, the radiance at which all patches together absorb what they send by themselves:
/// Σ A_j L_j / Σ A_j (1 − a_j V_j). With V = 1 this is the paper's L̄.
pub(super) fn equilibrium(
    scene: &PatchedScene,
    source: impl Fn(usize) -> Rgb,
    visible: &[f32],
) -> Rgb {
    let (mut sent, mut absorbed, mut total) = (glam::DVec3::ZERO, glam::DVec3::ZERO, 0f64);
    for (i, (area, visible)) in scene.patches.area.iter().zip(visible).enumerate() {
        let area = f64::from(*area);
        sent += source(i).as_dvec3() * area;
        absorbed += (Rgb::ONE - albedo(scene, i) * *visible).as_dvec3() * area;
        total += area;
    }
    (sent / absorbed.max(glam::DVec3::splat(total * f64::from(LEAST_ABSORPTION)))).as_vec3()
}

/// Irradiance that the emitters cause directly: shots by emitted power, picked systematically and
/// well spread over the patches. Its expectation over seeds is exact; within a job it is fixed.
fn direct_light(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
) -> Result<Vec<Rgb>, DeviceError> {
    let patches = &scene.patches;
    let shots = first_shots(scene, settings);
    let mut irradiance = vec![Rgb::ZERO; patches.len()];
    let mut shooting = device.begin(scene.clone(), settings)?;
    for some in shots.chunks(TRACED_TOGETHER) {
        for (shot, form_factors) in some.iter().zip(shooting.form_factors(some)?) {
            let power = shot.diffuse * (PI * shot.scale);
            for (i, form_factor) in form_factors.iter().enumerate() {
                irradiance[i] += power * (form_factor / patches.area[i]);
            }
        }
    }
    Ok(irradiance)
}

fn first_shots(scene: &PatchedScene, settings: &ShootingSettings) -> Vec<Shot> {
    let patches = &scene.patches;
    let power = |i: usize| f64::from(importance(PI * patches.area[i] * patches.emission[i]));
    let total: f64 = (0..patches.len()).map(power).sum();
    if total <= 0.0 || !total.is_finite() {
        return Vec::new();
    }
    let emitting: Vec<usize> = (0..patches.len()).filter(|i| power(*i) > 0.0).collect();
    let count = emitting.len().clamp(FIRST_SHOTS.0, FIRST_SHOTS.1);
    let draw = |stream, k: usize| uniform(settings.seed, stream, k as u64);
    let offset = f64::from(draw(Stream::FirstShot, 0));
    let shift = Vec2::new(draw(Stream::FirstShot, 1), draw(Stream::FirstShot, 2));
    let (mut at_emitter, mut before) = (0, 0.0);
    (0..count)
        .map(|k| {
            let at = (k as f64 + offset) / count as f64 * total;
            while before + power(emitting[at_emitter]) <= at && at_emitter + 1 < emitting.len() {
                before += power(emitting[at_emitter]);
                at_emitter += 1;
            }
            let i = emitting[at_emitter];
            // The additive recurrence of the plastic number spreads the points.
            let point = (shift + Vec2::new(0.754_877_7, 0.569_840_3) * k as f32).fract();
            let normal = patches.normal[i];
            let (tangent, bitangent) = frame(normal, TAU * draw(Stream::FirstShot, 3 + k));
            let probability = (power(i) / total) as f32;
            Shot {
                patch: i as u32,
                position: scene.point_on_patch(PatchIndex(i as u32), point),
                tangent,
                bitangent,
                normal,
                diffuse: patches.emission[i],
                probability,
                scale: patches.area[i] / (probability * count as f32),
                ..Shot::default()
            }
        })
        .collect()
}
