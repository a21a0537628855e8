//! Where the runs of a comparison happen: one method's picture of a view, on a device that is opened
//! again after it was lost.

use hemilux_engine::device::{Device, DeviceDescription};
use hemilux_engine::render::{
    CameraChoice, Limits, Observer, Progress, RenderError, RenderRequest, Rendered,
};
use hemilux_engine::scene::Scene;
use hemilux_engine::transport::render;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A method and its settings.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Name of the method.
    pub method: String,
    /// Its settings by name, over the defaults.
    pub options: BTreeMap<String, String>,
}

/// What a picture shows.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the scene, for titles.
    pub name: String,
    /// The scene.
    pub scene: Arc<Scene>,
    /// The camera.
    pub camera: CameraChoice,
    /// Width and height, pixels.
    pub size: (u32, u32),
}

impl View {
    /// A picture of it by a method.
    pub(super) fn request(
        &self,
        contender: &Contender,
        limits: Limits,
        seed: u64,
    ) -> RenderRequest {
        RenderRequest {
            camera: self.camera.clone(),
            limits,
            seed,
            options: contender.options.clone(),
            ..RenderRequest::new(self.scene.clone(), contender.method.clone(), self.size.into())
        }
    }
}

/// Where runs happen and who is told about them.
pub struct Bench<'a> {
    /// Opens the device; again after it was lost.
    pub open: &'a mut dyn FnMut() -> Result<Box<dyn Device>, String>,
    /// Told what begins, with the share of the work that is done.
    pub say: &'a mut dyn FnMut(&str, f64),
    /// Set from outside to end early with what there is.
    pub interrupted: &'a AtomicBool,
    device: Option<Box<dyn Device>>,
}

impl<'a> Bench<'a> {
    /// A bench whose device is not open yet.
    pub fn new(
        open: &'a mut dyn FnMut() -> Result<Box<dyn Device>, String>,
        say: &'a mut dyn FnMut(&str, f64),
        interrupted: &'a AtomicBool,
    ) -> Self {
        Self { open, say, interrupted, device: None }
    }

    /// What the device is, which is opened for it.
    pub(super) fn device(&mut self) -> Result<DeviceDescription, String> {
        let device = match self.device.take() {
            Some(device) => device,
            None => (self.open)()?,
        };
        let description = device.description();
        self.device = Some(device);
        Ok(description)
    }

    /// Renders; a failure of the device costs the device, which is opened again for the next.
    pub(super) fn render(&mut self, request: &RenderRequest) -> Result<Rendered, String> {
        let mut device = match self.device.take() {
            Some(device) => device,
            None => (self.open)()?,
        };
        let mut observer = Interruptible(self.interrupted);
        let done =
            catch_unwind(AssertUnwindSafe(|| render(device.as_mut(), request, &mut observer)));
        let result = match done {
            Err(_) => return Err("an unexpected fault in the renderer".into()),
            Ok(result) => result,
        };
        if !matches!(result, Err(RenderError::Device(_))) {
            self.device = Some(device);
        }
        result.map_err(|error| error.to_string())
    }
}

struct Interruptible<'a>(&'a AtomicBool);

impl Observer for Interruptible<'_> {
    fn progress(&mut self, _: &Progress) {}

    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
