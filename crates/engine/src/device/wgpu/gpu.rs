//! An open adapter: device and queue, what went wrong on it, waiting and reading back.

use crate::device::{DeviceDescription, DeviceError};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

/// A submission that takes longer is taken for a hanging driver.
const PATIENCE: Duration = Duration::from_secs(120);

/// Where the first failure on a device is kept; failures arrive on any thread.
#[derive(Clone, Default)]
struct Fault(Arc<Mutex<Option<String>>>);

impl Fault {
    fn report(&self, reason: String) {
        let mut first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        tracing::debug!(reason, "wgpu device fault");
        first.get_or_insert(reason);
    }

    fn get(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// An open adapter.
pub struct Gpu {
    /// The logical device.
    pub device: wgpu::Device,
    /// Its one queue.
    pub queue: wgpu::Queue,
    /// What it is.
    pub description: DeviceDescription,
    /// Whether the adapter runs on the processor.
    pub software: bool,
    fault: Fault,
}

/// All adapters of the native graphics APIs, in the loader's order.
pub fn adapters() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    // Indirect draws come from our own kernel and are in range; checking them costs a dispatch.
    descriptor.flags = wgpu::InstanceFlags::empty();
    descriptor.memory_budget_thresholds =
        wgpu::MemoryBudgetThresholds { for_resource_creation: Some(90), for_device_loss: None };
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
}

/// Limits that the kernels need on every adapter; buffer sizes come on top.
const STORAGE_BUFFERS: u32 = 7;
const WORKGROUP: u32 = 64;

/// What an adapter lacks for the kernels, `None` where it lacks nothing.
pub fn missing(adapter: &wgpu::Adapter) -> Option<&'static str> {
    let (limits, downlevel) = (adapter.limits(), adapter.get_downlevel_capabilities());
    let items = adapter.get_texture_format_features(super::formats::ITEM_FORMAT);
    let needed = [
        (downlevel.flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS), "compute shaders"),
        (downlevel.flags.contains(wgpu::DownlevelFlags::INDIRECT_EXECUTION), "indirect draws"),
        (limits.max_storage_buffers_per_shader_stage >= STORAGE_BUFFERS, "storage buffers"),
        (limits.max_compute_invocations_per_workgroup >= WORKGROUP, "workgroups of 64"),
        (
            items.allowed_usages.contains(wgpu::TextureUsages::RENDER_ATTACHMENT),
            "rendering to 32-bit integers",
        ),
    ];
    needed.iter().find(|(there, _)| !there).map(|(_, what)| *what)
}

/// Describes the adapter at an index of [`adapters`].
pub fn describe(index: usize, adapter: &wgpu::Adapter) -> DeviceDescription {
    let info = adapter.get_info();
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete_gpu",
        wgpu::DeviceType::IntegratedGpu => "integrated_gpu",
        wgpu::DeviceType::VirtualGpu => "virtual_gpu",
        wgpu::DeviceType::Cpu => "software_gpu",
        wgpu::DeviceType::Other => "other",
    };
    let driver = [info.backend.to_str(), &info.driver, &info.driver_info]
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join(" ");
    DeviceDescription { id: index.to_string(), name: info.name, kind: kind.into(), driver }
}

impl Gpu {
    /// Opens an adapter with all the limits that it offers.
    pub fn open(index: usize) -> Result<Self, DeviceError> {
        let adapters = adapters();
        let unknown = || DeviceError::Unknown(index.to_string());
        let adapter = adapters.get(index).ok_or_else(unknown)?;
        if missing(adapter).is_some() {
            return Err(unknown());
        }
        let description = describe(index, adapter);
        let request = wgpu::DeviceDescriptor {
            label: Some("hemilux"),
            required_features: wgpu::Features::empty(),
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&request)).map_err(|error| {
                DeviceError::Lost {
                    device: description.name.clone(),
                    reason: format!("it could not be opened: {error}"),
                }
            })?;
        let fault = Fault::default();
        let handler = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error| handler.report(error.to_string())));
        let handler = fault.clone();
        device.set_device_lost_callback(move |reason, message| {
            handler.report(format!("{reason:?}: {message}"));
        });
        let software = adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        Ok(Self { device, queue, description, software, fault })
    }

    /// The error of a device that can't be used any more.
    pub fn lost(&self, reason: impl Into<String>) -> DeviceError {
        DeviceError::Lost { device: self.description.name.clone(), reason: reason.into() }
    }

    /// Fails where anything failed on the device before.
    pub fn check(&self) -> Result<(), DeviceError> {
        self.fault.get().map_or(Ok(()), |reason| Err(self.lost(reason)))
    }

    /// Runs something that creates objects and fails where the driver complained.
    pub fn guarded<T>(&self, create: impl FnOnce() -> T) -> Result<T, DeviceError> {
        self.check()?;
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let created = create();
        let errors = [pollster::block_on(validation.pop()), pollster::block_on(internal.pop())];
        // What was not created harms nothing else: the device stays usable.
        match errors.into_iter().flatten().next() {
            Some(error) => Err(self.lost(error.to_string())),
            None => self.check().map(|()| created),
        }
    }

    /// Runs something that allocates; `Ok(None)` where the memory does not suffice.
    pub fn allocating<T>(&self, create: impl FnOnce() -> T) -> Result<Option<T>, DeviceError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let created = self.guarded(create);
        let short = pollster::block_on(memory.pop()).is_some();
        if short { Ok(None) } else { created.map(Some) }
    }

    /// Submits one command buffer.
    pub fn submit(
        &self,
        encoder: wgpu::CommandEncoder,
    ) -> Result<wgpu::SubmissionIndex, DeviceError> {
        let index = self.queue.submit([encoder.finish()]);
        self.check()?;
        Ok(index)
    }

    /// Waits until a submission is done.
    pub fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), DeviceError> {
        let wait =
            wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) };
        if let Err(error) = self.device.poll(wait) {
            self.fault.report(format!("waiting for it failed: {error}"));
        }
        self.check()
    }

    /// A buffer that the host can read after copying `size` bytes to it.
    pub fn staging(&self, size: u64) -> Result<wgpu::Buffer, DeviceError> {
        let buffer = self.allocating(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("staging"),
                size,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        })?;
        buffer.ok_or_else(|| self.out_of_memory(size, 0))
    }

    /// The error of a request for memory.
    pub fn out_of_memory(&self, needed_bytes: u64, available_bytes: u64) -> DeviceError {
        let device = self.description.name.clone();
        DeviceError::OutOfMemory { device, needed_bytes, available_bytes }
    }

    /// Submits the commands and returns what they have left in a staging buffer.
    pub fn read(
        &self,
        encoder: wgpu::CommandEncoder,
        staging: &wgpu::Buffer,
    ) -> Result<Vec<u32>, DeviceError> {
        let submission = self.submit(encoder)?;
        let (sender, receiver) = mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody listens any more where waiting has failed.
            let _ = sender.send(result);
        });
        self.wait(submission)?;
        match receiver.recv_timeout(PATIENCE) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.fault.report(format!("mapping a buffer failed: {error}")),
            Err(_) => self.fault.report("mapping a buffer did not finish".into()),
        }
        self.check()?;
        let words = {
            let view = staging
                .get_mapped_range(..)
                .map_err(|error| self.lost(format!("mapping a buffer failed: {error}")))?;
            bytemuck::pod_collect_to_vec(&view)
        };
        staging.unmap();
        Ok(words)
    }
}
