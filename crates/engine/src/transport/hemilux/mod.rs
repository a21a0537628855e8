//! The three tiers: shoot coarsely, gather smoothly, light exactly.
//!
//! 1. *Shoot*: stochastic hemicube iteration solves the light of the scene on a coarse mesh.
//! 2. *Gather*: at records on what the camera sees, rays over the hemisphere turn that solution
//!    into smooth indirect irradiance.
//! 3. *Light*: the emitters' own light is found per pixel, in closed form but for the share that
//!    shadow rays find blocked.
//!
//! Each iteration makes all three better. What an iteration does depends on its number alone, so
//! the same iterations give the same bits, whatever the number of threads.

mod cache;
mod elements;
mod estimate;
mod fragments;
mod gather;
mod gloss;
mod guide;
mod kept;
mod light;
mod light_tree;
mod lights;
mod links;
mod lobe;
mod luminous;
mod patch_light;
mod plan;
mod plane;
mod polygon;
mod sequence;
mod settings;
mod shoot;
mod splat;
mod unoccluded;

use super::Method;
use super::kept::Past;
use super::options::Settings;
use super::ray_traced::surface::World;
use super::run::Run;
use super::stage::{Asked, Stage};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceError, Shooting, free_memory};
use crate::image::Picture;
use crate::rays::Rays;
use crate::render::{Limits, Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::scene::Scene;
use cache::{Cache, Gathering, Look, Spacing};
use elements::Elements;
use estimate::Errors;
use fragments::{Fragment, Seen};
use gloss::Gloss;
use light::Direct;
use lights::Lights;
use rayon::prelude::*;
use sequence::Seed;
pub use settings::HemiluxSettings;
use shoot::Coarse;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::time::Instant;

/// Decisions in checkpoints: wanted patches of the coarse mesh, rays of a record in the first
/// iteration, sub-pixel samples.
const PATCHES: &str = "coarse_patches";
const FIRST_RAYS: &str = "first_rays";
const SAMPLES: &str = "pixel_samples";
/// Iterations before which more records are made, each nearer to its neighbours by [`DENSER`].
const REFILLS: [u64; 4] = [1, 4, 12, 28];
const DENSER: f32 = 0.85;
/// Most rays of a patch at a time, in times of those of the first iteration.
const MOST_ROUNDS: u32 = 64;
/// Points of a patch whose direct light is found at first.
const PATCH_POINTS: u32 = 2;
/// Most rays of records made later, in times of those that every record gets in an iteration.
const MOST_GATHER: u32 = 8;
/// Passes of shadow rays in an iteration of another camera that finds the rest known.
const LIGHT_AHEAD: u32 = 2;
/// What a picture takes, in shares of the first iteration, before one was made.
const PICTURE_SHARE: f64 = 0.25;
/// Pause between estimates for reports, in times of what the last one took.
const ESTIMATE_PAUSE: f64 = 10.0;
/// Share of an iteration that must fit into the time budget for it to begin.
const LATE: f64 = 0.7;

/// Shoot coarsely, gather smoothly, light exactly.
pub struct Hemilux;

impl Method for Hemilux {
    fn name(&self) -> &'static str {
        "hemilux"
    }

    fn checkpoint_format(&self) -> u32 {
        1
    }

    fn summary(&self) -> &'static str {
        "coarse hemicube shooting, smooth final gathering, exact direct light"
    }

    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        mut reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError> {
        let settings = Settings::new(&request.options)?;
        let mut options = HemiluxSettings::new(&settings)?;
        let mut past = Past::of(request, self.name(), &settings)?;
        let worth = Worth::new(request);
        let mut patches = worth.patches;
        if !request.options.contains_key("pixel_samples") {
            options.samples = worth.samples;
        }
        if let Some(past) = &past {
            patches = past.decided(PATCHES)?;
            if past.bound.is_some() {
                options.samples = past.decided(SAMPLES)?;
            }
        }
        let first_rays = match &past {
            Some(past) => past.decided(FIRST_RAYS)?,
            None => options.gather_rays,
        };
        options.coarse_patches = options.coarse_patches.or(Some(patches));
        let available_bytes = free_memory();
        let needed_bytes = needed_bytes(&request.scene, request.width, request.height);
        if needed_bytes > available_bytes {
            let device = CpuDevice::describe().id;
            return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes }.into());
        }
        reasons.extend(plan::reasons(&request.scene, &options, &device.description()));
        // All but shots is work for the processor.
        let computes =
            if options.shoot { device.description() } else { CpuDevice::describe_here() };
        let stage = Stage::with_patches(
            Asked { method: self.name(), reasons, request, settings: &settings },
            request.scene.clone(),
            computes,
            |_| Vec::new(),
            options.coarse_patches.unwrap_or(patches),
            observer,
        )?;
        let mut run = stage.run(request, observer);
        for (name, value) in [
            (PATCHES, patches as u64),
            (SAMPLES, options.samples.into()),
            (FIRST_RAYS, first_rays.into()),
        ] {
            run.owner.decided.insert(name.into(), value.to_string());
        }
        let mut clock = Clock::default();
        let world = World::new(request.scene.clone());
        let Some(lights) = Lights::new(&world.scene, &world.rays) else {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        };
        clock.lap("seconds_prepare");
        let wanted = options.coarse_patches.unwrap_or(patches);
        let elements = Elements::new(&stage.scene, wanted, !options.shoot);
        let count = elements.len();
        let ([all, before], direct) = match &mut past {
            Some(past) => {
                let (iterations, direct) = kept::restore_direct(&mut past.shared, count)?;
                (iterations, Some(direct))
            }
            None => ([0; 2], None),
        };
        let seed = Seed { number: request.seed, well_spread: options.well_spread };
        let mut coarse =
            Coarse::new(&world, &lights, stage.scene.clone(), elements, PATCH_POINTS, seed, direct);
        if !options.near_field {
            coarse.ignore_near_field();
        }
        clock.lap("seconds_patches");
        let shooting = match options.shoot {
            true => {
                let shots = coarse.settings(options.coarse_resolution, request.seed);
                Some(device.begin(stage.scene.clone(), &shots)?)
            }
            false => None,
        };
        let seen = Seen::new(
            &world,
            stage.scene.clone(),
            &stage.camera,
            [request.width, request.height],
            options.samples,
        );
        clock.lap("seconds_fragments");
        let direct = Direct::new(&lights, &seen, options.adaptive, worth.hasty);
        clock.lap("seconds_light");
        let mut tiers = Tiers {
            direct,
            gloss: Gloss::new(&world, &seen),
            world: &world,
            lights: &lights,
            seen: &seen,
            coarse,
            shooting,
            cache: Cache::default(),
            options,
            hasty: worth.hasty,
            first_rays,
            seed,
            before,
            clock,
            drawn: Drawn::default(),
            picture_seconds: None,
        };
        if let Some(past) = past {
            tiers.restore_shared(past.shared)?;
            match past.bound {
                Some(bound) => tiers.restore_bound(bound)?,
                None => tiers.turn(all),
            }
        }
        let result = tiers.solve(&mut run)?;
        let diagnostics = tiers.diagnostics();
        drop(tiers);
        Ok(stage.rendered(run, result, diagnostics))
    }
}

