//! Pages with generated parts: how figures are written, and where they go.

use crate::Failure;
use crate::statistics::Estimate;
use std::path::Path;

/// [`crate::regions::REGIONS`] in the words of a page.
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

/// Runnable threads, averaged over the last five minutes.
pub fn load() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().nth(1)?.parse().ok()
}

/// Makes the folder for results.
///
/// # Errors
/// Says which folder.
pub fn make_folder(path: &Path) -> Result<(), Failure> {
    let made = std::fs::create_dir_all(path);
    Ok(made.map_err(|error| format!("cannot make the folder {}: {error}", path.display()))?)
}

/// Whether a page is there to be rewritten: to be known before the minutes of measuring.
///
/// # Errors
/// Says what is wrong with it.
pub fn check(path: &Path) -> Result<(), Failure> {
    let found = std::fs::metadata(path);
    found.map_err(|error| format!("cannot rewrite {}: {error}", path.display()))?;
    Ok(())
}

/// Writes parts (name, Markdown) into a page, or to standard output without one.
///
/// # Errors
/// Where the page can't be read or written, or lacks a part's markers.
pub fn write(page: Option<&Path>, parts: &[(String, String)]) -> Result<(), Failure> {
    match page {
        Some(path) => rewrite(path, parts)?,
        None => parts.iter().for_each(|(name, text)| println!("{name}\n\n{text}\n")),
    }
    Ok(())
}

fn rewrite(path: &Path, parts: &[(String, String)]) -> Result<(), Failure> {
    let read = std::fs::read_to_string(path);
    let mut text = read.map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    for (name, content) in parts {
        text = crate::table::replace_generated(&text, name, content)
            .map_err(|error| format!("{}: {error}", path.display()))?;
    }
    std::fs::write(path, text)?;
    Ok(())
}
