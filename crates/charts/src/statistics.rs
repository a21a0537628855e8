//! Means, spreads and fits of repeated measurements.

/// Mean; NaN of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Median; the mean of two middle values.
///
/// # Panics
/// Without values.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
    if low == high { low } else { 0.5 * (low + high) }
}

/// Standard deviation of a sample; 0 with fewer than two values.
pub fn deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let center = mean(values);
    let squares: f64 = values.iter().map(|value| (value - center).powi(2)).sum();
    (squares / (values.len() - 1) as f64).sqrt()
}

/// A value and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

/// Any statistic of `count` repetitions with its standard error by the jackknife: `statistic` is
/// computed from all repetitions and from each choice of all but one. The error is NaN with fewer
/// than two.
pub fn jackknife(count: usize, statistic: impl Fn(&[usize]) -> f64) -> Estimate {
    let all: Vec<usize> = (0..count).collect();
    let value = statistic(&all);
    if count < 2 {
        return Estimate { value, error: f64::NAN };
    }
    let partial: Vec<f64> = (0..count)
        .map(|left_out| {
            let rest: Vec<usize> = all.iter().copied().filter(|i| *i != left_out).collect();
            statistic(&rest)
        })
        .collect();
    let error = deviation(&partial) * ((count - 1) as f64 / (count as f64).sqrt());
    Estimate { value, error }
}

/// Slope of ln y over ln x by least squares; NaN with fewer than two different x or where a value
/// is not positive.
pub fn log_slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let center_x = mean(&logs.iter().map(|p| p.0).collect::<Vec<_>>());
    let center_y = mean(&logs.iter().map(|p| p.1).collect::<Vec<_>>());
    let covariance: f64 = logs.iter().map(|p| (p.0 - center_x) * (p.1 - center_y)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - center_x).powi(2)).sum();
    if variance > 0.0 { covariance / variance } else { f64::NAN }
}

/// [`log_slope`] through independent y with their standard errors.
pub fn log_slope_of(points: &[(f64, Estimate)]) -> Estimate {
    let values: Vec<(f64, f64)> = points.iter().map(|(x, y)| (*x, y.value)).collect();
    // The slope is linear in every ln y.
    let variance: f64 = (0..points.len())
        .map(|at| {
            let mut moved = values.clone();
            moved[at].1 *= std::f64::consts::E;
            let weight = log_slope(&moved) - log_slope(&values);
            (weight * points[at].1.error / points[at].1.value).powi(2)
        })
        .sum();
    Estimate { value: log_slope(&values), error: variance.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_found_and_a_wrong_one_is_not() {
        let falling: Vec<_> = [64.0, 256.0, 1024.0].map(|x: f64| (x, 3.0 * x.powf(-0.5))).into();
        assert!((log_slope(&falling) + 0.5).abs() < 1e-12);
        let stuck: Vec<_> = falling.iter().map(|(x, y)| (*x, y.hypot(0.3))).collect();
        assert!(log_slope(&stuck) > -0.3, "a bias of .3 must show: {}", log_slope(&stuck));
        assert!(log_slope(&[(1.0, 2.0)]).is_nan());
        assert!(log_slope(&[(1.0, 2.0), (2.0, -1.0)]).is_nan());
    }

    #[test]
    fn errors_of_a_slope_come_from_its_points() {
        let with = |relative: f64| {
            let y = |value: f64| Estimate { value, error: relative * value };
            log_slope_of(&[(1.0, y(1.0)), (4.0, y(0.5))])
        };
        // Two points: (ln y₂ − ln y₁)/ln 4, errors add in quadrature.
        let slope = with(0.1);
        assert!((slope.value + 0.5).abs() < 1e-12);
        assert!((slope.error - 0.1 * 2f64.sqrt() / 4f64.ln()).abs() < 1e-12);
        assert_eq!(with(0.0).error, 0.0);
    }

    #[test]
    fn jackknife_of_a_mean_is_its_standard_error() {
        let values = [3.0, 4.0, 8.0, 5.0];
        let pick = |chosen: &[usize]| mean(&chosen.iter().map(|i| values[*i]).collect::<Vec<_>>());
        let estimate = jackknife(values.len(), pick);
        assert_eq!(estimate.value, 5.0);
        assert!((estimate.error - deviation(&values) / 2.0).abs() < 1e-12);
        assert!(jackknife(1, |_| 1.0).error.is_nan());
    }

    #[test]
    fn medians_ignore_outliers() {
        assert_eq!(median(vec![1.0, 900.0, 2.0]), 2.0);
        assert_eq!(median(vec![9.0, 1.0, 2.0, 4.0]), 3.0);
    }
}
