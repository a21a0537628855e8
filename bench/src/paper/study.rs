//! What comes out.

use super::bench::Size;
use super::measure::Series;
use super::scenes::View;

/// Everything that was measured in one view.
pub(super) struct Study {
    pub(super) view: View,
    /// `plain` first, then the switches by group.
    pub(super) switches: Vec<Series>,
    /// `plain` once for every length of runs, with as many shots in total.
    pub(super) slope: Vec<Series>,
    pub(super) extras: Vec<Series>,
    /// The same for a single shot: seconds of preparing and showing.
    pub(super) starts: Vec<Series>,
    pub(super) reductions: Vec<Series>,
    pub(super) fixed: Vec<Series>,
    pub(super) printed: Vec<Series>,
}

/// The whole run, for the page.
pub(super) struct Results {
    pub(super) studies: Vec<Study>,
    pub(super) truth: Option<(View, Vec<Series>)>,
    pub(super) size: Size,
    pub(super) quick: bool,
    pub(super) device: String,
    pub(super) jobs: u64,
    pub(super) seconds: f64,
    /// Mean number of runnable threads of the machine at the end of each scene, where the system
    /// tells; beyond the number of hardware threads, others were working too.
    pub(super) loads: Vec<f64>,
}
