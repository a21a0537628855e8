//! Sub-pixel samples and patches of a picture, by the job's limits: quick jobs get fewer.

use crate::render::{Limits, RenderRequest};

/// How much a job computes, by its limits.
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
    /// Most patches, whatever the limits.
    pub const MOST_PATCHES: usize = 120_000;

    /// By the limits of a request and the size of its picture.
    pub fn new(request: &RenderRequest) -> Self {
        let Limits { seconds, iterations, target_error, .. } = request.limits.to_plan_by();
        let (asked, error) = (seconds.unwrap_or(f64::INFINITY), target_error.unwrap_or(0.0));
        let hasty = asked < 0.25 || error >= 0.045;
        let (seconds, error) = (seconds.unwrap_or(0.0), target_error.unwrap_or(1.0));
        let iterations = iterations.unwrap_or(0);
        let (samples, patches) = if hasty {
            (8, 5000)
        } else if seconds >= 120.0 || error <= 0.003 || iterations >= 256 {
            (64, Self::MOST_PATCHES)
        } else if seconds >= 30.0 || error <= 0.006 || iterations >= 64 {
            (64, 60_000)
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

#[cfg(test)]
mod tests {
    use super::*;

    use std::sync::Arc;

    fn effort(limits: Limits, side: u32) -> Effort {
        Effort::new(&RenderRequest {
            limits,
            seed: 0,
            ..RenderRequest::new(Arc::default(), "hemilux", [side; 2])
        })
    }

    #[test]
    fn whoever_asks_for_more_gets_no_less() {
        let seconds = [0.1, 0.5, 1.5, 3.0, 10.0, 60.0, 600.0];
        let by_time = seconds.map(Limits::seconds);
        let errors = [0.1, 0.03, 0.02, 0.01, 0.005, 0.002];
        let by_error = errors.map(|e| Limits { target_error: Some(e), ..Limits::default() });
        for limits in [&by_time[..], &by_error[..]] {
            for side in [100, 300, 1000] {
                let efforts: Vec<Effort> = limits.iter().map(|l| effort(*l, side)).collect();
                assert!(efforts.is_sorted_by_key(|effort| effort.patches), "{side}");
                assert!(efforts.is_sorted_by_key(|effort| effort.samples), "{side}");
                assert!(efforts[0].hasty && !efforts[efforts.len() - 1].hasty);
            }
        }
    }

    #[test]
    fn what_the_server_allows_changes_nothing() {
        let asked = Limits::seconds(3.0);
        let (free, capped) =
            (effort(asked, 500), effort(Limits { cap_seconds: Some(0.1), ..asked }, 500));
        assert_eq!((free.samples, free.patches, free.hasty), (64, 16_000, false));
        assert_eq!((capped.samples, capped.patches, capped.hasty), (64, 16_000, false));
    }
}
