//! The view of a scene with real light, and the reference that its pictures are judged by.

use crate::results::Failure;
use crate::views::imported;
use hemilux_charts::accuracy::Reference;
use hemilux_engine::device::Device;
use hemilux_engine::image::Picture;
use hemilux_engine::render::{
    CameraChoice, Limits, RenderRequest, Rendered, Unobserved, choose_camera,
};
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
        (method, limits): (&str, Limits),
        seed: u64,
    ) -> Result<Rendered, Failure> {
        let request = RenderRequest {
            environment: Some(self.environment.clone()),
            limits,
            seed,
            ..RenderRequest::new(self.scene.clone(), method, [self.side; 2])
        };
        Ok(render(device, &request, &mut Unobserved)?)
    }

    /// The reference: from the folder, or traced for so many seconds a half and put there.
    pub fn reference(
        &self,
        device: &mut dyn Device,
        folder: &Path,
        seconds: f64,
    ) -> Result<Reference, Failure> {
        let mut half = |seed, name| -> Result<Picture, Failure> {
            let path = folder.join(format!("{}-{name}.exr", self.key));
            if let Ok(bytes) = std::fs::read(&path) {
                return Ok(Picture::from_exr(&bytes)?);
            }
            let limits = Limits::seconds(seconds);
            let rendered = self.render(device, ("ray-traced", limits), seed)?;
            eprintln!("{}: half {name}, {} passes", self.key, rendered.stats.figures.iterations);
            std::fs::write(&path, rendered.picture.to_exr()?)?;
            Ok(rendered.picture)
        };
        let [first, second] = REFERENCE_SEEDS;
        Ok(Reference::new(half(first, "a")?, half(second, "b")?))
    }
}

/// A number that differs where the scene or what surrounds it does.
fn content(made: &RealScene) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(&made.glb);
    made.environment.digest_into(&mut |piece| hasher.write(piece));
    hasher.finish()
}
