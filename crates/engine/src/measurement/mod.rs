//! The camera's picture from a solution on patches (Antal eq. 3): the surface that each sub-pixel
//! sample sees, interpolated irradiance there, and reflection with the scene's full-detail
//! textures.

mod camera;
mod pattern;
mod pixel_box;
pub mod reconstruction;
mod shading;

use crate::device::{Sums, Viewpoint};
use crate::hemicube::item;
use crate::image::Picture;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::raster::{Target, fill};
use crate::scene::{Background, Camera, Environment, Projection};
pub use camera::{Frame, View, ViewTriangle};
use glam::Vec2;
pub use pattern::{nth_of_pattern, sample_pattern};
pub use pixel_box::{BoxOffset, PixelBox};
use rayon::prelude::*;
use reconstruction::{Reconstruction, Smoothness};
use shading::{Band, ShadingInputs};
pub use shading::{PixelWeight, VertexWeights};
use std::sync::Arc;

/// Rows of pixels that are measured together, a parallel task.
const BAND: u32 = 32;

/// A solution on patches: averages over iterations, one entry a patch.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Mean irradiance E.
    pub irradiance: Vec<Rgb>,
    /// Mean lobe-weighted irradiance towards the viewer; empty without glossy patches.
    pub glossy: Vec<Rgb>,
}

impl Solution {
    /// No light on `patches` patches.
    pub fn dark(patches: usize) -> Self {
        Self { irradiance: vec![Rgb::ZERO; patches], glossy: Vec::new() }
    }

    /// The averages of sums; zero where nothing was summed.
    pub fn mean(sums: &Sums) -> Self {
        let count = sums.iterations.max(1) as f32;
        let mean = |values: &[Rgb]| values.iter().map(|v| *v / count).collect();
        Self { irradiance: mean(&sums.irradiance), glossy: mean(&sums.glossy) }
    }
}

/// A camera and everything about it that does not change while the solution gets better.
pub struct Measurement {
    scene: Arc<PatchedScene>,
    reconstruction: Reconstruction,
    view: View,
    /// Sub-pixel offsets, one a sample, in [−½, ½)².
    samples: Vec<Vec2>,
    /// What is seen where there is no surface.
    background: Background,
    environment: Arc<Environment>,
}

/// The direction towards a camera, for reflections that depend on it.
pub fn viewpoint(camera: &Camera) -> Viewpoint {
    match camera.projection {
        Projection::Perspective { .. } => Viewpoint::Eye(camera.to_world.w_axis.truncate()),
        Projection::Orthographic { .. } => {
            Viewpoint::Direction(camera.to_world.z_axis.truncate().normalize_or_zero())
        }
    }
}

impl Measurement {
    /// Prepares pictures of `width` × `height` pixels with `samples` sub-pixel samples each.
    pub fn new(
        scene: Arc<PatchedScene>,
        camera: &Camera,
        [width, height]: [u32; 2],
        samples: u32,
        smoothness: Smoothness,
    ) -> Self {
        let view = View::new(&scene, camera, width, height);
        let reconstruction = Reconstruction::new(&scene, smoothness);
        let samples = sample_pattern(samples.max(1));
        let (background, environment) = Default::default();
        Self { reconstruction, view, samples, scene, background, environment }
    }

    /// The same where samples that see no surface see `background`, which may be `environment`; with
    /// [`Measurement::new`] they see black.
    pub fn before(self, background: Background, environment: &Arc<Environment>) -> Self {
        Self { background, environment: environment.clone(), ..self }
    }

    /// The smooth reconstruction that pictures use.
    pub fn reconstruction(&self) -> &Reconstruction {
        &self.reconstruction
    }

    /// The picture of a solution: box-filtered radiance in the unit of the scene's emission.
    pub fn picture(&self, solution: &Solution) -> Picture {
        let mut light = shading::VertexLight {
            irradiance: self.reconstruction.apply(&solution.irradiance),
            glossy: self.reconstruction.apply(&solution.glossy),
        };
        // Before the first iteration only the lights themselves shine.
        light.irradiance.resize(self.reconstruction.vertices(), Rgb::ZERO);
        let (width, height) = (self.view.width, self.view.height);
        let mut picture = Picture::black(width, height);
        let share = 1.0 / self.samples.len() as f32;
        let inputs = self.inputs();
        let backdrop = (!self.background.is_black(&self.environment))
            .then(|| (self.background, &*self.environment));
        picture.pixels.par_chunks_mut((BAND * width) as usize).enumerate().for_each(
            |(band, pixels)| {
                self.visible(band as u32, &self.samples, |offset, items| {
                    let first_row = band as u32 * BAND;
                    let band = Band { first_row, offset, items };
                    shading::shade(inputs, &light, band, |at, radiance| {
                        pixels[at] += radiance * share;
                    });
                    if let Some(backdrop) = backdrop {
                        shading::add_background(backdrop, &self.view, band, |at, radiance| {
                            pixels[at] += radiance * share;
                        });
                    }
                });
            },
        );
        picture.alpha = self.background.is_transparent().then(|| self.coverage());
        picture
    }

    /// Share of each pixel's samples that see a surface.
    fn coverage(&self) -> Vec<f32> {
        let (width, height) = (self.view.width, self.view.height);
        let mut coverage = vec![0.0; width as usize * height as usize];
        let share = 1.0 / self.samples.len() as f32;
        coverage.par_chunks_mut((BAND * width) as usize).enumerate().for_each(|(band, pixels)| {
            let mut seen = vec![0u32; pixels.len()];
            self.visible(band as u32, &self.samples, |_, items| {
                for (count, code) in seen.iter_mut().zip(items) {
                    *count += u32::from(*code != item::EMPTY);
                }
            });
            for (pixel, count) in pixels.iter_mut().zip(seen) {
                *pixel = count as f32 * share;
            }
        });
        coverage
    }

    /// Weights of the reconstruction's vertices in the picture, for error estimates; one sample a
    /// pixel.
    pub fn vertex_weights(&self) -> VertexWeights {
        let vertices = self.reconstruction.vertices();
        let mut weights = VertexWeights {
            diffuse: vec![PixelWeight::default(); vertices],
            glossy: vec![PixelWeight::default(); vertices],
            pixels: 0.0,
        };
        for band in 0..self.view.height.div_ceil(BAND) {
            self.visible(band, &[Vec2::ZERO], |offset, items| {
                let band = Band { first_row: band * BAND, offset, items };
                shading::weigh(self.inputs(), band, &mut weights);
            });
        }
        weights
    }

    fn inputs(&self) -> ShadingInputs<'_> {
        ShadingInputs { scene: &self.scene, reconstruction: &self.reconstruction, view: &self.view }
    }

    /// Renders the item buffer of a band of rows for each sub-pixel offset.
    fn visible(&self, band: u32, offsets: &[Vec2], mut each: impl FnMut(Vec2, &[u32])) {
        let (first_row, width) = (band * BAND, self.view.width);
        let rows = BAND.min(self.view.height - first_row);
        let mut items = vec![0; (rows * width) as usize];
        let mut depth = vec![0.0; items.len()];
        let triangles = self.view.in_rows(first_row, first_row + rows);
        for offset in offsets {
            items.fill(0);
            depth.fill(0.0);
            let mut target = Target { width, first_row, items: &mut items, depth: &mut depth };
            for triangle in &triangles {
                fill(&mut target, &triangle.moved(*offset));
            }
            each(*offset, &items);
        }
    }
}
