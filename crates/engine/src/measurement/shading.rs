//! Radiance, reflected and emitted, that each sub-pixel sample sees; and the weights of vertices in
//! the picture.

use super::camera::View;
use super::reconstruction::Reconstruction;
use crate::hemicube::item;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::scene::{Background, Environment};
use glam::Vec2;
use std::f32::consts::PI;

/// What shading reads: scene, reconstruction and camera.
#[derive(Clone, Copy)]
pub struct ShadingInputs<'a> {
    /// The scene in patches.
    pub scene: &'a PatchedScene,
    /// How values on patches become a function.
    pub reconstruction: &'a Reconstruction,
    /// The camera.
    pub view: &'a View,
}

/// Weights of the reconstruction's vertices in the picture, from which errors are estimated.
pub struct VertexWeights {
    /// Of irradiance: factor kd/π.
    pub diffuse: Vec<PixelWeight>,
    /// Of lobe-weighted irradiance: factor ks.
    pub glossy: Vec<PixelWeight>,
    /// Number of pixels that were counted: those that see no emitter.
    pub pixels: f64,
}

/// Sums over the pixels that a vertex is interpolated into.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelWeight {
    /// Σ interpolation weight × factor.
    pub first: Rgb,
    /// Σ interpolation weight × factor².
    pub second: Rgb,
}

impl PixelWeight {
    fn add(&mut self, factor: Rgb, weight: f32) {
        self.first += factor * weight;
        self.second += factor * factor * weight;
    }
}

/// Light at the vertices of the reconstruction.
pub struct VertexLight {
    /// Irradiance.
    pub irradiance: Vec<Rgb>,
    /// Lobe-weighted irradiance; empty without glossy patches.
    pub glossy: Vec<Rgb>,
}

/// Item buffer of a band of rows, for one sub-pixel sample.
#[derive(Clone, Copy)]
pub struct Band<'a> {
    /// Its first row.
    pub first_row: u32,
    /// The sample's place, in pixels from each pixel's centre.
    pub offset: Vec2,
    /// The item buffer, row by row.
    pub items: &'a [u32],
}

/// A run of pixels in a row that see the same side of the same facet.
struct PixelRun {
    facet: usize,
    back: bool,
    /// Barycentric numerators and their sum at column 0, and their change per column.
    u: (f32, f32),
    v: (f32, f32),
    sum: (f32, f32),
}

/// Calls `each` for every run of a band with its pixel range.
fn runs(
    inputs: ShadingInputs<'_>,
    band: Band<'_>,
    mut each: impl FnMut(&PixelRun, usize, std::ops::Range<u32>),
) {
    let width = inputs.view.width as usize;
    for (row_index, row_items) in band.items.chunks(width).enumerate() {
        let mut column = 0;
        while column < width {
            let code = row_items[column];
            let end = row_items[column..]
                .iter()
                .position(|other| *other != code)
                .map_or(width, |length| column + length);
            if let Some((facet, back)) = item::decode(code) {
                let row = band.first_row + row_index as u32;
                let run = PixelRun::new(inputs, facet as usize, back, row, band.offset);
                each(&run, row_index * width, column as u32..end as u32);
            }
            column = end;
        }
    }
}

impl PixelRun {
    fn new(inputs: ShadingInputs<'_>, facet: usize, back: bool, row: u32, offset: Vec2) -> Self {
        let scene = inputs.scene;
        let corners = scene.facets[facet].corners.map(|c| scene.positions[c as usize]);
        let [e0, e1, e2] = inputs.view.edges(corners).map(|plane| {
            let at_row = plane.constant + plane.per_row * (row as f32 + offset.y);
            (at_row + plane.per_column * offset.x, plane.per_column)
        });
        Self { facet, back, u: e1, v: e2, sum: (e0.0 + e1.0 + e2.0, e0.1 + e1.1 + e2.1) }
    }

