//! Stochastic iteration on the CPU: select, shoot, update (Antal eq. 2, 4).

use super::kernel;
use super::raster::Raster;
use crate::checkpoint::{Reader, Writer};
use crate::device::{
    DeviceError, Shooting, ShootingSettings, ShotTrace, Substitute, Sums, Tally, VarianceReduction,
    Viewpoint, known_power, sources,
};
use crate::hemicube::{DeltaFormFactors, FACES, Shot};
use crate::patches::{PatchedScene, Patches};
use crate::radiometry::{LobeAlbedo, Rgb, importance};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::sync::{Arc, Mutex, TryLockError};

/// Patches per task of an update.
const CHUNK: usize = 2048;
/// Faces that are rendered by one task each, where an iteration has a single shot: as many pixels
/// in one as in the other. The cut does not depend on the threads, so the bits don't either.
const HALVES: [[f32; FACES]; 2] = [[1.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 1.0]];

/// Incoming light of the last iteration and sums over all of them.
pub struct State {
    /// Whole iterations done.
    pub iteration: u64,
    /// Per patch: Σ_k E_k of the last iteration, without known light.
    pub irradiance: Vec<Rgb>,
    /// Positions that the last iteration's shots came from.
    pub sources: Vec<Vec3>,
    /// Per glossy patch and shot: E_k of the last iteration, K values a patch; known light
    /// included.
    pub incoming: Vec<Rgb>,
    /// Importance of each patch's power, and its running sum.
    pub power: Vec<f32>,
    pub cumulative: Vec<f64>,
    /// Patches that shot in the last iteration.
    pub shooters: Vec<u32>,
    pub sums: Sums,
}

impl State {
    /// Nothing yet, of so many patches, values in rows of glossy ones and shots; `seen` where lobes
    /// towards a viewer are summed.
    fn new(patches: usize, row_values: usize, shots: usize, seen: bool) -> Self {
        Self {
            iteration: 0,
            irradiance: vec![Rgb::ZERO; patches],
            sources: vec![Vec3::ZERO; shots],
            incoming: vec![Rgb::ZERO; row_values],
            power: vec![0.0; patches],
            cumulative: vec![0.0; patches],
            shooters: Vec::new(),
            sums: Sums {
                iterations: 0,
                irradiance: vec![Rgb::ZERO; patches],
                glossy: vec![Rgb::ZERO; if seen { patches } else { 0 }],
            },
        }
    }

    /// Cuts what an iteration changes into ranges of [`CHUNK`] patches.
    fn ranges(&mut self, glossy_row: &[u32], shot_count: usize) -> Vec<PatchRange<'_>> {
        let seen = !self.sums.glossy.is_empty();
        // Glossy rows ascend with the patch index, so each range of patches owns consecutive rows.
        let mut incoming = self.incoming.as_mut_slice();
        let mut glossy_sums = self.sums.glossy.as_mut_slice();
        let by_patch = (self.irradiance.chunks_mut(CHUNK))
            .zip(self.power.chunks_mut(CHUNK))
            .zip(self.sums.irradiance.chunks_mut(CHUNK));
        let mut ranges = Vec::new();
        for (index, ((irradiance, power), sum)) in by_patch.enumerate() {
            let start = index * CHUNK;
            let rows = &glossy_row[start..start + irradiance.len()];
            let rows = rows.iter().filter(|row| **row != NOT_GLOSSY).count();
            let (own, rest) = incoming.split_at_mut(rows * shot_count);
            incoming = rest;
            let (own_glossy, rest) =
                glossy_sums.split_at_mut(if seen { irradiance.len() } else { 0 });
            glossy_sums = rest;
            let (incoming, glossy_sums) = (own, own_glossy);
            ranges.push(PatchRange { start, irradiance, power, sum, incoming, glossy_sums });
        }
        ranges
    }
}

/// The parts of [`State`] that an iteration changes, for a range of consecutive patches.
struct PatchRange<'a> {
    /// The first patch.
    start: usize,
    irradiance: &'a mut [Rgb],
    power: &'a mut [f32],
    /// Sums of irradiance over all iterations.
    sum: &'a mut [Rgb],
    /// Rows of its glossy patches.
    incoming: &'a mut [Rgb],
    /// Sums of lobes towards the viewer; empty without one.
    glossy_sums: &'a mut [Rgb],
}

