//! Direct light of a place from many shadow rays: the light without occlusion, which is known
//! exactly, times the share of it that the rays see.

use crate::emitters::ShadowSample;
use crate::radiometry::{Rgb, importance};
use bytemuck::{Pod, Zeroable};

/// Sums over shadow rays, as in [`ShadowSample`]: `seen` is the part of `cast` that is not
/// occluded, `apart` what arrives beside it. Checkpoints store them as they are: the order of the fields is part of the format.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightSums {
    count: u32,
    unoccluded: Rgb,
    cast: Rgb,
    seen: Rgb,
    apart: Rgb,
}

impl LightSums {
    /// Adds what a shadow ray found.
    pub fn add(&mut self, sample: ShadowSample) {
        self.count += 1;
        self.unoccluded += sample.unoccluded;
        self.cast += sample.cast;
        self.seen += sample.cast * sample.visibility;
        self.apart += sample.apart;
    }

    /// Number of shadow rays.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Mean irradiance: that without occlusion times the share that is seen of what was cast, and
    /// what is apart from it.
    pub fn irradiance(&self) -> Rgb {
        let share = Rgb::select(self.cast.cmpgt(Rgb::ZERO), self.seen / self.cast, Rgb::ZERO);
        (self.unoccluded * share + self.apart) / self.count.max(1) as f32
    }

    /// Share of the light that is seen, by importance.
    pub fn share(&self) -> f32 {
        importance(self.seen) / importance(self.cast).max(f32::MIN_POSITIVE)
    }
}
