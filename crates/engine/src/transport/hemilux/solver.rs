//! The three tiers at work: what an iteration does, and the picture after it.

use super::clock::Clock;
use super::coarse::{Coarse, PATCH_POINTS};
use super::direct::Direct;
use super::estimate::{self, Errors, PictureParts};
use super::fragments::{Fragment, Seen};
use super::gather::{Cache, FirstLook, Gathering, Spacing, least_scale};
use super::gloss::Gloss;
use super::settings::HemiluxSettings;
use crate::checkpoint::{CheckpointError, Reader};
use crate::device::DeviceError;
use crate::emitters::PolygonLights;
use crate::image::Picture;
use crate::patches::PatchedScene;
use crate::radiometry::Rgb;
use crate::render::{RenderError, StopReason};
use crate::sampling::Seed;
use crate::surface::World;
use crate::transport::checkpoints;
use crate::transport::run::Run;
use crate::transport::solver::{Estimate, Solver};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::sync::Arc;
use std::time::Instant;

/// Rays of a record in the first iteration, a decision in checkpoints.
pub const FIRST_RAYS: &str = "first_rays";
/// Iterations before which more records are made, each nearer to its neighbours by [`DENSER`].
const REFILLS: [u64; 4] = [1, 4, 12, 28];
const DENSER: f32 = 0.85;
/// Most rays of a patch at a time, in times of those of the first iteration.
const MOST_ROUNDS: u32 = 64;
/// Most rays of records made later, in times of those that every record gets in an iteration.
const MOST_GATHER: u32 = 8;
/// Passes of shadow rays in an iteration of another camera that finds the rest known.
const LIGHT_AHEAD: u32 = 2;
/// What a picture takes, in shares of the first iteration, before one was made.
const PICTURE_SHARE: f64 = 0.25;
/// Share of an iteration that must fit into the time budget for it to begin.
const LATE: f64 = 0.7;