/// Factor of all radii of records in an iteration.
fn scale(iteration: u64) -> f32 {
    DENSER.powi(REFILLS.iter().filter(|at| **at <= iteration).count() as i32)
}

/// What is worth its time, by the limits.
#[derive(Clone, Copy)]
struct Worth {
    /// Sub-pixel samples: more in small pictures, where more of the pixels see edges.
    samples: u32,
    /// Patches of the coarse mesh.
    patches: usize,
    /// Whether the first picture had better come soon than be good.
    hasty: bool,
}

impl Worth {
    fn new(request: &RenderRequest) -> Self {
        let Limits { seconds, iterations, target_error, .. } = request.limits.to_plan_by();
        let (asked, error) = (seconds.unwrap_or(f64::INFINITY), target_error.unwrap_or(0.0));
        let hasty = asked < 0.25 || error >= 0.045;
        let (seconds, error) = (seconds.unwrap_or(0.0), target_error.unwrap_or(1.0));
        let iterations = iterations.unwrap_or(0);
        let (samples, patches) = if hasty {
            (8, 5000)
        } else if seconds >= 4.0 || error <= 0.015 || iterations >= 16 {
            (64, 30_000)
        } else if seconds >= 2.0 {
            (64, 16_000)
        } else if seconds >= 1.0 || error <= 0.025 || iterations >= 8 {
            (32, 16_000)
        } else {
            (16, 10_000)
        };
        let pixels = request.width * request.height;
        let least = if pixels < 1 << 16 {
            64
        } else if pixels < 1 << 17 {
            32
        } else {
            8
        };
        Self { samples: samples.max(least), patches, hasty }
    }
}

