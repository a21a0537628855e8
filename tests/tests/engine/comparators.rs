//! Every comparator of the tests fails on a planted error.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_tests::comparison::{largest_relative_deviation, mean_ratio, relative_rmse};
use hemilux_tests::oracle::rays::Generator;
use hemilux_tests::oracle::statistics::Scores;
use hemilux_tests::replicas::Replicas;

#[test]
fn one_patch_off_is_found() {
    let mut values = vec![2.0; 50];
    assert!(largest_relative_deviation(&values, 2.0) < 1e-12);
    values[37] *= 1.011;
    assert!(largest_relative_deviation(&values, 2.0) > 0.01);
}

#[test]
fn noise_and_a_global_factor_are_found() {
    let reference = Picture::new(8, 4, vec![Rgb::new(1.0, 2.0, 3.0); 32]);
    let all = |_| true;
    assert_eq!(relative_rmse(&reference, &reference, all), 0.0);
    let mut off = reference.clone();
    off.pixels[5] += Rgb::X * 2.0;
    let expected = (4.0f64 / 96.0).sqrt() / 2.0;
    assert!((relative_rmse(&off, &reference, all) - expected).abs() < 1e-9);
    assert_eq!(relative_rmse(&off, &reference, |index| index != 5), 0.0);
    let brighter = Picture {
        pixels: reference.pixels.iter().map(|p| *p * 1.03).collect(),
        ..reference.clone()
    };
    assert!((mean_ratio(&brighter, &reference, all) - 1.03).abs() < 1e-6);
}

/// Pictures of radiance 2 with uniform noise of the given relative standard deviation, but for
/// the pixels that `change` brightens.
fn noisy(seed: u64, noise: f64, change: impl Fn(usize) -> f32) -> Replicas {
    let mut generator = Generator::new(seed);
    let pictures = (0..16).map(|_| {
        let mut value =
            || (2.0 * (1.0 + noise * 12f64.sqrt() * (generator.uniform() - 0.5))) as f32;
        let pixels =
            (0..40 * 40).map(|index| Rgb::from_array([0; 3].map(|_| value())) + change(index));
        Picture::new(40, 40, pixels.collect())
    });
    Replicas { pictures: pictures.collect() }
}

#[test]
fn a_wrong_block_and_a_wrong_mean_of_noisy_pictures_are_found() {
    let all = |_| true;
    let base = noisy(1, 0.5, |_| 0.0);
    let chance = |x: &Replicas, counted: &dyn Fn(usize) -> bool| {
        Scores::between(&x.blocks(5, counted), &base.blocks(5, counted)).is_chance()
    };
    assert!(chance(&noisy(2, 0.5, |_| 0.0), &all));
    // One block of 8 × 8 pixels is 10 % brighter.
    let block = |index: usize| index % 40 < 8 && index / 40 < 8;
    let wrong = noisy(3, 0.5, |index| if block(index) { 0.2 } else { 0.0 });
    assert!(!chance(&wrong, &all));
    assert!(chance(&wrong, &|index| !block(index)));
    // All are 2 % brighter: no block tells, the mean does.
    let brighter = noisy(4, 0.5, |_| 0.04);
    assert!(brighter.mean(all).z(&base.mean(all)) > 5.0);
    assert!(noisy(5, 0.5, |_| 0.0).mean(all).z(&base.mean(all)).abs() < 3.0);
}

#[test]
fn noise_is_told_from_what_all_pictures_share() {
    let pattern = |index: usize| if index.is_multiple_of(3) { 2.0 } else { -1.0 };
    let found = noisy(1, 0.2, pattern).noise(|_| true);
    assert!((found / 0.2 - 1.0).abs() < 0.03, "{found}");
    let louder = noisy(1, 0.3, pattern).noise(|_| true);
    assert!(louder / found > 1.4, "{louder}");
}
