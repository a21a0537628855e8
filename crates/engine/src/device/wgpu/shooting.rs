//! The iteration under way: encodes passes, keeps submissions short, reads back.

use super::buffers::{Buffers, DRAW_BYTES, Plan, TALLY_WORDS};
use super::gpu::Gpu;
use super::layout::{FACET_RUN, GpuPass, GpuShot, PIXEL_RUN, SPAN, triples};
use super::pipelines::{Pipelines, UNIFORM_STRIDE};
use crate::device::{DeviceError, Shooting, ShootingSettings, ShotTrace, Sums, Tally};
use crate::hemicube::{FACES, Face, Shot};
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Item codes.
pub const ITEM_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Inverse depth.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A submission can't be cancelled, so it should take about this long.
const SUBMISSION: Duration = Duration::from_millis(50);
const THREADS: u32 = 64;

/// An iteration under way.
pub struct WgpuShooting<'device> {
    gpu: &'device Gpu,
    pipelines: &'device Pipelines,
    scene: Arc<PatchedScene>,
    settings: ShootingSettings,
    plan: Plan,
    buffers: Buffers,
    tally_staging: wgpu::Buffer,
    /// Render passes per submission that take about [`SUBMISSION`].
    batch: u64,
    /// Iterations since the last drain.
    summed: u64,
}

impl<'device> WgpuShooting<'device> {
    /// Uploads the scene and starts at L(0) = L^e.
    pub fn new(
        gpu: &'device Gpu,
        pipelines: &'device Pipelines,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Result<Self, DeviceError> {
        gpu.check()?;
        let plan = Plan::new(gpu, &scene, settings)?;
        let buffers = Buffers::new(gpu, pipelines, &plan, &scene, settings)?;
        let tally_staging = gpu.staging(4 * TALLY_WORDS)?;
        let settings = settings.clone();
        let shooting = Self {
            gpu,
            pipelines,
            scene,
            settings,
            plan,
            buffers,
            tally_staging,
            batch: 1,
            summed: 0,
        };
        let mut encoder = shooting.encoder();
        shooting.encode_sums_of_power(&mut encoder.begin_compute_pass(&Default::default()));
        gpu.wait(gpu.submit(encoder)?)?;
        Ok(shooting)
    }

    fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu.device.create_command_encoder(&Default::default())
    }

    fn encode_sums_of_power(&self, compute: &mut wgpu::ComputePass<'_>) {
        let runs = (self.plan.patches as u32).div_ceil(SPAN);
        compute.set_bind_group(0, &self.buffers.select, &[]);
        compute.set_pipeline(&self.pipelines.sum_runs);
        compute.dispatch_workgroups(runs.div_ceil(THREADS), 1, 1);
        compute.set_pipeline(&self.pipelines.sum_groups);
        compute.dispatch_workgroups(runs.div_ceil(SPAN).div_ceil(THREADS), 1, 1);
    }

    /// Picks the shooters of the next iteration.
    fn encode_selection(&self, compute: &mut wgpu::ComputePass<'_>) {
        compute.set_bind_group(0, &self.buffers.select, &[]);
        compute.set_pipeline(&self.pipelines.make_shots);
        compute.dispatch_workgroups(self.settings.shots_per_iteration.div_ceil(THREADS), 1, 1);
    }

    /// Lists the facets that each face of `count` hemicubes draws.
    fn encode_culling(&self, compute: &mut wgpu::ComputePass<'_>, pass: u64, count: u32) {
        let runs = (self.plan.facets as u32).div_ceil(FACET_RUN).div_ceil(THREADS);
        let lists = count * FACES as u32;
        compute.set_bind_group(0, &self.buffers.cull, &[(pass * UNIFORM_STRIDE) as u32]);
        compute.set_pipeline(&self.pipelines.make_views);
        compute.dispatch_workgroups(lists.div_ceil(THREADS), 1, 1);
        compute.set_pipeline(&self.pipelines.mark_facets);
        compute.dispatch_workgroups(runs, count, 1);
        compute.set_pipeline(&self.pipelines.place_runs);
        compute.dispatch_workgroups(lists, 1, 1);
        compute.set_pipeline(&self.pipelines.list_facets);
        compute.dispatch_workgroups(runs, count, 1);
    }

    /// Draws `count` item buffers.
    fn encode_drawing(&self, encoder: &mut wgpu::CommandEncoder, count: u32) {
        let mut render = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("items"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.buffers.atlas_view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.buffers.depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        render.set_pipeline(&self.pipelines.draw);
        render.set_vertex_buffer(0, self.buffers.corners.slice(..));
        render.set_index_buffer(self.buffers.indices.slice(..), wgpu::IndexFormat::Uint32);
        let resolution = self.settings.resolution;
        for slot in 0..u64::from(count) {
            let (left, top) = self.plan.tile(slot);
            for (face, index) in Face::ALL.into_iter().zip(0..) {
                let list = slot * FACES as u64 + index;
                let (first, rows) = (top + face.first_row(resolution), face.rows(resolution));
                let (x, y) = (left as f32, first as f32);
                render.set_viewport(x, y, resolution as f32, rows as f32, 0.0, 1.0);
                render.set_scissor_rect(left, first, resolution, rows);
                render.set_bind_group(0, &self.buffers.raster, &[(list * UNIFORM_STRIDE) as u32]);
                render.draw_indexed_indirect(&self.buffers.draws, list * DRAW_BYTES);
            }
        }
    }

    /// Sums form factors over `count` item buffers.
    fn encode_deposit(&self, compute: &mut wgpu::ComputePass<'_>, pass: u64, count: u32) {
        let resolution = self.settings.resolution;
        let runs = 3 * resolution * resolution.div_ceil(PIXEL_RUN);
        compute.set_bind_group(0, &self.buffers.deposit, &[(pass * UNIFORM_STRIDE) as u32]);
        compute.set_pipeline(&self.pipelines.deposit_items);
        compute.dispatch_workgroups(runs.div_ceil(THREADS), count, 1);
    }

    fn encode_update(&self, compute: &mut wgpu::ComputePass<'_>, pass: u64) {
        compute.set_bind_group(0, &self.buffers.update, &[(pass * UNIFORM_STRIDE) as u32]);
        compute.set_pipeline(&self.pipelines.update_patches);
        compute.dispatch_workgroups((self.plan.patches as u32).div_ceil(THREADS), 1, 1);
    }

    /// One render pass of an iteration with everything before and behind it.
    fn encode_pass(&self, encoder: &mut wgpu::CommandEncoder, pass: u64) {
        let first = pass * self.plan.pass_shots;
        let count = self.plan.pass_shots.min(self.plan.shots - first) as u32;
        {
            let mut compute = encoder.begin_compute_pass(&Default::default());
            if pass == 0 {
                self.encode_selection(&mut compute);
            }
            self.encode_culling(&mut compute, pass, count);
        }
        self.encode_drawing(encoder, count);
        let mut compute = encoder.begin_compute_pass(&Default::default());
        self.encode_deposit(&mut compute, pass, count);
        self.encode_update(&mut compute, pass);
        if pass + 1 == self.plan.passes() {
            self.encode_sums_of_power(&mut compute);
        }
    }

    /// Submits the passes of whole iterations, two submissions ahead at most, and learns how many
    /// passes make a submission of the right length.
    fn submit_passes(&mut self, count: u64) -> Result<(), DeviceError> {
        let mut done = 0;
        let mut running: Option<(wgpu::SubmissionIndex, u64)> = None;
        let mut since = Instant::now();
        while done < count {
            let batch = self.batch.min(count - done);
            let mut encoder = self.encoder();
            for pass in done..done + batch {
                self.encode_pass(&mut encoder, pass % self.plan.passes());
            }
            done += batch;
            let submission = self.gpu.submit(encoder)?;
            if let Some((earlier, passes)) = running.replace((submission, batch)) {
                self.gpu.wait(earlier)?;
                let rate = passes as f64 / since.elapsed().as_secs_f64().max(1e-6);
                since = Instant::now();
                let fitting = (rate * SUBMISSION.as_secs_f64()) as u64;
                self.batch = fitting.clamp(1, 2 * passes);
            }
        }
        if let Some((last, _)) = running {
            self.gpu.wait(last)?;
        }
        Ok(())
    }

    /// Traces at most as many shots as share a render pass.
    fn trace_some(&self, shots: &[Shot]) -> Result<Vec<ShotTrace>, DeviceError> {
        let (plan, buffers, count) = (&self.plan, &self.buffers, shots.len() as u32);
        let (packed, units): (Vec<_>, Vec<_>) = shots.iter().map(GpuShot::new).unzip();
        let group = GpuPass { first: 0, count, opens: 0, closes: 0 };
        let pass = plan.passes();
        let queue = &self.gpu.queue;
        queue.write_buffer(&buffers.shots, 0, bytemuck::cast_slice(&packed));
        queue.write_buffer(&buffers.passes, pass * UNIFORM_STRIDE, bytemuck::bytes_of(&group));

        let mut encoder = self.encoder();
        self.encode_culling(&mut encoder.begin_compute_pass(&Default::default()), pass, count);
        self.encode_drawing(&mut encoder, count);
        self.encode_deposit(&mut encoder.begin_compute_pass(&Default::default()), pass, count);

        let size = plan.atlas_size();
        let row_bytes = (4 * size.width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let atlas_bytes = u64::from(row_bytes) * u64::from(size.height);
        let sums_bytes = plan.sums_bytes() * u64::from(count);
        let staging = self.gpu.staging(atlas_bytes + sums_bytes)?;
        encoder.copy_texture_to_buffer(
            buffers.atlas.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row_bytes),
                    rows_per_image: Some(size.height),
                },
            },
            size,
        );
        encoder.copy_buffer_to_buffer(&buffers.sums, 0, &staging, atlas_bytes, sums_bytes);
        encoder.clear_buffer(&buffers.sums, 0, Some(sums_bytes));
        let words = self.gpu.read(encoder, &staging)?;

        let (items, sums) = words.split_at(atlas_bytes as usize / 4);
        let sums_of = |slot: usize, plane: usize| {
            let patches = plan.patches as usize;
            let start = (slot * plan.planes() as usize + plane) * patches;
            let unit = units[slot];
            sums[start..start + patches].iter().map(move |sum| *sum as f32 * unit).collect()
        };
        let resolution = self.settings.resolution as usize;
        let trace = |slot: usize| {
            let (left, top) = plan.tile(slot as u64);
            let rows = items.chunks_exact(row_bytes as usize / 4).skip(top as usize);
            ShotTrace {
                items: rows
                    .take(3 * resolution)
                    .flat_map(|row| &row[left as usize..left as usize + resolution])
                    .copied()
                    .collect(),
                form_factor: sums_of(slot, 0),
                lobe_factor: match plan.planes() {
                    2 => sums_of(slot, 1),
                    _ => vec![0.0; plan.patches as usize],
                },
            }
        };
        Ok((0..shots.len()).map(trace).collect())
    }

    /// Whether there is nothing to draw and nothing to light.
    fn is_empty(&self) -> bool {
        self.plan.patches == 0
    }
}