/// Factor of all radii of records in an iteration.
fn scale(iteration: u64) -> f32 {
    DENSER.powi(REFILLS.iter().filter(|at| **at <= iteration).count() as i32)
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
pub struct Tiers {
    world: Arc<World>,
    lights: Arc<PolygonLights>,
    seen: Seen,
    coarse: Coarse,
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
    pub before: u64,
    clock: Clock,
    drawn: Drawn,
    /// What the last picture took.
    picture_seconds: Option<f64>,
    /// After how many iterations a job with a target error estimates it next.
    next_check: u64,
    /// Iterations done.
    done: u64,
}

/// How the tiers work.
pub struct How {
    /// The settings.
    pub options: HemiluxSettings,
    /// Rays of a record in the first iteration.
    pub first_rays: u32,
    /// What random numbers are drawn by.
    pub seed: Seed,
    /// Whether the first picture had better come soon than be good.
    pub hasty: bool,
    /// Iterations that earlier attempts at the same job did.
    pub done: u64,
}

/// What the tiers work on.
pub struct Parts {
    /// The scene as rays meet it.
    pub world: Arc<World>,
    /// Its emitters.
    pub lights: Arc<PolygonLights>,
    /// What the camera sees.
    pub seen: Seen,
    /// Tier 1.
    pub coarse: Coarse,
}

impl Tiers {
    /// Tiers that know nothing yet of what is not in their parts.
    pub fn new(parts: Parts, how: How, mut clock: Clock) -> Self {
        let Parts { world, lights, seen, coarse } = parts;
        let How { options, first_rays, seed, hasty, done } = how;
        let direct = Direct::new(&lights, &seen, options.adaptive, hasty);
        clock.lap("seconds_light");
        Self {
            direct,
            gloss: Gloss::new(&world, &seen),
            world,
            lights,
            seen,
            coarse,
            cache: Cache::default(),
            options,
            hasty,
            first_rays,
            seed,
            before: 0,
            clock,
            drawn: Drawn::default(),
            picture_seconds: None,
            next_check: 1,
            done,
        }
    }
}

impl Tiers {
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
        let least = least_scale(&self.seen);
        Spacing { scale: scale(iterations).max(least), least, even: !self.options.adaptive }
    }

    /// Takes the part for any camera, behind the points' direct light, with which tier 1 was made.
    pub fn restore_shared(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        self.coarse.restore_links(&mut from)?;
        self.cache.restore(&mut from)?;
        from.count(0)?;
        from.exactly::<Rgb>(0)?;
        from.end()
    }

    /// Takes the part of the same camera.
    pub fn restore_bound(&mut self, mut from: Reader<'_>) -> Result<(), CheckpointError> {
        self.direct.restore(&mut from)?;
        self.gloss.restore(&mut from)?;
        from.end()
    }

    /// Goes over to another camera, with what `before` iterations have found out.
    pub fn turn(&mut self, before: u64) {
        self.before = before;
        self.cache.turn(&self.seen, self.spacing(before));
    }

    /// One iteration: every tier gets better, as far as its number says.
    fn iterate(&mut self, run: &mut Run<'_>) {
        let number = run.standing.tally.iterations;
        // Until then another picture has done what is for any camera.
        let known = number < self.before;
        self.clock.start();
        if (number + 1).is_power_of_two() && !known {
            self.link(number);
        }
        self.clock.lap("seconds_links");
        if self.options.light {
            // Only shadows are new where all else is known.
            for _ in 0..if known { LIGHT_AHEAD } else { 1 } {
                self.direct.pass(&self.world, &self.lights, &self.seen, self.seed);
            }
        }
        self.clock.lap("seconds_light");
        if self.options.gather
            && let Some(rays) = self.gather(number, known)
        {
            self.first_rays = rays;
            run.owner.decide(FIRST_RAYS, &rays);
        }
        self.clock.lap("seconds_gather");
        if self.gloss.len() > 0 {
            self.look_at_lobes(number.max(self.before));
        }
        self.clock.lap("seconds_gloss");
        let tally = &mut run.standing.tally;
        tally.iterations += 1;
        tally.shots = self.coarse.links() as u64 + self.cache.rays() + self.direct.rays;
        tally.light_shots = self.direct.rays;
        self.done = tally.iterations;
    }

    /// As many links again as there are: iterations do so whenever they have doubled, since solving
    /// takes its time for all links.
    fn link(&mut self, number: u64) {
        let rounds = (number as u32).div_ceil(2).clamp(1, MOST_ROUNDS);
        // The first points there are already.
        let points = if number == 0 { 0 } else { PATCH_POINTS * rounds };
        self.coarse.link(self.seed, points, self.options.coarse_rays * rounds);
    }

    /// More rays for the records, and more records in some iterations. How many rays every record
    /// is worth in an iteration, where that was found out now.
    fn gather(&mut self, number: u64, known: bool) -> Option<u32> {
        let (options, first) = (self.options, number == 0);
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
            self.cache.refine(&self.world, &self.coarse, gathering, enough, number as usize);
        }
        if !(first || (REFILLS.contains(&number) && !known)) {
            return None;
        }
        self.cache.smooth(&self.seen, options.gather_fit);
        let (lights, seen) = (&*self.lights, &self.seen);
        let direct = |index| self.direct.irradiance(lights, seen, index, true).0;
        let follows = first && !known && options.adaptive;
        let look = follows.then_some(FirstLook { hasty: self.hasty, direct: &direct });
        let rays = self.cache.fill(&self.world, &self.coarse, seen, gathering, look);
        follows.then_some(rays)
    }

    /// Another pass of lobe rays, unless they are good enough; in the first iteration a second one,
    /// too, which knows where they are needed.
    fn look_at_lobes(&mut self, iterations: u64) {
        let first = self.gloss.passes == 0;
        if first {
            self.gloss.pass(&self.coarse, &self.seen, self.seed, self.options.adaptive);
            self.gloss.brightness = self.brightness();
        }
        if !(first && self.hasty) && self.gloss.matters(&self.seen, iterations) {
            self.gloss.pass(&self.coarse, &self.seen, self.seed, self.options.adaptive);
        }
    }

    /// Mean radiance of the picture, by the direct light and the coarse solution.
    fn brightness(&self) -> f32 {
        let (seen, coarse, direct, lights) =
            (&self.seen, &self.coarse, &self.direct, &*self.lights);
        let of_fragment = |(index, fragment): (usize, &Fragment)| {
            let place = seen.place_on_facet(fragment);
            let (direct, _) = direct.irradiance(lights, seen, index, false);
            let irradiance = direct + coarse.bounced(place);
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

    /// The present picture, drawn unless it is there already.
    fn draw(&mut self) -> &mut Drawn {
        let iterations = self.done;
        if self.drawn.iterations == Some(iterations) {
            return &mut self.drawn;
        }
        self.clock.start();
        let began = Instant::now();
        let bounced = if self.options.gather {
            self.cache.smooth(&self.seen, self.options.gather_fit);
            self.cache.irradiance(&self.seen)
        } else {
            vec![None; self.seen.fragments.len()]
        };
        self.clock.lap("seconds_smooth");
        let (picture, errors) = estimate::measure(&PictureParts {
            seen: &self.seen,
            lights: &self.lights,
            coarse: &self.coarse,
            bounced: &bounced,
            direct: &self.direct,
            gloss: &self.gloss,
            options: &self.options,
        });
        self.clock.lap("seconds_picture");
        self.picture_seconds = Some(began.elapsed().as_secs_f64());
        self.drawn = Drawn { iterations: Some(iterations), picture, errors };
        &mut self.drawn
    }
}

impl Solver for Tiers {
    fn advance(&mut self, run: &mut Run<'_>) -> Result<Option<StopReason>, RenderError> {
        let began = Instant::now();
        self.iterate(run);
        let iteration = began.elapsed().as_secs_f64();
        // The last picture, and most of another iteration that would come too late.
        let picture = self.picture_seconds.unwrap_or(PICTURE_SHARE * iteration);
        run.standing.picture_seconds = picture + LATE * iteration;
        Ok(None)
    }

    fn is_visible(&self) -> bool {
        true
    }

    fn checks_target(&mut self, iterations: u64) -> bool {
        let is_due = iterations >= self.next_check;
        if is_due {
            self.next_check = iterations + iterations.div_ceil(4);
        }
        is_due
    }

    fn estimate(&mut self) -> Estimate {
        let errors = self.draw().errors;
        errors.map_or(Estimate::Never, |errors| Estimate::Error(errors.all))
    }

    fn picture(&mut self) -> Picture {
        self.draw().picture.clone()
    }

    /// The coarse solution and the records are for any camera; direct light and lobes are of the
    /// fragments that one camera sees.
    fn save(&mut self, parts: &mut checkpoints::Parts) -> Result<(), DeviceError> {
        let to = &mut parts.shared;
        to.value([self.done.max(self.before), self.before]);
        self.coarse.save(to);
        self.cache.save(to);
        // Where sums of hemicube shots were, while tier 1 could be solved by those.
        to.value(0u64);
        to.slice::<Rgb>(&[]);
        self.direct.save(&mut parts.bound);
        self.gloss.save(&mut parts.bound);
        Ok(())
    }

    fn irradiance(&self) -> Option<(Arc<PatchedScene>, Vec<Rgb>)> {
        Some((self.coarse.mesh.scene.clone(), self.coarse.irradiances().to_vec()))
    }

    fn diagnostics(&self, _run: &Run<'_>) -> BTreeMap<String, f64> {
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
        figures.insert("links".into(), self.coarse.links() as f64);
        figures.insert("fragments".into(), self.seen.fragments.len() as f64);
        figures.insert("lights".into(), self.lights.count() as f64);
        figures
    }
}
