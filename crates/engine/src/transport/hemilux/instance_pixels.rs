//! Instances in the picture: they are not rasterised, since there may be far more of their triangles
//! than samples, but found by rays through the samples of those pixels that the box of one covers.

use crate::measurement::Frame;
use crate::scene::Camera;
use crate::surface::World;
use glam::Vec3;

/// Pixels that may see an instance.
pub struct InstancePixels {
    /// Row by row; empty where no pixel may.
    covered: Vec<bool>,
}

impl InstancePixels {
    /// Those of a camera's picture.
    pub fn new(world: &World, camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let instances = &world.scene.instances;
        if instances.is_empty() {
            return Self { covered: Vec::new() };
        }
        let frame = Frame::new(camera, width, height);
        let (columns, rows) = (width as usize + 1, height as usize + 1);
        // By pixel, how many more boxes begin than end: sums along rows and columns count them.
        let mut counts = vec![0i32; columns * rows];
        for own in instances.all() {
            let shape = instances.shape_of(own);
            let corner = |bits: u32| {
                let pick = |axis: usize| if bits >> axis & 1 == 0 { shape.low } else { shape.high };
                own.point(Vec3::new(pick(0).x, pick(1).y, pick(2).z))
            };
            let corners: [Vec3; 8] = std::array::from_fn(|bits| corner(bits as u32));
            let Some([x0, x1, y0, y1]) = frame.box_of(&corners, [width, height]) else { continue };
            let mut add =
                |x: u32, y: u32, count| counts[y as usize * columns + x as usize] += count;
            add(x0, y0, 1);
            add(x1, y0, -1);
            add(x0, y1, -1);
            add(x1, y1, 1);
        }
        for row in 0..rows {
            for column in 1..columns {
                counts[row * columns + column] += counts[row * columns + column - 1];
            }
        }
        for at in columns..counts.len() {
            counts[at] += counts[at - columns];
        }
        let covered = counts.chunks(columns).take(height as usize);
        let covered = covered.flat_map(|row| row[..width as usize].iter().map(|count| *count > 0));
        Self { covered: covered.collect() }
    }

    /// Whether a pixel may see one.
    #[inline]
    pub fn may_be_in(&self, pixel: u32) -> bool {
        self.covered.get(pixel as usize).is_some_and(|covered| *covered)
    }
}
