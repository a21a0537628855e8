//! What the stability suite asks of a device, and how it writes down what it saw.

use crate::devices::{Effort, Estimate, all, estimate};
use crate::oracle::statistics::Moments;
use hemilux_engine::device::{Device, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::render::{RenderRequest, Rendered, Unobserved};
use hemilux_engine::transport::render;
use std::cell::RefCell;
use std::sync::Arc;

/// Runs a row of the suite on every device; what it returns is printed as a row of
/// `docs/stability.md`.
pub fn on_every_device(row: &str, mut check: impl FnMut(&mut dyn Device) -> String) {
    thread_local! {
        // A test has a thread of its own, and opening a GPU takes longer than most rows.
        static DEVICES: RefCell<Vec<(&'static str, Box<dyn Device>)>> = RefCell::new(all());
    }
    DEVICES.with_borrow_mut(|devices| {
        for (name, device) in devices {
            let seen = check(device.as_mut());
            println!("| {row} | {name} | {seen} |");
        }
    });
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

/// Relative deviation of a value from what is expected.
///
/// # Panics
/// Where it is not below `tolerance`.
pub fn near(value: f64, expected: f64, tolerance: f64) -> f64 {
    let deviation = value / expected - 1.0;
    assert!(deviation.abs() < tolerance, "{value} instead of {expected}: {deviation:+.2e}");
    deviation
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_engine::device::cpu::CpuDevice;
    use hemilux_engine::scene::made;

    #[test]
    fn bounces_add_up_to_equilibrium() {
        let effort = |burn_in| Effort { burn_in, batches: 2, iterations: 2 };
        near(closed_room(3.0, 0.5, effort(60)), 6.0, 1e-12);
        // (1 + 1.5 + 1.75 + 1.875)/4 of the emitted power, and 1 + 2 + 3 + 4 without absorption.
        near(closed_room(1.0, 0.5, effort(0)), 6.125 / 4.0, 1e-12);
        near(closed_room(1.0, 1.0, effort(0)), 2.5, 1e-12);
    }

    #[test]
    fn power_of_the_wrong_albedo_or_emission_is_found() {
        let room = |albedo, emission| {
            let glb = made::furnace(Rgb::splat(albedo), Rgb::splat(emission));
            Arc::new(PatchedScene::new(crate::scenes::imported(&glb), 24))
        };
        let scene = room(0.5, 1.0);
        let mut device = CpuDevice::new(Some(1)).expect("threads");
        let settings = crate::scenes::settings(16, 4, 1);
        let mut deviation = |of: &Arc<PatchedScene>| {
            let estimate = solved(&mut device, of, &settings, SHORT);
            landed(of, &estimate, 0, |_| true) / closed_room(emitted(&scene, 0), 0.5, SHORT) - 1.0
        };
        assert!(deviation(&scene).abs() < 1e-3);
        assert!(deviation(&room(0.505, 1.0)).abs() > 5e-3);
        assert!(deviation(&room(0.5, 1.01)).abs() > 5e-3);
    }

    #[test]
    #[should_panic(expected = "instead of")]
    fn near_sees_what_is_not() {
        near(1.02, 1.0, 0.01);
    }

    #[test]
    #[should_panic(expected = "NaN")]
    fn near_sees_what_is_no_number() {
        near(f64::NAN, 1.0, 0.01);
    }

    #[test]
    #[should_panic(expected = "-1")]
    fn negative_irradiance_is_found() {
        checked_largest(&[Moments::exact(1.0), Moments::exact(-1.0)]);
    }

    #[test]
    #[should_panic(expected = "inf")]
    fn infinite_irradiance_is_found() {
        checked_largest(&[Moments::exact(f64::INFINITY)]);
    }
}