/// Per-shot sums over the patches.
struct ShotSums {
    form_factor: Vec<f32>,
    lobe_factor: Vec<f32>,
}

/// What the patches get from the shots of one iteration.
struct Update<'a> {
    patches: &'a Patches,
    /// The shots, none where there is nothing to shoot.
    shots: &'a [Shot],
    /// K, how many there may be.
    most_shots: usize,
    shot_sums: &'a [ShotSums],
    glossy_row: &'a [u32],
    source: &'a [Rgb],
    known_power: &'a [f32],
    /// The viewer whom glossy patches reflect light to, if it is to be summed.
    viewpoint: Option<Viewpoint>,
}

impl Update<'_> {
    /// Irradiance of a range by all shots.
    fn add_irradiance(&self, range: &mut PatchRange<'_>) {
        let (start, areas) = (range.start, &self.patches.area);
        range.irradiance.fill(Rgb::ZERO);
        for (shot, sums) in self.shots.iter().zip(self.shot_sums) {
            let diffuse = shot.diffuse * (shot.scale * PI);
            for (offset, total) in range.irradiance.iter_mut().enumerate() {
                let i = start + offset;
                *total += diffuse * (sums.form_factor[i] / areas[i]);
            }
            if shot.has_lobe() {
                let lobe = shot.lobe * (shot.scale * PI);
                for (offset, total) in range.irradiance.iter_mut().enumerate() {
                    let i = start + offset;
                    *total += lobe * (sums.lobe_factor[i] / areas[i]);
                }
            }
        }
    }

    /// Adds that to the sums, and finds the power that each patch of the range would shoot.
    fn add_up(&self, range: PatchRange<'_>) {
        let PatchRange { start, irradiance, power, sum, incoming, glossy_sums } = range;
        let patches = self.patches;
        let mut rows = incoming.chunks_mut(self.most_shots);
        for offset in 0..irradiance.len() {
            let i = start + offset;
            let mut reflected = patches.diffuse[i] * irradiance[offset];
            if self.glossy_row[i] != NOT_GLOSSY {
                let row = rows.next().expect("one row a glossy patch");
                self.reflect(i, row, &mut reflected, glossy_sums.get_mut(offset));
            }
            sum[offset] += irradiance[offset];
            let known = self.known_power.get(i).copied().unwrap_or(0.0);
            power[offset] = importance(patches.area[i] * (PI * self.source[i] + reflected)) + known;
        }
    }

    /// Of the glossy patch i, the irradiance by each shot, what its lobe reflects of them, and what
    /// of that goes towards the viewer.
    #[inline]
    fn reflect(&self, i: usize, row: &mut [Rgb], reflected: &mut Rgb, mut seen: Option<&mut Rgb>) {
        let patches = self.patches;
        row.fill(Rgb::ZERO);
        for ((shot, sums), e) in self.shots.iter().zip(self.shot_sums).zip(row) {
            let share = PI * shot.scale / patches.area[i];
            let mut radiance = (shot.diffuse + shot.known) * sums.form_factor[i];
            if shot.has_lobe() {
                radiance += shot.lobe * sums.lobe_factor[i];
            }
            *e = radiance * share;
            if *e == Rgb::ZERO {
                continue;
            }
            let to_source = (shot.position - patches.centroid[i]).normalize_or_zero();
            let cosine = patches.normal[i].dot(to_source);
            let albedo = LobeAlbedo::shared().at(patches.exponent[i], cosine);
            *reflected += patches.specular[i] * *e * albedo;
            if let (Some(seen), Some(viewpoint)) = (&mut seen, self.viewpoint) {
                let to_viewer = viewpoint.direction_from(patches.centroid[i]);
                let (normal, exponent) = (patches.shading_normal[i], patches.exponent[i]);
                **seen += *e * phong_lobe(normal, to_source, to_viewer, exponent);
            }
        }
    }
}

/// The device's own threads, or those of the pool that the caller is in.
#[derive(Clone, Copy)]
struct Pool<'device>(Option<&'device rayon::ThreadPool>);

