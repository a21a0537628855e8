//! What a picture is traced of: the scene as rays meet it, its lights, the camera's frame, and how
//! pixels are sampled.

use super::film::Film;
use super::path::{Caustics, Tracer};
use super::pixels::Pixels;
use super::settings::RayTracedSettings;
use crate::emitters::{DiskPoints, Disks, SceneLights};
use crate::measurement::Frame;
use crate::surface::World;
use crate::transport::job::Job;

/// What a picture is traced of.
pub struct View {
    /// The scene.
    pub world: World,
    /// Its lights.
    pub lights: SceneLights,
    disks: Option<(Disks, DiskPoints)>,
    options: RayTracedSettings,
    frame: Frame,
    size: [u32; 2],
    seed: u64,
}

impl View {
    /// The view of a job.
    pub fn new(
        job: &Job<'_>,
        world: World,
        lights: SceneLights,
        options: RayTracedSettings,
    ) -> Self {
        let size = [job.request.width, job.request.height];
        Self {
            disks: lights.triangles.as_ref().and_then(|lights| options.disks(&world, lights)),
            world,
            lights,
            options,
            frame: Frame::new(&job.camera, size[0], size[1]),
            size,
            seed: job.request.seed,
        }
    }

    /// An empty film for it.
    pub fn film(&self) -> Film {
        Film::new(self.size, self.options.period(), self.world.background.is_transparent())
    }

    /// Its pixels, of which some light may come from a map.
    pub fn pixels<'a>(&'a self, caustics: Option<&'a dyn Caustics>) -> Pixels<'a> {
        Pixels {
            tracer: Tracer {
                world: &self.world,
                lights: &self.lights,
                disks: self.disks.as_ref().map(|(disks, points)| (disks, *points)),
                reflections: self.options.reflections,
                rays_per_pixel: self.options.rays_per_pixel,
                caustics,
            },
            frame: self.frame,
            size: self.size,
            traced: self.options.traced,
            sampling: self.options.pixel_sampling,
            path_strata: self.options.spreads_paths(),
            seed: self.seed,
        }
    }
}