/// Memory at the peak, bytes.
pub fn needed_bytes(scene: &Scene, width: u32, height: u32) -> u64 {
    needed_bytes_for(scene.triangles.len() as u64, width, height)
}

/// Memory at the peak for a scene of so many triangles, bytes.
pub fn needed_bytes_for(triangles: u64, width: u32, height: u32) -> u64 {
    const PER_PIXEL: u64 = 440;
    const PER_TRIANGLE: u64 = 1500;
    let pixels = u64::from(width) * u64::from(height);
    Rays::needed_bytes(triangles) + triangles * PER_TRIANGLE + pixels * PER_PIXEL
}

/// Seconds by what they were spent on.
struct Clock {
    last: Instant,
    spent: BTreeMap<&'static str, f64>,
}

impl Default for Clock {
    fn default() -> Self {
        Self { last: Instant::now(), spent: BTreeMap::new() }
    }
}

impl Clock {
    fn lap(&mut self, what: &'static str) {
        let now = Instant::now();
        *self.spent.entry(what).or_default() += (now - self.last).as_secs_f64();
        self.last = now;
    }
}

/// A picture.
#[derive(Default)]
struct Drawn {
    /// After how many iterations.
    iterations: Option<u64>,
    picture: Picture,
    /// Its estimated error.
    errors: Option<Errors>,
}

/// The three tiers at work.
struct Tiers<'a> {
    world: &'a World,
    lights: &'a Lights,
    seen: &'a Seen,
    coarse: Coarse<'a>,
    shooting: Option<Box<dyn Shooting + 'a>>,
    cache: Cache,
    direct: Direct,
    gloss: Gloss,
    options: HemiluxSettings,
    /// Whether the first picture had better come soon than be good.
    hasty: bool,
    /// Rays of a record in the first iteration.
    first_rays: u32,
    seed: Seed,
    /// Iterations of another camera's picture that the coarse solution and the records are from.
    before: u64,
    clock: Clock,
    drawn: Drawn,
    /// What the last picture took.
    picture_seconds: Option<f64>,
}

