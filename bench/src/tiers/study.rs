//! What all parts share.

use super::views;
use crate::real_view::squares_of;
use crate::results::Failure;
use hemilux_engine::device;
use std::path::PathBuf;

/// Width and height of pictures, pixels.
const SIDE: u32 = 200;

/// What all parts share.
pub(super) struct Study {
    pub(super) device: Box<dyn device::Device>,
    pub(super) out: PathBuf,
    pub(super) references: PathBuf,
    pub(super) reference_seconds: f64,
    pub(super) quick: bool,
    /// Names of the views that are looked at; none for all.
    pub(super) only: Vec<String>,
}

impl Study {
    /// A view's reference.
    pub(super) fn truth(&mut self, view: &views::View) -> Result<views::Truth, Failure> {
        view.truth(self.device.as_mut(), &self.references, (self.reference_seconds, 1))
    }

    /// About a thousand pixels of it, traced as long as all of it is.
    pub(super) fn sparse_truth(&mut self, view: &views::View) -> Result<views::Truth, Failure> {
        let how = (self.reference_seconds, squares_of(view.side));
        view.truth(self.device.as_mut(), &self.references, how)
    }

    /// The views that are looked at.
    pub(super) fn views(&self) -> Vec<views::View> {
        let mut all = views::all(SIDE);
        if self.quick {
            all.truncate(2);
        }
        all.retain(|view| self.only.is_empty() || self.only.contains(&view.name));
        all
    }
}
