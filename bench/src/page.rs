//! How figures are written on pages.

use hemilux_charts::statistics::Estimate;

/// [`hemilux_charts::regions::REGIONS`] in the words of a page.
pub const REGION_WORDS: [&str; 3] = ["all pixels", "near edges", "elsewhere"];

/// 12.3 %.
pub fn percent(value: f64) -> String {
    if value.is_nan() { "–".into() } else { format!("{:.1} %", 100.0 * value) }
}

/// 12.3 ± 0.4 %, or without the error where there is none.
pub fn percent_with(estimate: Estimate) -> String {
    let Estimate { value, error } = estimate;
    if error.is_nan() {
        return percent(value);
    }
    format!("{:.1} ± {:.1} %", 100.0 * value, 100.0 * error)
}

/// 1.23 ± 0.04, or without the error where there is none.
pub fn ratio(estimate: Estimate) -> String {
    let Estimate { value, error } = estimate;
    if error.is_nan() { format!("{value:.2}") } else { format!("{value:.2} ± {error:.2}") }
}