impl Tiers<'_> {
    /// Rays of a record in an iteration: where few do at first, more every time.
    fn gather_rays(&self, iteration: u64) -> u32 {
        let so_many = u64::from(self.first_rays) * (1 + iteration);
        so_many.min(self.options.gather_rays.into()) as u32
    }

    /// Rays of a record after an iteration; where it is made late, [`MOST_GATHER`] times those of
    /// one at most.
    fn gathered(&self, iteration: u64) -> u32 {
        let most = self.options.gather_rays.saturating_mul(MOST_GATHER);
        // Enough iterations for the most, whatever the first one did.
        let counted = iteration.min(u64::from(most / self.first_rays.max(1)));
        (0..=counted).map(|number| self.gather_rays(number)).fold(0, u32::saturating_add).min(most)
    }

    /// What the radii of records follow after so many iterations.
    fn spacing(&self, iterations: u64) -> Spacing {
        let least = cache::least_scale(self.seen);
        Spacing { scale: scale(iterations).max(least), least, even: !self.options.adaptive }
    }

    /// Goes over to another camera, with what `before` iterations have found out.
    fn turn(&mut self, before: u64) {
        self.before = before;
        self.cache.turn(self.seen, self.spacing(before));
    }

    /// Iterates until a limit is reached.
    fn solve(&mut self, run: &mut Run<'_>) -> Result<(Picture, StopReason), RenderError> {
        let mut next_estimate = 1;
        let mut estimated = Instant::now();
        let stopped = loop {
            if let Some(reason) = run.stop() {
                break reason;
            }
            let began = Instant::now();
            self.iterate(run)?;
            let iteration = began.elapsed().as_secs_f64();
            // The last picture, and most of another iteration that would come too late.
            let picture = self.picture_seconds.unwrap_or(PICTURE_SHARE * iteration);
            run.picture_seconds = picture + LATE * iteration;
            let done = run.tally.iterations;
            let wanted = run.wants_estimate() && done >= next_estimate;
            // Estimates for the reports take a small share of the time.
            let pause = ESTIMATE_PAUSE * self.picture_seconds.unwrap_or(0.0);
            if wanted || (run.report_is_due() && estimated.elapsed().as_secs_f64() >= pause) {
                next_estimate = done + done.div_ceil(4);
                run.estimated_error = self.draw(done).errors.map(|errors| errors.all);
                run.without_estimate = run.estimated_error.is_none();
                estimated = Instant::now();
            }
            if run.report_is_due() {
                run.report(true, || self.draw(done).picture.clone());
            }
            run.keep_if_wanted(|parts| self.save(parts, done))?;
        };
        let done = run.tally.iterations;
        run.keep_solution(|parts| self.save(parts, done))?;
        run.bake(&self.coarse.scene, || self.coarse.irradiances().to_vec());
        let drawn = self.draw(done);
        run.estimated_error = drawn.errors.map(|errors| errors.all);
        Ok((std::mem::take(&mut drawn.picture), stopped))
    }

    fn iterate(&mut self, run: &mut Run<'_>) -> Result<(), RenderError> {
        let number = run.tally.iterations;
        let first = number == 0;
        // Until then another picture has done what is for any camera.
        let known = number < self.before;
        let options = self.options;
        self.clock.last = Instant::now();
        match &mut self.shooting {
            Some(shooting) => {
                let shots = options.coarse_shots / if first { 1 } else { 2 };
                let tally = shooting.iterate((shots / 8).max(1))?;
                run.tally.shots += tally.shots;
                run.tally.light_shots += tally.light_shots;
                self.coarse.absorb(&mut **shooting)?;
            }
            // As many again as there are, whenever the iterations have doubled: solving takes its
            // time for all links.
            None if (number + 1).is_power_of_two() && !known => {
                let rounds = (number as u32).div_ceil(2).clamp(1, MOST_ROUNDS);
                // The first ones there are already.
                let points = if first { 0 } else { PATCH_POINTS * rounds };
                self.coarse.link(self.seed, points, options.coarse_rays * rounds);
            }
            None => {}
        }
        self.clock.lap("seconds_shoot");
        if options.light {
            // Only shadows are new where all else is known.
            for _ in 0..if known { LIGHT_AHEAD } else { 1 } {
                self.direct.pass(self.world, self.lights, self.seen, self.seed);
            }
        }
        self.clock.lap("seconds_light");
        if options.gather {
            // New records catch up with those that are there: at once, or, where another camera's
            // picture left many, over some iterations, so that the first picture comes soon.
            let so_far = number.max(self.before);
            let enough = self.gathered(so_far);
            let gathering = Gathering {
                seed: self.seed,
                rays: self.gather_rays(so_far),
                new_rays: if known { enough.min(options.gather_rays) } else { enough },
                afresh: options.gather_direct,
                spacing: self.spacing(so_far),
            };
            if !first {
                let enough = if known { enough } else { u32::MAX };
                self.cache.refine(self.world, &self.coarse, gathering, enough, number as usize);
            }
            if first || (REFILLS.contains(&number) && !known) {
                self.cache.smooth(self.seen, options.gather_fit);
                let (lights, seen) = (self.lights, self.seen);
                let direct = |index| self.direct.irradiance(lights, seen, index, true).0;
                let follows = first && !known && options.adaptive;
                let look = follows.then_some(Look { hasty: self.hasty, direct: &direct });
                let rays = self.cache.fill(self.world, &self.coarse, seen, gathering, look);
                if follows {
                    self.first_rays = rays;
                    run.owner.decided.insert(FIRST_RAYS.into(), rays.to_string());
                }
            }
        }
        self.clock.lap("seconds_gather");
        if self.gloss.len() > 0 {
            self.look_at_lobes(number.max(self.before));
        }
        self.clock.lap("seconds_gloss");
        run.tally.iterations += 1;
        if self.shooting.is_none() {
            run.tally.shots = self.coarse.links() as u64 + self.cache.rays() + self.direct.rays;
            run.tally.light_shots = self.direct.rays;
        }
        Ok(())
    }

    /// Another pass of lobe rays, unless they are good enough; in the first iteration a second one,
    /// too, which knows where they are needed.
    fn look_at_lobes(&mut self, iterations: u64) {
        let first = self.gloss.passes == 0;
        if first {
            self.gloss.pass(&self.coarse, self.seen, self.seed, self.options.adaptive);
            self.gloss.brightness = self.brightness();
        }
        if !(first && self.hasty) && self.gloss.matters(self.seen, iterations) {
            self.gloss.pass(&self.coarse, self.seen, self.seed, self.options.adaptive);
        }
    }

    /// Mean radiance of the picture, by the direct light and the coarse solution.
    fn brightness(&self) -> f32 {
        let (seen, coarse, direct, lights) = (self.seen, &self.coarse, &self.direct, self.lights);
        let of_fragment = |(index, fragment): (usize, &Fragment)| {
            let (facet, back, at) = seen.place_on_facet(fragment);
            let (direct, _) = direct.irradiance(lights, seen, index, false);
            let irradiance = direct + coarse.bounced(facet, back, at);
            (fragment.diffuse * irradiance).element_sum() * fragment.share / PI
        };
        let chunks = seen.fragments.par_chunks(1024).enumerate();
        let of_chunk = |(chunk, fragments): (usize, &[Fragment])| {
            let numbered = fragments.iter().enumerate();
            let numbered = numbered.map(|(index, fragment)| (1024 * chunk + index, fragment));
            numbered.map(|fragment| f64::from(of_fragment(fragment))).sum::<f64>()
        };
        let sums: Vec<f64> = chunks.map(of_chunk).collect();
        (sums.iter().sum::<f64>() / (3 * seen.shine.len()) as f64) as f32
    }

    /// The picture after so many iterations, unless it is there already.
    fn draw(&mut self, iterations: u64) -> &mut Drawn {
        if self.drawn.iterations == Some(iterations) {
            return &mut self.drawn;
        }
        self.clock.last = Instant::now();
        let began = Instant::now();
        let bounced = if self.options.gather {
            self.cache.smooth(self.seen, self.options.gather_fit);
            self.cache.irradiance(self.seen)
        } else {
            vec![None; self.seen.fragments.len()]
        };
        self.clock.lap("seconds_smooth");
        let (picture, errors) = estimate::measure(self, &bounced);
        self.clock.lap("seconds_picture");
        self.picture_seconds = Some(began.elapsed().as_secs_f64());
        self.drawn = Drawn { iterations: Some(iterations), picture, errors };
        &mut self.drawn
    }

    fn diagnostics(&self) -> BTreeMap<String, f64> {
        let mut figures: BTreeMap<String, f64> =
            self.clock.spent.iter().map(|(name, value)| ((*name).into(), *value)).collect();
        for (cause, error) in
            estimate::CAUSES.iter().zip(self.drawn.errors.unwrap_or_default().parts)
        {
            figures.insert(format!("error_{cause}"), error);
        }
        figures.insert("records".into(), self.cache.len() as f64);
        figures.insert("records_reused".into(), self.cache.reused as f64);
        figures.insert("first_rays".into(), f64::from(self.first_rays));
        figures.insert("gather_rays".into(), self.cache.rays() as f64);
        figures.insert("shadow_rays".into(), self.direct.rays as f64);
        figures.insert("closed".into(), f64::from(u8::from(self.coarse.closed)));
        figures.insert("links".into(), self.coarse.links() as f64);
        figures.insert("fragments".into(), self.seen.fragments.len() as f64);
        figures.insert("lights".into(), self.lights.count() as f64);
        figures
    }
}

#[cfg(test)]
mod tests;