impl Shooting for WgpuShooting<'_> {
    fn iterate(&mut self, iterations: u32) -> Result<Tally, DeviceError> {
        self.gpu.check()?;
        self.summed += u64::from(iterations);
        if self.is_empty() {
            return Ok(Tally { iterations: iterations.into(), ..Tally::default() });
        }
        self.submit_passes(u64::from(iterations) * self.plan.passes())?;
        let mut encoder = self.encoder();
        let bytes = 4 * TALLY_WORDS;
        encoder.copy_buffer_to_buffer(&self.buffers.control, 0, &self.tally_staging, 0, bytes);
        encoder.clear_buffer(&self.buffers.control, 0, Some(bytes));
        let words = self.gpu.read(encoder, &self.tally_staging)?;
        let [iterations, shots, light_shots] = [0, 1, 2].map(|word| u64::from(words[word]));
        Ok(Tally { iterations, shots, light_shots })
    }

    fn drain(&mut self) -> Result<Sums, DeviceError> {
        self.gpu.check()?;
        let iterations = std::mem::take(&mut self.summed);
        let (patches, glossy) = (self.plan.patches, self.plan.glossy);
        let seen = self.settings.viewpoint.is_some() && glossy > 0;
        if self.is_empty() {
            return Ok(Sums { iterations, ..Sums::default() });
        }
        let staging = self.gpu.staging(16 * (patches + glossy))?;
        let mut encoder = self.encoder();
        let mut take = |buffer, start: u64, to: u64, size: u64| {
            if size > 0 {
                encoder.copy_buffer_to_buffer(buffer, 16 * start, &staging, 16 * to, 16 * size);
                encoder.clear_buffer(buffer, 16 * start, Some(16 * size));
            }
        };
        take(&self.buffers.irradiance, patches, 0, patches);
        take(&self.buffers.incoming, self.plan.shots * glossy, patches, glossy);
        let words = self.gpu.read(encoder, &staging)?;
        let (irradiance, lobes) = words.split_at(4 * patches as usize);
        let mut sums =
            Sums { iterations, irradiance: triples(irradiance).collect(), glossy: vec![] };
        if seen {
            let mut lobes = triples(lobes);
            let all = &self.scene.patches;
            let of = |patch| if all.is_glossy(patch) { lobes.next() } else { None };
            sums.glossy = (0..all.len()).map(of).map(|sum| sum.unwrap_or(Rgb::ZERO)).collect();
        }
        Ok(sums)
    }

    fn trace(&mut self, shots: &[Shot]) -> Result<Vec<ShotTrace>, DeviceError> {
        self.gpu.check()?;
        if self.is_empty() {
            let items = vec![0; self.plan.pixels() as usize];
            let blank = ShotTrace { items, form_factor: vec![], lobe_factor: vec![] };
            return Ok(vec![blank; shots.len()]);
        }
        let mut traces = Vec::with_capacity(shots.len());
        for some in shots.chunks(self.plan.pass_shots as usize) {
            traces.extend(self.trace_some(some)?);
        }
        Ok(traces)
    }
}
