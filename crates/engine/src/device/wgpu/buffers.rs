//! What a scene and its shooting take on the adapter: sizes first, then the buffers.

use super::formats::{DEPTH_FORMAT, ITEM_FORMAT};
use super::gpu::Gpu;
use super::layout::{
    FACET_RUN, GpuCorner, GpuFacet, GpuPass, GpuPatch, GpuSettings, GpuShot, PIXEL_RUN, SPAN,
};
use super::pipelines::{Pipelines, UNIFORM_STRIDE};
use crate::device::{DeviceError, ShootingSettings, free_memory};
use crate::hemicube::{DeltaFormFactors, FACES};
use crate::patches::PatchedScene;
use bytemuck::Zeroable;
use wgpu::BufferUsages;

/// Most shots that share a render pass. More no longer raise the throughput, and each costs an
/// item and a depth buffer.
const SHOTS_PER_PASS: u64 = 32;
/// On an adapter that runs on the processor, where one hemicube fits the caches and already keeps
/// all cores busy: two a pass were 10 % slower on lavapipe, eight 40 %.
const SOFTWARE_SHOTS_PER_PASS: u64 = 1;
/// Bytes that more than one shot a pass may take.
const PASS_BYTES: u64 = 512 << 20;
/// Item code and depth of a pixel.
const PIXEL_BYTES: u64 = 8;
/// Threads of a workgroup in every kernel.
pub const THREADS: u32 = 64;
/// Bytes of a draw's arguments.
pub const DRAW_BYTES: u64 = 20;
/// Bytes of [`Buffers::control`] before the sources.
pub const CONTROL_HEADER: u64 = 32;
/// Words of [`Buffers::control`] that count since the last look.
pub const TALLY_WORDS: u64 = 4;

/// Counts that determine all sizes.
#[derive(Clone, Copy, Debug)]
pub struct BufferPlan {
    /// R.
    pub resolution: u64,
    /// Patches.
    pub patches: u64,
    /// Patches with a lobe.
    pub glossy: u64,
    /// Facets.
    pub facets: u64,
    /// K.
    pub shots: u64,
    /// Shots that share a render pass.
    pub pass_shots: u64,
    /// Hemicubes side by side in the atlas.
    pub columns: u64,
}

impl BufferPlan {
    /// Plans within the adapter's limits.
    pub fn new(
        gpu: &Gpu,
        scene: &PatchedScene,
        settings: &ShootingSettings,
    ) -> Result<Self, DeviceError> {
        let patches = &scene.patches;
        let mut plan = Self {
            resolution: u64::from(settings.resolution),
            patches: patches.len() as u64,
            glossy: (0..patches.len()).filter(|i| patches.is_glossy(*i)).count() as u64,
            facets: scene.facets.len() as u64,
            shots: u64::from(settings.shots_per_iteration),
            pass_shots: 1,
            columns: 1,
        };
        let limits = gpu.device.limits();
        let side = u64::from(limits.max_texture_dimension_2d);
        let threads = u64::from(THREADS * limits.max_compute_workgroups_per_dimension);
        // A hemicube must fit into a texture and its runs of pixels into a dispatch.
        let runs = threads * u64::from(PIXEL_RUN) / 3;
        let finest = (side / 3).min(runs.isqrt() - u64::from(PIXEL_RUN));
        if plan.resolution > finest {
            let bytes = |side: u64| PIXEL_BYTES.saturating_mul(3 * side).saturating_mul(side);
            return Err(gpu.out_of_memory(bytes(plan.resolution), bytes(finest)));
        }
        let binding = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let largest = plan.largest_buffer();
        if largest > binding {
            return Err(gpu.out_of_memory(largest, binding));
        }
        if plan.patches > threads {
            let bytes = |patches: u64| GpuPatch::SIZE * patches;
            return Err(gpu.out_of_memory(bytes(plan.patches), bytes(threads)));
        }
        let available = if gpu.software { free_memory() / 2 } else { u64::MAX };
        if plan.total_bytes() > available {
            return Err(gpu.out_of_memory(plan.total_bytes(), available));
        }
        let preferred = if gpu.software { SOFTWARE_SHOTS_PER_PASS } else { SHOTS_PER_PASS };
        let tiles = (side / plan.resolution) * (side / (3 * plan.resolution));
        for pass_shots in 2..=preferred.min(plan.shots).min(tiles) {
            let more = Self { pass_shots, ..plan };
            let fits = more.largest_buffer() <= binding
                && more.pass_bytes() <= PASS_BYTES
                && more.total_bytes() <= available;
            if fits {
                plan.pass_shots = pass_shots;
            }
        }
        plan.columns = plan.pass_shots.min(side / plan.resolution);
        Ok(plan)
    }

