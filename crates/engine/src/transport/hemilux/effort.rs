//! How much effort a picture is worth, by what was asked for.

use crate::render::{Limits, RenderRequest};

/// What is worth its time, by the limits.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Sub-pixel samples: more in small pictures, where more of the pixels see edges.
    pub samples: u32,
    /// Patches of the coarse mesh.
    pub patches: usize,
    /// Whether the first picture had better come soon than be good.
    pub hasty: bool,
}

impl Effort {
    /// By the limits of a request and the size of its picture.
    pub fn new(request: &RenderRequest) -> Self {
        let Limits { seconds, iterations, target_error, .. } = request.limits.to_plan_by();
        let (asked, error) = (seconds.unwrap_or(f64::INFINITY), target_error.unwrap_or(0.0));
        let hasty = asked < 0.25 || error >= 0.045;
        let (seconds, error) = (seconds.unwrap_or(0.0), target_error.unwrap_or(1.0));
        let iterations = iterations.unwrap_or(0);
        let (samples, patches) = if hasty {
            (8, 5000)
        } else if seconds >= 4.0 || error <= 0.015 || iterations >= 16 {
            (64, 30_000)
        } else if seconds >= 2.0 {
            (64, 16_000)
        } else if seconds >= 1.0 || error <= 0.025 || iterations >= 8 {
            (32, 16_000)
        } else {
            (16, 10_000)
        };
        let pixels = request.width * request.height;
        let least = if pixels < 1 << 16 {
            64
        } else if pixels < 1 << 17 {
            32
        } else {
            8
        };
        Self { samples: samples.max(least), patches, hasty }
    }
}
