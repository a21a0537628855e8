//! The view of a scene with real light, and the reference that its pictures are judged by.

use crate::results::Failure;
use crate::views::imported;
use hemilux_charts::accuracy::Reference;
use hemilux_engine::device::Device;
use hemilux_engine::image::Picture;
use hemilux_engine::render::{
    CameraChoice, Limits, RenderRequest, Rendered, Unobserved, choose_camera,
};
use hemilux_engine::sampling::SparsePixels;
use hemilux_engine::scene::made::real::RealScene;
use hemilux_engine::scene::{Camera, Environment, Scene};
use hemilux_engine::transport::render;
use std::hash::{DefaultHasher, Hasher};
use std::path::Path;
use std::sync::Arc;

/// Seeds of a reference's halves; judged runs count from 1.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];

/// A scene seen by its first camera.
pub struct RealView {
    pub scene: Arc<Scene>,
    environment: Arc<Environment>,
    /// Width and height of pictures, pixels.
    side: u32,
    /// Name of its references' files: other scenes, surroundings and sizes have others.
    key: String,
}

impl RealView {
    pub fn new(made: &RealScene, side: u32) -> Self {
        Self {
            scene: Arc::new(imported(&made.glb)),
            environment: Arc::new(made.environment.clone()),
            side,
            key: format!("{}-{side}-{:016x}", made.name, content(made)),
        }
    }

    pub fn camera(&self) -> Result<Camera, Failure> {
        Ok(choose_camera(&self.scene, &CameraChoice::First, [self.side; 2])?.0)
    }

    pub fn render(
        &self,
        device: &mut dyn Device,
        how: (&str, Limits),
        seed: u64,
    ) -> Result<Rendered, Failure> {
        Ok(render(device, &self.request(how, seed), &mut Unobserved)?)
    }

    fn request(&self, (method, limits): (&str, Limits), seed: u64) -> RenderRequest {
        RenderRequest {
            environment: Some(self.environment.clone()),
            limits,
            seed,
            ..RenderRequest::new(self.scene.clone(), method, [self.side; 2])
        }
    }

    /// The reference: from the folder, or traced for so many seconds a half and put there.
    pub fn reference(
        &self,
        device: &mut dyn Device,
        folder: &Path,
        seconds: f64,
    ) -> Result<Reference, Failure> {
        self.traced(device, folder, (seconds, 1))
    }

    /// About a thousand pixels of the reference, traced as long as all of it would be, and which they are:
    /// they say how far pictures are off where a whole reference is too noisy for that.
    pub fn sparse_reference(
        &self,
        device: &mut dyn Device,
        folder: &Path,
        seconds: f64,
    ) -> Result<(Reference, Vec<bool>), Failure> {
        let squares = squares_of(self.side);
        let reference = self.traced(device, folder, (seconds, squares))?;
        Ok((reference, SparsePixels::new(squares).mask([self.side; 2])))
    }

    /// The reference by one pixel of each square of so many pixels.
    fn traced(
        &self,
        device: &mut dyn Device,
        folder: &Path,
        (seconds, squares): (f64, u32),
    ) -> Result<Reference, Failure> {
        let mut half = |seed, name| -> Result<Picture, Failure> {
            let kind = kind_of(squares);
            let path = folder.join(format!("{}-{kind}{name}.exr", self.key));
            if let Ok(bytes) = std::fs::read(&path) {
                return Ok(Picture::from_exr(&bytes)?);
            }
            let mut request = self.request(("ray-traced", Limits::seconds(seconds)), seed);
            request.options.insert("pixel_squares".into(), squares.to_string());
            let rendered = render(device, &request, &mut Unobserved)?;
            eprintln!("{}: half {name}, {} passes", self.key, rendered.stats.figures.iterations);
            std::fs::write(&path, rendered.picture.to_exr()?)?;
            Ok(rendered.picture)
        };
        let [first, second] = REFERENCE_SEEDS;
        Ok(Reference::new(half(first, "a")?, half(second, "b")?))
    }
}

/// Pixels along the squares that leave about 32 × 32 of a picture's pixels.
pub fn squares_of(side: u32) -> u32 {
    (side / 32).max(1)
}

/// What names of files say of references that are not whole.
pub fn kind_of(squares: u32) -> String {
    if squares > 1 { format!("of{squares}-") } else { String::new() }
}

/// A number that differs where the scene or what surrounds it does.
fn content(made: &RealScene) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(&made.glb);
    made.environment.digest_into(&mut |piece| hasher.write(piece));
    hasher.finish()
}