impl Pool<'_> {
    fn threads(self) -> usize {
        self.0.map_or_else(rayon::current_num_threads, |pool| pool.current_num_threads())
    }

    /// Does the work on these threads.
    fn install<R: Send>(self, work: impl FnOnce() -> R + Send) -> R {
        match self.0 {
            Some(pool) => pool.install(work),
            // On a thread of the pool from here on, rather than going there for each step.
            None => rayon::scope(|_| work()),
        }
    }
}

/// An iteration under way.
pub struct CpuShooting<'device> {
    pool: Pool<'device>,
    pub scene: Arc<PatchedScene>,
    pub settings: ShootingSettings,
    table: DeltaFormFactors,
    /// One a thread.
    rasters: Vec<Mutex<Raster>>,
    /// One a shot of the iteration; one a half of its only shot.
    shot_sums: Vec<ShotSums>,
    /// Row of [`State::incoming`] for each patch; `u32::MAX` for diffuse ones.
    pub glossy_row: Vec<u32>,
    /// Radiance that each patch sends by itself: L^e, or with a known part K of the light
    /// L^e − K + kd·E_K/π.
    pub source: Vec<Rgb>,
    /// What the power of each patch has on top, so that it can be picked wherever it sends known
    /// light to glossy receivers; empty where there is no need.
    known_power: Vec<f32>,
    pub state: State,
}

pub const NOT_GLOSSY: u32 = u32::MAX;

/// Memory that an iteration takes, bytes, with the batches and fits that the solver keeps of it.
pub fn needed_bytes(scene: &PatchedScene, settings: &ShootingSettings, threads: usize) -> u64 {
    const SOLVER_BYTES_PER_PATCH: u64 = 16 * 24 * 2 + 400;
    let patches = scene.patches.len() as u64;
    let glossy = (0..scene.patches.len()).filter(|p| scene.patches.is_glossy(*p)).count() as u64;
    let shots = u64::from(settings.shots_per_iteration).max(HALVES.len() as u64);
    let lobes = if glossy > 0 { 2 } else { 1 };
    let per_shot = shots * (4 * lobes * patches + 12 * glossy);
    let pixels = 3 * u64::from(settings.resolution).pow(2);
    let corners = scene.positions.len() as u64;
    let raster = 8 * pixels + 13 * corners + 16 * scene.facets.len() as u64;
    per_shot + (68 + SOLVER_BYTES_PER_PATCH) * patches + raster * threads as u64 + 4 * pixels
}

impl<'device> CpuShooting<'device> {
    pub fn new(
        pool: Option<&'device rayon::ThreadPool>,
        scene: Arc<PatchedScene>,
        settings: &ShootingSettings,
    ) -> Self {
        let pool = Pool(pool);
        let patches = &scene.patches;
        let (count, shots) = (patches.len(), settings.shots_per_iteration as usize);
        let mut glossy = 0;
        let glossy_row = (0..count)
            .map(|patch| {
                if !patches.is_glossy(patch) {
                    return NOT_GLOSSY;
                }
                glossy += 1;
                glossy - 1
            })
            .collect();
        let glossy = glossy as usize;
        let tasks = if shots == 1 { HALVES.len() } else { shots };
        let threads = pool.threads().min(tasks);
        let seen = settings.viewpoint.is_some() && glossy > 0;
        let source = sources(&scene, settings);
        let known_power = known_power(&scene, settings);
        let rows = glossy * shots;
        let mut state = State::new(count, rows, shots, seen);
        for (i, power) in state.power.iter_mut().enumerate() {
            let known = known_power.get(i).copied().unwrap_or(0.0);
            *power = importance(PI * patches.area[i] * source[i]) + known;
        }
        let raster = || Mutex::new(Raster::new(settings.resolution, &scene));
        let sums = || ShotSums {
            form_factor: vec![0.0; count],
            lobe_factor: vec![0.0; if glossy > 0 { count } else { 0 }],
        };
        Self {
            rasters: (0..threads).map(|_| raster()).collect(),
            shot_sums: (0..tasks).map(|_| sums()).collect(),
            state,
            table: DeltaFormFactors::new(settings.resolution),
            settings: settings.clone(),
            glossy_row,
            source,
            known_power,
            pool,
            scene,
        }
    }

