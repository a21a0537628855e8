//! Pictures of what nothing lights: black surfaces before the background.

use super::job::Job;
use crate::image::Picture;
use crate::measurement::{Frame, sample_pattern};
use crate::radiometry::Rgb;
use crate::rays::RayOfPixel;
use glam::Vec2;
use rayon::prelude::*;

/// Rays through a pixel.
const SAMPLES: u32 = 16;

/// The picture of a job whose scene nothing lights.
pub fn picture(job: &Job<'_>) -> Picture {
    let (width, height) = (job.request.width, job.request.height);
    let background = job.request.background;
    let shows_alpha = background.is_transparent();
    if background.is_black(&job.environment) && !shows_alpha {
        return Picture::black(width, height);
    }
    let world = job.world();
    let frame = Frame::new(&job.camera, width, height);
    let samples = sample_pattern(SAMPLES);
    let size = Vec2::new(width as f32, height as f32);
    let of_pixel = |pixel: u32| {
        let middle = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
        let (mut radiance, mut covered) = (Rgb::ZERO, 0);
        for (number, offset) in samples.iter().enumerate() {
            let at = 2.0 * (middle + *offset) / size - 1.0;
            let (eye, direction) = frame.ray(Vec2::new(at.x, -at.y));
            let ray = RayOfPixel { index: number as u32, pixel };
            let near = world.rays.approach(eye, direction);
            let hit = near.and_then(|from| world.rays.closest_in_pixel(from, direction, ray));
            match hit {
                Some(_) => covered += 1,
                None => radiance += world.beside_surfaces(direction),
            }
        }
        (radiance / SAMPLES as f32, covered as f32 / SAMPLES as f32)
    };
    let (pixels, coverage) = (0..width * height).into_par_iter().map(of_pixel).unzip();
    let alpha = shows_alpha.then_some(coverage);
    Picture { alpha, ..Picture::new(width, height, pixels) }
}
