//! What the stability suite asks of a device, and how it writes down what it saw.

use crate::devices::{Effort, Estimate, all, estimate};
use crate::oracle::statistics::Moments;
use hemilux_engine::device::{Device, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{RenderRequest, Rendered, Unobserved, render};
use std::sync::Arc;

/// Runs a row of the suite on every device; what it returns is printed as a row of
/// `docs/stability.md`.
pub fn on_every_device(row: &str, mut check: impl FnMut(&mut dyn Device) -> String) {
    for (name, mut device) in all() {
        let seen = check(device.as_mut());
        println!("| {row} | {name} | {seen} |");
    }
}

/// A short run: enough where all power that is shot has to land, or where bounds follow from the
/// scatter.
pub const SHORT: Effort = Effort { burn_in: 30, batches: 12, iterations: 12 };

/// Area-weighted sums over the patches that `counted` allows: Σ A E of one channel, W.
pub fn landed(
    scene: &PatchedScene,
    estimate: &Estimate,
    channel: usize,
    counted: impl Fn(usize) -> bool,
) -> f64 {
    let patches = (0..scene.patches.len()).filter(|patch| counted(*patch));
    let power = |i: usize| f64::from(scene.patches.area[i]) * estimate.channels[channel][i].mean();
    patches.map(power).sum()
}

/// Power that the patches emit in one channel, W.
pub fn emitted(scene: &PatchedScene, channel: usize) -> f64 {
    let patches = &scene.patches;
    let power =
        |i: usize| f64::from(patches.area[i]) * f64::from(patches.emission[i].to_array()[channel]);
    std::f64::consts::PI * (0..patches.len()).map(power).sum::<f64>()
}

/// Power that lands on average over the iterations of an estimate in a closed room whose surfaces
/// all reflect the share `albedo`: Φ(1 − a^m)/(1 − a) in iteration m, mΦ for a = 1. Where shooters
/// are picked by power, nothing of it is left to chance.
pub fn closed_room(emitted: f64, albedo: f64, effort: Effort) -> f64 {
    let last = effort.burn_in + effort.batches * effort.iterations;
    let (mut power, mut sum) = (0.0, 0.0);
    for iteration in 1..=last {
        power = emitted + albedo * power;
        if iteration > effort.burn_in {
            sum += power;
        }
    }
    sum / f64::from(last - effort.burn_in)
}

/// Largest of all values, for looking whether they are finite and not negative.
///
/// # Panics
/// Where one is not.
pub fn checked_largest(moments: &[Moments]) -> f64 {
    moments.iter().fold(0.0, |largest, moments| {
        let mean = moments.mean();
        assert!(mean.is_finite() && mean >= 0.0, "{mean}");
        largest.max(mean)
    })
}

/// [`estimate`] with patches that must all come out finite and not negative.
pub fn solved(
    device: &mut dyn Device,
    scene: &Arc<PatchedScene>,
    settings: &ShootingSettings,
    effort: Effort,
) -> Estimate {
    let estimate = estimate(device, scene, settings, effort);
    checked_largest(&estimate.sum);
    estimate
}

/// Renders a picture whose pixels must all be finite.
pub fn rendered(device: &mut dyn Device, request: &RenderRequest) -> Rendered {
    let rendered = render(device, request, &mut Unobserved).expect("the request is good");
    assert!(rendered.picture.pixels.iter().all(|pixel| pixel.is_finite()));
    rendered
}

/// Mean of all pixels of a picture.
pub fn mean_pixel(rendered: &Rendered) -> Rgb {
    let pixels = &rendered.picture.pixels;
    let sum: glam::DVec3 = pixels.iter().map(|pixel| pixel.as_dvec3()).sum();
    (sum / pixels.len() as f64).as_vec3()
}
