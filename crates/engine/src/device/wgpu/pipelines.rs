//! Kernels and the layouts of their bindings; the same for every scene.

use super::formats::{DEPTH_FORMAT, ITEM_FORMAT};
use super::gpu::Gpu;
use super::layout::{GpuCorner, GpuPass};
use wgpu::ShaderStages;

/// Bytes between the dynamic uniforms of consecutive passes and faces: the largest alignment
/// that an adapter may ask for.
pub const UNIFORM_STRIDE: u64 = 256;

/// What a kernel binds at one index.
#[derive(Clone, Copy)]
enum Binding {
    Uniform,
    DynamicUniform(u64),
    Read,
    Write,
    Items,
}

/// A compute kernel's layout, shared by the entry points of one file.
struct Module {
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    shader: wgpu::ShaderModule,
}

/// Everything compiled.
pub struct Pipelines {
    /// Bindings of the kernels in `select.wgsl`.
    pub select: wgpu::BindGroupLayout,
    /// Bindings of the kernels in `cull.wgsl`.
    pub cull: wgpu::BindGroupLayout,
    /// Bindings of `raster.wgsl`.
    pub raster: wgpu::BindGroupLayout,
    /// Bindings of `deposit.wgsl`.
    pub deposit: wgpu::BindGroupLayout,
    /// Bindings of `update.wgsl`.
    pub update: wgpu::BindGroupLayout,
    /// Prefix sum over powers: runs, then groups of runs.
    pub sum_runs: wgpu::ComputePipeline,
    /// See [`Pipelines::sum_runs`].
    pub sum_groups: wgpu::ComputePipeline,
    /// Picks shooters.
    pub make_shots: wgpu::ComputePipeline,
    /// Views of the faces.
    pub make_views: wgpu::ComputePipeline,
    /// Which facets each face draws.
    pub mark_facets: wgpu::ComputePipeline,
    /// Where each run's list starts.
    pub place_runs: wgpu::ComputePipeline,
    /// Index lists.
    pub list_facets: wgpu::ComputePipeline,
    /// Item buffers.
    pub draw: wgpu::RenderPipeline,
    /// Form-factor sums.
    pub deposit_items: wgpu::ComputePipeline,
    /// Incoming light and next powers.
    pub update_patches: wgpu::ComputePipeline,
}

const COMMON: &str = include_str!("common.wgsl");
const REFLECTION: &str = include_str!("reflection.wgsl");
const LOBE: &str = include_str!("lobe.wgsl");

impl Pipelines {
    /// Compiles all kernels.
    pub fn new(gpu: &Gpu) -> Self {
        use Binding::{DynamicUniform, Items, Read, Uniform, Write};
        let pass = DynamicUniform(size_of::<GpuPass>() as u64);
        let select = module(
            gpu,
            "select",
            &[COMMON, REFLECTION, include_str!("random.wgsl"), include_str!("select.wgsl")],
            &[Uniform, Write, Write, Read, Read, Read, Read, Write],
        );
        let cull = module(
            gpu,
            "cull",
            &[COMMON, include_str!("cull.wgsl")],
            &[Uniform, pass, Read, Write, Read, Write, Write, Write, Write],
        );
        let deposit = module(
            gpu,
            "deposit",
            &[COMMON, LOBE, include_str!("deposit.wgsl")],
            &[Uniform, pass, Read, Read, Read, Write, Items],
        );
        let update = module(
            gpu,
            "update",
            &[COMMON, REFLECTION, LOBE, include_str!("update.wgsl")],
            &[Uniform, pass, Write, Write, Read, Write, Write, Read, Write],
        );
        let (raster, draw) = raster(gpu);
        Self {
            sum_runs: compute(gpu, &select, "sum_runs"),
            sum_groups: compute(gpu, &select, "sum_groups"),
            make_shots: compute(gpu, &select, "make_shots"),
            make_views: compute(gpu, &cull, "make_views"),
            mark_facets: compute(gpu, &cull, "mark_facets"),
            place_runs: compute(gpu, &cull, "place_runs"),
            list_facets: compute(gpu, &cull, "list_facets"),
            draw,
            deposit_items: compute(gpu, &deposit, "deposit"),
            update_patches: compute(gpu, &update, "update"),
            select: select.layout,
            cull: cull.layout,
            raster,
            deposit: deposit.layout,
            update: update.layout,
        }
    }
}

fn bind_group_layout(
    gpu: &Gpu,
    label: &str,
    stages: ShaderStages,
    bindings: &[Binding],
) -> wgpu::BindGroupLayout {
    let buffer = |ty, has_dynamic_offset, size| wgpu::BindingType::Buffer {
        ty,
        has_dynamic_offset,
        min_binding_size: wgpu::BufferSize::new(size),
    };
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let entries: Vec<_> = bindings
        .iter()
        .zip(0..)
        .map(|(kind, binding)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: stages,
            ty: match *kind {
                Binding::Uniform => buffer(wgpu::BufferBindingType::Uniform, false, 0),
                Binding::DynamicUniform(size) => {
                    buffer(wgpu::BufferBindingType::Uniform, true, size)
                }
                Binding::Read => buffer(storage(true), false, 0),
                Binding::Write => buffer(storage(false), false, 0),
                Binding::Items => wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Uint,
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &entries,
    })
}

fn shader(gpu: &Gpu, label: &str, parts: &[&str]) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(parts.concat().into()),
    })
}

fn module(gpu: &Gpu, label: &str, parts: &[&str], bindings: &[Binding]) -> Module {
    let layout = bind_group_layout(gpu, label, ShaderStages::COMPUTE, bindings);
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    Module { layout, pipeline_layout, shader: shader(gpu, label, parts) }
}

fn compute(gpu: &Gpu, module: &Module, entry_point: &str) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&module.pipeline_layout),
        module: &module.shader,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

fn raster(gpu: &Gpu) -> (wgpu::BindGroupLayout, wgpu::RenderPipeline) {
    let bindings = [Binding::DynamicUniform(UNIFORM_STRIDE)];
    let layout = bind_group_layout(gpu, "raster", ShaderStages::VERTEX, &bindings);
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("raster"),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let module = shader(gpu, "raster", &[COMMON, include_str!("raster.wgsl")]);
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("raster"),
        layout: Some(&pipeline_layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: GpuCorner::SIZE,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32],
            })],
        },
        primitive: wgpu::PrimitiveState {
            // The near plane, close to the eye as it is, also ends triangles that go on
            // behind it. Without it, by `unclipped_depth`, NVIDIA's driver drops those whole.
            unclipped_depth: false,
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("pixel"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(ITEM_FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    (layout, pipeline)
}
