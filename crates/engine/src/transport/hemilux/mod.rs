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
mod fragments;
mod gather;
mod light;
mod lights;
mod links;
mod sequence;
mod settings;
mod shoot;

use super::Method;
use super::options::Settings;
use super::ray_traced::surface::World;
use super::run::Run;
use super::stage::{Asked, Stage};
use crate::device::{Device, Shooting};
use crate::image::Picture;
use crate::radiometry::Rgb;
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use cache::{Cache, Gathering};
use fragments::Seen;
use light::Direct;
use lights::Lights;
use rayon::prelude::*;
pub use settings::HemiluxSettings;
use shoot::Coarse;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::time::Instant;

/// Shoot coarsely, gather smoothly, light exactly.
pub struct Hemilux;

impl Method for Hemilux {
    fn name(&self) -> &'static str {
        "hemilux"
    }

    fn summary(&self) -> &'static str {
        "coarse hemicube shooting, smooth final gathering, exact direct light"
    }

    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError> {
        let settings = Settings::new(&request.options)?;
        let options = HemiluxSettings::new(&settings)?;
        let stage = Stage::with_patches(
            Asked { method: self.name(), reasons, request, settings: &settings },
            request.scene.clone(),
            device.description(),
            |_| Vec::new(),
            options.coarse_patches,
            observer,
        )?;
        let mut run = stage.run(request, observer);
        let mut clock = Clock::default();
        let world = World::new(request.scene.clone());
        let Some(lights) = Lights::new(&world.scene, &world.rays) else {
            let black = (stage.black(), StopReason::NoLight);
            return Ok(stage.rendered(run, black, BTreeMap::new()));
        };
        clock.lap("seconds_prepare");
        let coarse = Coarse::new(&world, &lights, stage.scene.clone(), 16, request.seed);
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
        let mut tiers = Tiers {
            direct: Direct::new(&world, &lights, &seen),
            world: &world,
            lights: &lights,
            seen: &seen,
            coarse,
            shooting,
            cache: Cache::default(),
            options,
            seed: request.seed,
            clock,
        };
        let result = tiers.solve(&mut run)?;
        let diagnostics = tiers.diagnostics();
        drop(tiers);
        Ok(stage.rendered(run, result, diagnostics))
    }
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

/// The three tiers at work.
struct Tiers<'a> {
    world: &'a World,
    lights: &'a Lights,
    seen: &'a Seen,
    coarse: Coarse<'a>,
    shooting: Option<Box<dyn Shooting + 'a>>,
    cache: Cache,
    direct: Direct,
    options: HemiluxSettings,
    seed: u64,
    clock: Clock,
}

impl Tiers<'_> {
    /// Iterates until a limit is reached.
    fn solve(&mut self, run: &mut Run<'_>) -> Result<(Picture, StopReason), RenderError> {
        let stopped = loop {
            if let Some(reason) = run.stop() {
                break reason;
            }
            self.iterate(run)?;
            if run.report_is_due() {
                run.report(true, || self.picture());
            }
        };
        Ok((self.picture(), stopped))
    }

    fn iterate(&mut self, run: &mut Run<'_>) -> Result<(), RenderError> {
        let first = run.tally.iterations == 0;
        self.clock.last = Instant::now();
        match &mut self.shooting {
            Some(shooting) => {
                let shots = self.options.coarse_shots / if first { 1 } else { 2 };
                let tally = shooting.iterate((shots / 8).max(1))?;
                run.tally.shots += tally.shots;
                run.tally.light_shots += tally.light_shots;
                self.coarse.absorb(&mut **shooting)?;
            }
            None => self.coarse.link(self.seed, self.options.coarse_rays),
        }
        self.clock.lap("seconds_shoot");
        if self.options.light {
            self.direct.pass(self.world, self.lights, self.seen, self.seed);
        }
        self.clock.lap("seconds_light");
        if self.options.gather {
            let gathering = Gathering {
                seed: self.seed,
                rays: self.options.gather_rays,
                afresh: self.options.gather_direct,
                scale: 1.0,
            };
            if first {
                self.cache.fill(self.world, &self.coarse, self.seen, gathering);
            } else {
                self.cache.refine(self.world, &self.coarse, gathering);
            }
        }
        self.clock.lap("seconds_gather");
        run.tally.iterations += 1;
        Ok(())
    }

    fn picture(&mut self) -> Picture {
        self.clock.last = Instant::now();
        let bounced = if self.options.gather {
            self.cache.smooth(self.seen, self.options.gather_fit);
            self.cache.irradiance(self.seen)
        } else {
            vec![None; self.seen.fragments.len()]
        };
        self.clock.lap("seconds_smooth");
        let seen = self.seen;
        let mut picture = Picture { width: seen.width, height: seen.height, pixels: Vec::new() };
        let pixel = |pixel: usize| {
            let mut radiance = seen.shine[pixel];
            for index in seen.start[pixel] as usize..seen.start[pixel + 1] as usize {
                let fragment = &seen.fragments[index];
                let direct = if self.options.light {
                    self.direct.irradiance(self.lights, seen, index, self.options.shadow_filter)
                } else {
                    let (facet, back, at) = seen.place_on_facet(fragment);
                    self.coarse.direct(facet, back, at)
                };
                let bounced = bounced[index].unwrap_or_else(|| {
                    let (facet, back, at) = seen.place_on_facet(fragment);
                    self.coarse.bounced(facet, back, at)
                });
                let diffuse = fragment.diffuse * (fragment.share / PI);
                radiance += diffuse * (direct + bounced).max(Rgb::ZERO);
            }
            radiance
        };
        let count = seen.shine.len();
        picture.pixels = (0..count).into_par_iter().with_min_len(1024).map(pixel).collect();
        self.clock.lap("seconds_picture");
        picture
    }

    fn diagnostics(&self) -> BTreeMap<String, f64> {
        let mut figures: BTreeMap<String, f64> =
            self.clock.spent.iter().map(|(name, value)| ((*name).into(), *value)).collect();
        figures.insert("records".into(), self.cache.len() as f64);
        figures.insert("gather_rays".into(), self.cache.rays() as f64);
        figures.insert("shadow_rays".into(), self.direct.rays as f64);
        figures.insert("links".into(), self.coarse.links() as f64);
        figures.insert("fragments".into(), self.seen.fragments.len() as f64);
        figures.insert("lights".into(), self.lights.count() as f64);
        figures
    }
}