    /// Planes of the form-factor sums: with and without the lobe's weight.
    pub fn planes(&self) -> u64 {
        if self.glossy > 0 { 2 } else { 1 }
    }

    /// Pixels of one hemicube.
    pub fn pixels(&self) -> u64 {
        3 * self.resolution * self.resolution
    }

    /// Render passes of an iteration.
    pub fn passes(&self) -> u64 {
        self.shots.div_ceil(self.pass_shots)
    }

    /// Bytes of the form-factor sums of one shot.
    pub fn sums_bytes(&self) -> u64 {
        4 * self.planes() * self.patches
    }

    /// Width and height of the atlas of item buffers.
    pub fn atlas_size(&self) -> wgpu::Extent3d {
        let rows = self.pass_shots.div_ceil(self.columns);
        wgpu::Extent3d {
            width: (self.columns * self.resolution) as u32,
            height: (rows * 3 * self.resolution) as u32,
            depth_or_array_layers: 1,
        }
    }

    /// Left upper pixel of a hemicube in the atlas.
    pub fn tile(&self, slot: u64) -> (u32, u32) {
        let (column, row) = (slot % self.columns, slot / self.columns);
        ((column * self.resolution) as u32, (row * 3 * self.resolution) as u32)
    }

    fn power_entries(&self) -> u64 {
        let runs = self.patches.div_ceil(u64::from(SPAN));
        self.patches + runs + runs.div_ceil(u64::from(SPAN))
    }

    fn facet_runs(&self) -> u64 {
        self.facets.div_ceil(u64::from(FACET_RUN))
    }

    fn index_bytes(&self) -> u64 {
        12 * FACES as u64 * self.facets * self.pass_shots
    }

    /// Bytes of what grows with the shots per pass.
    fn pass_bytes(&self) -> u64 {
        let lists = (4 * FACES as u64 + u64::from(FACET_RUN)) * self.facet_runs();
        let buffers = PIXEL_BYTES * self.pixels() + self.sums_bytes() + lists + GpuShot::SIZE;
        self.pass_shots * buffers + self.index_bytes()
    }

    fn largest_buffer(&self) -> u64 {
        let sizes = [
            GpuPatch::SIZE * self.patches,
            16 * (self.shots + 1) * self.glossy,
            GpuFacet::SIZE * self.facets,
            GpuCorner::SIZE * GpuCorner::PER_FACET * self.facets,
            self.index_bytes(),
            self.sums_bytes() * self.pass_shots,
            GpuShot::SIZE * (self.shots + self.pass_shots),
        ];
        sizes.into_iter().max().unwrap_or(0)
    }

    /// Bytes of everything, with the largest transfer to and from the host.
    pub fn total_bytes(&self) -> u64 {
        let corners = GpuCorner::SIZE * GpuCorner::PER_FACET;
        let per_patch = GpuPatch::SIZE + 32 + 8;
        let scene = per_patch * self.patches
            + (GpuFacet::SIZE + corners) * self.facets
            + 16 * (self.shots + 1) * self.glossy
            + 2 * self.pixels()
            + (GpuShot::SIZE + 16 + UNIFORM_STRIDE) * self.shots;
        let transfer = (16 * (self.patches + self.glossy))
            .max(corners * self.facets)
            .max(GpuPatch::SIZE * self.patches);
        scene + self.pass_bytes() + transfer
    }
}

/// Buffers, item textures and the bindings that name them. The names are those in the kernels.
pub struct Buffers {
    pub control: wgpu::Buffer,
    pub passes: wgpu::Buffer,
    pub power: wgpu::Buffer,
    pub irradiance: wgpu::Buffer,
    pub incoming: wgpu::Buffer,
    /// Those of an iteration, and behind them room for traced ones.
    pub shots: wgpu::Buffer,
    pub sums: wgpu::Buffer,
    pub corners: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub draws: wgpu::Buffer,
    pub atlas: wgpu::Texture,
    pub atlas_view: wgpu::TextureView,
    pub depth_view: wgpu::TextureView,
    pub select: wgpu::BindGroup,
    pub cull: wgpu::BindGroup,
    pub raster: wgpu::BindGroup,
    pub deposit: wgpu::BindGroup,
    pub update: wgpu::BindGroup,
}

impl Buffers {
    /// Those that say where the iteration stands.
    pub fn state(&self) -> [&wgpu::Buffer; 5] {
        [&self.control, &self.power, &self.irradiance, &self.incoming, &self.shots]
    }