    /// Renders and deposits the shots, several at a time.
    fn shoot(&mut self, shots: &[Shot]) {
        let (scene, table, rasters) = (&*self.scene, &self.table, &self.rasters);
        let so_far = (self.state.iteration + 1) * u64::from(self.settings.shots_per_iteration);
        let rule = self.settings.variance_reduction;
        let halved = shots.len() == 1;
        let run = |(shot, sums): (&Shot, &mut ShotSums)| {
            sums.form_factor.fill(0.0);
            sums.lobe_factor.fill(0.0);
            // A free buffer always exists: there are as many as threads that can be here.
            let mut raster = rasters
                .iter()
                .cycle()
                .find_map(|raster| match raster.try_lock() {
                    Ok(raster) => Some(raster),
                    // Rendering starts by clearing the buffers, whatever a panic left in them.
                    Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
                    Err(TryLockError::WouldBlock) => None,
                })
                .expect("the iterator is endless");
            kernel::run(kernel::Job {
                scene,
                table,
                shot,
                raster: &mut raster,
                form_factor: &mut sums.form_factor,
                lobe_factor: &mut sums.lobe_factor,
            });
            // One shot's two halves are not yet whole.
            if let (Some(rule), false) = (rule, halved) {
                reduce_variance(scene, shot, rule, rule.shots.unwrap_or(so_far), sums);
            }
        };
        if !halved {
            shots.par_iter().zip(self.shot_sums.par_iter_mut()).with_max_len(1).for_each(run);
            return;
        }
        let shot = shots[0];
        let part = |drawn: [f32; FACES]| {
            let face_weights = std::array::from_fn(|face| shot.face_weights[face] * drawn[face]);
            Shot { face_weights, ..shot }
        };
        let parts = HALVES.map(part);
        parts.par_iter().zip(self.shot_sums.par_iter_mut()).with_max_len(1).for_each(run);
        let (whole, half) = self.shot_sums.split_at_mut(1);
        let (whole, half) = (&mut whole[0], &half[0]);
        add(&mut whole.form_factor, &half.form_factor);
        add(&mut whole.lobe_factor, &half.lobe_factor);
        if let Some(rule) = rule {
            reduce_variance(scene, &shot, rule, rule.shots.unwrap_or(so_far), whole);
        }
    }

    /// Turns the shots' sums into incoming light, next powers and running sums.
    fn update(&mut self, shots: &[Shot]) {
        let Self { scene, settings, shot_sums, glossy_row, source, known_power, state, .. } = self;
        for (source, shot) in state.sources.iter_mut().zip(shots) {
            *source = shot.position;
        }
        state.shooters.clear();
        state.shooters.extend(shots.iter().map(|shot| shot.patch));
        let update = Update {
            patches: &scene.patches,
            shots,
            most_shots: settings.shots_per_iteration as usize,
            shot_sums,
            glossy_row,
            source,
            known_power,
            viewpoint: settings.viewpoint.filter(|_| !state.sums.glossy.is_empty()),
        };
        let ranges = state.ranges(glossy_row, update.most_shots);
        ranges.into_par_iter().for_each(|mut range| {
            update.add_irradiance(&mut range);
            update.add_up(range);
        });
        state.iteration += 1;
        state.sums.iterations += 1;
    }

    fn one_iteration(&mut self, tally: &mut Tally) {
        let shots = self.select().unwrap_or_default();
        self.shoot(&shots);
        self.update(&shots);
        let patches = &self.scene.patches;
        tally.iterations += 1;
        tally.shots += shots.len() as u64;
        tally.light_shots +=
            shots.iter().filter(|shot| patches.emits(shot.patch as usize)).count() as u64;
    }
}

fn add(sums: &mut [f32], more: &[f32]) {
    sums.par_chunks_mut(CHUNK).zip(more.par_chunks(CHUNK)).for_each(|(sums, more)| {
        for (sum, more) in sums.iter_mut().zip(more) {
            *sum += more;
        }
    });
}