    /// Barycentric coordinates that a column sees.
    #[expect(clippy::manual_clamp, reason = "`max` and `min` drop NaN, `clamp` would keep it")]
    fn at(&self, column: u32) -> (f32, f32) {
        let column = column as f32;
        let scale = 1.0 / (self.sum.0 + self.sum.1 * column);
        let u = ((self.u.0 + self.u.1 * column) * scale).max(0.0).min(1.0);
        let v = ((self.v.0 + self.v.1 * column) * scale).max(0.0).min(1.0 - u);
        (u, v)
    }
}

/// Radiance towards the camera of every sample of a band: `each(pixel, radiance)`.
pub fn shade(
    inputs: ShadingInputs<'_>,
    light: &VertexLight,
    band: Band<'_>,
    mut each: impl FnMut(usize, Rgb),
) {
    let patched = inputs.scene;
    let scene = &patched.scene;
    runs(inputs, band, |run, row_start, columns| {
        let facet = &patched.facets[run.facet];
        let triangle = &scene.triangle(facet.source);
        let material = &scene.materials[triangle.material as usize];
        let varies = patched.colour_varies(facet);
        let uniform = material.reflectance(&scene.appearance(triangle, 0.0, 0.0));
        let emission = scene.emission(triangle, 0.0, 0.0);
        for column in columns {
            let (u, v) = run.at(column);
            let (reflectance, emission) = if varies {
                let at = facet.to_source(u, v);
                let appearance = scene.appearance(triangle, at.x, at.y);
                (material.reflectance(&appearance), scene.emission(triangle, at.x, at.y))
            } else {
                (uniform, emission)
            };
            let corners = inputs.reconstruction.corners(run.facet, run.back, facet, u, v);
            let mut radiance = emission;
            if let Some(corners) = corners {
                let interpolate = |values: &[Rgb]| {
                    corners.iter().map(|(vertex, w)| values[*vertex as usize] * *w).sum::<Rgb>()
                };
                radiance += reflectance.diffuse * interpolate(&light.irradiance) / PI;
                if !light.glossy.is_empty() && reflectance.is_glossy() {
                    radiance += reflectance.specular * interpolate(&light.glossy);
                }
            }
            each(row_start + column as usize, radiance);
        }
    });
}

/// Radiance of a background, in its surroundings, towards the camera of every sample of a band that
/// sees no surface: `each(pixel, radiance)`.
pub fn add_background(
    (background, environment): (Background, &Environment),
    view: &View,
    band: Band<'_>,
    mut each: impl FnMut(usize, Rgb),
) {
    for (at, _) in band.items.iter().enumerate().filter(|(_, code)| item::decode(**code).is_none())
    {
        let (column, row) = (at as u32 % view.width, band.first_row + at as u32 / view.width);
        let place = Vec2::new(column as f32, row as f32) + band.offset;
        each(at, background.radiance(environment, view.direction(place)));
    }
}

/// Adds the pixels of a band to the vertices' weights in the picture.
pub fn weigh(inputs: ShadingInputs<'_>, band: Band<'_>, weights: &mut VertexWeights) {
    let patched = inputs.scene;
    let scene = &patched.scene;
    weights.pixels += band.items.len() as f64;
    runs(inputs, band, |run, _, columns| {
        let facet = &patched.facets[run.facet];
        let triangle = &scene.triangle(facet.source);
        let material = &scene.materials[triangle.material as usize];
        if material.emits() {
            weights.pixels -= columns.len() as f64;
            return;
        }
        for column in columns {
            let (u, v) = run.at(column);
            let at = facet.to_source(u, v);
            let reflectance = material.reflectance(&scene.appearance(triangle, at.x, at.y));
            let (kd, ks) = (reflectance.diffuse / PI, reflectance.specular);
            let corners = inputs.reconstruction.corners(run.facet, run.back, facet, u, v);
            for (vertex, weight) in corners.into_iter().flatten() {
                weights.diffuse[vertex as usize].add(kd, weight);
                weights.glossy[vertex as usize].add(ks, weight);
            }
        }
    });
}