    /// Allocates and fills everything for a plan.
    pub fn new(
        gpu: &Gpu,
        pipelines: &Pipelines,
        plan: &BufferPlan,
        scene: &PatchedScene,
        settings: &ShootingSettings,
    ) -> Result<Self, DeviceError> {
        let buffers = gpu.allocating(|| Self::allocate(gpu, pipelines, plan, scene, settings))?;
        // What the driver still had is unknown; it was less than was asked for.
        buffers.ok_or_else(|| gpu.out_of_memory(plan.total_bytes(), plan.total_bytes() / 2))
    }

    fn allocate(
        gpu: &Gpu,
        pipelines: &Pipelines,
        plan: &BufferPlan,
        scene: &PatchedScene,
        settings: &ShootingSettings,
    ) -> Self {
        let allocator = Allocator(gpu);
        let target = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let atlas = allocator.texture("items", plan, ITEM_FORMAT, target | read);
        let depth = allocator.texture("depth", plan, DEPTH_FORMAT, target);
        let atlas_view = atlas.create_view(&wgpu::TextureViewDescriptor::default());
        let depth_view = depth.create_view(&wgpu::TextureViewDescriptor::default());
        let arrays = Arrays::new(allocator, plan, scene, settings);
        Self {
            select: allocator.bind(&pipelines.select, &arrays.for_select()),
            cull: allocator.bind(&pipelines.cull, &arrays.for_cull()),
            raster: allocator.bind(&pipelines.raster, &arrays.for_raster()),
            deposit: allocator.bind(&pipelines.deposit, &arrays.for_deposit(&atlas_view)),
            update: allocator.bind(&pipelines.update, &arrays.for_update()),
            control: arrays.control,
            passes: arrays.passes,
            power: arrays.power,
            irradiance: arrays.irradiance,
            incoming: arrays.incoming,
            shots: arrays.shots,
            sums: arrays.sums,
            corners: arrays.corners,
            indices: arrays.indices,
            draws: arrays.draws,
            atlas,
            atlas_view,
            depth_view,
        }
    }
}

/// Makes what is on the adapter.
#[derive(Clone, Copy)]
struct Allocator<'a>(&'a Gpu);

