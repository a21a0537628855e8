//! Every comparator of the tests fails on a planted error.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_tests::comparison::{largest_relative_deviation, mean_ratio, relative_rmse};

#[test]
fn one_patch_off_is_found() {
    let mut values = vec![2.0; 50];
    assert!(largest_relative_deviation(&values, 2.0) < 1e-12);
    values[37] *= 1.011;
    assert!(largest_relative_deviation(&values, 2.0) > 0.01);
}

#[test]
fn noise_and_a_global_factor_are_found() {
    let reference = Picture { width: 8, height: 4, pixels: vec![Rgb::new(1.0, 2.0, 3.0); 32] };
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
