//! References made of two independent halves. Each half has noise of its own, so the product of the
//! differences from both is free of it, and small errors of pictures can be told from it.

use crate::comparison::{away_from_light, error_by_halves, mean_ratio};
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::image::Picture;
use hemilux_engine::render::{RenderRequest, Unobserved};
use hemilux_engine::transport::render;

/// Two pictures of one view that differ by their noise only.
pub struct Halves {
    /// The halves.
    pub pictures: [Picture; 2],
    /// By pixel, whether it counts: none that is near a light.
    pub counted: Vec<bool>,
}

impl Halves {
    /// Renders a request twice, with its seed and with the next. Pixels brighter than `light` see
    /// an emitter.
    ///
    /// # Panics
    /// Where the request cannot be rendered.
    pub fn traced(request: &RenderRequest, light: f32) -> Self {
        let mut device = CpuDevice::new(None).expect("threads");
        let mut half = |more| {
            let request = RenderRequest { seed: request.seed + more, ..request.clone() };
            render(&mut device, &request, &mut Unobserved).expect("the request is good").picture
        };
        let pictures = [half(0), half(1)];
        Self::new(pictures, light)
    }

    fn new(pictures: [Picture; 2], light: f32) -> Self {
        let near_no_light = away_from_light(&pictures[0], light);
        let counted = (0..pictures[0].pixels.len()).map(near_no_light).collect();
        Self { pictures, counted }
    }

    /// rRMSE of a picture of the same view.
    pub fn error(&self, picture: &Picture) -> f64 {
        let [a, b] = &self.pictures;
        error_by_halves(picture, a, b, |index| self.counted[index])
    }

    /// Mean of a picture over that of both halves.
    pub fn mean_ratio(&self, picture: &Picture) -> f64 {
        let inverse = |half| 1.0 / mean_ratio(picture, half, |index| self.counted[index]);
        2.0 / self.pictures.iter().map(inverse).sum::<f64>()
    }

    /// The same of pictures with sides a half as long.
    pub fn half_as_wide(&self, light: f32) -> Self {
        let pictures = self.pictures.each_ref().map(|full| {
            let mut small = Picture::black(full.width / 2, full.height / 2);
            for (index, pixel) in full.pixels.iter().enumerate() {
                let (x, y) = (index as u32 % full.width, index as u32 / full.width);
                small.pixels[(y / 2 * small.width + x / 2) as usize] += *pixel / 4.0;
            }
            small
        });
        Self::new(pictures, light)
    }

    /// rRMSE that either half has by its noise: from their difference.
    pub fn noise(&self) -> f64 {
        let [a, b] = &self.pictures;
        crate::comparison::relative_rmse(a, b, |index| self.counted[index]) / 2f64.sqrt()
    }
}
