//! The iteration under way: encodes passes, keeps submissions short, reads back.

use super::buffers::{BufferPlan, Buffers, DRAW_BYTES, TALLY_WORDS, THREADS};
use super::gpu::Gpu;
use super::layout::{FACET_RUN, GpuPass, GpuShot, PIXEL_RUN, SPAN, triples};
use super::pipelines::{Pipelines, UNIFORM_STRIDE};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::{DeviceError, Shooting, ShootingSettings, ShotTrace, Sums, Tally};
use crate::hemicube::{FACES, Face, Shot};
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Says that a wgpu device wrote a state.
const WGPU: u32 = 0x57_47_50_55;
/// A submission can't be cancelled, so it should take about this long.
const SUBMISSION: Duration = Duration::from_millis(50);

/// An iteration under way.
pub struct WgpuShooting<'device> {
    gpu: &'device Gpu,
    pipelines: &'device Pipelines,
    scene: Arc<PatchedScene>,
    settings: ShootingSettings,
    plan: BufferPlan,
    buffers: Buffers,
    tally_staging: wgpu::Buffer,
    /// Render passes per submission that take about [`SUBMISSION`].
    batch: u64,
    /// Iterations since the last drain.
    summed: u64,
}

/// What traced shots leave on the adapter.
struct Traced {
    /// Item codes of all their hemicubes.
    atlas: Vec<u32>,
    /// Words of a row of them.
    row_words: usize,
    /// Form-factor sums, fixed-point.
    sums: Vec<u32>,
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
        let plan = BufferPlan::new(gpu, &scene, settings)?;
        Self::planned(gpu, pipelines, scene, settings, plan)
    }

    fn planned(
        gpu: &'device Gpu,
        pipelines: &'device Pipelines,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
        plan: BufferPlan,
    ) -> Result<Self, DeviceError> {
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

    /// Submits the passes of whole iterations, one submission ahead of the one that runs.
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
                since = self.finish(earlier, passes, since)?;
            }
        }
        if let Some((last, passes)) = running {
            self.finish(last, passes, since)?;
        }
        Ok(())
    }

    /// Waits for a submission that has run since about `since`, learns from it how many passes
    /// make one of the right length, and says when it was done.
    fn finish(
        &mut self,
        submission: wgpu::SubmissionIndex,
        passes: u64,
        since: Instant,
    ) -> Result<Instant, DeviceError> {
        self.gpu.wait(submission)?;
        let now = Instant::now();
        let rate = passes as f64 / (now - since).as_secs_f64().max(1e-6);
        let fitting = (rate * SUBMISSION.as_secs_f64()) as u64;
        self.batch = fitting.clamp(1, 2 * self.batch);
        Ok(now)
    }

    /// Traces at most as many shots as share a render pass.
    fn trace_some(&self, shots: &[Shot]) -> Result<Vec<ShotTrace>, DeviceError> {
        let (plan, buffers, count) = (&self.plan, &self.buffers, shots.len() as u32);
        let (packed, units): (Vec<_>, Vec<_>) = shots.iter().map(GpuShot::new).unzip();
        let group = GpuPass { first: plan.shots as u32, count, opens: 0, closes: 0 };
        let pass = plan.passes();
        let queue = &self.gpu.queue;
        queue.write_buffer(
            &buffers.shots,
            GpuShot::SIZE * plan.shots,
            bytemuck::cast_slice(&packed),
        );
        queue.write_buffer(&buffers.passes, pass * UNIFORM_STRIDE, bytemuck::bytes_of(&group));

        let mut encoder = self.encoder();
        self.encode_culling(&mut encoder.begin_compute_pass(&Default::default()), pass, count);
        self.encode_drawing(&mut encoder, count);
        self.encode_deposit(&mut encoder.begin_compute_pass(&Default::default()), pass, count);
        let traced = self.read_traced(encoder, count)?;
        Ok(units.iter().zip(0..).map(|(unit, slot)| self.trace_of(&traced, slot, *unit)).collect())
    }

    /// Submits, and reads and clears what `count` traced shots have left.
    fn read_traced(
        &self,
        mut encoder: wgpu::CommandEncoder,
        count: u32,
    ) -> Result<Traced, DeviceError> {
        let (plan, buffers) = (&self.plan, &self.buffers);
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
        let mut atlas = self.gpu.read(encoder, &staging)?;
        let sums = atlas.split_off(atlas_bytes as usize / 4);
        Ok(Traced { atlas, row_words: row_bytes as usize / 4, sums })
    }

    /// The item buffer of one of the traced shots, and its sums, of which `unit` is one
    /// fixed-point unit.
    fn trace_of(&self, traced: &Traced, slot: usize, unit: f32) -> ShotTrace {
        let plan = &self.plan;
        let (patches, planes) = (plan.patches as usize, plan.planes() as usize);
        let sums_of = |plane: usize| {
            let start = (slot * planes + plane) * patches;
            traced.sums[start..start + patches].iter().map(|sum| *sum as f32 * unit).collect()
        };
        let resolution = self.settings.resolution as usize;
        let (left, top) = plan.tile(slot as u64);
        let rows = traced.atlas.chunks_exact(traced.row_words).skip(top as usize);
        ShotTrace {
            items: rows
                .take(3 * resolution)
                .flat_map(|row| &row[left as usize..left as usize + resolution])
                .copied()
                .collect(),
            form_factor: sums_of(0),
            lobe_factor: match planes {
                2 => sums_of(1),
                _ => vec![0.0; patches],
            },
        }
    }

    /// All words of a buffer.
    fn read_whole(&self, buffer: &wgpu::Buffer) -> Result<Vec<u32>, DeviceError> {
        let staging = self.gpu.staging(buffer.size())?;
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        self.gpu.read(encoder, &staging)
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
        if let Some(known) = &self.settings.known {
            for (sum, known) in sums.irradiance.iter_mut().zip(&known.irradiance) {
                *sum += *known * iterations as f32;
            }
        }
        if seen {
            let mut lobes = triples(lobes);
            let all = &self.scene.patches;
            let of = |patch| if all.is_glossy(patch) { lobes.next() } else { None };
            sums.glossy = (0..all.len()).map(of).map(|sum| sum.unwrap_or(Rgb::ZERO)).collect();
        }
        Ok(sums)
    }

    fn save(&mut self, to: &mut Writer) -> Result<(), DeviceError> {
        self.gpu.check()?;
        to.value(WGPU);
        to.slice(self.gpu.description.name.as_bytes());
        to.value(self.summed);
        for buffer in self.buffers.state() {
            to.slice(&self.read_whole(buffer)?);
        }
        Ok(())
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<u64, DeviceError> {
        self.gpu.check()?;
        if from.value::<u32>()? != WGPU
            || from.slice::<u8>()? != self.gpu.description.name.as_bytes()
        {
            let here = &self.gpu.description.name;
            return Err(CheckpointError::foreign(format!("another device, not {here}")).into());
        }
        self.summed = from.count(1 << 48)?;
        for buffer in self.buffers.state() {
            let words: Vec<u32> = from.exactly((buffer.size() / 4) as usize)?;
            self.gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&words));
        }
        self.gpu.wait(self.gpu.submit(self.encoder())?)?;
        Ok(self.summed)
    }

    fn shooters(&mut self) -> Result<Vec<u32>, DeviceError> {
        self.gpu.check()?;
        if self.is_empty() {
            return Ok(Vec::new());
        }
        let bytes = GpuShot::SIZE * self.plan.shots;
        let staging = self.gpu.staging(bytes)?;
        let mut encoder = self.encoder();
        encoder.copy_buffer_to_buffer(&self.buffers.shots, 0, &staging, 0, bytes);
        let words = self.gpu.read(encoder, &staging)?;
        Ok(GpuShot::shooters(&words).collect())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Device;
    use crate::device::wgpu::{WgpuDevice, list};
    use crate::sampling::frame;
    use crate::scene::{Material, Scene, Triangle, Vertex};
    use glam::{Vec2, Vec3};

    /// `None` where the environment says to do without an adapter.
    fn open() -> Option<WgpuDevice> {
        if std::env::var_os("HEMILUX_NO_WGPU").is_some_and(|value| value == "1") {
            println!("skipped: HEMILUX_NO_WGPU=1");
            return None;
        }
        let adapters = list();
        let first = adapters.first().expect("a wgpu adapter, or HEMILUX_NO_WGPU=1 to skip");
        Some(WgpuDevice::open(first.id.parse().expect("an index")).expect("the adapter opens"))
    }

    /// A shining triangle and one that faces it.
    fn lamp() -> Arc<PatchedScene> {
        let corner = |position| Vertex::new(position, Vec3::Z);
        let up = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let down = [Vec3::ZERO, Vec3::Y, Vec3::X].map(|position| position + Vec3::Z);
        let shining = Material { emission: Rgb::ONE, ..Material::default() };
        let scene = Scene {
            vertices: up.into_iter().chain(down).map(corner).collect(),
            triangles: vec![
                Triangle { vertices: [0, 1, 2], material: 0 },
                Triangle { vertices: [3, 4, 5], material: 1 },
            ],
            materials: vec![shining, Material::default()],
            ..Scene::default()
        };
        Arc::new(PatchedScene::new(Arc::new(scene), 100))
    }

    fn settings() -> ShootingSettings {
        ShootingSettings {
            resolution: 32,
            shots_per_iteration: 2,
            seed: 1,
            ..ShootingSettings::default()
        }
    }

    #[test]
    fn shots_that_share_a_pass_do_not_change_the_result() {
        let Some(device) = open() else { return };
        let settings = ShootingSettings { shots_per_iteration: 7, ..settings() };
        let scene = lamp();
        let shots: Vec<_> = (0..7)
            .map(|k| {
                let (tangent, bitangent) = frame(Vec3::Z, k as f32);
                Shot {
                    patch: k,
                    position: scene.patches.centroid[k as usize],
                    tangent,
                    bitangent,
                    jitter: Vec2::splat(0.1 * k as f32 - 0.4),
                    lobe: Rgb::ONE,
                    exponent: 3.0,
                    ..Shot::default()
                }
            })
            .collect();
        let run = |pass_shots, columns| {
            let plan = BufferPlan::new(&device.gpu, &scene, &settings).expect("fits");
            let plan = BufferPlan { pass_shots, columns, ..plan };
            let (gpu, pipelines) = (&device.gpu, &device.pipelines);
            let shooting = WgpuShooting::planned(gpu, pipelines, scene.clone(), &settings, plan);
            let mut shooting = shooting.expect("begins");
            shooting.iterate(6).expect("iterates");
            let sums = shooting.drain().expect("drains").irradiance;
            let traces = shooting.trace(&shots).expect("traces");
            let traces: Vec<_> =
                traces.into_iter().map(|t| (t.items, t.form_factor, t.lobe_factor)).collect();
            (sums, traces)
        };
        let alone = run(1, 1);
        assert!(alone.0.iter().any(|e| e.x > 0.0));
        assert!(alone.1.iter().all(|trace| trace.2.iter().any(|sum| *sum > 0.0)));
        for (pass_shots, columns) in [(7, 7), (5, 2), (3, 1)] {
            assert!(alone == run(pass_shots, columns), "{pass_shots} in {columns} columns");
        }
    }

    #[test]
    fn a_lost_device_says_so_and_stays_lost() {
        let Some(mut device) = open() else { return };
        let native = device.gpu.device.clone();
        let mut shooting = device.begin(lamp(), &settings()).expect("begins");
        shooting.iterate(2).expect("iterates");
        native.destroy();
        for _ in 0..2 {
            let lost = shooting.iterate(2).expect_err("there is no device");
            assert!(matches!(lost, DeviceError::Lost { .. }), "{lost}");
        }
        assert!(matches!(shooting.drain(), Err(DeviceError::Lost { .. })));
        assert!(matches!(shooting.trace(&[]), Err(DeviceError::Lost { .. })));
        drop(shooting);
        let again = device.begin(lamp(), &settings()).err().expect("it stays lost");
        assert!(matches!(again, DeviceError::Lost { .. }), "{again}");
    }

    #[test]
    fn an_invalid_command_is_reported_not_a_panic() {
        let Some(mut device) = open() else { return };
        let native = device.gpu.device.clone();
        let invalid = || {
            native.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: 4,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        assert!(device.gpu.guarded(invalid).is_err());
        let mut shooting = device.begin(lamp(), &settings()).expect("a caught error harms nothing");
        shooting.iterate(1).expect("iterates");
        let _uncaught = invalid();
        let lost = shooting.iterate(1).expect_err("the error is seen");
        assert!(lost.to_string().contains("usage"), "{lost}");
    }

    #[test]
    fn what_does_not_fit_is_refused_before_it_is_allocated() {
        let Some(mut device) = open() else { return };
        for (resolution, shots_per_iteration) in [(u32::MAX - 1, 1), (1 << 20, 1), (32, u32::MAX)] {
            let settings = ShootingSettings { resolution, shots_per_iteration, ..settings() };
            match device.begin(lamp(), &settings).err() {
                Some(DeviceError::OutOfMemory { needed_bytes, available_bytes, .. }) => {
                    assert!(needed_bytes > available_bytes);
                }
                other => panic!("{other:?}"),
            }
        }
        device
            .begin(lamp(), &settings())
            .expect("the device still works")
            .iterate(1)
            .expect("runs");
    }

    #[test]
    fn an_unknown_adapter_is_refused() {
        assert!(matches!(WgpuDevice::open(1000), Err(DeviceError::Unknown(_))));
    }
}
