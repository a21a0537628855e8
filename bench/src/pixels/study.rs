//! What is compared, and what comes out.

use crate::cell::Cell;

/// Cells of a jittered pixel, and most samples of an adaptive one in a pass.
pub(super) const CELLS: u64 = 16;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Size {
    /// Width and height of pictures, pixels.
    pub(super) side: u32,
    /// Seeds of every run.
    pub(super) seeds: u64,
    /// Samples of a pixel: the lengths of runs.
    pub(super) samples: &'static [u64],
    /// Samples of a pixel in each half of a reference: of paths, of direct light.
    pub(super) reference: [u64; 2],
}

pub(super) const FULL: Size =
    Size { side: 72, seeds: 4, samples: &[16, 32, 64, 128], reference: [512, 128] };
pub(super) const QUICK: Size =
    Size { side: 48, seeds: 2, samples: &[16, 64], reference: [256, 64] };

/// What a sample of a pixel is.
pub(super) struct Kind {
    pub(super) name: &'static str,
    pub(super) options: &'static [(&'static str, &'static str)],
}

pub(super) const KINDS: [Kind; 2] = [
    Kind { name: "paths", options: &[] },
    Kind { name: "direct", options: &[("ray_depth", "1"), ("rays_per_pixel", "16")] },
];

/// A way to sample pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampling {
    pub(super) name: &'static str,
    pub(super) options: &'static [(&'static str, &'static str)],
    /// Samples that a pass takes at most.
    pub(super) samples_of_pass: u64,
}

/// The first is what others are compared with.
pub(super) const SAMPLINGS: [Sampling; 6] = [
    Sampling {
        name: "independent",
        options: &[("pixel_sampling", "independent")],
        samples_of_pass: 1,
    },
    Sampling { name: "jittered", options: &[("pixel_sampling", "jittered")], samples_of_pass: 1 },
    Sampling {
        name: "adaptive",
        options: &[("pixel_sampling", "adaptive")],
        samples_of_pass: CELLS,
    },
    Sampling {
        name: "adaptive, contrast .1",
        options: &[("pixel_sampling", "adaptive"), ("adaptive_contrast", "0.1")],
        samples_of_pass: CELLS,
    },
    Sampling {
        name: "adaptive, contrast .7",
        options: &[("pixel_sampling", "adaptive"), ("adaptive_contrast", "0.7")],
        samples_of_pass: CELLS,
    },
    Sampling {
        name: "adaptive, fresh samples",
        options: &[("pixel_sampling", "adaptive_fresh")],
        samples_of_pass: CELLS,
    },
];

/// One way to sample pixels in one view, after increasing numbers of samples.
pub(super) struct Series {
    pub(super) sampling: Sampling,
    pub(super) cells: Vec<Cell>,
}

/// One kind of samples in one scene.
pub(super) struct Study {
    pub(super) scene: &'static str,
    pub(super) kind: usize,
    /// rRMSE of the reference's own mean.
    pub(super) reference_error: f64,
    pub(super) series: Vec<Series>,
}

/// The whole run.
pub(super) struct Results {
    pub(super) studies: Vec<Study>,
    pub(super) size: Size,
    pub(super) quick: bool,
    pub(super) device: String,
    pub(super) jobs: u64,
    pub(super) seconds: f64,
    pub(super) load: Option<f64>,
}