impl Allocator<'_> {
    fn buffer(self, label: &str, size: u64, usage: BufferUsages) -> wgpu::Buffer {
        self.0.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            // Empty scenes have empty arrays, bindings must not be.
            size: size.max(UNIFORM_STRIDE).next_multiple_of(16),
            usage: usage | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// A buffer with something in it.
    fn filled(self, label: &str, bytes: &[u8], usage: BufferUsages) -> wgpu::Buffer {
        let buffer = self.buffer(label, bytes.len() as u64, usage);
        self.0.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A texture as large as the atlas.
    fn texture(
        self,
        label: &str,
        plan: &BufferPlan,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.0.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: plan.atlas_size(),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Binds resources to the bindings from 0 on.
    fn bind(
        self,
        layout: &wgpu::BindGroupLayout,
        resources: &[wgpu::BindingResource<'_>],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = resources
            .iter()
            .cloned()
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        self.0.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        })
    }
}

/// All buffers, those too that only bindings name.
struct Arrays {
    constants: wgpu::Buffer,
    passes: wgpu::Buffer,
    control: wgpu::Buffer,
    power: wgpu::Buffer,
    patches: wgpu::Buffer,
    facets: wgpu::Buffer,
    corners: wgpu::Buffer,
    irradiance: wgpu::Buffer,
    incoming: wgpu::Buffer,
    shots: wgpu::Buffer,
    sums: wgpu::Buffer,
    views: wgpu::Buffer,
    marks: wgpu::Buffer,
    counts: wgpu::Buffer,
    indices: wgpu::Buffer,
    draws: wgpu::Buffer,
    delta: wgpu::Buffer,
}

impl Arrays {
    /// Allocates them all, and fills those that say what the scene is.
    fn new(
        allocator: Allocator<'_>,
        plan: &BufferPlan,
        scene: &PatchedScene,
        settings: &ShootingSettings,
    ) -> Self {
        let make = |label, size, usage| allocator.buffer(label, size, usage);
        let filled = |label, bytes: &[u8], usage| allocator.filled(label, bytes, usage);
        let (storage, uniform) = (BufferUsages::STORAGE, BufferUsages::UNIFORM);
        let readable = storage | BufferUsages::COPY_SRC;
        let lists = FACES as u64 * plan.pass_shots;
        let runs = plan.facet_runs();
        let marks = u64::from(FACET_RUN) * runs * plan.pass_shots;

        let constants = GpuSettings::new(scene, settings, plan.glossy as u32, plan.columns as u32);
        let patches = GpuPatch::all(scene, settings);
        let facets = GpuFacet::all(scene);
        let corners = GpuCorner::all(scene);
        let delta = DeltaFormFactors::new(settings.resolution);
        let delta = &delta.values[..delta.values.len() / 2];
        let power = make("power", 4 * plan.power_entries(), readable);
        let first_powers = GpuPatch::first_powers(&patches);
        allocator.0.queue.write_buffer(&power, 0, bytemuck::cast_slice(&first_powers));
        Self {
            constants: filled("settings", bytemuck::bytes_of(&constants), uniform),
            passes: filled("passes", &pass_uniforms(plan), uniform),
            control: make("control", CONTROL_HEADER + 16 * plan.shots, readable),
            power,
            patches: filled("patches", bytemuck::cast_slice(&patches), storage),
            facets: filled("facets", bytemuck::cast_slice(&facets), storage),
            corners: filled("corners", bytemuck::cast_slice(&corners), BufferUsages::VERTEX),
            irradiance: make("irradiance", 32 * plan.patches, readable),
            incoming: make("incoming", 16 * (plan.shots + 1) * plan.glossy, readable),
            shots: make("shots", GpuShot::SIZE * (plan.shots + plan.pass_shots), readable),
            sums: make("sums", plan.sums_bytes() * plan.pass_shots, readable),
            views: make("views", UNIFORM_STRIDE * lists, storage | uniform),
            marks: make("marks", marks, storage),
            counts: make("counts", 4 * lists * runs, storage),
            indices: make("indices", plan.index_bytes(), storage | BufferUsages::INDEX),
            draws: make("draws", DRAW_BYTES * lists, storage | BufferUsages::INDIRECT),
            delta: filled("delta form factors", bytemuck::cast_slice(delta), storage),
        }
    }

    fn for_select(&self) -> [wgpu::BindingResource<'_>; 8] {
        [
            &self.constants,
            &self.control,
            &self.power,
            &self.patches,
            &self.irradiance,
            &self.incoming,
            &self.facets,
            &self.shots,
        ]
        .map(wgpu::Buffer::as_entire_binding)
    }

    fn for_cull(&self) -> [wgpu::BindingResource<'_>; 9] {
        [
            self.constants.as_entire_binding(),
            self.pass(),
            self.shots.as_entire_binding(),
            self.views.as_entire_binding(),
            self.facets.as_entire_binding(),
            self.marks.as_entire_binding(),
            self.counts.as_entire_binding(),
            self.indices.as_entire_binding(),
            self.draws.as_entire_binding(),
        ]
    }

    fn for_raster(&self) -> [wgpu::BindingResource<'_>; 1] {
        [part(&self.views, UNIFORM_STRIDE)]
    }

    fn for_deposit<'a>(&'a self, atlas: &'a wgpu::TextureView) -> [wgpu::BindingResource<'a>; 7] {
        [
            self.constants.as_entire_binding(),
            self.pass(),
            self.shots.as_entire_binding(),
            self.facets.as_entire_binding(),
            self.delta.as_entire_binding(),
            self.sums.as_entire_binding(),
            wgpu::BindingResource::TextureView(atlas),
        ]
    }

    fn for_update(&self) -> [wgpu::BindingResource<'_>; 9] {
        [
            self.constants.as_entire_binding(),
            self.pass(),
            self.control.as_entire_binding(),
            self.power.as_entire_binding(),
            self.patches.as_entire_binding(),
            self.irradiance.as_entire_binding(),
            self.incoming.as_entire_binding(),
            self.shots.as_entire_binding(),
            self.sums.as_entire_binding(),
        ]
    }

    /// One of the passes, at an offset that is given with each dispatch.
    fn pass(&self) -> wgpu::BindingResource<'_> {
        part(&self.passes, size_of::<GpuPass>() as u64)
    }
}

/// So many bytes of a buffer, at an offset that is given with each dispatch or draw.
fn part(buffer: &wgpu::Buffer, size: u64) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer,
        offset: 0,
        size: wgpu::BufferSize::new(size),
    })
}

/// `Pass` of every render pass of an iteration, and room for one more for traced shots.
fn pass_uniforms(plan: &BufferPlan) -> Vec<u8> {
    let mut bytes = vec![0; ((plan.passes() + 1) * UNIFORM_STRIDE) as usize];
    for (index, slot) in bytes.chunks_exact_mut(UNIFORM_STRIDE as usize).enumerate() {
        let first = index as u64 * plan.pass_shots;
        let mut pass = GpuPass::zeroed();
        if first < plan.shots {
            pass.first = first as u32;
            pass.count = plan.pass_shots.min(plan.shots - first) as u32;
            pass.opens = u32::from(first == 0);
            pass.closes = u32::from(first + u64::from(pass.count) == plan.shots);
        }
        slot[..size_of::<GpuPass>()].copy_from_slice(bytemuck::bytes_of(&pass));
    }
    bytes
}