/// Replaces the transfers that [`VarianceReduction`] is about.
fn reduce_variance(
    scene: &PatchedScene,
    shot: &Shot,
    rule: VarianceReduction,
    total_shots: u64,
    sums: &mut ShotSums,
) {
    let limit = 2.0 * total_shots as f32 * shot.probability;
    // No form factor exceeds 1.
    if limit >= 1.0 {
        return;
    }
    let areas = &scene.patches.area;
    let shooter_area = areas[shot.patch as usize];
    let factor = match rule.substitute {
        Substitute::Zero => 0.0,
        // A_j over the scale A_j/(p_j K).
        Substitute::Mean => shooter_area / shot.scale,
    };
    for (i, area) in areas.iter().enumerate() {
        let form_factor = (sums.form_factor[i] * shooter_area / area).min(1.0);
        if form_factor > limit {
            sums.form_factor[i] *= factor;
            if let Some(sum) = sums.lobe_factor.get_mut(i) {
                *sum *= factor;
            }
        }
    }
}

/// (n+2)/(2π)·cosⁿα between the mirror of `to_source` about `normal` and `to_viewer`; zero below
/// the horizon of either.
fn phong_lobe(normal: Vec3, to_source: Vec3, to_viewer: Vec3, exponent: f32) -> f32 {
    let (incidence, view) = (normal.dot(to_source), normal.dot(to_viewer));
    if incidence <= 0.0 || view <= 0.0 {
        return 0.0;
    }
    let cosine = (2.0 * incidence * view - to_source.dot(to_viewer)).min(1.0);
    if cosine <= 0.0 {
        return 0.0;
    }
    (exponent + 2.0) / TAU * cosine.powf(exponent)
}

impl Shooting for CpuShooting<'_> {
    fn iterate(&mut self, iterations: u32) -> Result<Tally, DeviceError> {
        let pool = self.pool;
        let mut tally = Tally::default();
        pool.install(|| {
            for _ in 0..iterations {
                self.one_iteration(&mut tally);
            }
        });
        Ok(tally)
    }

    fn drain(&mut self) -> Result<Sums, DeviceError> {
        let fresh = Sums {
            iterations: 0,
            irradiance: vec![Rgb::ZERO; self.state.sums.irradiance.len()],
            glossy: vec![Rgb::ZERO; self.state.sums.glossy.len()],
        };
        let mut sums = std::mem::replace(&mut self.state.sums, fresh);
        if let Some(known) = &self.settings.known {
            let iterations = sums.iterations as f32;
            for (sum, known) in sums.irradiance.iter_mut().zip(&known.irradiance) {
                *sum += *known * iterations;
            }
        }
        Ok(sums)
    }

    fn shooters(&mut self) -> Result<Vec<u32>, DeviceError> {
        Ok(self.state.shooters.clone())
    }

    fn save(&mut self, to: &mut Writer) -> Result<(), DeviceError> {
        self.state.save(to);
        Ok(())
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<u64, DeviceError> {
        self.state.restore(from, self.scene.patches.len())?;
        Ok(self.state.sums.iterations)
    }

    fn trace(&mut self, shots: &[Shot]) -> Result<Vec<ShotTrace>, DeviceError> {
        let (scene, resolution) = (&*self.scene, self.settings.resolution);
        let one = |raster: &mut Raster, shot: &Shot| {
            let count = scene.patches.len();
            let (mut form_factor, mut lobe_factor) = (vec![0.0; count], vec![0.0; count]);
            kernel::run(kernel::Job {
                scene,
                table: &self.table,
                shot,
                raster,
                form_factor: &mut form_factor,
                lobe_factor: &mut lobe_factor,
            });
            ShotTrace { items: raster.items.clone(), form_factor, lobe_factor }
        };
        let raster = || Raster::new(resolution, scene);
        Ok(self.pool.install(|| shots.par_iter().map_init(raster, one).collect()))
    }

    fn form_factors(&mut self, shots: &[Shot]) -> Result<Vec<Vec<f32>>, DeviceError> {
        let (scene, resolution) = (&*self.scene, self.settings.resolution);
        let one = |raster: &mut Raster, shot: &Shot| {
            let mut form_factor = vec![0.0; scene.patches.len()];
            kernel::run(kernel::Job {
                scene,
                table: &self.table,
                shot: &Shot { lobe: Rgb::ZERO, ..*shot },
                raster,
                form_factor: &mut form_factor,
                lobe_factor: &mut [],
            });
            form_factor
        };
        let raster = || Raster::new(resolution, scene);
        Ok(self.pool.install(|| shots.par_iter().map_init(raster, one).collect()))
    }
}
